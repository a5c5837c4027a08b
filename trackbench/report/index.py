"""index.html: a card for each of several experiments, and every verdict."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trackbench.report.comparison import LEGEND, summary_lines
from trackbench.report.counts import Bar, bars
from trackbench.report.drawings import key_picture
from trackbench.report.page import verdict_tables
from trackbench.report.results import Results
from trackbench.report.templating import write_page
from trackbench.report.thumbnail import thumbnail
from trackbench.report.verdicts import Comparison


@dataclass(frozen=True)
class Card:
    """An experiment in the index; ``link`` is empty if it has no report."""

    name: str
    title: str
    filters: int
    runs: int
    counted: list[Bar]
    thumbnail: Any
    link: str


def write_index(folder: Path, found: list[tuple[Results, Comparison]]) -> Path:
    """Write index.html over the results folders in ``folder``."""
    everything = together([comparison for _, comparison in found])
    return write_page(
        folder / "index.html",
        "index.html",
        live=False,
        title="Experiments and what they say of the papers",
        experiments=[_card(folder, *item) for item in found],
        counted=bars(everything),
        verdict_lines=summary_lines(everything),
        ledger=verdict_tables(everything),
        legend=LEGEND.replace("`", ""),
    )


def _card(folder: Path, results: Results, comparison: Comparison) -> Card:
    from markupsafe import Markup

    config, report = results.config, results.folder / "report.html"
    picture = key_picture(results)
    return Card(
        name=config["name"],
        title=results.filled(config["title"]),
        filters=len(results.filters),
        runs=config["runs"],
        counted=bars(comparison),
        thumbnail=Markup(thumbnail(picture)) if picture else "",
        link=report.relative_to(folder).as_posix() if report.is_file() else "",
    )


def together(comparisons: list[Comparison]) -> Comparison:
    """All of several experiments."""
    return Comparison(
        [row for c in comparisons for row in c.rows],
        [row for c in comparisons for row in c.claims],
        [row for c in comparisons for row in c.ranks],
    )
