"""Record of a guess at a table: columns and units, reasons, sensors, runs, tracks and noise levels."""

from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import Place
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import measures_velocity
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, Rows

ColumnByQuantity: TypeAlias = dict[str, str]
"""Name of the column of each quantity."""
UnitByQuantity: TypeAlias = dict[str, str]
"""Unit of each quantity, if it is known."""
ReasonByKey: TypeAlias = dict[str, str]
"""Comments for the config that say why a key, or a quantity's unit, was guessed."""


class Track(NamedTuple):
    """Measured positions, or ranges and azimuths, of one sensor in the longest run."""

    time: Array
    """times (R,), s; those of dates and of UNIX times count from 1970"""
    values: Array
    """x and y, m, or range, m, and azimuth, rad (2, R)"""
    is_dated: bool
    """True if times count from 1970"""


class SensorGuess(NamedTuple):
    """A sensor of the table."""

    name: str
    """name in the table's column of sensors, if it has one"""
    kind: str
    """type, a key of `guess_sensors.SENSORS`"""
    quantities: tuple[str, ...]
    """names of the measured quantities"""
    sigmas: tuple[float, ...] = ()
    """standard deviations of the quantities' errors, in SI units"""


@dataclass(frozen=True)
class Guess:
    """Guess at a table: how it is read and why, its sensors and runs, and their errors."""

    naming: Naming
    reasons: ReasonByKey
    """reason for each guessed key or unit"""
    runs: list[tuple[str, int]]
    """name and number of rows of each run, the longest first"""
    sensors: list[SensorGuess]
    speed: float
    """usual speed, m/s"""
    process_noise: float = 0.0
    """process noise q, m^2/s^3, if the rows show one; 0 if `usual_process_noise` of the speed serves"""
    names: list[str] = field(default_factory=list)
    """all columns of the table"""
    steps: int = 0
    """different times of the longest run"""
    inputs: dict[str, float] = field(default_factory=dict)
    """standard deviations of a robot's measured speed v and turn rate w, if it is one"""
    odometry: Rows | None = None
    """rows of a robot's speed and turn rate in the longest run, in order of time"""
    interval: float = 0.0
    """usual interval of the longest run's rows, s, or steps"""
    origin: tuple[float, ...] = ()
    """latitude and longitude of the first position, deg; empty without one"""
    is_dated: bool = False
    """True if times are dates"""
    format_of_other_order: str = ""
    """format of its dates with another order of day and month, if both orders give the same times since
    the first row"""
    outliers: float = 0.0
    """largest share of a sensor's rows that lie far from the line between their neighbors"""
    path: str = ""
    """the table"""
    radar: Track | None = None
    """ranges and azimuths of the first sensor that measures them"""
    positions: Track | None = None
    """positions of the first sensor that measures them"""
    questions: list[Place] = field(default_factory=list)
    """questions that the table leaves open, and a truth may answer"""
    files: tuple["Guess", ...] = ()
    """guess at each file, if there are several"""

    @property
    def each_file(self) -> tuple["Guess", ...]:
        """Guesses at the files, of which there may be one alone."""
        return self.files or (self,)

    @property
    def measures_velocity(self) -> bool:
        """True if velocities are measured beside positions."""
        quantities = [sensor.quantities for sensor in self.sensors]
        return measures_velocity(quantities, self.naming.columns)


@dataclass(frozen=True)
class RobotTables:
    """Tables beside the measurements of a robot, by which these are recognized as such."""

    odometry: Guess | None = None
    """guess at the table of speeds and turn rates"""
    landmarks: tuple[str, ...] = ()
    """plain labels of the landmarks whose places are known"""
    names_turn_rate: bool = False
    """True if the user named the column of the turn rate in the table of odometry"""

    @property
    def is_empty(self) -> bool:
        """True if there is no such table."""
        return self.odometry is None and not self.landmarks


@dataclass(frozen=True)
class TableAnswers:
    """Answers of the user to the questions on a table of measurements."""

    naming: Naming
    """naming of columns and units"""
    user_keys: set[str]
    """keys that the user set, as ``columns.time``"""


def track_of(context: ReadingContext, rows: Rows, scale: float = 1.0) -> Track:
    """Return the positions, or ranges and azimuths, of rows as a track; dates count from 1970.

    ``scale`` is the factor from the second value to SI, such as that from degrees to radians.
    """
    time = rows.time
    if context.dated:
        time = time + context.first_date_us / 1e6
    values = np.stack([rows.values[0], rows.values[1] * scale])
    # UNIX times count from 1970, too.
    is_unix = context.clock is not None and context.clock.kind == "unix"
    return Track(time=time, values=values, is_dated=bool(context.dated) or is_unix)
