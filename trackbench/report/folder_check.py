"""Check of a results folder that is opened: its results are complete, unchanged and readable."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trackbench.config.build_components import build
from trackbench.config.experiment_keys import Settings
from trackbench.config.plugins_of_config import load_plugins
from trackbench.errors import RunError, UserError, first_names, reason
from trackbench.plugins.plugin_errors import foreign_line, package_line
from trackbench.registry import Group
from trackbench.report.findings import phrases
from trackbench.report.plugin_tables_and_figures import unavailable_kinds
from trackbench.report.tables_and_figures import Results
from trackbench.results.file_names import RUN_FILES
from trackbench.results.manifest import reject_newer_format
from trackbench.results.missing_and_changed_files import Damage, check_digests
from trackbench.results.read_folder import RUN_AGAIN

_MANIFEST_TYPES: dict[str, type] = {
    "packages": dict,
    "cpu_s": float,
    "training_holds_out": str,
    "training_failures": dict,
    "data_notes": list,
    "date": str,
    "trackbench": str,
    "python": str,
    "platform": str,
    "failed": list,
    "experiment_runs": int,
    "loops_over_runs": list,
    "deterministic": list,
}
"""Types of the manifest's entries that a report shows."""
_CHANGED = "changed after the run"
_MOST_FILES = 3  # that a message names


class IncompleteResultsError(UserError):
    """A results folder whose run did not finish, or whose runs were changed or lost afterwards."""


@contextmanager
def explain_content_errors(folder: Path | str) -> Iterator[None]:
    """Raise any error within the block as one line, as anybody may have written the folder's content.

    The line names the place in this program, which may itself have the error. Errors of plugins, and
    errors that are one line already, are not changed.
    """
    try:
        yield
    except (UserError, RunError):
        raise
    except OSError as error:
        raise RunError(f"{error.filename or folder}: {reason(error)}") from error
    except Exception as error:
        if foreign_line(error):  # the code of a plugin
            raise
        message = f"holds something that no run writes, {package_line(error)}"
        raise UserError(f"{folder}: {message}: {RUN_AGAIN}") from error


def open_results(folder: Path) -> Results:
    """Read and check the results in a folder.

    Parameters
    ----------
    folder
        results folder

    Returns
    -------
    Results
        results, of which each file is read at its first use.

    Raises
    ------
    IncompleteResultsError
        a file of the run is damaged
    UserError
        the folder has no results, those of a newer version, or a config that does not fit them
    """
    with explain_content_errors(folder):
        check_folder(folder)
        results = Results(folder)
        _check_manifest(results)
        source = results.source
        if not isinstance(source.data, dict):
            source.add_problem((), "is not an experiment's config")
        elif build(Settings, source, ()) is not None:  # None if it noted mistakes in the source
            summary = results.columns("summary")
            # The columns before "filter" are those of the grid.
            columns = list(summary)
            grid_columns = columns[: columns.index("filter")]
            missing_labels = set(summary["filter"]) - set(results.labels)
            if grid_columns != results.grid:
                source.add_problem(("grid",), "the results were computed over another grid")
            elif missing_labels:
                message = f"{min(missing_labels)!r} has results but is not a filter here any more"
                source.add_problem(("filters",), message)
        source.check()
        return results


def check_folder(folder: Path) -> None:
    """Raise UserError unless the path is a results folder."""
    if not os.path.isdir(folder):  # unlike Path.is_dir, quiet about a name that is too long
        raise UserError(f"{folder}: there is no such folder")
    if not (folder / "config.yaml").is_file():
        raise UserError(f"{folder}: is not a results folder, it has no config.yaml")


def open_with_notes(folder: Path, allow_plugins: bool = False) -> Results:
    """Return the results in a folder; print notes on files that were changed after the run.

    Notes also name tables and figures whose plugin is not loaded. With ``allow_plugins`` the plugins of
    the config are loaded, which runs their code, and notes name those that were changed after the run.
    """
    results = open_results(folder)
    lines = changed_files(results)
    recorded_digests = results.manifest.get("plugins", {})
    plugins = load_plugins(results.source, folder, allowed=True) if allow_plugins else ()
    for plugin in plugins:
        name = Path(plugin.path).name
        if recorded_digests.get(name) != plugin.digest:
            lines.append(f"{folder}: {name} was {_CHANGED}")
    groups: tuple[Group, ...] = ("tables", "figures")
    for group in groups:
        for name, kind in unavailable_kinds(results.config, group).items():
            message = f"{kind!r} is not a kind of {group[:-1]} without a plugin (--allow-plugins)"
            lines.append(f"{folder}: {group}.{name} is left as it is: {message}")
    for line in lines:
        print(f"note: {line}", file=sys.stderr)
    return results


def changed_files(results: Results) -> list[str]:
    """Return lines on missing and changed files other than the run's data.

    These are the config, and what is computed from the data: tables, figures, verdicts.
    """
    recorded_digests = results.manifest["files"]
    other_digests = {}
    for name, digest in recorded_digests.items():
        if name not in RUN_FILES:
            other_digests[name] = digest
    return _damage_lines(results.folder, check_digests(results.folder, other_digests))


def _check_manifest(results: Results) -> None:
    """Check that the manifest can be read, is of no newer version, and fits the run's files.

    Raises IncompleteResultsError or UserError.
    """
    folder = results.folder
    if not (folder / "manifest.json").is_file():
        message = "is half-written, it has no manifest.json"
        raise IncompleteResultsError(f"{folder}: {message}: {RUN_AGAIN}")
    # Step 1: the types of what the report reads from it.
    try:
        manifest = results.manifest
        version = int(manifest["format"])
        recorded_digests = dict(manifest["files"])
        valid = isinstance(manifest.get("commit") or "", str)
        for key, expected_type in _MANIFEST_TYPES.items():
            # A missing entry is valid: `dict()`, `0.0` and so on stand for it.
            valid &= isinstance(manifest.get(key, expected_type()), expected_type)
        for row in results.failed:
            valid &= {"filter", "reason"} <= set(row)
    except (UserError, ValueError, KeyError, TypeError):
        valid = False
    if not valid:
        raise IncompleteResultsError(f"{folder}: manifest.json cannot be read: {RUN_AGAIN}")
    # Step 2: the format's version.
    reject_newer_format(folder, version, manifest)
    # Step 3: digests of the files that the run wrote.
    run_digests = {name: recorded_digests[name] for name in RUN_FILES if name in recorded_digests}
    problems = _damage_lines(folder, check_digests(folder, run_digests))
    if problems:
        raise IncompleteResultsError(*problems)


def _damage_lines(folder: Path, damage: Damage) -> list[str]:
    """Describe missing files in a line, changed ones in a line, and each that cannot be read."""
    lines = []
    for name, why in damage.unreadable.items():
        lines.append(f"{folder}: {name} cannot be read: {why}")
    if damage.missing:
        verb = phrases.verb(damage.missing)
        lines.append(
            f"{folder}: {first_names(damage.missing, _MOST_FILES)} {verb} missing: {RUN_AGAIN}"
        )
    if damage.changed:
        verb = "was" if len(damage.changed) == 1 else "were"
        lines.append(
            f"{folder}: {first_names(damage.changed, _MOST_FILES)} {verb} {_CHANGED}: {RUN_AGAIN}"
        )
    return lines
