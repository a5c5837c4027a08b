"""Derivatives of motions and sensors: numerical ones, by central differences, and those at a state."""

from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from typing import cast

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, with_axes_of, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.models.base import TwiceDifferentiable, WithJacobian

_STEP = 1e-6  # of central differences, relative to a component
_SECOND_STEP = 1e-4  # of differences of Jacobians, which may have errors of 1e-10 by differences
_STATES_PER_CALL = 512  # of a function that takes displaced states side by side
_LEAST_STEP = 1e-4  # in standard deviations of the component
_STATE: ContextVar[Gaussian | None] = ContextVar(
    "state at which derivatives are taken", default=None
)


def central_differences(
    function: Callable[[Array], Array],
    x: Array,
    difference: Callable[[Array, Array], Array] = np.subtract,
    step: float = _STEP,
    spread: Array | None = None,
    side_by_side: bool = False,
) -> Array:
    """Return the derivatives of a function of states by central differences.

    Parameters
    ----------
    function
        Function of states (n, *batch) with values (m, *batch).
    x : array (n, *batch)
        States at which the derivatives are taken.
    difference
        Subtracts two values, for angles with a wrap.
    step : float
        Step, relative to the size of a component.
    spread : array (n[, *batch]), optional
        Standard deviations of the components, by default those of the state in `jacobian_at`. A step
        is at least a share of them. Without a spread it is at least ``step`` units.
    side_by_side : bool
        Call the function for many displaced states at once, (n, *batch, number), which saves calls
        where the batch is small.

    Returns
    -------
    array (m, n, *batch)
        Derivatives.
    """
    # Take the spread of the state that `jacobian_at` works on, unless x are other states than its mean.
    state = _STATE.get()
    if spread is None and state is not None and state.mean.shape == x.shape:
        with np.errstate(invalid="ignore"):  # of a run that has diverged
            spread = np.sqrt(linalg.diagonal(state.cov))
    least = np.full(len(x), step)
    if spread is not None:
        least = _LEAST_STEP * spread
    steps = []
    for i, value in enumerate(x):
        h = np.maximum(step * np.abs(value), with_axes_of(value, least[i]))
        # A component that is zero and has no spread is moved by `step` units.
        steps.append(np.where(h > 0.0, h, step))
    displaced = _displaced_states(x, steps)
    if side_by_side:
        values = iter(_values_side_by_side(function, [*displaced]))
    else:
        values = map(function, displaced)
    columns = []
    for h in steps:
        # df/dx_i = (f(x + h e_i) - f(x - h e_i)) / (2 h)
        ahead = next(values)
        behind = next(values)
        columns.append(difference(ahead, behind) / (2.0 * h))
    return np.stack(columns, axis=1)


def _displaced_states(x: Array, steps: Sequence[Array]) -> Iterator[Array]:
    """Yield x + h_i e_i and then x - h_i e_i, (n, *batch) each, for each component i.

    ``steps`` are the h_i (*batch). The states are made as they are needed, to save memory.
    """
    for i, h in enumerate(steps):
        ahead = x.copy()
        ahead[i] += h
        yield ahead
        behind = x.copy()
        behind[i] -= h
        yield behind


def _values_side_by_side(
    function: Callable[[Array], Array], displaced: Sequence[Array]
) -> list[Array]:
    """Evaluate a function of states (n, *batch) for several arrays of states, many in a call."""
    number = max(1, _STATES_PER_CALL // max(1, displaced[0][0].size))
    values: list[Array] = []
    for first in range(0, len(displaced), number):
        together = function(np.stack(displaced[first : first + number], axis=-1))
        values += [together[..., i] for i in range(together.shape[-1])]
    return values


def jacobian_at(function: WithJacobian, state: Gaussian, k: int, order: int = 1) -> Array:
    """Return the first or second derivatives of a motion or sensor at a state's mean.

    Differences have steps relative to the standard deviations, so that they do not depend on the units.

    Parameters
    ----------
    function : WithJacobian
        Motion or sensor.
    state : Gaussian
        State at whose mean (n, *batch) the derivatives are taken.
    k : int
        Step.
    order : {1, 2}
        Order of the derivatives.

    Returns
    -------
    array (m, n[, *batch]) or (m, n, n[, *batch])
        Jacobian, or Hessian of each component.
    """
    # `central_differences`, which a model may call, takes its steps from this state.
    token = _STATE.set(state)
    try:
        if order == 1:
            return function.jacobian(state.mean, k)
        if hasattr(function, "hessian"):
            return cast(TwiceDifferentiable, function).hessian(state.mean, k)
        return hessian_by_differences(function.jacobian, state.mean, k)
    finally:
        _STATE.reset(token)


def hessian_by_differences(
    jacobian: Callable[[Array, int], Array], x: Array, k: int, side_by_side: bool = False
) -> Array:
    """Return the second derivatives of a function by differences of its Jacobian.

    Parameters
    ----------
    jacobian
        Function of states (n, *batch) and the step, which returns derivatives (m, n, *batch). One matrix
        (m, n) for a batch of states is that of a linear function.
    x : array (n, *batch)
        States at which the derivatives are taken.
    k : int
        Step.
    side_by_side : bool
        Call the function for many displaced states at once, as in `central_differences`.

    Returns
    -------
    array (m, n, n) or (m, n, n, *batch)
        Hessian of each of the m components. Without batch axes it is zero, of a linear function.

    Raises
    ------
    ValueError
        If one matrix for several states changes with the states.
    """
    J = jacobian(x, k)
    if J.ndim == 2 and x.ndim > 1:
        # One matrix for all states: the function is linear, or there is only one state.
        if _is_constant(jacobian, J, x, k):
            return np.zeros((*J.shape, len(x)))
        if x[0].size != 1:
            message = (
                f"gives one matrix {J.shape} for {x[0].size} states, and depends on the states"
            )
            raise ValueError(
                f"jacobian: {message}; one for each state has the shape (m, n, *batch)"
            )

    def rows_of_jacobian(states: Array) -> Array:
        """Return the Jacobians of states (n, *batch) with their m n entries in one axis."""
        batch = states.shape[1:]
        derivatives = with_trailing(jacobian(states, k), len(batch), leading=2)
        # A matrix that all states have in common is repeated.
        of_each_state = np.broadcast_to(derivatives, (*J.shape[:2], *batch))
        return of_each_state.reshape(-1, *batch)

    rows = central_differences(rows_of_jacobian, x, step=_SECOND_STEP, side_by_side=side_by_side)
    return rows.reshape(*J.shape[:2], *x.shape)


def _is_constant(jacobian: Callable[[Array, int], Array], J: Array, x: Array, k: int) -> bool:
    """Test whether a Jacobian at step k has the value J at x, and at states beside x, too."""
    displaced = x + _SECOND_STEP * np.maximum(np.abs(x), 1.0)
    return np.array_equal(jacobian(displaced, k), J, equal_nan=True)
