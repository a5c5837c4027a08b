"""Figures that were drawn before: of the same numbers, keys and code they are the same files."""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

import trackbench
from trackbench.atomic_files import record_writes, write_bytes
from trackbench.errors import WriteError
from trackbench.execution.cache import figure_folder
from trackbench.report.kinds import FigureKind
from trackbench.report.results import Results
from trackbench.results.folder_contents import RUN_FILES

Files: TypeAlias = list[tuple[str, bytes]]
"""Format and content."""
_PARTS = ("tables", "figures")
"""Each is made by its own keys alone, and a figure by the lines' looks."""
_FACTS = ("steps", "loops_over_runs", "deterministic", "failed")
"""What figures take from the manifest."""


@dataclass(frozen=True)
class KeptFigures:
    """The figures of one state of a results folder, each under the digest of all it could show."""

    made_of: str
    """digest of what any figure may be made of beside its own keys"""

    @classmethod
    def of(cls, results: Results) -> "KeptFigures | None":
        """Return the cache of these results; None if a settings file sets up matplotlib."""
        if any(path.is_file() for path in _set_ups()):
            return None
        libraries = [version(name) for name in ("matplotlib", "numpy", "scipy")]
        words = {key: value for key, value in results.config.items() if key not in _PARTS}
        facts = [results.manifest.get(name) for name in _FACTS]
        looks = {
            label: results.line_style(label) for label in results.labels
        }  # of all figures' keys
        made_by = [libraries, words, facts, looks, _sources()]
        digest = hashlib.sha256(json.dumps(made_by, default=str).encode())
        names = (*RUN_FILES, "tuning.csv", *results.config.get("published", ()))
        _add(digest, (results.folder / name for name in names))
        return cls(digest.hexdigest())

    def get(self, spec: FigureKind, formats: Sequence[str]) -> Files | None:
        """Return a figure's files; None if not all of them are there."""
        try:
            return [(form, self._path(spec, form).read_bytes()) for form in formats]
        except OSError:
            return None

    def put(self, spec: FigureKind, files: Files) -> None:
        """Keep a figure's files; what cannot be kept will be drawn again."""
        with (
            record_writes(),
            suppress(OSError, WriteError),
        ):  # they are none of the results folder's
            for form, content in files:
                path = self._path(spec, form)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(path, content)

    def _path(self, spec: FigureKind, form: str) -> Path:
        key = hashlib.sha256(f"{self.made_of} {spec!r}".encode()).hexdigest()
        return figure_folder() / key[:2] / f"{key}.{form}"


@cache
def _sources() -> str:
    """Digest of the package's own source."""
    digest = hashlib.sha256()
    _add(digest, sorted(Path(trackbench.__file__).parent.rglob("*.py")))
    return digest.hexdigest()


def _add(digest: "hashlib._Hash", paths: Iterable[Path]) -> None:
    for path in paths:
        digest.update(f"\n{path.name}\n".encode())
        digest.update(path.read_bytes() if path.is_file() else b"")


def _set_ups() -> Iterator[Path]:
    """Return the folders of matplotlib's settings files."""
    yield Path("matplotlibrc")
    if "MATPLOTLIBRC" in os.environ:
        named = Path(os.environ["MATPLOTLIBRC"])
        yield from (named, named / "matplotlibrc")
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    folders = (
        os.environ.get("MPLCONFIGDIR"),
        Path(home) / "matplotlib",
        Path.home() / ".matplotlib",
    )
    yield from (Path(folder) / "matplotlibrc" for folder in folders if folder)
