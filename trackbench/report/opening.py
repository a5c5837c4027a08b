"""Whether a folder holds whole results that this version can read."""

from pathlib import Path

from trackbench.experiment.definition import Settings
from trackbench.experiment.manifest import FORMAT
from trackbench.experiment.problems import Problem, UserError
from trackbench.experiment.store import digests
from trackbench.experiment.validate import build
from trackbench.report.results import Results

_KINDS: dict[str, type] = {"failed": list, "packages": dict, "cpu_s": float}
"""Of what kind the manifest's entries are that a report shows."""


def open_results(folder: Path) -> Results:
    """The results in a folder; raises UserError if it is not whole, too new, or edited by hand."""
    if not folder.is_dir():
        raise UserError(f"{folder}: there is no such folder")
    if not (folder / "config.yaml").is_file():
        raise UserError(f"{folder}: is not a results folder, it has no config.yaml")
    results = Results(folder)
    _check_manifest(results)
    problems: list[Problem] = []
    if not isinstance(results.source.data, dict):
        problems.append(Problem(results.source.mark(()), "", "is not an experiment's config"))
    elif build(Settings, results.source, (), problems) is not None:
        missing = set(results.summary["filter"]) - set(results.labels)
        if _grid_columns(results) != results.grid:
            what = "the results were computed over another grid"
            problems.append(Problem(results.source.mark(("grid",)), "grid", what))
        elif missing:
            what = f"{min(missing)!r} has results but is not a filter here any more"
            problems.append(Problem(results.source.mark(("filters",)), "filters", what))
    if problems:
        raise UserError(*problems)
    return results


def _grid_columns(results: Results) -> list[str]:
    columns = list(results.summary.columns)
    return columns[: columns.index("filter")]


def _check_manifest(results: Results) -> None:
    folder = results.folder
    again = "run the experiment again"
    if not (folder / "manifest.json").is_file():
        raise UserError(f"{folder}: is half-written, it has no manifest.json: {again}")
    try:
        manifest = results.manifest
        version, recorded = int(manifest["format"]), dict(manifest["files"])
        whole = all(isinstance(manifest.get(key, kind()), kind) for key, kind in _KINDS.items())
        whole &= all({"filter", "reason"} <= set(row) for row in results.failed)
    except (ValueError, KeyError, TypeError, AssertionError):
        whole = False
    if not whole:
        raise UserError(f"{folder}: manifest.json cannot be read: {again}")
    if version > FORMAT:
        what = f"was written by trackbench {manifest.get('trackbench')} in format {version}"
        raise UserError(f"{folder}: {what}, this version reads up to {FORMAT}: update trackbench")
    found = digests(folder)
    problems = []
    for name, digest in recorded.items():
        if name not in found:
            problems.append(f"{folder / name}: is missing: {again}")
        elif found[name] != digest:
            problems.append(f"{folder / name}: was changed after the run wrote it: {again}")
    if problems:
        raise UserError(*problems)
