"""Names of the components of a state, and their rows."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import InvalidKeyError

AXES = ("x", "y", "z")
_DIRECTIONS = frozenset(("heading", "bearing", "azimuth", "yaw", "course"))
"""Words of the names of components that are angles."""
_NO_DIRECTIONS = frozenset(("rate", "dot", "bias", "offset", "velocity", "speed"))
"""Words beside them in the names of components that are none."""


@cache
def position_velocity_names(axes: int) -> tuple[str, ...]:
    """Return the names of position and velocity along ``axes`` axes in turn: px, vx, py, ..."""
    return tuple(kind + axis for axis, kind in product(AXES[:axes], "pv"))


def has_position_and_velocity(components: tuple[str, ...]) -> bool:
    """Test whether the state is position and velocity along each of one to three axes."""
    return components in (
        position_velocity_names(1),
        position_velocity_names(2),
        position_velocity_names(3),
    )


def rows_in_plane(
    components: Sequence[str], errors: Mapping[str, Sequence[str]]
) -> tuple[int, int] | None:
    """Return the rows of the two components of a position; None if a state has none.

    They are px and py, or the first two of the error ``position`` if the ``errors`` of a score have it.
    """
    named = [name for name in errors.get("position", ()) if name in components]
    if len(named) < 2:
        named = [name for name in ("px", "py") if name in components]
    if len(named) < 2:
        return None
    return components.index(named[0]), components.index(named[1])


def by_component(
    numbers: dict[str, float] | tuple[float, ...], components: tuple[str, ...], *path: str | int
) -> Array:
    """Return ``numbers`` (n,) in the order of the components, 0 where a mapping has none.

    ``numbers`` are a mapping by component, or a tuple that is in order already. Raises InvalidKeyError,
    with the key ``path`` of the numbers, for an unknown component and for a tuple of another length.
    """
    names = ", ".join(components)
    if not isinstance(numbers, dict):
        if len(numbers) != len(components):
            raise InvalidKeyError(f"{len(numbers)} numbers for {names}", *path)
        return np.array(numbers, dtype=float)
    for name in numbers:
        if name not in components:
            raise InvalidKeyError(f"unknown component {name!r}; known: {names}", *path, name)
    return np.array([numbers.get(name, 0.0) for name in components], dtype=float)


def may_be_angle(name: str) -> bool:
    """Test whether a component's name is that of a direction, such as heading and yaw_rad."""
    words = set(re.findall("[a-z]+", name.lower()))
    return not words.isdisjoint(_DIRECTIONS) and words.isdisjoint(_NO_DIRECTIONS)
