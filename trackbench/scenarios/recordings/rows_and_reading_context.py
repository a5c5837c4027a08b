"""Rows of a sensor as arrays, and the context that the files of a recording share when read."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import Place
from trackbench.scenarios.recordings.clocks_of_files import (
    SharedClock,
)
from trackbench.scenarios.recordings.naming_of_columns import Naming, NamingKeys
from trackbench.scenarios.recordings.parse_tables import WholeNumbers
from trackbench.scenarios.recordings.recognize_column_names import NamedColumn
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

TICK = 1e-6
"""s: times that round to the same multiple of it are one time"""

ONE_RUN = "0"
"""Name of the run of one file without names of runs."""


class Rows(NamedTuple):
    """R rows of one sensor, or of a truth or inputs, from all files."""

    run: WholeNumbers
    """number (R,) of each row's run"""
    time: Array
    """time (R,), s, or number of the step"""
    values: Array
    """values (n, R) of the n quantities, in SI, NaN where they are missing"""
    file: WholeNumbers
    """number (R,) of each row's file, for messages"""
    line: WholeNumbers
    """line (R,) in the file, for messages"""
    received: Array
    """time (R,) at which the row was received, by default its own"""

    def at(self, chosen: WholeNumbers) -> "Rows":
        """Return the rows with these indices, in their order."""
        return Rows(
            run=self.run[chosen],
            time=self.time[chosen],
            values=self.values[:, chosen],
            file=self.file[chosen],
            line=self.line[chosen],
            received=self.received[chosen],
        )

    @property
    def ticks(self) -> WholeNumbers:
        """Times (R,) as whole numbers of `TICK`, for comparison."""
        return np.rint(self.time / TICK).astype(np.int64)


@dataclass
class ReadingContext(SharedClock):
    """Properties that the files of a recording share, collected while they are read one by one."""

    naming: Naming
    """names and units of columns, of the file which is read or whose rows are put in order"""
    origin: tuple[float, ...] | None = None
    """latitude and longitude, deg, perhaps height, m: the one in the config, else the first position of
    the chosen runs"""
    origin_key: tuple[str, ...] = ()
    """path of the origin's key in the config"""
    position_dependent: Collection[str] = ()
    """quantities that depend on the position, such as x and range"""
    in_space: bool = False
    """True if the target moves in space, so that heights count"""
    chosen: Collection[str] = ()
    """names of the chosen runs; empty if all are chosen"""
    own_origins: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """origins of the runs that begin far from the first position, by their names"""
    located_runs: set[str] = field(default_factory=set)
    """names of the runs whose first position has been compared with the origin"""
    far_runs: list[str] = field(default_factory=list)
    """texts on the runs that have origins of their own, with their distances"""
    refuses_far_rows: bool = True
    """True if positions too far from their origin are an error"""
    unrotated_velocity_file: str = ""
    """first file with velocities and without positions"""
    first_position: str = ""
    """file and line of the first position if it is the origin; empty if the config has an origin"""
    largest_distance: float = 0.0
    """largest distance of a position from its origin, m"""
    geodetic_file: str = ""
    """first file with latitude and longitude"""
    planar_file: str = ""
    """first file with a column of a position-dependent quantity, and the name of this quantity"""
    has_delays: bool = False
    """True if a column has the times at which rows were received"""
    has_inputs: bool = False
    """True if rows may hold inputs alone, without a sensor"""
    unread_time_parts: dict[str, NamedColumn] = field(default_factory=dict)
    """columns that look like further parts of the time and are not read, by `week` or `subsecond`"""
    unavailable: Counter[str] = field(default_factory=Counter)
    """number of cells with a code of "not available", by quantity and code"""
    mixed_rows: list[str] = field(default_factory=list)
    """notes on rows of several targets that the config mixes, as `columns: {run: ""}` does"""
    runs: list[str] = field(default_factory=list)
    """names of the runs; a run's number is its place here"""
    files: list[str] = field(default_factory=list)
    """paths of the files; a file's number is its place here"""
    notices: list[str] = field(default_factory=list)
    """notes to the user"""

    def place(self, rows: Rows, i: int, message: str) -> Place:
        """Return the place of row i in its file, with a message on a mistake there."""
        return Place(self.files[rows.file[i]], int(rows.line[i]), 1, message)

    def numbers_of(self, names: Sequence[str]) -> WholeNumbers:
        """Return the numbers (R,) of runs by their ``names``; a new name gets the next number."""
        self.runs = list(dict.fromkeys([*self.runs, *names]))
        known = {name: i for i, name in enumerate(self.runs)}
        return np.array([known[name] for name in names], dtype=np.int32)

    def numbers_of_known(self, names: Collection[str]) -> WholeNumbers:
        """Return the numbers of the runs with these names; names that no file has are left out."""
        return np.array([i for i, name in enumerate(self.runs) if name in names], dtype=np.int32)


def usual_interval(times: Array) -> float:
    """Return the median interval between different times (R,); 1 if there is only one time.

    Of an even number of intervals it is the larger one of the middle two.
    """
    intervals = np.sort(np.diff(np.unique(times)))
    if not len(intervals):
        return 1.0
    return float(intervals[len(intervals) // 2])


def values_of_nearest_rows(time: Array, known_time: Array, values: Array) -> Array:
    """Return the values (n, R) that are nearest in time to each of the times (R,).

    ``values`` (n, L) are known at the times ``known_time`` (L,), in any order. The result is NaN where
    the nearest value is further away than the usual interval between known ones.
    """
    rows = np.flatnonzero(np.isfinite(known_time) & np.isfinite(values).all(axis=0))
    rows = rows[np.argsort(known_time[rows], kind="stable")]
    nearest_values = np.full((len(values), len(time)), np.nan)
    if not len(rows):
        return nearest_values
    known_time = known_time[rows]
    after = np.clip(np.searchsorted(known_time, time), 0, len(rows) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(time - known_time[before]) < np.abs(known_time[after] - time)
    nearest = np.where(is_before, before, after)
    is_near = np.abs(known_time[nearest] - time) <= usual_interval(known_time)
    nearest_values[:, is_near] = values[:, rows[nearest[is_near]]]
    return nearest_values


def in_kilometers(meters: float) -> str:
    """Return a distance as a text with its unit, m or km: 350 m, 12.3 km."""
    if meters < 1e3:
        return f"{meters:.0f} m"
    if meters < 1e6:
        return f"{meters / 1e3:.3g} km"
    return f"{meters / 1e3:.0f} km"


def positions_of_rows(rows: Rows, kind: str, in_degrees: bool) -> Array | None:
    """Return the positions (2, R) of rows, m; None for a sensor that measures none.

    ``kind`` is the type of the rows' sensor; ``in_degrees`` is True if its angles are in degrees.
    """
    if kind == "position":
        return rows.values[:2]
    if kind == "range-azimuth":
        azimuth = rows.values[1] * (UNITS["deg"] if in_degrees else 1.0)
        return rows.values[0] * np.stack([np.cos(azimuth), np.sin(azimuth)])
    return None


def context_of_further_file(
    context: ReadingContext, naming: Naming, keys: NamingKeys, has_own_keys: bool
) -> ReadingContext:
    """Return the context with which `read_rows` begins a file of inputs or of the truth.

    It is that of the measurements, with their origin and clock, but without their runs, files and
    notices. If ``has_own_keys``, the file has keys of units and zones of its own; otherwise it shares
    those of the measurements. ``naming`` and ``keys`` are those of the file. The chosen runs are those
    of the measurements, and the one run of a file without names of runs.
    """
    further = replace(
        context,
        naming=naming,
        keys=keys,
        runs=[],
        files=[],
        notices=[],
        unavailable=Counter(),
        chosen=(*context.runs, ONE_RUN),
    )
    # `ReadingContext.check_idle_keys` reports keys of units and zones that no file uses: of several
    # files that share them, or of this one alone.
    if has_own_keys:
        further.used_keys = set()
        further.idle_keys = {}
    return further
