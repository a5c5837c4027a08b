"""Posterior Cramer-Rao bound of a tracking scenario, along one path or over simulated ones.

Tichavsky, Muravchik & Nehorai 1998. It begins with the start's covariance at the truth. A measurement
that may be missing counts by its probability, which leaves a lower bound. If every run flies the same
path, the bound is that of a filter that knows all accelerations. A filter that has to find them is far
above it.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, with_axes_of, with_trailing
from trackbench.core.distributions import PointMass
from trackbench.core.random_streams import Streams, block_stream
from trackbench.core.sums import mean, total
from trackbench.models.augmented_priors import append_drawn_components
from trackbench.models.base import Motion, SampledMotion, extra_std
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.nonlinear import AdditiveNoise
from trackbench.models.sensors.stacked import Sensors, sensors_of
from trackbench.scenarios.starts.base import Start

BATCHES = 10
"""Number of independent batches of paths."""
_PATHS = 1000
"""Number of paths of each batch."""
_PATHS_WITH_ERRORS = 100
"""Number of paths along which a covariance is turned into errors."""
_FEW = 10
"""Number of paths that may not carry too much of the mean information."""
_MOST_OF_FEW = 0.1
"""Largest share of the mean information that these few paths may carry."""
Squares = Callable[[Array, Array], dict[str, Array]]
"""Function that returns mean squared errors (K,) by quantity, such as ``position``.

Its arguments are the covariances (n, n, K) of the errors and the states (n, K) at which they hold.
"""


class Bound(NamedTuple):
    """Bounds on every RMSE (K,) by quantity."""

    whole: dict[str, Array]
    """bounds from all paths"""
    without_batch: tuple[dict[str, Array], ...] = ()
    """bounds from all batches of paths but one, for each batch"""
    caution: str = ""
    """reason why the mean information may be wrong"""


class Course(NamedTuple):
    """Steps, motion and sensors that a bound is computed for."""

    steps: Sequence[int]
    """numbers (K,) of the steps from the first state on"""
    motion: SampledMotion
    sensor: Sensors
    initial: Array
    """covariance (n, n) of the first state"""
    squares: Squares
    """function that turns covariances of the state into mean squared errors by quantity"""


def has_bound(motion: SampledMotion) -> bool:
    """Test whether a motion is x' = F x + b(k) + N(0, Q) with constant matrices.

    Parameters
    ----------
    motion : SampledMotion
        Motion over one sampling interval.

    Returns
    -------
    bool
        True for a motion with these matrices, of which `motion_matrices` returns F and Q.
    """
    if isinstance(motion, Linear):
        return True
    if not isinstance(motion, AdditiveNoise):
        return False
    # The Jacobian of the equations of one step; it is constant if they are linear in the state.
    J = getattr(motion.step, "J", None)
    return J is not None and J.constant is not None


def motion_of_bound(own_motion: Motion | None, T: float, axes: int) -> SampledMotion:
    """Return the motion for the bound: the target's own, or constant velocity on a fixed path.

    On a fixed path it has no noise, so that the bound is that of a filter that knows all accelerations.

    Parameters
    ----------
    own_motion : Motion or None
        Motion that drives the target. None for a fixed path.
    T : float
        Sampling interval, s.
    axes : int
        Number of axes of the space.

    Returns
    -------
    SampledMotion
        Motion over T seconds.
    """
    motion = own_motion or ConstantVelocity(q=0.0)
    return motion.sampled(T, axes)


def motion_matrices(motion: SampledMotion) -> tuple[Array, Array]:
    """Return F and Q (n, n) of a motion that `has_bound`."""
    assert isinstance(motion, Linear | AdditiveNoise)
    # F is the same at every state and step.
    F = motion.jacobian(np.zeros(len(motion.components)), 1)
    return F, motion.Q


def bound_along_path(course: Course, path: Array) -> Bound:
    """Bound errors along a path that is flown in every run.

    Parameters
    ----------
    course : Course
        Steps, motion and sensors for which a filter is bounded.
    path : array (n, K)
        True states at the K steps of the course.

    Returns
    -------
    Bound
        Bound (K,) on the RMSE of each quantity, and a caution if the path passes over a sensor.
    """
    information = []
    caution = ""
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, x in zip(course.steps[1:], path.T[1:], strict=True):
            information.append(course.sensor.information(x, k))
            if not caution and not np.isfinite(information[-1]).all():
                caution = (
                    f"at step {k} the path passes over a sensor, where the information about an angle "
                    "has no limit: there is no bound from this step on"
                )
        # J' = (Q + F J^-1 F')^-1 + H' R^-1 H, from the covariance `initial` of the first state, J_0^-1.
        P = _bound_of_target(course.motion, course.initial, information)
        # `squares` returns mean squared errors (K,) by quantity, such as the position.
        return Bound(_roots(course.squares(P, path)), caution=caution)


def bound_over_paths(
    course: Course, draw_first_states: Callable[[int, Streams], Array]
) -> Bound | None:
    """Bound errors with the mean information ``E[H' R^-1 H]`` over paths that the motion draws.

    Parameters
    ----------
    course : Course
        Steps, motion and sensors for which a filter is bounded.
    draw_first_states
        Function of a number N and random numbers, which draws N first states (n, N).

    Returns
    -------
    Bound or None
        Bounds (K,) on the RMSE of each quantity. Those without each batch of paths give the standard
        error. None if all paths are equal, or if the sensor is linear, so that the information is equal
        along all paths.
    """
    # A sensor has `H` or `linear` only if it is linear in the state.
    if hasattr(course.sensor, "H") or hasattr(course.sensor, "linear"):
        return None
    # The paths are the same in all experiments, whatever their seed.
    rng = block_stream(0, 0)
    motion = course.motion
    _, Q = motion_matrices(motion)
    start = draw_first_states(BATCHES * _PATHS, rng)
    n = len(start)
    if not Q.any() and (start == start[:, :1]).all():
        return None
    # States of the first paths, step by step: the errors are computed along these.
    states = [start[:, :_PATHS_WITH_ERRORS]]
    # Caution against a mean of which a few paths carry a large share.
    largest = _LargestShare()

    def mean_information() -> Iterator[Array]:
        """Yield the mean information (n, n, 1 + BATCHES) of each step.

        The first is that of all batches of paths, the others are those without one batch each. There are
        `_PATHS` paths in a batch. On the way the states of some paths are appended to ``states``, and
        the information of each step is added to ``largest``, both of the enclosing function.
        """
        # Draw all paths from their first states `start` (n, N). The motion may have components beyond
        # the n of the target, such as an acceleration.
        x = append_drawn_components(start, extra_std(motion), rng)
        for k in course.steps[1:]:
            x = motion.transition(x, k).sample(rng)
            states.append(x[:n, :_PATHS_WITH_ERRORS])
            information = with_trailing(course.sensor.information(x[:n], k), 1, leading=2)
            of_path = np.broadcast_to(information, (n, n, BATCHES * _PATHS))
            largest.add(of_path, k)
            # Both functions work along the last axis: the paths of a batch, and then the batches.
            batches = mean(of_path.reshape(n, n, BATCHES, _PATHS))
            whole = total(batches)[..., None]
            yield np.concatenate([whole / BATCHES, (whole - batches) / (BATCHES - 1)], axis=-1)

    initial = np.repeat(course.initial[..., None], 1 + BATCHES, axis=-1)
    P = _bound_of_target(motion, initial, mean_information())
    paths = np.stack(states, axis=1)
    bounds = []
    for i in range(1 + BATCHES):
        bounds.append(_roots(_mean_squares(course.squares, P[:, :, i], paths)))
    return Bound(whole=bounds[0], without_batch=tuple(bounds[1:]), caution=largest.caution)


def _bound_of_target(motion: SampledMotion, initial: Array, information: Iterable[Array]) -> Array:
    """Bound the errors of the target's n components by those of all components of the motion.

    A motion may have further components, such as an acceleration. They begin at N(0, s^2), are not
    measured, and have to be estimated, too. ``initial`` (n, n[, B]) and the ``information`` (n, n[, B])
    of each of T steps are of the target's components; so are the bounds (n, n[, B], T + 1).
    """
    F, Q = motion_matrices(motion)
    n = len(initial)
    batch = initial.shape[2:]
    variances = np.diag(np.square(extra_std(motion)))
    unmeasured = np.zeros_like(variances)
    padded = (linalg.block_diagonal([gained, unmeasured], batch) for gained in information)
    first = linalg.block_diagonal([initial, variances], batch)
    return posterior_cramer_rao(first, F, Q, padded)[:n, :n]


class _LargestShare:
    """Largest share of a step's mean information that comes from a few paths.

    Where the information has no mean, as that of a bearing at r = 0 in the plane, E[1 / r^2], the mean
    over more paths grows without end, and a few paths carry a large share of it.
    """

    def __init__(self) -> None:
        self._share = 0.0
        self._step = 0

    def add(self, information: Array, k: int) -> None:
        """Compare the largest share of step k with the largest one so far, and keep the larger.

        The share is that of the `_FEW` paths with the most information about a component of the state,
        of the information (n, n, N) of all N paths.
        """
        for of_component in linalg.diagonal(information):
            of_all_paths = float(total(of_component))
            if of_all_paths > 0.0:
                of_few_paths = float(total(np.partition(of_component, -_FEW)[-_FEW:]))
                share = of_few_paths / of_all_paths
                if share > self._share:
                    self._share = share
                    self._step = k

    @property
    def caution(self) -> str:
        """Reason to doubt the mean; empty if there is none."""
        if self._share < _MOST_OF_FEW:
            return ""
        return (
            f"{_FEW} of {BATCHES * _PATHS} simulated paths carry {self._share:.0%} of the information "
            f"of step {self._step}: its mean may not exist, as where a target may pass over a sensor, "
            "and the bound changes with the number of paths"
        )


def _mean_squares(squares: Squares, P: Array, paths: Array) -> dict[str, Array]:
    """Return the mean squared errors (K,) by quantity, averaged over paths (n, K, N).

    ``squares`` computes them from the covariances P (n, n, K) at the states (n, K) of one path.
    """
    by_path = [squares(P, np.ascontiguousarray(path)) for path in np.moveaxis(paths, -1, 0)]
    averages = {}
    for name in by_path[0]:
        averages[name] = mean(np.stack([errors[name] for errors in by_path], axis=-1))
    return averages


def _roots(squares: dict[str, Array]) -> dict[str, Array]:
    return {name: np.sqrt(square) for name, square in squares.items()}


def why_no_bound(
    motion: SampledMotion,
    sensor: Sensors,
    start: Start,
    n_x: int,
    is_recorded: bool,
    has_faults: bool,
) -> str | None:
    """Explain why there is no bound for these components of a scenario.

    Delays of sensors are no reason: a bound for measurements on time is also valid for late ones.

    Parameters
    ----------
    motion : SampledMotion
        Motion for the bound, as `motion_of_bound` returns it.
    sensor : Sensors
        True sensor, or all sensors as one.
    start : Start
        Start of the target's state.
    n_x : int
        Number of components of the target's state.
    is_recorded : bool
        True if the measurements are recorded.
    has_faults : bool
        True if a sensor has faults.

    Returns
    -------
    str or None
        Reason, in words. None if there is a bound.
    """
    if is_recorded:
        return "the data are recorded"
    if has_faults:
        return "the bound is of a sensor without faults"
    if not has_bound(motion):
        return "the target's motion is not x' = F x + b with constant F and Q"
    sensors = sensors_of(sensor)
    if any(each.outliers is not None or each.bias for each in sensors):
        return "the bound is of normal errors without a bias"
    if any(each.has_noise_of_state for each in sensors):
        return "the covariance of the noise depends on the state"
    # Any state: R does not depend on it any more, and is one matrix (n_z, n_z). Only a plugin's sensor
    # may return R (n_z, n_z, 1), for this one state.
    state = np.ones((n_x, 1))
    with np.errstate(all="ignore"):
        covariances = [each.measurement(state, 1).cov for each in sensors]
    if any(linalg.is_singular(R.reshape(R.shape[:2])) for R in covariances):
        return "a component of the measurement has no noise (R is singular)"
    if start.scans > 1 and extra_std(motion):
        return (
            f"the start `{start.kind}` has errors of the velocity that depend on the target's "
            "acceleration, which the motion has as a further component"
        )
    if start.prior_type(sensor) is PointMass:
        return "the first state is known"
    # A start whose prior is not normal does not override `bound`.
    if type(start).bound is Start.bound:
        return f"the bound is of a normal first state, and the start is `{start.kind}`"
    return None


def posterior_cramer_rao(initial: Array, F: Array, Q: Array, information: Iterable[Array]) -> Array:
    """Bound the mean squared error matrix of a linear motion with Gaussian noise from below.

    ``J_{k+1} = (Q + F J_k^-1 F')^-1 + E[H' R^-1 H]``, eq. 21 of Tichavsky et al. 1998 with
    D11 = F' Q^-1 F in a form that also accepts a singular Q.

    Parameters
    ----------
    initial : (n, n[, B])
        Bound before the first step, J_0^-1; of B problems side by side.
    F, Q : (n, n)
        Transition matrix and noise covariance.
    information : iterable of (n, n[, B])
        E[H' R^-1 H] of each of the T steps, over the states of that step.

    Returns
    -------
    (n, n[, B], T + 1)
        Bounds J_k^-1, the initial one first.
    """
    bounds = [initial]
    for gained in information:
        predicted = linalg.sandwich(F, bounds[-1])
        predicted = predicted + with_axes_of(predicted, Q)
        bounds.append(_inverse(_inverse(predicted) + gained))
    return np.stack(bounds, axis=-1)


def _inverse(P: Array) -> Array:
    """Invert through a unit diagonal, because meters and meters per second differ by many decades."""
    scale = 1.0 / np.sqrt(linalg.diagonal(P))
    both = linalg.outer(scale, scale)
    return both * linalg.inverse(both * P)
