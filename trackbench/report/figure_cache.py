"""Cache of drawn figures.

It is keyed by results, options of the figure, source code, plugins that have run, and settings of
matplotlib.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

import trackbench
from trackbench.atomic_files import record_writes, write_bytes
from trackbench.errors import WriteError
from trackbench.execution.cache import figure_cache_folder
from trackbench.plugins.loaded_and_changed_plugins import loaded_identities
from trackbench.readable_files import require_regular_file
from trackbench.report.kinds import FigureKind
from trackbench.report.mean_or_rms_of_metric import compared_statistics
from trackbench.report.plotting import style
from trackbench.report.tables_and_figures import Results
from trackbench.results.file_names import RUN_FILES

Files: TypeAlias = list[tuple[str, bytes]]
"""Format and content."""
_EXHIBIT_KEYS = ("tables", "figures")
"""Keys of the config that do not decide how a figure looks, beside those of the figure itself."""
_MANIFEST_KEYS = ("steps", "loops_over_runs", "deterministic", "failed")
"""Entries of the manifest that figures show."""


@dataclass(frozen=True)
class FigureCache:
    """Cache of the figures of one state of a results folder."""

    digest: str
    """digest of all that any figure may show, beside its own keys"""

    @classmethod
    def from_results(cls, results: Results) -> "FigureCache | None":
        """Return the cache of these results; None if a settings file sets up matplotlib.

        Figures under such settings are not cached, as the digest does not cover the file.
        """
        if any(path.is_file() for path in _matplotlibrc_paths()):
            return None
        # A change of another table or figure in the config should not clear the cache. So the config
        # counts without both, and two things that a figure takes from the others count instead: the
        # color and dash of each filter, which all figures decide together, and the statistic of each
        # metric, mean or rms, by which the tables compare filters.
        changed_settings = style.changed_settings()
        inputs = [
            [version(name) for name in ("matplotlib", "numpy", "scipy")],
            {key: value for key, value in results.config.items() if key not in _EXHIBIT_KEYS},
            [results.manifest.get(name) for name in _MANIFEST_KEYS],
            {label: results.line_style(label) for label in results.labels},
            compared_statistics(results.config),
            _digest_of_sources(),
            # Code of a plugin, or of a notebook, may change how matplotlib draws any figure.
            {name: repr(value) for name, value in changed_settings.items()},
            loaded_identities(),
        ]
        digest = hashlib.sha256(json.dumps(inputs, default=str).encode())
        # The key ``published`` names the files with numbers of papers, which some figures show.
        for name in (*RUN_FILES, "tuning.csv", *results.config.get("published", ())):
            _add_file(digest, results.folder / name)
        return cls(digest.hexdigest())

    def get(self, spec: FigureKind, formats: Sequence[str]) -> Files | None:
        """Return a figure's files, format and content of each; None if a format is not in the cache."""
        try:
            paths = [require_regular_file(self._path(spec, form)) for form in formats]
            contents = [path.read_bytes() for path in paths]
        except OSError:
            return None
        return list(zip(formats, contents, strict=True))

    def put(self, spec: FigureKind, files: Files) -> None:
        """Store a figure's files in the cache. A file that cannot be written will be drawn again."""
        # A caller lists the files that it writes into the results folder. These are none of them: within
        # the block they are recorded in a list that nobody reads.
        with record_writes(), suppress(OSError, WriteError):
            for form, content in files:
                path = self._path(spec, form)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(path, content)

    def _path(self, spec: FigureKind, form: str) -> Path:
        key = hashlib.sha256(f"{self.digest} {spec!r}".encode()).hexdigest()
        return figure_cache_folder() / key[:2] / f"{key}.{form}"


@cache
def _digest_of_sources() -> str:
    """Return the digest of the names and contents of the package's own Python files."""
    digest = hashlib.sha256()
    for path in sorted(Path(trackbench.__file__).parent.rglob("*.py")):
        _add_file(digest, path)
    return digest.hexdigest()


def _add_file(digest: "hashlib._Hash", path: Path) -> None:
    """Add a file's name and content to a digest; of a missing file the name."""
    digest.update(f"\n{path.name}\n".encode())
    if path.is_file():
        digest.update(path.read_bytes())


def _matplotlibrc_paths() -> Iterator[Path]:
    """Yield the paths at which matplotlib looks for a settings file of the user; none needs to exist."""
    yield Path("matplotlibrc")
    if "MATPLOTLIBRC" in os.environ:
        named = Path(os.environ["MATPLOTLIBRC"])
        yield named
        yield named / "matplotlibrc"
    if os.environ.get("MPLCONFIGDIR"):
        yield Path(os.environ["MPLCONFIGDIR"]) / "matplotlibrc"
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    yield Path(home) / "matplotlib" / "matplotlibrc"
    yield Path.home() / ".matplotlib" / "matplotlibrc"
