"""report.html: a results folder on one self-contained page."""

import base64
import hashlib
import inspect
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.atomic_files import write_text
from trackbench.config.dump import as_yaml
from trackbench.config.grid import single_paths
from trackbench.report.findings import phrases
from trackbench.report.findings.sentences import HOW_DECIDED
from trackbench.report.html.svg import inline
from trackbench.report.kinds import FigureKind, figure_folder
from trackbench.report.render import conclusions, draw_figure, ranking
from trackbench.report.results import Results
from trackbench.report.table import Text, TextTable, rounded
from trackbench.report.verdicts.cpu_times import time_tables, time_verdicts
from trackbench.report.verdicts.files import bars, summary_lines, verdict_tables
from trackbench.report.verdicts.numbers import Verdicts, compare
from trackbench.statistics import rules

if TYPE_CHECKING:
    from jinja2 import Environment


def write_report(
    results: Results, comparison: Verdicts | None = None, path: Path | None = None
) -> Path:
    """Write report.html into the results folder, or another file."""
    comparison = comparison or compare(results)
    ranked = ranking(results, numbers=True)
    tables = [*ranked[1:], *(table.texts() for table in results.tables.values())]
    pairs = results.attempt("pairs", lambda: _pairs(results), TextTable("", []))
    verdicts = verdict_tables(comparison)
    figures, times = drawings(results), time_tables(time_verdicts(results))
    sections = (
        ("figures", "Figures", figures[1:]),
        ("verdicts", "Verdicts", verdicts),
        ("times", "CPU times", times),
        ("tables", "Tables", tables),
        ("pairs", "Pairs", pairs.rows),
        ("again", "Run it again", True),
    )
    return write_page(
        path or results.folder / "report.html",
        "report.html",
        live=bool(figures),
        name=results.config["name"],
        title=results.title,
        ranking=ranked[0] if ranked else None,
        answer=conclusions(results),
        how_decided=HOW_DECIDED,
        counted=bars(comparison),
        key=figures[0] if figures else None,
        figures=figures[1:],
        facts=_facts(results),
        failed={row["filter"]: row["reason"] for row in results.failed} | results.unmade,
        verdict_lines=summary_lines(comparison),
        verdict_tables=verdicts,
        times=times,
        tables=tables,
        pairs=pairs if pairs.rows else None,
        rerun=_rerun(results),
        config=as_yaml(results.config),
        versions=_versions(results),
        sections=[(id_, name) for id_, name, has_content in sections if has_content],
    )


def _rerun(results: Results) -> str:
    """Write the config's path for a shell; of an absolute path the last part."""
    path = results.folder / "config.yaml"
    shown = path.as_posix() if not path.is_absolute() else "/".join(path.parts[-2:])
    is_foreign = results.config.get("plugins") or _programs(results)
    return shlex.quote(shown) + (" --allow-plugins" if is_foreign else "")


def _programs(results: Results) -> list[str]:
    """Find the filters that are programs in other languages."""
    return [label for label, f in results.config["filters"].items() if f["kind"] == "external"]


def _facts(results: Results) -> list[tuple[str, object]]:
    config, manifest = results.config, results.manifest
    scenario = config["scenario"]["kind"]
    facts = [
        *([("Cite as", results.citation)] if results.citation else []),
        *([("Scenario", scenario)] if scenario != "tracking" else []),
        ("Filters", len(results.filters)),
        ("Runs", config["runs"]),
        ("Seed", config["seed"]),
        ("CPU time", f"{manifest.get('cpu_s', float('nan')):.3g} s"),
    ]
    if programs := _programs(results):
        what = f"{', '.join(programs)}: the same numbers on the same machine only"
        facts.append(("External programs", what))
    together = [single_paths(path) for path in results.grid]
    grid = ", ".join(p[0] + (f" and {len(p) - 1} more" if p[1:] else "") for p in together)
    return [*facts, ("Grid", grid)] if grid else facts


_ALONE = (
    "An interval is of its pair alone, and left out where it would show a difference that is not "
    "significant."
)


def _pairs(results: Results) -> TextTable:
    heads = [*results.grid_heads, "a", "b", "Metric", "a - b", "95 % interval", "a is"]
    rule = f"Significant: {rules.HOW_FILTERS_DIFFER}. {_ALONE}"
    table = TextTable("Differences on common runs", heads, notes=[rule])
    for point, pairs in results.pairs:
        for pair in pairs:
            of = pair.comparison.difference
            difference, *ends = (rounded(x, of.stderr, 4) for x in (of.value, *of.interval()))
            row = []
            for value in point.values():
                number = value if isinstance(value, int | float) else None
                row.append(Text(phrases.number(value), number))
            row += [*map(Text, (pair.filter_a, pair.filter_b, pair.metric))]
            between = " to ".join(end.partition(" ")[0] for end in ends)
            if pair.comparison.interval_contradicts:
                between = "–"
            table.rows.append([*row, Text(difference, of.value), Text(between), Text(pair.word)])
    return table


def _versions(results: Results) -> TextTable:
    manifest = results.manifest
    rows = {"trackbench": manifest.get("trackbench"), "git commit": manifest.get("commit")}
    rows |= {"python": manifest.get("python"), "platform": manifest.get("platform")}
    rows |= manifest.get("packages", {})
    table = TextTable("Versions of the run", ["Part", "Version"])
    table.rows = [[Text(k), Text(str(v))] for k, v in rows.items() if v is not None]
    return table


def drawings(results: Results) -> list[dict[str, Any]]:
    """Prepare all figures for the page, the key figure first; disallowed plugins' as stored.

    Each has name, svg, heading (its name, where the picture has no title), caption (what to see in it).
    """
    from markupsafe import Markup

    drawn = []
    for name, spec, content in _pictures(results):
        config = results.figure_configs.get(name, {})
        title, said = (results.fill_title(config.get(key) or "") for key in ("title", "caption"))
        what = (inspect.getdoc(type(spec)) or "").partition("\n")[0] if spec is not None else ""
        caption = said or _caption(results, name, spec) or what
        svg = Markup(inline(content, name, ". ".join(filter(None, [title or name, what]))))
        words = {"heading": "" if title else f"{name}.", "caption": caption}
        drawn.append({"name": name, "svg": svg, **words})
    return drawn


def _caption(results: Results, name: str, spec: FigureKind | None) -> str:
    if spec is None:
        return ""
    what = f"caption of figure {name}"
    return results.attempt(what, lambda: spec.with_best(results).default_caption(results), "", spec)


def key_picture(results: Results) -> bytes | None:
    """Return the SVG that the report begins with; None if there is none."""
    return next((content for _, _, content in _pictures(results)), None)


def _pictures(results: Results) -> Iterator[tuple[str, FigureKind | None, bytes]]:
    """Name, kind and SVG of each figure that is in the folder, or can be drawn."""
    specs, configs = results.parts("figures"), results.figure_configs
    names = [*(name for name in specs if name not in configs), *configs]
    for name in sorted(names, key=lambda name: name != results.key_figure):
        spec = specs.get(name)
        place = Path("figures" if spec is None else figure_folder(spec)) / f"{name}.svg"
        path, parts = results.folder / place, (place, *place.parents[:-1])
        is_own = path.is_file() and not any((results.folder / p).is_symlink() for p in parts)
        contents = [path.read_bytes()] if is_own else []
        failed = f"figure {name}" in results.unmade
        if not contents and spec is not None and name in configs and not failed:
            with results.without(f"figure {name}"):
                contents = [content for _, content in draw_figure(spec, results, ["svg"])]
        if contents:
            yield name, spec, contents[0]


_TEMPLATES = Path(__file__).parent / "templates"
VERDICTS = dict.fromkeys(("equal", "agrees", "holds"), "good")
VERDICTS |= {"compatible": "fair", "differs": "bad", "fails": "bad", "inconclusive": "open"}
"""Verdicts and how they look."""


def write_page(path: Path, template: str, live: bool = True, **context: Any) -> Path:
    """Write a page; ``live`` ones have the script of figures."""
    from markupsafe import Markup

    script = "".join(map(_template_text, ("page.js", "curves.js") if live else ("page.js",)))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page: dict[str, Any] = {"script": Markup(script), "style": Markup(_template_text("page.css"))}
    page |= {"script_digest": f"sha256-{digest}", "verdicts": VERDICTS}
    write_text(path, _environment().get_template(template).render(**page, **context))
    return path


@cache
def _template_text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


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
