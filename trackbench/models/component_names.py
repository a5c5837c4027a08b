"""Names of the components of a state: positions and velocities, and numbers by component."""

from collections.abc import Sequence
from functools import cache
from itertools import product

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.field_types import InvalidKeyError

AXES = ("x", "y", "z")


@cache
def position_velocity_names(axes: int) -> tuple[str, ...]:
    """Return the names of position and velocity along ``axes`` axes in turn: px, vx, py, ..."""
    return tuple(kind + axis for axis, kind in product(AXES[:axes], "pv"))


def has_position_and_velocity(components: tuple[str, ...]) -> bool:
    """Test whether the state is position and velocity along each of one to three axes.

    Parameters
    ----------
    components : tuple of str
        Names of the state's components, in order.

    Returns
    -------
    bool
        True for px, vx, py, vy, ... and nothing else.
    """
    return components in (
        position_velocity_names(1),
        position_velocity_names(2),
        position_velocity_names(3),
    )


def by_component(
    numbers: dict[str, float] | tuple[float, ...], components: tuple[str, ...], *path: str | int
) -> Array:
    """Return numbers in the order of the components.

    Parameters
    ----------
    numbers : dict of float or tuple of float
        Numbers by component, 0 where there is none, or numbers that are in order already.
    components : tuple of str
        Names of the n components, in order.
    *path : str or int
        Key of the numbers in the config, for an error.

    Returns
    -------
    array (n,)
        The numbers in order.

    Raises
    ------
    InvalidKeyError
        For an unknown component, and for a tuple of another length.
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


MOST_NAMES = 10
"""Names of components that `few_names` writes out."""


def few_names(names: Sequence[str]) -> str:
    """Write the names of components; of more than ten the first, the last and their number."""
    if len(names) <= MOST_NAMES:
        return " ".join(names)
    return f"{names[0]} ... {names[-1]}, {counted(len(names), 'component')}"
