"""report.html: a results folder on one self-contained page; index.html over several of them."""

import base64
import hashlib
import inspect
import shlex
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from trackbench.experiment.files import write_text
from trackbench.experiment.reading.points import single_paths
from trackbench.experiment.reading.resolved import as_yaml
from trackbench.report import style
from trackbench.report.answer import LEGEND as HOW_DECIDED
from trackbench.report.answer import answer
from trackbench.report.comparison import (
    LEGEND,
    claim_table,
    number_tables,
    rank_table,
    summary_lines,
    verdict_counts,
)
from trackbench.report.render import drawn
from trackbench.report.results import Results
from trackbench.report.svg import inline
from trackbench.report.table import rounded
from trackbench.report.text import Text, TextTable
from trackbench.report.verdicts import Comparison, compare

if TYPE_CHECKING:
    from jinja2 import Environment

_TEMPLATES = Path(__file__).parent / "templates"
_MOST_ROWS = 50
"""Longer tables are folded."""
_VERDICTS = {
    "agrees": "good",
    "holds": "good",
    "compatible": "fair",
    "near": "fair",
    "differs": "bad",
    "fails": "bad",
    "chosen": "open",
    "not decided": "open",
    "not measured": "open",
}


class Drawing(NamedTuple):
    """A figure as it stands on the page."""

    name: str
    svg: Any
    caption: str


@dataclass(frozen=True)
class Entry:
    """An experiment's line in the index; ``link`` is empty if it has no report."""

    name: str
    title: str
    filters: int
    runs: int
    numbers: str
    claims: str
    link: str


def write_report(
    results: Results, comparison: Comparison | None = None, path: Path | None = None
) -> Path:
    """Write report.html into the results folder, or another file."""
    comparison = comparison or compare(results)
    tables = [table.texts() for table in results.tables.values()]
    pairs, undecided = _pairs(results)
    context = {
        "title": results.title,
        "facts": _facts(results),
        "answer": answer(results),
        "how_decided": HOW_DECIDED,
        "failed": {row["filter"]: row["reason"] for row in results.failed},
        "verdict_lines": summary_lines(comparison),
        "verdict_tables": verdict_tables(comparison),
        "legend": LEGEND.replace("`", ""),
        "tables": tables,
        "most_rows": _MOST_ROWS,
        "figures": _figures(results),
        "pairs": pairs if pairs.rows else None,
        "undecided": undecided,
        "rerun": _shown_path(results.folder / "config.yaml")
        + (" --allow-plugins" if results.config.get("plugins") else ""),
        "config": as_yaml(results.config),
        "versions": _versions(results),
    }
    context["sections"] = [
        (id_, name)
        for id_, name, there in (
            ("verdicts", "Verdicts", context["verdict_lines"]),
            ("tables", "Tables", tables),
            ("figures", "Figures", context["figures"]),
            ("pairs", "Pairs", pairs.rows),
            ("again", "Run it again", True),
        )
        if there
    ]
    return _write(path or results.folder / "report.html", "report.html", context)


def write_index(folder: Path, found: list[tuple[Results, Comparison]]) -> Path:
    """Write index.html over the results folders in ``folder``."""
    everything = together([comparison for _, comparison in found])
    context = {
        "title": "Experiments and what they say of the papers",
        "experiments": [_entry(folder, *item) for item in found],
        "verdict_lines": summary_lines(everything),
        "ledger": verdict_tables(everything),
        "legend": LEGEND.replace("`", ""),
    }
    return _write(folder / "index.html", "index.html", context)


def _shown_path(path: Path) -> str:
    """The path as the user gave it, for a shell; of an absolute one the end, which is so for others."""
    return shlex.quote(path.as_posix() if not path.is_absolute() else "/".join(path.parts[-2:]))


def _write(path: Path, template: str, context: dict[str, Any]) -> Path:
    from markupsafe import Markup

    script = (_TEMPLATES / "page.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page = {
        "style": Markup((_TEMPLATES / "page.css").read_text(encoding="utf-8")),
        "script": Markup(script),
        "script_digest": f"sha256-{digest}",
        "verdicts": _VERDICTS,
    }
    write_text(path, _environment().get_template(template).render(**page, **context))
    return path


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _facts(results: Results) -> list[tuple[str, object]]:
    config, manifest = results.config, results.manifest
    scenario = config["scenario"]["kind"]
    facts = [
        ("Experiment", config["name"]),
        ("Scenario", scenario),
        ("Filters", len(results.filters)),
        ("Runs", config["runs"]),
        ("Seed", config["seed"]),
        ("CPU time", f"{manifest.get('cpu_s', float('nan')):.3g} s"),
    ]
    together = [single_paths(path) for path in results.grid]
    grid = ", ".join(p[0] + (f" and {len(p) - 1} more" if p[1:] else "") for p in together)
    return [*facts, ("Grid", grid)] if grid else facts


def _figures(results: Results) -> list[Drawing]:
    from markupsafe import Markup

    drawings, specs, asked = [], results.parts("figures"), results.config.get("figures") or {}
    for name in asked or specs:
        spec, path = specs.get(name), results.folder / "figures" / f"{name}.svg"
        contents = [path.read_bytes()] if path.is_file() else []
        if spec is not None and name in asked:
            contents = contents or [content for _, content in drawn(spec, results, ["svg"])]
        if not contents:
            continue
        caption = results.filled(asked.get(name, {}).get("title") or name)
        title = f"{caption}. {inspect.getdoc(type(spec)) if spec else ''}".partition("\n")[0]
        drawings.append(Drawing(name, Markup(inline(contents[0], name, title)), caption))
    return drawings


def verdict_tables(comparison: Comparison) -> list[TextTable]:
    """Numbers per published table, agreement of orders, claims."""
    tables = number_tables(comparison)
    tables += [rank_table(comparison.ranks)] if comparison.ranks else []
    return [*tables, claim_table(comparison.claims)] if comparison.claims else tables


def _pairs(results: Results) -> tuple[TextTable, int]:
    """All pairs, and how many of them do not differ significantly."""
    heads = [*results.grid_heads, "a", "b", "Metric", "Mean of a - b", "z", "p (Holm)"]
    table = TextTable("Differences per run, corrected over all pairs of a metric (Holm)", heads)
    undecided = 0
    for point, pairs in results.pairs:
        for pair in pairs:
            undecided += not pair.p_holm < 0.05
            difference = rounded(pair.difference, pair.stderr, 4)
            table.rows.append(
                [
                    *(_point_cell(v) for v in point.values()),
                    *(Text(x) for x in (pair.filter_a, pair.filter_b, pair.metric)),
                    Text(difference, pair.difference),
                    Text(f"{pair.z:+.1f}", pair.z),
                    Text(f"{pair.p_holm:.2g}", pair.p_holm),
                ]
            )
    return table, undecided


def _point_cell(value: Any) -> Text:
    return Text(style.number(value), value if isinstance(value, int | float) else None)


def _versions(results: Results) -> TextTable:
    manifest = results.manifest
    rows = {"trackbench": manifest.get("trackbench"), "git commit": manifest.get("commit")}
    rows |= {"python": manifest.get("python"), "platform": manifest.get("platform")}
    rows |= manifest.get("packages", {})
    table = TextTable("Versions of the run", ["Part", "Version"])
    table.rows = [[Text(k), Text(str(v))] for k, v in rows.items() if v is not None]
    return table


def _entry(folder: Path, results: Results, comparison: Comparison) -> Entry:
    config = results.config
    report = results.folder / "report.html"
    return Entry(
        name=config["name"],
        title=results.filled(config["title"]),
        filters=len(results.filters),
        runs=config["runs"],
        numbers=verdict_counts(number.best for number in comparison.numbers),
        claims=verdict_counts(comparison.claims),
        link=report.relative_to(folder).as_posix() if report.is_file() else "",
    )


def together(comparisons: list[Comparison]) -> Comparison:
    """All of several experiments."""
    return Comparison(
        [row for c in comparisons for row in c.rows],
        [row for c in comparisons for row in c.claims],
        [row for c in comparisons for row in c.ranks],
    )
