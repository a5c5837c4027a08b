"""A target whose path comes from a file: fly a trajectory of one's own in every run."""

import hashlib
from dataclasses import dataclass, field

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.keys import DataError, DataFile, Place
from trackbench.registry import register
from trackbench.scenarios.recordings import read_columns
from trackbench.scenarios.targets.base import Timeline
from trackbench.scenarios.targets.flown import Flown
from trackbench.scenarios.targets.waypoints import smooth_path


@register("targets", "recorded")
@dataclass(frozen=True, kw_only=True)
class RecordedPath(Flown):
    """A recorded path, whose measurements are simulated anew in every run.

    Between its rows the target flies Akima's spline; where the file has velocities, the cubic that has
    them too. The file covers all of the scenario's steps.
    """

    file: DataFile
    """CSV with the columns time (s), x, y (m) and perhaps z, vx, vy, vz"""
    content: str = field(init=False, default="")
    """digest of the numbers that were read"""

    def __post_init__(self) -> None:
        columns = read_columns(self.file, ("time", "x", "y"), ("z", "vx", "vy", "vz"))
        given = [name for name in ("vx", "vy", "vz") if name in columns]
        wanted = ["vx", "vy", *(["vz"] if "z" in columns else [])]
        if given and given != wanted:
            what = f"velocities are {', '.join(wanted)}, all or none"
            raise DataError(Place(self.file, 1, 1, what))
        if len(columns["time"]) < 2 or (np.diff(columns["time"]) <= 0.0).any():
            raise DataError(Place(self.file, 1, 1, "the times must increase, from row to row"))
        table = fixed(np.stack(list(columns.values())))
        object.__setattr__(self, "_columns", dict(zip(columns, table, strict=True)))
        digest = hashlib.sha256(repr(list(columns)).encode() + table.tobytes()).hexdigest()
        object.__setattr__(self, "content", digest)

    @property
    def contents(self) -> dict[str, str]:
        """Digest of the numbers that were read, by file."""
        return {self.file: self.content}

    @property
    def axes(self) -> int:
        """Axes of the space it moves in."""
        return 3 if "z" in self._read else 2

    @property
    def _read(self) -> dict[str, Array]:
        columns: dict[str, Array] = self.__dict__["_columns"]
        return columns

    def check(self, timeline: Timeline) -> None:
        """The file covers the time there is."""
        first, last = self._read["time"][[0, -1]]
        if timeline.times[0] < first or timeline.times[-1] > last:
            what = f"covers {first:g} to {last:g} s of {timeline.times[0]:g} to {timeline.times[-1]:g} s"
            raise DataError(Place(self.file, 1, 1, what))

    def states(self, times: Array) -> Array:
        """States (n, K) at these times."""
        names, columns = "xyz"[: self.axes], self._read
        points = np.stack([columns[name] for name in names])
        if "vx" not in columns:
            return smooth_path(columns["time"], points, times)
        from scipy.interpolate import CubicHermiteSpline

        out = []
        for name in names:
            spline = CubicHermiteSpline(columns["time"], columns[name], columns[f"v{name}"])
            out += [spline(times), spline.derivative()(times)]
        return np.stack(out)
