"""Naming of a file's columns: keys on their names, units, formats, missing cells and directions."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from trackbench.field_types import Finite, InvalidKeyError
from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat
from trackbench.scenarios.recordings.impossible_values import LIMITS
from trackbench.scenarios.recordings.quantity_keys import (
    COURSE,
    GEODETIC,
    KEYS,
    QUATERNION,
    STAMP_PARTS,
    plain_name,
)
from trackbench.scenarios.recordings.time_zones import is_utc, mistake_in_zone, offset_of_zone
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS, mistaken_unit

_DEFAULT_UNITS = {"latitude": "deg", "longitude": "deg", "course": "deg"}
PLANE_AXES = ("x", "y", "z")
VELOCITY_AXES = ("vx", "vy", "vz")
_NO_ANGLES = (*PLANE_AXES, *VELOCITY_AXES, *GEODETIC, "range", "range_rate", "speed", "course")


@dataclass(frozen=True, kw_only=True, eq=False)
class Naming:
    """Keys of whatever reads tables: what their columns are called and what they are in."""

    columns: dict[str, str] = field(default_factory=dict)
    """names of columns, where they differ: {x: east_m, time: t}; latitude and longitude stand for x
    and y (altitude for z), north_south and east_west for their hemispheres if they have no signs, speed
    and course for vx and vy, and qx, qy, qz and qw, a quaternion, for a heading; a time in two columns
    has its nanoseconds in `subsecond` or weeks in `week`"""
    units: dict[str, str] = field(default_factory=dict)
    """units that are not SI: {x: km, speed: kn, azimuth: deg}; latitude, longitude and course are in
    degrees unless they are said to be in rad, or in degE7, whole numbers of 1e-7 deg"""
    origin: tuple[Finite, ...] = ()
    """latitude and longitude (deg), perhaps height (m), of the point from which x counts east and y
    north; default: the first position that is read, for a run far from it that run's own first one"""
    clockwise: tuple[str, ...] | None = None
    """measured angles that count clockwise: [azimuth] from north, as those of radars and compasses do,
    [bearing] of landmarks from the heading; default: an azimuth counts from x to y, a bearing from the
    heading to the left. A course always is clockwise. An empty list, [], says that none does"""
    time_format: str = ""
    """form of dates that are not in ISO 8601, as strptime has it: "%d/%m/%Y %H:%M:%S"; a column `date`
    stands before a time of day"""
    zone: str = ""
    """zone of dates without one, UTC or their offset from it, "+02:00"; needed beside UNIX times"""
    missing: tuple[Finite, ...] | dict[str, tuple[Finite, ...]] | None = None
    """numbers that stand for a missing cell of any column: [-9999]; or those of each quantity:
    {latitude: [0], longitude: [0]}. An empty list, [], says that none does"""
    same_time: Literal["mean", "last", "spread"] | None = None
    """what becomes of different rows of one sensor, run and time: their mean, the last of them, or times
    spread evenly until the next; default: they are a mistake"""
    format: TextFormat | None = None
    """how a text file is written, where its first lines do not show it: {separator: ";", skip: 1}"""

    def __post_init__(self) -> None:
        """Raise InvalidKeyError for an unknown unit, zone or form of the origin."""
        for key, unit in self.units.items():
            if unit not in UNITS:
                message = f"{unit!r} is not one of {', '.join(UNITS)}"
                raise InvalidKeyError(message, "units", key)
        if self.zone and offset_of_zone(self.zone) is None:
            raise InvalidKeyError(mistake_in_zone(self.zone), "zone")
        if self.origin and len(self.origin) not in (2, 3):
            raise InvalidKeyError("is latitude, longitude and perhaps height", "origin")
        for name, degrees in zip(GEODETIC, self.origin[:2], strict=False):
            least, largest, *_ = LIMITS[name]
            if not least <= degrees <= largest:
                limits = f"a {name} is within {least:g} and {largest:g} deg"
                message = f"{degrees:g} deg is impossible; {limits}"
                raise InvalidKeyError(message, "origin", GEODETIC.index(name))

    @property
    def is_in_utc(self) -> bool:
        """True if the config says that times are in UTC."""
        return is_utc(self.zone)

    @property
    def offset(self) -> float:
        """Offset of dates without a zone from UTC, s."""
        return offset_of_zone(self.zone) or 0.0

    def with_defaults(self, others: "Naming") -> "Naming":
        """Return this naming with the keys of ``others`` where its own are not set.

        An empty list of ``clockwise`` or ``missing`` is set: no angle of this file counts clockwise, no
        number stands for a missing cell. Other keys with an empty value, such as ``time_format: ""``,
        count as not set. The result has no origin, which is one for all files and stands in the target.
        """
        return Naming(
            columns={**others.columns, **self.columns},
            units={**others.units, **self.units},
            clockwise=others.clockwise if self.clockwise is None else self.clockwise,
            time_format=self.time_format or others.time_format,
            zone=self.zone or others.zone,
            missing=others.missing if self.missing is None else self.missing,
            same_time=self.same_time or others.same_time,
            format=self.format or others.format,
        )

    def missing_numbers(self, quantity: str) -> tuple[float, ...]:
        """Return the numbers that stand for a missing cell in the column of a quantity, such as x.

        Weeks and parts of a second belong to the time, which is never missing. The numbers of all
        columns are none of theirs.
        """
        if isinstance(self.missing, dict):
            of_all_sensors = self.missing.get(plain_name(quantity), ())
            return self.missing.get(quantity, of_all_sensors)
        if self.missing is None or quantity in STAMP_PARTS:
            return ()
        return self.missing

    def has_no_missing_number(self, quantity: str) -> bool:
        """Test whether the config says by an empty list that no number means a missing cell.

        This counts for all columns, or for that of the ``quantity``, such as x.
        """
        is_set = self.missing is not None
        if isinstance(self.missing, dict):
            is_set = quantity in self.missing or plain_name(quantity) in self.missing
        return is_set and not self.missing_numbers(quantity)

    def check_names(self, components: Sequence[str], *within: str | int) -> None:
        """Raise InvalidKeyError for an unknown quantity, and for a unit of another dimension.

        ``components`` are the quantities that are read, ``within`` is the path of this naming in the
        config.
        """
        # A state may have a component that is called speed or course, too.
        known = [*dict.fromkeys((*KEYS, *GEODETIC, *COURSE, *components))]
        if "heading" in components:
            known += QUATERNION
        missing = self.missing if isinstance(self.missing, dict) else {}
        keys_of_parts = {"columns": [*self.columns], "units": [*self.units], "missing": [*missing]}
        for part, keys in keys_of_parts.items():
            for key in keys:
                if key not in known:
                    message = f"there is no {key}; known: {', '.join(known)}"
                    raise InvalidKeyError(message, *within, part, key)
        for i, name in enumerate(self.clockwise or ()):
            if name in components and plain_name(name) not in _NO_ANGLES:
                continue
            message = (
                f"{name!r} is no angle that is measured here; there are {', '.join(components)}"
            )
            if name == "course":
                message = "a course always counts clockwise from north; leave it out"
            raise InvalidKeyError(message, *within, "clockwise", i)
        # The state may be a scalar, or have other components than positions and velocities. Its x, and a
        # measured z, are then numbers of any unit, which `mistaken_unit` accepts.
        is_scalar = not {"px", "vx"} & {*components}
        for key, unit in self.units.items():
            mistake = mistaken_unit(key, unit, is_scalar)
            if mistake is not None:
                raise InvalidKeyError(mistake, *within, "units", key)

    def column_of(self, name: str, names: Sequence[str]) -> str | None:
        """Return the column of the quantity ``name`` among the columns ``names``; None without one.

        The quantity of a second sensor, such as 2.x, may have the column of x.
        """
        # Of 2.px: 2.px itself, px without the number of the sensor, and the quantity x.
        for key in dict.fromkeys((name, name.rpartition(".")[2], plain_name(name))):
            column = self.columns.get(key, key)
            # If `columns` says that the column x is a longitude, it is not that of the quantity x.
            is_geodetic = key not in self.columns and any(
                self.columns.get(geodetic) == column for geodetic in GEODETIC if geodetic != key
            )
            if column in names and not is_geodetic:
                return column
        return None

    def is_clockwise(self, name: str) -> bool:
        """Test whether the quantity ``name`` is an angle that counts clockwise.

        An azimuth then counts from north, and a bearing from the heading.
        """
        clockwise = self.clockwise or ()
        return name in clockwise or plain_name(name) in clockwise

    def scale(self, name: str) -> float:
        """Return the factor from the unit of the quantity ``name`` to SI; 1 without a unit."""
        plain = plain_name(name)
        unit = self.units.get(name) or self.units.get(plain) or _DEFAULT_UNITS.get(plain)
        if unit is None:
            return 1.0
        return UNITS[unit]


class NamingKeys(NamedTuple):
    """Keys of a config that have the names of a file's columns, for messages."""

    quantities: str = "columns"
    """key of the columns of quantities"""
    clock: str = "columns"
    """key of the columns of times, runs and the like"""
    own: str = ""
    """key of a naming that the file may have of its own; empty for a file of measurements"""


def explain_missing_column(
    names: Sequence[str], naming: Naming, keys: NamingKeys, name: str, key: str
) -> str:
    """Return the message on the quantity ``name`` without a column in a file, and the advice.

    ``names`` are the columns of the file, and ``naming`` and ``keys`` are those of the file. ``key`` is
    the key of the config that names its columns.
    """
    known = ", ".join(names)[:200]
    # Without the number of its sensor 2.x, of the second one, is x.
    quantity = name.rpartition(".")[2]
    column = naming.columns.get(name) or naming.columns.get(quantity)
    message = f"no column {name}; there are {known}"
    remedy = f" (see `{key}`)"
    if column:
        message = f"no column {column}, which `{key}` has for {quantity}; there are {known}"
        remedy = ""
    if keys.own and key == "columns":
        remedy = f": a file with other names needs `{keys.own}: {{columns: {{time: NAME}}}}`"
    return f"{message}{remedy}"
