"""Target `recorded`: a trajectory from a file, whose measurements are simulated anew."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.durations import time_text
from trackbench.errors import counted, form_for
from trackbench.field_types import DataError, DataFile, Place
from trackbench.registry import register
from trackbench.scenarios.recordings.chosen_runs import chosen_runs
from trackbench.scenarios.recordings.names_and_digests_of_data_files import FromFiles
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.origins import check_origin, note_distances
from trackbench.scenarios.recordings.read_rows_of_all_files import read_rows
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext
from trackbench.scenarios.targets.base import Flown
from trackbench.scenarios.targets.timeline import Timeline
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
        """Check the keys, and read the file once: the property `_path` returns what was read."""
        super().__post_init__()
        self.check_names((*_POSITIONS, *_VELOCITIES))
        with self.reading():
            times, states = self._read_path()
        object.__setattr__(self, "_read", (fixed(times), fixed(states)))

    def _read_path(self) -> tuple[Array, Array]:
        """Read times (R,) and x, y, z, vx, vy, vz (6, R), NaN where the file has none of them."""
        # Step 1: read the rows of one run, in order of time.
        chosen: tuple[str, ...] = ()
        if self.run is not None:
            chosen = (str(self.run),)
        context = ReadingContext(
            self,
            origin=self.origin or None,
            origin_key=("origin",),
            in_space=True,  # heights are read, too, if the file has them
            chosen=chosen,
        )
        quantities = (*_POSITIONS, *_VELOCITIES)
        # The file has x and y at least, or latitude and longitude in place of them.
        rows = read_rows(context, [self.file], [quantities], least=2)
        context.check_idle_keys()
        check_origin(context, self.origin, "origin")
        note_distances(context)  # adds a note if positions are far from their origin
        # One table for each sensor, and here the only one; its runs are checked below.
        (path,) = chosen_runs(context, rows, chosen, ("run",))
        path = in_order(context, path)
        if context.counts_steps:  # the file has numbers of steps in place of times
            raise self._mistake("a path needs a column time")
        if len(context.runs) > 1:
            raise self._mistake(f"has {len(context.runs)} runs: name one by `run`")
        # Step 2: check the columns: x and y, perhaps z, and velocities along all axes or none.
        finite = np.isfinite(path.values)
        has_column = [bool(column.any()) for column in finite]
        has_x, has_y, has_z = has_column[:3]
        has_velocities = has_column[3:]
        if not (has_x and has_y):
            raise self._mistake("a path needs the columns x and y")
        if any(has_velocities) and has_velocities != [True, True, has_z]:
            wanted = ", ".join(_VELOCITIES[: 2 + has_z])
            raise self._mistake(f"velocities are {wanted}, all or none")
        # Step 3: keep the rows that have a number in each of these columns.
        whole = np.flatnonzero(finite[has_column].all(axis=0))
        if len(whole) < 2:
            raise self._mistake("a path needs two rows, at two times")
        left_out = len(path.time) - len(whole)
        if left_out:
            message = f"{counted(left_out, 'row')} with an empty cell"
            context.notices.append(f"{message} {form_for(left_out, 'was', 'were')} left out")
        object.__setattr__(self, "_notices", tuple(context.notices))
        return path.time[whole], path.values[:, whole]

    def _mistake(self, message: str) -> DataError:
        return DataError(Place(self.file, 1, 1, message))

    @property
    def patterns(self) -> tuple[str, ...]:
        """File."""
        return (self.file,)

    @property
    def notices(self) -> tuple[str, ...]:
        """Notes on changes to the rows."""
        return self.__dict__["_notices"]

    @property
    def axes(self) -> int:
        """Axes of the space it moves in."""
        # Row 2 is z, which is NaN in all rows of a file without it.
        _, values = self._path
        return 2 if np.isnan(values[2, 0]) else 3

    @property
    def _path(self) -> tuple[Array, Array]:
        """Times (R,), s, and x, y, z, vx, vy, vz (6, R) of the rows."""
        return self.__dict__["_read"]

    def check(self, timeline: Timeline) -> None:
        """Check that the file covers the run's time."""
        times, _ = self._path
        first, last = times[[0, -1]]
        if timeline.times[0] < first or timeline.times[-1] > last:
            span = f"{time_text(timeline.times[0])} to {time_text(timeline.times[-1])} s"
            covered = f"{time_text(first)} to {time_text(last)} s"
            raise self._mistake(f"covers {covered} of {span} (see `begin`)")

    def states(self, times: Array) -> Array:
        """Return states (n, K) at these times."""
        # The rows of `values` are x, y, z, vx, vy, vz.
        row_times, values = self._path
        positions = values[: self.axes]
        velocities = values[3 : 3 + self.axes]
        if np.isnan(velocities).any():  # the file has none
            return smooth_path(row_times, positions, times)
        from scipy.interpolate import CubicHermiteSpline

        states = []
        for position, velocity in zip(positions, velocities, strict=True):
            # Cubic Hermite spline through the positions with the recorded velocities.
            spline = CubicHermiteSpline(row_times, position, velocity)
            states += [spline(times), spline.derivative()(times)]
        return np.stack(states)
