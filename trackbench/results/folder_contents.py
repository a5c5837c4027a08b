"""Files and lock of a results folder: names, digests, and which files the next run removes.

Git keeps the files that every machine writes again byte for byte and that are small. It has the digests
of the large ones (`DATA_FILES`). What one run adds on one machine stands apart (`is_of_one_run`): CPU
times, versions and dates in ``run/``, ``report.html``, and formats that an option asks for.
"""

import errno
import hashlib
import json
import os
import re
import stat
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import product
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any, NamedTuple

from trackbench.atomic_files import ensure_folder, remove, within, write_text
from trackbench.errors import UserError, WriteError, reason
from trackbench.field_types import require_regular_file
from trackbench.results.point_facts import printable_json
from trackbench.yaml_source import read

FORMAT = 3
"""Number of the folder's format: it grows when older code would misread a folder."""
MANIFEST = "manifest.json"
"""Facts and digests of the results."""
MACHINE = "run/machine.json"
"""Facts and digests of the one run that wrote the results."""
TIMING = "run/timing.csv"
TIME_VERDICTS = "run/time_verdicts.csv"
DATA_FILES = ("per_run.csv", "per_run.npz", "per_step.csv", "per_step.npz", "shown.npz")
"""Large files, of which git keeps the digests.

The arrays are in place of the rows if there are very many runs, or very long ones.
"""
ARRIVALS = "arrivals.csv"
"""Steps at which measurements arrive, of a scenario with delays."""
RUN_FILES = (*DATA_FILES, "summary.csv", "points.json", ARRIVALS, TIMING)
"""Files that a run writes. Tables, figures and verdicts are made from them and from the config."""
DERIVED_FILES = (
    "tracks.npz",
    "paired.csv",
    "comparison.csv",
    "comparison.md",
    "claims.csv",
    TIME_VERDICTS,
    "sweep.csv",
    "tuning.csv",
    "report.html",
)
"""Files that are made from the files of a run, beside tables and figures."""
_OLD_FILES = ("timing.csv", "time_verdicts.csv", *(f"{name}.xz" for name in RUN_FILES))
"""Files of older versions, which a run removes."""
COLUMNS = {
    "per_run.csv": ["filter", "run", "metric", "value"],
    "per_step.csv": ["filter", "step", "time", "metric", "value", "stderr", "runs"],
    "summary.csv": ["filter", "metric", "value", "stderr", "runs", "lost"],
    "timing.csv": [
        "filter",
        "runs",
        "cpu_s",
        "cpu_s_per_run",
        "stderr",
        "repeats",
        "likelihoods",
        "covariances",
    ],
}
"""Headings of the CSV files of a run, after those of the grid."""
ARRIVAL_COLUMNS = ["run", "sensor", "step", "arrived"]
"""Headings of `ARRIVALS`, after those of the grid."""
TABLE_FORMS = ("csv", "md", "tex")
FIGURE_FORMS = ("png", "svg", "pdf")
DEFAULT = "results"
"""Name of the table and of the figure of a config that asks for none."""
TRACK = "track"
"""Name of the figure that a config in the plane without tables and figures has beside it."""
_NAMED = {"tables": TABLE_FORMS, "figures": FIGURE_FORMS}
"""Folders of files that the config names, and their formats."""
_FORMS = {
    "tables": TABLE_FORMS,
    "figures": FIGURE_FORMS,
    "run/tables": TABLE_FORMS,
    "run/figures": FIGURE_FORMS,
    "published": ("csv",),
}
"""Formats of the files in each folder."""
_PARTIAL = re.compile(r"\.(.+)\.[0-9]+\.part")
"""Name of a file that is being written: that of the whole file, and the process id."""
_FACTS_OF_RESULTS = (
    "experiment",
    "seed",
    "runs",
    "steps",
    "loops_over_runs",
    "deterministic",
    "training_holds_out",
    "plugins",
    "failed",
    "format",
)
"""Facts in the manifest; ``run/machine.json`` has all others."""
DIGITS = {"per_run.csv": 7, "per_step.csv": 6, "summary.csv": 7}
"""Significant digits of values and standard errors, far more than the errors justify."""
EXACT_DIGITS = 15
"""Significant digits in per_run.csv if a paper prints seven or more and nothing is random."""


class Damage(NamedTuple):
    """Damaged files of a results folder."""

    missing: list[str]
    """names of files that are missing although git keeps them"""
    changed: list[str]
    """names of files with another digest"""
    unreadable: Mapping[str, str] = MappingProxyType({})
    """reasons why files cannot be read, by their names"""


def is_of_one_run(name: str) -> bool:
    """Test whether a file depends on the machine or on options of the run."""
    is_optional = name.endswith((".png", ".pdf", ".tex")) or name in ("report.html", "tracks.npz")
    return is_optional or name.startswith("run/")


def is_in_git(name: str) -> bool:
    """Test whether git keeps a file: a folder is complete without all others."""
    return name not in DATA_FILES and not is_of_one_run(name)


def remove_outputs(folder: Path, keep: Collection[str]) -> None:
    """Remove the files that earlier runs wrote, the manifest last; files of the user stay.

    The manifest names the files of a complete run. The config names tables and figures of an interrupted
    run, whose manifest has only the data or is missing. ``keep`` are names of files that the next run
    reads.
    """
    names = {*RUN_FILES, *DERIVED_FILES, *_OLD_FILES, MACHINE}
    names.update(_named_by_manifests(folder))
    names.update(_named_by_config(folder))
    paths = [folder / name for name in names.difference(keep)]
    # Half-written files of a killed process: the caller has locked the folder.
    for inner in ("", "run", *_FORMS):
        for path in (folder / inner).glob(".*.part"):
            whole = _PARTIAL.fullmatch(path.name)
            if whole and _is_output(PurePosixPath(inner, whole[1])):
                paths.append(path)
    for path in (*paths, folder / MANIFEST):
        # A link inside the folder may lead to files of the user. The last parent is the folder itself.
        inner_folders = path.relative_to(folder).parents[:-1]
        if path.is_file() and not any((folder / inner).is_symlink() for inner in inner_folders):
            remove(path)


def _is_output(path: PurePosixPath) -> bool:
    """Test whether any version writes files of this name into a results folder."""
    known = (*RUN_FILES, *DERIVED_FILES, *_OLD_FILES, "config.yaml", MANIFEST, MACHINE)
    forms = _FORMS.get(path.parent.as_posix(), ())
    return str(path) in known or path.suffix.removeprefix(".") in forms


def _named_by_manifests(folder: Path) -> Iterator[str]:
    """Yield the names in the manifests that a run can have written.

    Other names are left out, as anybody may have edited a manifest.
    """
    for manifest in (MANIFEST, MACHINE):
        with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
            for name in json.loads(require_regular_file(folder / manifest).read_bytes())["files"]:
                if _is_output(PurePosixPath(name)):
                    yield name


def _named_by_config(folder: Path) -> Iterator[str]:
    """Yield names of the tables and figures that the config asks for."""
    with suppress(UserError):
        config = read(folder / "config.yaml").data
        if not isinstance(config, dict):
            return
        for group, forms in _NAMED.items():
            exhibits = config.get(group)
            if not isinstance(exhibits, dict):
                continue
            # A name with a slash could lead out of the folder.
            safe = [name for name in (*exhibits, DEFAULT) if "/" not in str(name)]
            for place, name, form in product(("", "run/"), safe, forms):
                yield f"{place}{group}/{name}.{form}"


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the facts and digests of both manifests, of which `MACHINE` may be missing.

    The digests of all files, by name, are under the key ``files``.
    """
    facts: dict[str, Any] = {}
    files: dict[str, str] = {}
    for name in (MACHINE, MANIFEST):
        if name == MANIFEST or (folder / name).is_file():
            content = printable_json((folder / name).read_text(encoding="utf-8"))
            facts = {**facts, **content}
            files = {**files, **content["files"]}
            facts["files"] = files
    return facts


def write_manifest(
    folder: Path, facts: Mapping[str, Any], written: Iterable[Path]
) -> dict[str, str]:
    """Write both manifests after all other files, with new digests of the files in ``written``.

    The digests of other files are those of ``facts["files"]``. Return all digests by the files' names.
    """
    digests = dict(facts.get("files", {}))
    for path in written:
        name = path.relative_to(folder).as_posix()
        digests.pop(name, None)
        if path.is_file() and name not in (MACHINE, MANIFEST):
            try:
                digests[name] = _digest(path)
            except OSError as error:
                raise WriteError.from_os_error(path, error) from error
    # Each fact and each file stands in one of both manifests.
    run_manifest: dict[str, Any] = {}
    results_manifest: dict[str, Any] = {}
    for key, value in {**facts, "format": FORMAT}.items():
        manifest = results_manifest if key in _FACTS_OF_RESULTS else run_manifest
        manifest[key] = value
    run_manifest["files"] = {}
    results_manifest["files"] = {}
    for name, digest in sorted(digests.items()):
        manifest = run_manifest if is_of_one_run(name) else results_manifest
        manifest["files"][name] = digest
    ensure_folder(within(folder, "run"))
    write_text(folder / MACHINE, json.dumps(run_manifest, indent=2) + "\n")
    write_text(folder / MANIFEST, json.dumps(results_manifest, indent=2) + "\n")
    return digests


def check_digests(folder: Path, recorded: Mapping[str, str]) -> Damage:
    """Find which of the files with ``recorded`` digests are missing or changed.

    A missing file counts only if git keeps it.
    """
    missing = []
    changed = []
    unreadable = {}
    for name, digest in recorded.items():
        if not (folder / name).is_file():
            if is_in_git(name):
                missing.append(name)
            continue
        try:
            digest_now = _digest(folder / name)
        except OSError as error:
            unreadable[name] = reason(error)
            continue
        if digest_now != digest:
            changed.append(name)
    return Damage(missing=missing, changed=changed, unreadable=unreadable)


def _digest(path: Path) -> str:
    """Return a file's digest; raises OSError if it cannot be read."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def locked(folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Lock ``folder`` against other processes; if it is locked, call ``say`` with a line and wait.

    The system frees the lock of a process that dies.
    """
    path = folder / ".lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = _acquire(path, say)
    except OSError as error:
        raise WriteError.from_os_error(path, error) from error
    try:
        yield
    finally:
        with suppress(PermissionError):  # of Windows, where an open file cannot be removed
            path.unlink(missing_ok=True)
        os.close(descriptor)


_FLAGS = os.O_RDWR | os.O_CREAT
if sys.platform != "win32":
    _FLAGS |= os.O_NOFOLLOW | os.O_NONBLOCK
_DIGITS = 20  # more than a process id has


def _acquire(path: Path, say: Callable[[str], None]) -> int:
    """Open and lock the file ``path``; return its descriptor.

    If another process has locked it, call ``say`` with a line and wait.
    """
    waiting = False
    while True:
        descriptor = os.open(path, _FLAGS, 0o644)
        try:
            holder = _holder(descriptor)
            _lock(descriptor, wait=False)
        except BlockingIOError:
            if not waiting:
                say(f"{path.parent}/ is in use by process {holder}; waiting for it to finish")
            waiting = True
            _lock(descriptor, wait=True)
        except OSError:
            os.close(descriptor)
            raise
        if _is_current(descriptor, path):
            os.ftruncate(descriptor, 0)
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.write(descriptor, str(os.getpid()).encode())
            return descriptor
        os.close(descriptor)  # the process before removed the file: it is no longer the lock


def _holder(descriptor: int) -> str:
    """Return the process id in a lock file; raises OSError if no run wrote the file.

    The text is ``?`` if the file is empty, as it is until its process has the lock. A results folder may
    come from anywhere. A file with other content or with a second name (a hard link) is left alone.
    """
    status = os.fstat(descriptor)
    text = b"not a file"
    if stat.S_ISREG(status.st_mode):
        text = os.read(descriptor, _DIGITS + 1)
    if status.st_nlink > 1 or len(text) > _DIGITS or not (text.isdigit() or not text):
        raise OSError(errno.EEXIST, "is not a lock of trackbench; remove it by hand")
    return text.decode() or "?"


def _is_current(descriptor: int, path: Path) -> bool:
    """Test whether the open file still has this path."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False


if sys.platform == "win32":
    import msvcrt

    _FAR = 1 << 30
    """A byte beyond the content: Windows does not let others read locked bytes."""

    def _lock(descriptor: int, wait: bool) -> None:
        """Lock an open file against other processes; raises BlockingIOError unless it may wait."""
        while True:
            os.lseek(descriptor, _FAR, os.SEEK_SET)
            try:
                # LK_LOCK gives up after ten seconds.
                mode = msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK
                msvcrt.locking(descriptor, mode, 1)
                return
            except OSError as error:
                if not wait:
                    raise BlockingIOError from error

else:
    import fcntl

    def _lock(descriptor: int, wait: bool) -> None:
        """Lock an open file against other processes; raises BlockingIOError unless it may wait."""
        operation = fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB
        fcntl.flock(descriptor, operation)
