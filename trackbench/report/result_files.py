"""A results folder, read back: its data frames and arrays."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from io import TextIOWrapper
from pathlib import Path
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any, TextIO, cast

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import UserError
from trackbench.plugins.errors import message_of
from trackbench.report.requested import Asked
from trackbench.results.folder_contents import COLUMNS
from trackbench.results.point_facts import FILE, Given, points_in, prefix_of
from trackbench.results.read_csv import Columns, Runs, check_heads, read_columns, read_runs
from trackbench.results.xz import opened, there

if TYPE_CHECKING:
    import pandas as pd

AGAIN = "run the experiment again"


@dataclass(frozen=True, repr=False)
class Frames(Asked):
    """The files of one results folder, read when asked for."""

    facts: dict[str, Any] | None = None
    """what the manifest is going to say, as long as it is not written"""
    points_given: tuple[Given, ...] | None = None
    """what is known of the points, if not by the folder"""

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Return versions, platform, times."""
        if self.facts is not None:
            return self.facts
        with self.reading("manifest.json") as path:
            manifest = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(manifest, dict):
                raise TypeError("is not a mapping")
            return manifest

    @property
    def loops_over_runs(self) -> list[str]:
        """Return labels of the filters whose runs are looped over in Python, which their times show."""
        return self.manifest.get("loops_over_runs", [])

    @property
    def failed(self) -> list[dict[str, Any]]:
        """Return filters that raised: ``filter``, ``reason`` and the grid point's values."""
        return self.manifest["failed"]

    def given(self, point: dict[str, Any]) -> Given:
        """Return facts about a point besides its numbers: scenario, filters, components, shading."""
        found = next((g for g in self._given if is_same(g.values, point)), None)
        if found is None:
            raise UserError(f"{self.folder / FILE}: {point} is not in it: {AGAIN}")
        return found

    @cached_property
    def _given(self) -> tuple[Given, ...]:
        if self.points_given is not None:
            return self.points_given
        with self.reading(FILE) as path:
            return tuple(points_in(path.read_text(encoding="utf-8")))

    @cached_property
    def per_run(self) -> "pd.DataFrame":
        """Return ``filter,run,metric,value``: for people; tables and figures take `runs`."""
        return self._frame("per_run.csv")

    @cached_property
    def per_step(self) -> "pd.DataFrame":
        """Return ``filter,step,time,metric,value,stderr,runs``."""
        return self._frame("per_step.csv")

    @cached_property
    def summary(self) -> "pd.DataFrame":
        """Return ``filter,metric,value,stderr,runs,lost``."""
        return self._frame("summary.csv")

    @cached_property
    def timing(self) -> "pd.DataFrame":
        """Return ``filter,runs,cpu_s,cpu_s_per_run,stderr,repeats,likelihoods,covariances``."""
        return self._frame("timing.csv")

    @cached_property
    def shown(self) -> dict[str, Array]:
        """Return the contents of shown.npz for all points; empty if every filter failed."""
        return self.arrays("shown.npz")

    def arrays(self, name: str) -> dict[str, Array]:
        """Return a file of arrays; empty if it is not there."""
        if not (self.folder / name).is_file():
            return {}
        with self.reading(name) as path, path.open("rb") as file, np.load(file) as arrays:
            return dict(arrays)

    def tracks(self, point: dict[str, Any]) -> dict[str, Array]:
        """Return whole tracks of the first runs: ``truth``, ``measurements``, ``mean/<filter>``.

        None where every filter failed: such points count, too.
        """
        i = self.place(point)
        prefix = prefix_of(i or 0, len(self.every_point))
        return {
            name.removeprefix(prefix): array
            for name, array in self.shown.items()
            if i is not None and name.startswith(prefix)
        }

    def steps(self, point: dict[str, Any]) -> int:
        """Return steps that a filter takes in a run at a point."""
        found, place = self.manifest.get("steps"), self.place(point) or 0
        number = found[place] if isinstance(found, list) and place < len(found) else found
        if not isinstance(number, int) or number < 1:
            what = "does not say how many steps a run has"
            raise UserError(f"{self.folder / 'manifest.json'}: {what}: {AGAIN}")
        return number

    def runs(self, point: dict[str, Any]) -> Runs:
        """Return values per run at a point; none if every filter failed there."""
        return self._runs.get(tuple(point.values()), {})

    @cached_property
    def _runs(self) -> dict[tuple[Any, ...], Runs]:
        parses = self.columns("summary").parses
        with self.opened("per_run.csv") as file:
            return read_runs(file, {path: parses[path] for path in self.grid}, self.filters)

    @contextmanager
    def opened(self, name: str) -> Iterator[TextIO]:
        """Open one of the CSV files as text; raises UserError if it cannot be read."""
        with self.reading(name) as path:
            content = cast(IO[bytes], opened(path))
            with TextIOWrapper(content, encoding="utf-8", newline="") as file:
                yield file

    @contextmanager
    def reading(self, name: str) -> Iterator[Path]:
        """Give a file's path, packed or not; whatever a damaged file raises becomes one line."""
        path = there(self.folder / name)
        if path is None:
            raise UserError(f"{self.folder / name}: is missing: {AGAIN}")
        try:
            yield path
        except Exception as error:
            raise UserError(f"{path}: cannot be read, {message_of(error)}: {AGAIN}") from error

    def points(self) -> list[dict[str, Any]]:
        """Return the points that have results, in order; one empty point without a grid."""
        summary = self.columns("summary")
        if not self.grid or not len(summary):  # every filter failed
            return self.every_point
        rows = dict.fromkeys(summary.tuples(self.grid))
        return [dict(zip(self.grid, row, strict=True)) for row in rows]

    def place(self, point: dict[str, Any]) -> int | None:
        """Return a point's number in the config's grid; None if it is not there any more."""
        return next((i for i, given in enumerate(self.every_point) if is_same(given, point)), None)

    def columns(self, name: str, point: Mapping[str, Any] = MappingProxyType({})) -> Columns:
        """Return rows of `summary`, `per_step` or `timing`, at a grid point or all of them."""
        if name not in self._columns:
            with self.opened(f"{name}.csv") as file:
                self._columns[name] = read_columns(file, COLUMNS[f"{name}.csv"])
        return self._columns[name].at(point)

    @cached_property
    def _columns(self) -> dict[str, Columns]:
        return {}

    def at(self, frame: "pd.DataFrame", point: dict[str, Any]) -> "pd.DataFrame":
        """Return the rows of one grid point."""
        for path, value in point.items():
            frame = frame[frame[path] == value]
        return frame

    def _frame(self, name: str) -> "pd.DataFrame":
        import pandas as pd

        missing = {key: ["nan"] for key in _NUMBERS}  # no others: a filter may be called nan
        with self.reading(name) as path:
            frame = pd.read_csv(path, dtype=_TYPES, keep_default_na=False, na_values=missing)
            check_heads(frame.columns, COLUMNS[name])
            return frame


def is_same(point: dict[str, Any], read_back: dict[str, Any]) -> bool:
    """Return whether a point of the config is one of the files, where nothing and lists are words."""
    pairs = ((value, read_back[path]) for path, value in point.items())
    return all(a == b or ("" if a is None else str(a)) == str(b) for a, b in pairs)


_NUMBERS = ("time", "value", "stderr", "cpu_s", "cpu_s_per_run")
_TYPES: Any = {
    "filter": str,
    **dict.fromkeys(["run", "step", "runs", "lost"], int),
    **dict.fromkeys(_NUMBERS, float),
}
"""Of columns, so that they are the same in a file without rows, where every filter failed."""
