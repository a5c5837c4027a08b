"""Keys of the quantities that columns of a table have, such as x and range, and of further columns."""

from collections.abc import Mapping, Sequence

KEYS = (
    "run",
    "time",
    "step",
    "sensor",
    "date",
    "received",
    "north_south",
    "east_west",
    "week",
    "subsecond",
)
"""Keys of `columns` that are no quantities."""
STAMP_PARTS = {"week": 604800.0, "subsecond": 1e-9}
"""Columns that are added to the time, if the config names them, and their usual unit, s."""
GEODETIC = ("latitude", "longitude", "altitude")
COURSE = ("speed", "course")
PLACE = ("x", "y")
VELOCITY = ("vx", "vy")
MEASURED = ("x", "y", "latitude", "longitude", "range", "azimuth", "bearing")
ODOMETRY = ("v", "w")
QUATERNION = ("qx", "qy", "qz", "qw")
"""Components of a rotation, from which a heading is computed; w is its scalar part."""


def plain_name(name: str) -> str:
    """Return the quantity of a component: x of ``px``, and of the second sensor's ``2.x``."""
    plain = name.rpartition(".")[2]
    if plain in ("px", "py", "pz"):
        return plain.removeprefix("p")
    return plain


def has_velocity(columns: Mapping[str, str]) -> bool:
    """Test whether there are columns of a velocity, or of speed and course.

    ``columns`` are the columns by quantity.
    """
    return columns.keys() >= {*VELOCITY} or columns.keys() >= {*COURSE}


def measures_velocity(quantities: Sequence[Sequence[str]], columns: Mapping[str, str]) -> bool:
    """Test whether a config gets `kind: velocity`: beside a single sensor, which is one of positions.

    ``quantities`` are those of each sensor, and ``columns`` the columns by quantity.
    """
    return [*quantities] == [PLACE] and has_velocity(columns)
