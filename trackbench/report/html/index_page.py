"""Several results folders together: results/index.html, and results/README.md as the ledger."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from trackbench.atomic_files import write_text
from trackbench.errors import Problem, UserError
from trackbench.report.html.page_figures import key_picture
from trackbench.report.html.render import write_page
from trackbench.report.html.thumbnail import thumbnail
from trackbench.report.open import open_with_notes, using
from trackbench.report.results import Results
from trackbench.report.text import TextTable
from trackbench.report.verdicts.cpu_times import time_tables, time_verdicts
from trackbench.report.verdicts.files import LEGEND, Bar, bars, summary_lines, verdict_tables
from trackbench.report.verdicts.numbers import Comparison, compare

Overview: TypeAlias = list[tuple[Results, Comparison]]

_HEAD = """# Published and measured

Every number, word and claim of the papers that an experiment here measures, with its verdict. Of a
number only `agrees` says that it reproduces; `compatible` is an error too wide to show it. Written by
`trackbench report results`; `make check-results` fails if a verdict does not come out again.
"""


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


def write_overview(folder: Path) -> list[Path]:
    """Write index.html and README.md over the results folders in ``folder``."""
    found = _opened(folder)
    everything = _together([comparison for _, comparison in found])
    index = _write_index(folder, found, everything)
    ledger = folder / "README.md"
    write_text(ledger, _ledger(folder, found, everything))
    return [index, ledger]


def _write_index(folder: Path, found: Overview, everything: Comparison) -> Path:
    return write_page(
        folder / "index.html",
        "index.html",
        live=False,
        title="Experiments and what they say of the papers",
        experiments=[_card(folder, *item) for item in found],
        counted=bars(everything),
        verdict_lines=summary_lines(everything),
        ledger=[*verdict_tables(everything), *_times(found)],
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


def _together(comparisons: list[Comparison]) -> Comparison:
    """Return the summary over several experiments."""
    return Comparison(
        [row for c in comparisons for row in c.rows],
        [row for c in comparisons for row in c.claims],
        [row for c in comparisons for row in c.ranks],
    )


def _opened(folder: Path) -> Overview:
    if not os.path.isdir(folder):
        raise UserError(f"{folder}: there is no such folder")
    candidates = sorted(p.parent for p in folder.glob("*/config.yaml"))
    if not candidates:
        raise UserError(f"{folder}: has neither a config.yaml nor results folders in it")
    opened: Overview = []
    problems: list[Problem | str] = []
    for candidate in candidates:
        try:
            with using(candidate):
                results = open_with_notes(candidate)
                opened.append((results, compare(results)))
        except UserError as error:
            problems += error.problems
    if problems:
        raise UserError(*problems)
    return opened


def _ledger(folder: Path, found: Overview, everything: Comparison) -> str:
    lines = [f"- {line}" for line in summary_lines(everything)]
    parts = [_HEAD.rstrip(), "\n".join(lines) or "Nothing is published about these experiments."]
    for results, comparison in found:
        name = results.folder.relative_to(folder).as_posix()
        parts.append(f"## [{results.config['name']}]({name}/): {results.title}")
        parts += [f"- {line}" for line in summary_lines(comparison)]
        parts += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    parts += [LEGEND, *(table.markdown().rstrip() for table in _times(found))]
    return "\n\n".join(parts) + "\n"


def _times(found: Overview) -> list[TextTable]:
    """Return the verdicts on CPU times of all experiments, counted separately."""
    return time_tables(verdict for results, _ in found for verdict in time_verdicts(results))
