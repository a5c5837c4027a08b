"""report.html: a results folder on one self-contained page."""

import inspect
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from trackbench.config.grid import single_paths
from trackbench.report.findings.best_filter_sentences import how_decided, unranked_count
from trackbench.report.html.page_templates import write_page
from trackbench.report.html.stored_pictures import pictures
from trackbench.report.html.svg import inline
from trackbench.report.kinds import FigureKind
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.render import best_filter, conclusions, ranking
from trackbench.report.tables.differences import table_of_pairs
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts, compare
from trackbench.report.verdicts.cpu_time_verdicts import time_verdicts
from trackbench.report.verdicts.verdict_counts import bars, needed_runs, summary_lines
from trackbench.report.verdicts.verdict_tables import time_tables, verdict_tables


def path_beside_read_only(folder: Path) -> Path:
    """Return the path of a report on a results folder that may not be written in.

    It is NAME-report.html, in the working directory.
    """
    return Path(f"{folder.resolve().name}-report.html")


def write_report(
    results: Results, comparison: Verdicts | None = None, path: Path | None = None
) -> Path:
    """Write report.html.

    Parameters
    ----------
    results
        results folder
    comparison
        verdicts on what is published; default: they are computed
    path
        file; default: report.html in the results folder

    Returns
    -------
    Path
        path of the file.
    """
    comparison = comparison or compare(results)
    # The ranking comes first on the page. With ``numbers`` there are further tables with the numbers of
    # each scenario or setting, which stand among the other tables.
    ranked = ranking(results, numbers=True)
    tables = list(ranked[1:])
    for name, table in results.tables.items():
        texts = table.texts()
        # A table that can be folded needs a title.
        tables.append(replace(texts, title=texts.title or name))
    pairs = results.attempt("pairs", lambda: table_of_pairs(results), TextTable("", []))
    verdicts = verdict_tables(comparison)
    figures = drawings(results)
    times = time_tables(time_verdicts(results))
    # Parts of the page that have a link at its top: id, name, and the content, without which the part is
    # left out.
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
        template="report.html",
        live=bool(figures),  # whether the page needs the script of interactive figures
        name=results.config["name"],
        title=results.title,
        ranking=next(iter(ranked), None),
        data_notes=results.data_notes,
        best=best_filter(results),
        answer=conclusions(results),
        how_decided=how_decided(results),
        counted=bars(comparison),
        needed=needed_runs(comparison),
        key=next(iter(figures), None),  # the key figure
        figures=figures[1:],
        facts=_facts(results),
        failed={row["filter"]: row["reason"] for row in results.failed} | results.unmade,
        verdict_lines=summary_lines(comparison),
        verdict_tables=verdicts,
        times=times,
        tables=tables,
        has_one_run=results.config["runs"] == 1,
        pairs=pairs if pairs.rows else None,
        rerun=_rerun(results),
        config=results.config_text,
        versions=_versions(results),
        sections=[(id_, name) for id_, name, has_content in sections if has_content],
    )


def _rerun(results: Results) -> str:
    """Write the arguments of `trackbench run`, for a shell, that run the config again.

    Of an absolute path only the folder's name and the file's are written.
    """
    path = results.folder / "config.yaml"
    shown = "/".join(path.parts[-2:]) if path.is_absolute() else path.as_posix()
    arguments = shlex.quote(shown)
    # The code of plugins and of programs must be allowed, also of those that were not run.
    has_program = any(entry["kind"] == "external" for entry in results.config["filters"].values())
    if results.config.get("plugins") or has_program:
        arguments += " --allow-plugins"
    return arguments


def _facts(results: Results) -> list[tuple[str, object]]:
    """Return heading and value of each line that the page lists about the experiment and its run."""
    config = results.config
    facts: list[tuple[str, object]] = []
    if results.citation:
        facts.append(("Cite as", results.citation))
    scenario = config["scenario"]["kind"]
    if scenario != "tracking":  # the kind of a plugin; `tracking` is the package's only one
        facts.append(("Scenario", scenario))
    cpu_s = results.manifest.get("cpu_s", float("nan"))
    facts += [
        ("Filters", _filter_count(results)),
        ("Runs", config["runs"]),
        ("Seed", config["seed"]),
        ("CPU time", f"{cpu_s:.3g} s"),
    ]
    programs = results.programs
    if programs:
        programs_text = f"{', '.join(programs)}: the same numbers on the same machine only"
        facts.append(("External programs", programs_text))
    # Of paths that vary together the first one is named.
    path_texts = []
    for path in results.grid:
        paths_together = single_paths(path)
        path_text = paths_together[0]
        if len(paths_together) > 1:
            path_text += f" and {len(paths_together) - 1} more"
        path_texts.append(path_text)
    if path_texts:
        facts.append(("Grid", ", ".join(path_texts)))
    if results.idle_figures:
        names = ", ".join(results.idle_figures)
        facts.append(("Figures not drawn", f"{names}: none of their filters ran"))
    return facts


def _filter_count(results: Results) -> str:
    """Write the number of filters, and how many of them are ranked: ``14, 13 ranked``."""
    number = len(results.filters)
    unranked = unranked_count(results)
    if not unranked:
        return str(number)
    return f"{number}, {number - unranked} ranked"


def _versions(results: Results) -> TextTable:
    """Tabulate the versions of the package, Python and the libraries that made the run."""
    manifest = results.manifest
    versions = {
        "trackbench": manifest.get("trackbench"),
        "git commit": manifest.get("commit"),
        "python": manifest.get("python"),
        "platform": manifest.get("platform"),
        **manifest.get("packages", {}),
    }
    table = TextTable("Versions of the run", ["Part", "Version"])
    for name, version in versions.items():
        if version is not None:
            table.rows.append([Text(name), Text(str(version))])
    return table


def drawings(results: Results) -> list[dict[str, Any]]:
    """Prepare all figures for the page, the key figure first.

    Each figure has a name, an SVG, a heading and a caption. The heading is the name, or empty if the
    picture has a title. Figures of plugins that are not allowed are shown as they are stored.
    """
    from markupsafe import Markup

    drawn = []
    for name, spec, content in pictures(results):
        config = results.figure_configs.get(name, {})
        title = results.fill_title(config.get("title") or "")
        caption = results.fill_title(config.get("caption") or "")
        # The kind's own description, for screen readers and where there is no caption.
        description = ""
        if spec is not None:
            description = (inspect.getdoc(type(spec)) or "").partition("\n")[0]
        label = ". ".join(filter(None, [title or name, description]))
        drawn.append(
            {
                "name": name,
                "svg": Markup(inline(content, name, label)),
                "heading": "" if title else f"{name}.",
                "caption": caption or _default_caption(results, name, spec) or description,
            }
        )
    return drawn


def _default_caption(results: Results, name: str, spec: FigureKind | None) -> str:
    """Return a figure's own caption; empty if its plugin is not loaded, or fails."""
    if spec is None:
        return ""

    def make_caption() -> str:
        # As it is drawn: a figure of several filters also shows the best ones.
        return spec.with_best(results).default_caption(results)

    return results.attempt(f"caption of figure {name}", make_caption, default="", exhibit=spec)
