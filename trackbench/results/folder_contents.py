"""Which files a run owns: deleted before the next run, listed with digests in the manifest."""

import hashlib
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from lzma import LZMAError
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from trackbench.atomic_files import remove, write_text
from trackbench.errors import UserError
from trackbench.field_types import require_regular_file
from trackbench.results.xz import PACKED, left_out, opened, packed, there
from trackbench.yaml_source import read

FORMAT = 2
"""Counts up when a results folder changes so that older code would misread it."""
RAW = ("per_run.csv", "per_step.csv", "summary.csv", "timing.csv", "shown.npz", "points.json")
"""Files that only a run writes; all others but the tracks are made from them and from the config."""
COLUMNS = {
    "per_run.csv": ["filter", "run", "metric", "value"],
    "per_step.csv": ["filter", "step", "time", "metric", "value", "stderr", "runs"],
    "summary.csv": ["filter", "metric", "value", "stderr", "runs", "lost"],
    "timing.csv": [
        *("filter", "runs", "cpu_s", "cpu_s_per_run", "stderr"),
        *("repeats", "likelihoods", "covariances"),
    ],
}
"""Headings of the CSV files of a run, after those of the grid."""
MADE = (
    *("tracks.npz", "paired.csv", "comparison.csv", "comparison.md", "claims.csv"),
    "time_verdicts.csv",
    *("sweep.csv", "tuning.csv", "report.html"),
)
"""Files that are made from these, but for tables and figures."""
TABLE_FORMS, FIGURE_FORMS = ("csv", "md", "tex"), ("png", "svg", "pdf")
_NAMED = {"tables": TABLE_FORMS, "figures": FIGURE_FORMS}
"""Folders of files that the config names, and their formats."""
DEFAULT = "results"
"""Name of the table and of the figure where the config asks for none."""
_FORMS = {**_NAMED, "published": ("csv",)}
_PARTIAL = re.compile(r"\.(.+)\.[0-9]+\.part")
"""Name of a file that is being written: that of the whole one, and the process id."""
_DAMAGED = "damaged"  # in place of a digest: no file has it


class Damage(NamedTuple):
    """Names of files that are not there any more, and of those that are not as they were written."""

    missing: list[str]
    changed: list[str]


def remove_outputs(folder: Path, keep: Collection[str]) -> None:
    """Take away what earlier runs wrote, the manifest last, and nothing that is somebody else's.

    Their files are named by the manifest; those of a run that was killed before it wrote one, and of
    older versions, by the config. ``keep`` are names of files that the next run is made from.
    """
    named = set(_recorded(folder))
    if "config.yaml" not in named:
        named |= set(_by_config(folder))
    names = {*named, *RAW, *MADE}.difference(keep)
    paths = [folder / name for name in names] + [packed(folder / name) for name in PACKED]
    for path in (*_leftovers(folder), *paths, folder / "manifest.json"):
        is_elsewhere = path.parent != folder and path.parent.is_symlink()
        if path.is_file() and not is_elsewhere:
            remove(path)


def _leftovers(folder: Path) -> Iterator[Path]:
    """Half-written files of a killed process; nobody else may be writing there."""
    for inner in ("", *_FORMS):
        for path in (folder / inner).glob(".*.part"):
            whole = _PARTIAL.fullmatch(path.name)
            if whole and _is_output(PurePosixPath(inner, whole[1])):
                yield path


def _is_output(path: PurePosixPath) -> bool:
    """Return whether this version writes files of such a name into a results folder."""
    if len(path.parts) == 1:
        return path.name.removesuffix(".xz") in (*RAW, *MADE, "config.yaml", "manifest.json")
    inner = path.parent.as_posix()
    return path.suffix.removeprefix(".") in _FORMS.get(inner, ()) and ".." not in path.parts


def seal(folder: Path, facts: Mapping[str, Any], touched: Iterable[Path]) -> None:
    """Write the manifest, after all other files: facts, and digests of those that were touched, too."""
    files = dict(facts.get("files", {}))
    for path in touched:
        name = path.relative_to(folder).as_posix()
        files.pop(name, None)
        if path.is_file():
            files[name] = _digest(path)
    content = {**facts, "format": FORMAT, "files": dict(sorted(files.items()))}
    write_text(folder / "manifest.json", json.dumps(content, indent=2) + "\n")


def damage(folder: Path, recorded: Mapping[str, str]) -> Damage:
    """Which files differ from their digests; a file that was packed since is taken as unpacked."""
    paths = {name: there(folder / name) for name in recorded}
    missing = [name for name, path in paths.items() if path is None and not left_out(name)]
    changed = [name for name, path in paths.items() if path and _digest(path) != recorded[name]]
    return Damage(missing, changed)


def _digest(path: Path) -> str:
    with suppress(OSError, EOFError, LZMAError), opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
    return _DAMAGED


def _recorded(folder: Path) -> Iterator[str]:
    """Names in the manifest that a run can have written: a manifest may be edited or forged."""
    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        for name in json.loads(require_regular_file(folder / "manifest.json").read_bytes())[
            "files"
        ]:
            if _is_output(PurePosixPath(name)):
                yield name


def _by_config(folder: Path) -> Iterator[str]:
    """Tables and figures that the config asks for."""
    with suppress(UserError):
        config = read(folder / "config.yaml").data
        for group, forms in _NAMED.items():
            names = config.get(group) if isinstance(config, dict) else None
            for name in (names or [DEFAULT]) if isinstance(names, dict) else ():
                yield from (f"{group}/{name}.{form}" for form in forms if "/" not in str(name))
