"""Velocities of a recognized table: when they count, and when the config takes them."""

from collections.abc import Mapping, Sequence

from trackbench.scenarios.recordings.quantities import COURSE, PLACE, VELOCITY


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
