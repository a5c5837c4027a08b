"""A target whose path comes from a file: fly a trajectory of one's own in every run."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.field_types import DataError, DataFile, Place
from trackbench.registry import register
from trackbench.scenarios.recordings.column_mapping import Naming
from trackbench.scenarios.recordings.rows import (
    FromFiles,
    Gathered,
    chosen_runs,
    in_order,
    read_rows,
)
from trackbench.scenarios.targets.base import Flown, Timeline
from trackbench.scenarios.targets.waypoints import smooth_path

_POSITIONS = ("x", "y", "z")
_VELOCITIES = ("vx", "vy", "vz")


@register("targets", "recorded")
@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedPath(FromFiles, Naming, Flown):
    """A recorded path, whose measurements are simulated anew in every run.

    Between its rows the target flies Akima's spline; where the file has velocities, the cubic that has
    them too. The file covers all of the scenario's steps. Dates count from that of the first row.
    """

    file: DataFile
    """CSV or Parquet with the columns time, x, y (m) and perhaps z, vx, vy, vz; or what gives them"""
    run: str | int | None = None
    """name of the run that is flown; needed if the file has several"""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_names((*_POSITIONS, *_VELOCITIES))
        with self.reading():
            times, states = self._rows()
        object.__setattr__(self, "_read", (fixed(times), fixed(states)))

    def _rows(self) -> tuple[Array, Array]:
        """Return times (R,) and x, y, z, vx, vy, vz (6, R), NaN where the file has none of them."""
        # Step 1: read the rows of one run, in order of time.
        found = Gathered(self, self.origin or None)
        rows = read_rows(found, [self.file], [(*_POSITIONS, *_VELOCITIES)], least=2)
        found.check_origin("origin")
        (path,) = chosen_runs(found, rows, () if self.run is None else (str(self.run),), ("run",))
        path = in_order(found, path)
        if found.stepped:
            raise self._mistake("a path needs a column time")
        if len(found.runs) > 1:
            raise self._mistake(f"has {len(found.runs)} runs: name one by `run`")
        # Step 2: check the columns: x and y, perhaps z, and velocities along all axes or none.
        there = np.isfinite(path.values)
        x, y, z, *moving = (bool(column.any()) for column in there)
        if not (x and y):
            raise self._mistake("a path needs the columns x and y")
        if any(moving) and moving != [True, True, z]:
            wanted = ", ".join(_VELOCITIES[: 2 + z])
            raise self._mistake(f"velocities are {wanted}, all or none")
        # Step 3: keep the rows that have a number in each of these columns.
        whole = np.flatnonzero(there[[x, y, z, *moving]].all(axis=0))
        if len(whole) < 2:
            raise self._mistake("a path needs two rows, at two times")
        left_out = len(path.time) - len(whole)
        if left_out:
            found.told.append(f"{left_out} rows with an empty cell were left out")
        object.__setattr__(self, "_told", tuple(found.told))
        return path.time[whole], path.values[:, whole]

    def _mistake(self, what: str) -> DataError:
        return DataError(Place(self.file, 1, 1, what))

    @property
    def patterns(self) -> tuple[str, ...]:
        """Return the file."""
        return (self.file,)

    @property
    def notices(self) -> tuple[str, ...]:
        """Return notes on changes to the rows."""
        return self.__dict__["_told"]

    @property
    def axes(self) -> int:
        """Return axes of the space it moves in."""
        return 2 if np.isnan(self._path[1][2, 0]) else 3

    @property
    def _path(self) -> tuple[Array, Array]:
        return self.__dict__["_read"]

    def check(self, timeline: Timeline) -> None:
        """Check that the file covers the run's time."""
        first, last = self._path[0][[0, -1]]
        if timeline.times[0] < first or timeline.times[-1] > last:
            span = f"{timeline.times[0]:g} to {timeline.times[-1]:g} s"
            raise self._mistake(f"covers {first:g} to {last:g} s of {span} (see `begin`)")

    def states(self, times: Array) -> Array:
        """Return states (n, K) at these times."""
        at, values = self._path
        positions, velocities = values[: self.axes], values[3 : 3 + self.axes]
        if np.isnan(velocities).any():
            return smooth_path(at, positions, times)
        from scipy.interpolate import CubicHermiteSpline

        out = []
        for position, velocity in zip(positions, velocities, strict=True):
            # Cubic Hermite spline through the positions with the recorded velocities.
            spline = CubicHermiteSpline(at, position, velocity)
            out += [spline(times), spline.derivative()(times)]
        return np.stack(out)
