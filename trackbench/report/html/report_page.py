"""report.html: a results folder on one self-contained page."""

import shlex
from pathlib import Path
from typing import Any

from trackbench.config.dump import as_yaml
from trackbench.config.grid import single_paths
from trackbench.report.findings import phrases
from trackbench.report.findings.sentences import HOW_DECIDED, answer
from trackbench.report.html.render import drawings, write_page
from trackbench.report.results import Results
from trackbench.report.table import rounded
from trackbench.report.text import Text, TextTable
from trackbench.report.verdicts.cpu_times import time_tables, time_verdicts
from trackbench.report.verdicts.files import bars, summary_lines, verdict_tables
from trackbench.report.verdicts.numbers import Comparison, compare


def write_report(
    results: Results, comparison: Comparison | None = None, path: Path | None = None
) -> Path:
    """Write report.html into the results folder, or another file."""
    comparison = comparison or compare(results)
    tables = [table.texts() for table in results.tables.values()]
    pairs = _pairs(results)
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
        answer=answer(results),
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
        sections=[(id_, name) for id_, name, there in sections if there],
    )


def _rerun(results: Results) -> str:
    """Return the config's path for a shell; of an absolute path the last part."""
    path = results.folder / "config.yaml"
    shown = path.as_posix() if not path.is_absolute() else "/".join(path.parts[-2:])
    return shlex.quote(shown) + (" --allow-plugins" if results.config.get("plugins") else "")


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
    together = [single_paths(path) for path in results.grid]
    grid = ", ".join(p[0] + (f" and {len(p) - 1} more" if p[1:] else "") for p in together)
    return [*facts, ("Grid", grid)] if grid else facts


def _pairs(results: Results) -> TextTable:
    """Return all pairs."""
    heads = [*results.grid_heads, "a", "b", "Metric", "Mean of a - b", "z", "p (Holm)"]
    table = TextTable("Differences per run, corrected over all pairs of a metric (Holm)", heads)
    for point, pairs in results.pairs:
        for pair in pairs:
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
    return table


def _point_cell(value: Any) -> Text:
    return Text(phrases.number(value), value if isinstance(value, int | float) else None)


def _versions(results: Results) -> TextTable:
    manifest = results.manifest
    rows = {"trackbench": manifest.get("trackbench"), "git commit": manifest.get("commit")}
    rows |= {"python": manifest.get("python"), "platform": manifest.get("platform")}
    rows |= manifest.get("packages", {})
    table = TextTable("Versions of the run", ["Part", "Version"])
    table.rows = [[Text(k), Text(str(v))] for k, v in rows.items() if v is not None]
    return table
