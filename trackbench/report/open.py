"""Open results folders: check that the results are complete, unchanged and readable."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trackbench.config.build import build
from trackbench.config.experiment import Settings
from trackbench.config.plugin_checks import load_plugins
from trackbench.errors import RunError, UserError, reason
from trackbench.plugins.errors import foreign_line, package_line
from trackbench.registry import Group
from trackbench.report.results import Results
from trackbench.results.folder import RUN_AGAIN
from trackbench.results.folder_contents import FORMAT, RUN_FILES, Damage, check_digests

_KINDS: dict[str, type] = {"packages": dict, "cpu_s": float, "training_holds_out": str}
_KINDS |= dict.fromkeys(("date", "trackbench", "python", "platform"), str)
_KINDS |= dict.fromkeys(("failed", "loops_over_runs", "deterministic"), list)
"""Types of the manifest's entries that a report shows."""
_CHANGED = "changed after the run"


class IncompleteResultsError(UserError):
    """A results folder whose run did not finish, or whose runs were changed or lost afterwards."""


@contextmanager
def explain_content_errors(folder: Path | str) -> Iterator[None]:
    """Turn any error over a folder's content into one line: anybody may have written the content.

    The line names the place in this program, which may be wrong after all. Errors of plugins and
    errors with a line of their own pass.
    """
    try:
        yield
    except (UserError, RunError):
        raise
    except OSError as error:
        raise RunError(f"{error.filename or folder}: {reason(error)}") from error
    except Exception as error:
        if foreign_line(error):
            raise
        what = f"holds something that no run writes, {package_line(error)}"
        raise UserError(f"{folder}: {what}: {RUN_AGAIN}") from error


def open_results(folder: Path) -> Results:
    """Read and check the results in a folder.

    Raises IncompleteResultsError if a file of the run is damaged, and UserError if the folder has no
    results, those of a newer version, or a config that does not fit them.
    """
    with explain_content_errors(folder):
        check_folder(folder)
        results = Results(folder)
        _check_manifest(results)
        source = results.source
        if not isinstance(source.data, dict):
            source.add_problem((), "is not an experiment's config")
        elif build(Settings, source, ()) is not None:
            summary = results.columns("summary")
            missing, columns = set(summary["filter"]) - set(results.labels), list(summary)
            if columns[: columns.index("filter")] != results.grid:
                source.add_problem(("grid",), "the results were computed over another grid")
            elif missing:
                what = f"{min(missing)!r} has results but is not a filter here any more"
                source.add_problem(("filters",), what)
        source.check()
        return results


def check_folder(folder: Path) -> None:
    """Raise UserError unless the path is a results folder."""
    if not os.path.isdir(folder):  # unlike Path.is_dir, quiet about a name that is too long
        raise UserError(f"{folder}: there is no such folder")
    if not (folder / "config.yaml").is_file():
        raise UserError(f"{folder}: is not a results folder, it has no config.yaml")


def open_with_notes(folder: Path, allow_plugins: bool = False) -> Results:
    """Return the results in a folder, and print notes on other files that were changed.

    Notes also name tables and figures of plugins whose code may not run.
    """
    results = open_results(folder)
    lines, recorded = changed_files(results), results.manifest.get("plugins", {})
    for plugin in load_plugins(results.source, folder, allowed=True) if allow_plugins else ():
        name = Path(plugin.path).name
        if recorded.get(name) != plugin.digest:
            lines.append(f"{folder}: {name} was {_CHANGED}")
    groups: tuple[Group, ...] = ("tables", "figures")
    for group in groups:
        for name, kind in results.unavailable_kinds(group).items():
            what = f"{kind!r} is not a kind of {group[:-1]} without a plugin (--allow-plugins)"
            lines.append(f"{folder}: {group}.{name} is left as it is: {what}")
    for line in lines:
        print(f"note: {line}", file=sys.stderr)
    return results


def changed_files(results: Results) -> list[str]:
    """Return lines on changed files beside those of the run: tables, figures, the config."""
    recorded = results.manifest["files"]
    others = {name: digest for name, digest in recorded.items() if name not in RUN_FILES}
    return _lines(results.folder, check_digests(results.folder, others))


def _check_manifest(results: Results) -> None:
    folder = results.folder
    if not (folder / "manifest.json").is_file():
        what = "is half-written, it has no manifest.json"
        raise IncompleteResultsError(f"{folder}: {what}: {RUN_AGAIN}")
    # The types of what the report reads from it.
    try:
        manifest = results.manifest
        version, recorded = int(manifest["format"]), dict(manifest["files"])
        valid = all(isinstance(manifest.get(key, kind()), kind) for key, kind in _KINDS.items())
        valid &= isinstance(manifest.get("commit") or "", str)
        valid &= all({"filter", "reason"} <= set(row) for row in results.failed)
    except (UserError, ValueError, KeyError, TypeError):
        valid = False
    if not valid:
        raise IncompleteResultsError(f"{folder}: manifest.json cannot be read: {RUN_AGAIN}")
    if version > FORMAT:
        newer = manifest.get("trackbench", "of a newer version")
        what = f"was written by trackbench {newer} in format {version}"
        raise UserError(f"{folder}: {what}, this version reads up to {FORMAT}: update trackbench")
    # Digests of the files that the run wrote.
    of_run = {name: recorded[name] for name in RUN_FILES if name in recorded}
    problems = _lines(folder, check_digests(folder, of_run))
    if problems:
        raise IncompleteResultsError(*problems)


def _lines(folder: Path, damage: Damage) -> list[str]:
    """Describe missing files in a line and changed ones in a line."""
    ends = ((damage.missing, ("is", "are"), "missing"), (damage.changed, ("was", "were"), _CHANGED))
    lines = []
    for names, verbs, what in ends:
        if names:
            few = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
            lines.append(f"{folder}: {few} {verbs[len(names) > 1]} {what}: {RUN_AGAIN}")
    return lines
