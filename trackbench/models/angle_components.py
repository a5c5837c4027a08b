"""Components that are angles: found by innovations, in equations, or by their names; their unit."""

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from math import isclose, pi

import numpy as np

from trackbench.field_types import InvalidKeyError
from trackbench.metrics import unit_of
from trackbench.models.base import SampledMotion, Sensor, angle_rows
from trackbench.models.equations import Equations, Term
from trackbench.models.expression_trees import Node, in_order, is_constant
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.nonlinear import SteppedMotion
from trackbench.models.motions.unequal_intervals import Irregular

_DIRECTIONS = frozenset(("heading", "bearing", "azimuth", "yaw", "course"))
"""Words of the names of components that are angles."""
_NO_DIRECTIONS = frozenset(("rate", "dot", "bias", "offset", "velocity", "speed"))
"""Words beside them in the names of components that are none."""


def measured_angle_rows(sensor: Sensor) -> tuple[int, ...]:
    """Return the rows of the measured angles: a whole turn changes nothing in their innovation.

    Parameters
    ----------
    sensor : Sensor
        Sensor, whose `innovation` wraps angles.

    Returns
    -------
    tuple of int
        Rows of the measurement that are angles, rad.
    """
    n = len(sensor.components)
    zero = np.zeros((n, n))
    # Component i of column i differs by a whole turn, of which an angle's innovation is zero, or by a
    # tenth of a radian, which an angle's innovation keeps.
    of_turn = np.diagonal(sensor.innovation(2.0 * np.pi * np.eye(n), zero))
    of_tenth = np.diagonal(sensor.innovation(0.1 * np.eye(n), zero))
    is_angle = np.isclose(of_turn, 0.0, atol=1e-9) & np.isclose(of_tenth, 0.1)
    return tuple(np.flatnonzero(is_angle).tolist())


def may_be_angle(name: str) -> bool:
    """Test whether a component's name is that of a direction, such as heading and yaw_rad."""
    words = set(re.findall("[a-z]+", name.lower()))
    return not words.isdisjoint(_DIRECTIONS) and words.isdisjoint(_NO_DIRECTIONS)


def unit_of_component(name: str, angles: Collection[str]) -> str:
    """Return the unit of a component of the state: rad for an angle without another; empty if unknown.

    ``angles`` are the names of the components that are angles.
    """
    unit = unit_of(f"rmse_{name}")  # that of the component's error
    if not unit and name in angles:
        return "rad"
    return unit


def with_angle_names(motion: SampledMotion, names: Collection[str]) -> SampledMotion:
    """Return the motion with the components of these names marked as angles, beside its own angles.

    Parameters
    ----------
    motion : SampledMotion
        Motion.
    names : collection of str
        Names of components that are angles, rad. Names that are no components have no effect.

    Returns
    -------
    SampledMotion
        Motion with these angles. A motion of a plugin is returned as it is: it names its angles itself.
    """
    known = angle_names(motion).union(names)
    rows = tuple(i for i, name in enumerate(motion.components) if name in known)
    if rows == angle_rows(motion):
        return motion
    # An `Irregular` computes its `rows_of_angles` from this field, in which all angles stand.
    if isinstance(motion, Irregular):
        return replace(motion, named_angles=rows)
    if isinstance(motion, Linear | SteppedMotion):
        return replace(motion, rows_of_angles=rows)
    return motion


def angle_names(motion: SampledMotion) -> set[str]:
    """Return the names of the components that are angles."""
    return {motion.components[i] for i in angle_rows(motion)}


def angles_in_equations(
    equations: Equations, terms: Mapping[str, Term], key: str
) -> tuple[str, ...]:
    """Find the components whose expression is an angle in rad, as an `atan2` or a sum with one.

    Parameters
    ----------
    equations : Equations
        Names that the expressions may use.
    terms : mapping of str to Term
        Expressions by component.
    key : str
        Key of the config that has them, for an error.

    Returns
    -------
    tuple of str
        Names of the components that are angles.

    Raises
    ------
    InvalidKeyError
        For an angle in another unit, and for an expression that is mistaken.
    """
    names = []
    for name, term in terms.items():
        turns = turns_at_cut(equations.parse(term, key, name))
        if turns and not isclose(turns, 1.0):
            message = f"an angle that jumps by {2.0 * pi * turns:.4g} at the cut of atan2"
            way_on = "write it in rad, or `angles: []` if no target crosses the cut"
            raise InvalidKeyError(f"{message}; only angles in rad wrap: {way_on}", key, name)
        if turns:
            names.append(name)
    return tuple(names)


def components_turning_with(
    angles: Collection[str], equations: Equations, terms: Mapping[str, Term], key: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Find the components that jump where one of the state's ``angles`` does.

    Parameters
    ----------
    angles : collection of str
        Names of the state's components that are angles, rad.
    equations : Equations
        Names that the expressions may use.
    terms : mapping of str to Term
        Expressions by component.
    key : str
        Key of the config that has them, for an error.

    Returns
    -------
    angular : tuple of str
        Components that jump by 2 pi, up or down, and so are angles themselves.
    multiples : tuple of str
        Components that jump by any other number of turns. They are multiples of an angle, as in other
        units.

    Raises
    ------
    InvalidKeyError
        For an expression that is mistaken.
    """
    angular = []
    multiples = []
    for name, term in terms.items():
        turns = turns_at_cut(equations.parse(term, key, name), angles)
        if isclose(turns, 1.0):
            angular.append(name)
        elif turns:
            multiples.append(name)
    return tuple(angular), tuple(multiples)


def turns_at_cut(expression: Node, angles: Collection[str] = ()) -> float:
    """Count the turns by which an expression jumps where an angle in it crosses its cut.

    Parameters
    ----------
    expression : Node
        Expression.
    angles : collection of str
        Names of variables that are angles, beside every `atan2`.

    Returns
    -------
    float
        The jump over 2 pi. It is 1 for an angle in rad, alone or in a sum, 2 for twice the angle, and
        57.3 for one in degrees. It is 0 for an `atan2` without a cut, such as the elevation
        ``atan2(z, sqrt(x**2 + y**2))``, and for any other expression.
    """
    turns: dict[int, float] = {}
    never_negative: dict[int, bool] = {}
    for node in in_order([expression]):
        jumps = [turns[id(a)] for a in node.arguments]
        signs = [never_negative[id(a)] for a in node.arguments]
        turns[id(node)] = 1.0 if node.name in angles else _turns(node, jumps, signs)
        # The value of a node that is no number is 0.
        is_positive = node.operation in ("sqrt", "abs", "exp") or node.value > 0.0
        is_even_power = node.operation == "**" and node.arguments[1].value in (2.0, 4.0, 6.0)
        of_never_negative = node.operation in ("+", "*", "/") and all(signs)
        never_negative[id(node)] = is_positive or is_even_power or of_never_negative
    return turns[id(expression)]


def _turns(node: Node, jumps: list[float], never_negative: list[bool]) -> float:
    """Count the turns by which a node's value jumps at the cut of an angle, as `turns_at_cut`.

    ``jumps`` are the turns of its arguments; ``never_negative`` marks arguments that are never negative.
    """
    match node.operation:
        case "atan2":
            # The cut is where the second argument is negative.
            return 0.0 if never_negative[1] else 1.0
        case "+" | "-" | "negative":
            # Angles in a sum cross their cuts in different states: the largest jump counts.
            return max(jumps)
        case "*" if any(jumps) and any(map(is_constant, node.arguments)):
            # A factor of an angle, such as 180/pi.
            u, v = node.arguments
            factor = u.value if is_constant(u) else v.value
            return abs(max(jumps) * factor)
        case "/" if any(jumps) and is_constant(node.arguments[1]):
            return abs(max(jumps) / node.arguments[1].value)
        case _:
            # Periodic functions such as sin do not jump. Other functions of an angle are taken for no
            # angle.
            return 0.0
