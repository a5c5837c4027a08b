"""Exact posterior of a state of two components, on a grid that moves with it; the noise is Gaussian.

The logarithm of the density is stored at the nodes of a grid that moves with the posterior. The axes of
the grid are those in which the noise has no correlation and the prediction has unit covariance. The
density moves along the inverse of the motion's map, and one axis after the other is convolved with the
noise, however narrow. If the map has no inverse, the Chapman-Kolmogorov equation is a sum over so many
nodes that the noise reaches from the image of each to the next.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import linalg
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.cumulative_probabilities import normal_cdf
from trackbench.core.distributions import LOG_2PI, Distribution, Gaussian, per_run_moments
from trackbench.core.elementary import exp, log
from trackbench.core.gauss_hermite_points import gauss_hermite
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.sums import mean, total
from trackbench.filters.base import WHOLE_FILTER, Filter, WrongReturnError
from trackbench.models.base import Model, SampledMotion, Scene, angle_rows
from trackbench.models.likelihood import log_likelihood
from trackbench.models.numerical_derivatives import central_differences
from trackbench.registry import register

_TOLERANCE = 1e-6  # of means in standard deviations, and of covariances likewise, by half the nodes
_NEGLIGIBLE = 1e-6  # probability of an angle beyond half a turn from its mean
_DEPTH = 36.0  # log-density below the largest at which a posterior ends: 8.5 standard deviations
_REACH = 8.0  # standard deviations of the noise at which it ends
_MARGIN = 3  # nodes about a posterior
_SEARCHES = 3  # for the part of the box that the measurement leaves
_ITERATIONS = 20  # of Newton's method
_OFFSETS = range(-2, 4)  # of six neighbors on a line, for an interpolation of degree five
_EDGE = 2, 3  # nodes that these need before the first and after the last interval
_SMALLEST = 1e-300
_MASS_TOLERANCE = 1e-5
_MOST_PARTS = 32  # of a cell
_RELEVANT = 20.0  # log-density below the largest at which a node is relevant: the rest has 1e-9
_HERMITE = (
    7  # nodes of the noise: exact for densities that are polynomials of degree 13 over its width
)


class UnresolvedError(ValueError):
    """Grid whose nodes do not resolve a prediction."""


@dataclass(frozen=True)
class Map:
    """Motion x' = f(x) + w: f and its Jacobian of states (2, N), and the covariance Q (2, 2) of w."""

    f: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    Q: Array


@dataclass(frozen=True)
class Box:
    """Nodes x = basis v at the centers of equal cells: v_i = low_i + (j + 1/2) step_i."""

    basis: Array
    low: Array
    step: Array
    shape: tuple[int, int]

    @cached_property
    def nodes(self) -> Array:
        """Nodes (2, n1 n2), the second axis fastest."""
        lines = [
            low + (np.arange(n) + 0.5) * step
            for low, step, n in zip(self.low, self.step, self.shape, strict=True)
        ]
        v = np.stack([np.repeat(lines[0], self.shape[1]), np.tile(lines[1], self.shape[0])])
        return linalg.matvec(self.basis, v)

    @property
    def cell(self) -> float:
        """Area of a cell."""
        return float(abs(_determinant(self.basis)) * self.step[0] * self.step[1])

    def places(self, x: Array) -> Array:
        """Return the indices (2, N) of states, which need not be whole."""
        v = linalg.matvec(_inverse(self.basis), x)
        return np.asarray((v - self.low[:, None]) / self.step[:, None] - 0.5)

    def cut_out(self, first: Array, last: Array, n: int) -> "Box":
        """Cut out the cells from ``first`` (2,) to ``last`` (2,) along the axes, as n by n new cells."""
        high = self.low + (last + 1) * self.step
        low = self.low + first * self.step
        return Box(self.basis, low, (high - low) / n, (n, n))


@dataclass(frozen=True)
class Plane:
    """Log-density at the nodes of a box (n1 n2,), and log p(z) of the last measurement."""

    box: Box
    log_density: Array
    evidence: float = np.nan

    def within(self, depth: float) -> Mask:
        """Return the nodes (n1 n2,) whose log-density is at most so far below the largest."""
        return np.asarray(self.log_density > self.log_density.max() - depth)

    @cached_property
    def mass(self) -> Array:
        """Probability at each node, in sum one."""
        p = exp(self.log_density - self.log_density.max())
        return np.asarray(p / total(p))

    @cached_property
    def moments(self) -> Gaussian:
        """Mean (2,) and covariance (2, 2)."""
        return _moments_of_nodes(self.box.nodes, self.mass)


State = Plane | Array


class Planes(NamedTuple):
    """Posterior of each run, and the posterior by half as many nodes that it is checked against."""

    posteriors: tuple[State, ...]
    checks: tuple[State, ...]


@register("filters", "grid-2d")
@dataclass(frozen=True, kw_only=True)
class PlaneGrid(Filter[Planes]):
    """Exact posterior of a state of two components with additive Gaussian noise: no RMSE is smaller.

    A grid of `nodes` by `nodes` moves with the posterior. The density moves along the inverse of the
    motion's map and is convolved with the noise, however narrow. If the map has no inverse, the
    prediction is a sum over all nodes, which takes some ten times as long and needs noise that reaches
    from node to node. The filter fails where half as many nodes change a
    mean or a covariance by a millionth. Likelihoods of any law are used as they are.
    """

    loops_over_runs: ClassVar[bool] = True
    density_only: ClassVar[bool] = True

    nodes: Annotated[int, Ge(32)] = 128
    """nodes along each axis; a step of a run takes about 0.03 s of CPU time at 128, and 0.12 s at 256"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject other than two components, and a prior or noise that is not Gaussian."""
        motion = scenario.model.motion
        n = len(motion.components)
        if n != 2:
            return {WHOLE_FILTER: f"grid-2d needs a state of two components; this one has {n}"}
        if not issubclass(scenario.prior_type, Gaussian):
            return {WHOLE_FILTER: "grid-2d needs a Gaussian start"}
        # The scenario's first step has the start; the first transition leads to the next step.
        step_after_start = int(scenario.steps[0]) + 1
        transition = motion.transition(np.zeros((2, 1)), step_after_start)
        if not isinstance(transition, Gaussian) or transition.cov.ndim > 2:
            return {WHOLE_FILTER: "grid-2d needs additive Gaussian noise of constant covariance"}
        return {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Planes:
        """Return the prior of each run on nodes, or the state itself if it is known.

        Each posterior is computed a second time with half as many nodes along each axis, as a check that
        the nodes resolve it. Raises WrongReturnError if the prior has no density and is no known state
        either.
        """
        runs = range(prior.mean.shape[1])
        if not np.any(prior.cov):
            # A known state has no density to check.
            known = tuple(prior.mean[:, run] for run in runs)
            return Planes(posteriors=known, checks=known)
        moments = per_run_moments(prior)
        priors = [Gaussian(moments.mean[:, run], moments.cov[..., run]) for run in runs]
        if any(linalg.is_singular(of_run.cov) for of_run in priors):
            raise WrongReturnError("init", "a part of the prior has no density: raise its `sigma`")
        nodes, check_nodes = self._node_counts
        return Planes(
            posteriors=tuple(over_prior(of_run, nodes) for of_run in priors),
            checks=tuple(over_prior(of_run, check_nodes) for of_run in priors),
        )

    @property
    def _node_counts(self) -> tuple[int, int]:
        """Number of nodes along an axis of the posterior, and number along an axis of its check."""
        return self.nodes, self.nodes // 2

    def step(self, model: Model, state: Planes, z: Array, k: int, rng: Generator) -> Planes:
        """Condition each run on the measurement z (n_z, M) of step k.

        Raises WrongReturnError if half as many nodes give other moments.
        """
        motion = _map(model.motion, self.estimate(state), k)  # f, its Jacobian and Q
        nodes, check_nodes = self._node_counts
        posteriors = []
        checks = []
        for run, (old, old_check) in enumerate(zip(state.posteriors, state.checks, strict=True)):

            def log_density_of_z(x: Array, z: Array = z[:, run : run + 1]) -> Array:
                """Return log p(z | x) (N,) of states x (2, N), for the measurement z of this run."""
                return log_likelihood(model.sensor, z, x[:, None], k)[0]

            try:
                posteriors.append(condition(old, motion, log_density_of_z, nodes))
                checks.append(condition(old_check, motion, log_density_of_z, check_nodes))
            except UnresolvedError as error:
                raise self._unresolved(k, f": {error}") from None
        planes = Planes(posteriors=tuple(posteriors), checks=tuple(checks))
        if not _largest_difference(planes) <= _TOLERANCE:  # or NaN
            raise self._unresolved(k, "")
        for i in angle_rows(model.motion):
            if _most_beyond_half_a_turn(planes.posteriors, i) > _NEGLIGIBLE:
                name = model.motion.components[i]
                message = f"at step {k} the angle {name!r} may differ by more than half a turn"
                raise WrongReturnError(
                    "step", f"{message}, and grid-2d averages it as a number; narrow the start"
                )
        return planes

    def _unresolved(self, k: int, why: str) -> WrongReturnError:
        """Return the error of step k; ``why`` is a reason after a colon, or empty."""
        message = (
            f"grid-2d does not resolve the posterior at step {k} with `nodes: {self.nodes}`{why}"
        )
        return WrongReturnError("step", f"{message}; raise `nodes`, or narrow the start")

    def estimate(self, state: Planes) -> Gaussian:
        """Return the posterior mean (2, M) and covariance (2, 2, M)."""
        return _moments_of_runs(state.posteriors)

    def posterior(self, state: Planes) -> Posterior | None:
        """Return the density on the grid; None for a known state, which has none."""
        planes = tuple(plane for plane in state.posteriors if isinstance(plane, Plane))
        if len(planes) < len(state.posteriors):
            return None
        return PlanePosterior(planes)

    def log_likelihood(self, state: Planes) -> Array:
        """Evaluate log p(z_k | z_1..k-1) (M,), exact; NaN before the first measurement.

        A known state, which is no `Plane`, is one before the first measurement.
        """
        return np.array(
            [plane.evidence if isinstance(plane, Plane) else np.nan for plane in state.posteriors]
        )


def _most_beyond_half_a_turn(states: Iterable[State], row: int) -> float:
    """Return the largest probability, over the runs, of angles beyond half a turn from their mean."""
    most = 0.0
    for state in states:
        if isinstance(state, Plane):  # a known state, an array, has no spread
            distance = np.abs(state.box.nodes[row] - state.moments.mean[row])
            most = max(most, float(total(np.where(distance > np.pi, state.mass, 0.0))))
    return most


def _moments_of_runs(states: Iterable[State]) -> Gaussian:
    """Return the means (2, M) and covariances (2, 2, M) of the states of M runs."""
    means = []
    covs = []
    for state in states:
        if isinstance(state, Plane):
            means.append(state.moments.mean)
            covs.append(state.moments.cov)
        else:  # a known state
            means.append(state)
            covs.append(np.zeros((2, 2)))
    return Gaussian(np.stack(means, axis=-1), np.stack(covs, axis=-1))


def _map(motion: SampledMotion, state: Gaussian, k: int) -> Map:
    """Express the motion to step k as a map with additive noise.

    Its Jacobian is that of central differences, with steps relative to the spread of state and noise.
    One spread (2,) serves all runs: the mean of their variances, plus those of the noise. ``state`` has
    the mean (2, M) and the covariance (2, 2, M).
    """

    def f(x: Array) -> Array:
        """Move states x (2, N) without noise."""
        return motion.transition(x[:, None], k).mean[:, 0]

    # `conflicts` has rejected a Q that depends on the state.
    Q = motion.transition(np.zeros((2, 1)), k).cov.reshape(2, 2)
    spread = np.sqrt(mean(linalg.diagonal(state.cov)) + np.diagonal(Q))
    return Map(f, lambda x: central_differences(f, x, spread=spread), Q)


def _largest_difference(both: Planes) -> float:
    """Return the largest difference of the posterior from its check, in standard deviations.

    The check is the posterior by half as many nodes.
    """
    moments = _moments_of_runs(both.posteriors)
    check = _moments_of_runs(both.checks)
    sd = np.sqrt(linalg.diagonal(moments.cov))
    of_means = np.abs(check.mean - moments.mean) / sd
    of_covariances = np.abs(check.cov - moments.cov) / (sd[:, None] * sd)
    return float(max(of_means.max(), of_covariances.max()))


def over_prior(prior: Gaussian, n: int) -> Plane:
    """Put a prior on nodes over 8.5 standard deviations to either side of its mean.

    Parameters
    ----------
    prior : Gaussian
        Prior of one run: mean (2,), covariance (2, 2), which must be positive definite.
    n : int
        Number of nodes along each axis.

    Returns
    -------
    Plane
        Log-density at the nodes (n^2,), without log p(z).
    """
    # On these axes the prior has unit covariance.
    basis = linalg.cholesky(prior.cov)
    span = np.full(2, np.sqrt(2.0 * _DEPTH))  # 8.5
    center = linalg.matvec(_inverse(basis), prior.mean)
    box = Box(basis, center - span, 2.0 * span / n, (n, n))
    log_norm = LOG_2PI + log(abs(_determinant(basis)))
    return Plane(box, _normal_part(prior, box.nodes) - log_norm)


def condition(
    old: Plane | Array, motion: Map, log_likelihood: Callable[[Array], Array], n: int
) -> Plane:
    """Condition on one step of the motion and one measurement, on n by n nodes.

    Parameters
    ----------
    old : Plane or array (2,)
        Posterior of the step before, or a known state.
    motion : Map
        Motion over the step.
    log_likelihood : callable
        log p(z | x) (N,) of states (2, N).
    n : int
        Nodes along each axis.

    Returns
    -------
    Plane
        Posterior, with log p(z).

    Raises
    ------
    UnresolvedError
        If the noise is narrower than the distance of the nodes and the map has no inverse, if the nodes
        of ``old`` are too few, or if the measurement has no likelihood at any node.
    """
    if isinstance(old, Plane) and min(old.box.shape) < len(_OFFSETS):
        raise UnresolvedError(f"{len(_OFFSETS)} nodes or more are needed along each axis")
    # Step 1: a box around all that the prediction reaches, and a way to compute it.
    box, variances = _predicted_box(old, motion, n)
    predict, log_predicted = _predictor(old, motion, box, variances)
    # Step 2: cut the box to what the measurement leaves of it. If that is a small part, search in it
    # once more, with n / 2 nodes along each axis, to save time. The last box has n again.
    for search in range(_SEARCHES):
        if search > 0:
            log_predicted = predict(box)
        log_joint = log_predicted + log_likelihood(box.nodes)
        is_likely = (log_joint > log_joint.max() - _DEPTH).reshape(box.shape)
        if not is_likely.any():
            raise UnresolvedError("the measurement has no likelihood at any node")
        # The first and the last likely row and column, with a margin within the box.
        rows = np.flatnonzero(is_likely.any(axis=1))
        columns = np.flatnonzero(is_likely.any(axis=0))
        first = np.maximum([rows[0] - _MARGIN, columns[0] - _MARGIN], 0)
        last = np.minimum([rows[-1] + _MARGIN, columns[-1] + _MARGIN], np.array(box.shape) - 1)
        # Another search is worth it if less than 80 % of the nodes along an axis are left.
        is_small = ((last - first + 1) < 0.8 * np.array(box.shape)).any()
        searches_on = is_small and search < _SEARCHES - 1
        box = box.cut_out(first, last, n // 2 if searches_on else n)
        if not is_small:
            break
    # Step 3: the posterior there, p(z | x) p(x) / p(z).
    log_joint = predict(box) + log_likelihood(box.nodes)
    top = log_joint.max()
    evidence = top + log(total(exp(log_joint - top)) * box.cell)
    return Plane(box, log_joint - evidence, float(evidence))


def _predicted_box(old: Plane | Array, motion: Map, n: int) -> tuple[Box, Array]:
    """Lay a box of n by n nodes around the prediction, with the noise's variances (2,) on its axes.

    The prediction ends `_REACH` standard deviations of the noise from the image of any likely state. A
    state is likely if its log-density is at most `_DEPTH` below the largest. ``old`` is the posterior
    before the motion, or a known state (2,).
    """
    if isinstance(old, Plane):
        likely = old.within(_DEPTH)
        moved = motion.f(old.box.nodes[:, likely])
        mass = old.mass[likely]
    else:
        moved = motion.f(old[:, None])
        mass = np.ones(1)
    # Axes in which the prediction's covariance is one and the noise's diagonal.
    L = linalg.cholesky(_moments_of_nodes(moved, mass).cov + motion.Q)
    whitened = linalg.solve_lower(L, linalg.solve_lower(L, motion.Q).T)
    variances, V = linalg.eigen(linalg.symmetrize(whitened))
    basis = linalg.matmul(L, V)
    variances = np.maximum(variances, 0.0)
    # Every likely state's image, and the noise about it.
    v = linalg.matvec(_inverse(basis), moved)
    reach = _REACH * np.sqrt(variances)
    low = v.min(axis=1) - reach
    high = v.max(axis=1) + reach
    return Box(basis, low, (high - low) / n, (n, n)), variances


def _predictor(
    old: Plane | Array, motion: Map, box: Box, variances: Array
) -> tuple[Callable[[Box], Array], Array]:
    """Choose the function that computes the prediction's log-density in a part of the box.

    Return it, and its result at the nodes of the whole box. ``old`` is the posterior before the motion,
    or a known state (2,). ``variances`` (2,) are those of the noise on the axes of the box.
    """
    if not isinstance(old, Plane):
        if not np.all(variances > 0.0):
            raise UnresolvedError("a known first state needs noise of both components")
        predict = partial(_of_known, old, motion, variances)
        return predict, predict(box)
    # Way 1: the inverse of the map, if there is one.
    if _keeps_orientation(old, motion):
        predict = partial(_by_inverse, old, motion, variances)
        log_predicted = predict(box)
        # Where the map has no inverse, mass is lost, and its sum is not one.
        if abs(total(exp(log_predicted)) * box.cell - 1.0) <= _MASS_TOLERANCE:
            return predict, log_predicted
    # Way 2: a sum over so many nodes that the noise reaches from the image of each to the next.
    parts = _parts(old, motion, box.basis, variances)
    if parts.prod() > _MOST_PARTS:
        raise UnresolvedError(
            "the noise of the motion is too narrow for the nodes, and its map has no inverse that they "
            "resolve"
        )
    if parts.prod() > 1.0:  # cut the cells
        n1, n2 = (parts * old.box.shape).astype(int)
        finer = Box(old.box.basis, old.box.low, old.box.step / parts, (n1, n2))
        old = Plane(finer, _interpolate(old, finer.nodes))
    predict = partial(_by_sums, old, motion, variances)
    return predict, predict(box)


def _of_known(state: Array, motion: Map, variances: Array, box: Box) -> Array:
    """Evaluate log N(x'; f(x), Q) of a known state x (2,), in the axes of the box."""
    v = linalg.matvec(_inverse(box.basis), box.nodes - motion.f(state[:, None]))
    return np.asarray(-0.5 * total(v * v / variances[:, None], axis=0) - _scale(box, variances))


def _scale(box: Box, variances: Array) -> Array:
    """Return the logarithm by which the noise's density is normalized.

    It is ``log(2 pi sqrt(v_1 v_2) |det basis|)``, with the ``variances`` v on the axes of the box.
    """
    return LOG_2PI + log(abs(_determinant(box.basis))) + 0.5 * log(variances[0] * variances[1])


def _parts(old: Plane, motion: Map, basis: Array, variances: Array) -> Array:
    """Count the parts (2,) into which a cell is cut along each axis of the old box.

    The images of neighboring parts are within a standard deviation of the noise, along both axes of
    ``basis``, on which the noise has the ``variances`` (2,). The number is infinite if an axis has no
    noise: a sum over nodes then cannot resolve the prediction.
    """
    is_relevant = old.within(_RELEVANT).reshape(old.box.shape)
    moved = linalg.matvec(_inverse(basis), motion.f(old.box.nodes)).reshape(2, *old.box.shape)
    parts = []
    for axis in (0, 1):
        along_axis = np.moveaxis(is_relevant, axis, 0)
        are_relevant = np.moveaxis(along_axis[1:] & along_axis[:-1], 0, axis)  # both neighbors
        if not are_relevant.any():
            raise UnresolvedError("the nodes are too far apart for the posterior before this step")
        gap = np.abs(np.diff(moved, axis=axis + 1))[:, are_relevant].max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            deviations = np.where(gap > 0.0, gap / np.sqrt(variances), 0.0)
        parts.append(max(np.ceil(deviations.max()), 1.0))
    return np.array(parts)


def _keeps_orientation(old: Plane, motion: Map) -> bool:
    """Test whether the Jacobian's determinant has one sign at all nodes that are relevant.

    Otherwise the motion's map has no inverse over the posterior ``old`` before it.
    """
    is_relevant = old.within(_RELEVANT)
    determinants = _determinant(motion.jacobian(old.box.nodes[:, is_relevant]))
    return bool((determinants > 0.0).all() or (determinants < 0.0).all())


def _by_sums(old: Plane, motion: Map, variances: Array, box: Box) -> Array:
    """Return the log of ``sum_j N(x'; f(x_j), Q) m_j`` over the likely nodes x_j of mass m_j.

    x_j are nodes of the posterior ``old`` before the motion, and x' those of ``box``. ``variances`` (2,)
    are those of the noise on the axes of the box. The result is (n1 n2,), as the box's nodes.
    """
    likely = old.within(_DEPTH)
    moved = linalg.matvec(_inverse(box.basis), motion.f(old.box.nodes[:, likely]))
    kernels = []
    # On the axes of the box the noise's density is a product.
    for axis in (0, 1):
        line = box.low[axis] + (np.arange(box.shape[axis]) + 0.5) * box.step[axis]
        e = (line - moved[axis][:, None]) / np.sqrt(variances[axis])
        kernels.append(exp(-0.5 * e * e))
    kernels[0] *= old.mass[likely][:, None]
    # `_scale` is the log of 2 pi sqrt(v1 v2), and of the determinant of the box's basis, since the noise
    # is a density of the state and not of the places in that basis.
    return np.asarray(_log(_sum_of_products(*kernels)).ravel() - _scale(box, variances))


def _by_inverse(old: Plane, motion: Map, variances: Array, box: Box) -> Array:
    """Move the log-density by the inverse of the map, and convolve it with the noise.

    Without noise it is ``p(f^-1(x')) / |det F|`` at x', F the Jacobian at f^-1(x'). ``old`` is the
    posterior before the motion, and x' are the nodes (n1 n2,) of ``box``, on whose axes the noise has
    the ``variances`` (2,).
    """
    # Step 1: more nodes on each side, as far as the noise and the moved density reach.
    likely = old.within(_DEPTH)
    places = box.places(motion.f(old.box.nodes[:, likely]))
    spread = np.sqrt(variances) / box.step
    nodes_before = []
    lengths = []
    for axis, n in enumerate(box.shape):
        reach = np.ceil(_REACH * spread[axis])
        needed_before = min(reach, -np.floor(places[axis].min()))
        needed_after = min(reach, np.ceil(places[axis].max()) - n)
        # More for the interpolation: `_blurred` reads up to 6 rows beyond those that it returns, up to 4
        # for the outermost node of a noise that is narrower than a row, and 2 or 3 for the polynomial
        # there. There is one more than these 2 * _MARGIN.
        before_axis = int(max(needed_before, 0)) + 2 * _MARGIN + 1
        after_axis = int(max(needed_after, 0)) + 2 * _MARGIN + 1
        nodes_before.append(before_axis)
        lengths.append(before_axis + n + after_axis)
    before = np.array(nodes_before)
    shape = (lengths[0], lengths[1])
    wide = Box(box.basis, box.low - before * box.step, box.step, shape)
    # Step 2: their origins, and the density there.
    x, F = _origins(old, motion, wide.nodes)
    moved = (_interpolate(old, x) - log(np.abs(_determinant(F)))).reshape(shape)
    # Step 3: the noise, along one axis and then the other.
    moved = _blurred(moved, nodes_before[0], box.shape[0], spread[0]).T
    return _blurred(moved, nodes_before[1], box.shape[1], spread[1]).T.ravel()


def _origins(old: Plane, motion: Map, target: Array) -> tuple[Array, Array]:
    """Solve f(x) = target (2, N) by Newton's method; return x (2, N) and the Jacobians (2, 2, N) there.

    The states x are sought around the mean of the posterior ``old`` before the motion.
    """
    # Start from the map's linear part at the mean.
    mean = old.moments.mean[:, None]
    x = mean + linalg.matvec(_inverse(motion.jacobian(mean)), target - motion.f(mean))
    for _ in range(_ITERATIONS):
        change = linalg.matvec(_inverse(motion.jacobian(x)), target - motion.f(x))
        x = x + change
        # Stop if the change was less than 1e-9 cells of the box. `places` is linear, so that the size of
        # the change in cells does not depend on where it is made, here from the new x on.
        if np.abs(old.box.places(x + change) - old.box.places(x)).max() < 1e-9:
            break
    return x, motion.jacobian(x)


def _interpolate(plane: Plane, x: Array) -> Array:
    """Interpolate the log-density (N,) at states x (2, N): that of its Gaussian, and the difference.

    Beyond the box the difference is that at its edge, so the tails stay smooth.
    """
    normal = plane.moments
    difference = plane.log_density - _normal_part(normal, plane.box.nodes)
    difference = difference.reshape(plane.box.shape)
    places = plane.box.places(x)
    # Step 1: on each axis the node before each state, and the weights of its six neighbors.
    left: list[Index] = []
    weights = []
    for place, n in zip(places, plane.box.shape, strict=True):
        # A place near the edge or beyond is moved so far into the box that it has six neighbors.
        place = np.clip(place, _EDGE[0], n - _EDGE[1])
        index = np.minimum(np.floor(place).astype(np.intp), n - _EDGE[1] - 1)
        left.append(index)
        weights.append(_lagrange(place - index))
    # Step 2: the weighted sum of the 6 by 6 neighbors.
    value = np.zeros(x.shape[1])
    for i, a in zip(_OFFSETS, weights[0], strict=True):
        row = np.zeros(x.shape[1])
        for j, b in zip(_OFFSETS, weights[1], strict=True):
            row += b * difference[left[0] + i, left[1] + j]
        value += a * row
    return np.asarray(value + _normal_part(normal, x))


def _normal_part(normal: Gaussian, x: Array) -> Array:
    """Return the Gaussian's log-density at states (2, N), but for a constant."""
    e = linalg.solve_lower(linalg.cholesky(normal.cov), x - normal.mean[:, None])
    return np.asarray(-0.5 * total(e * e, axis=0))


def _blurred(log_density: Array, first: int, n: int, spread: float) -> Array:
    """Convolve a log-density (rows, columns) with noise along its first axis.

    Return the n rows from the row ``first`` on. ``spread`` is the noise's standard deviation in rows. If
    it is below 1, there must be 6 more rows on both sides of the returned ones.
    """
    unblurred = log_density[first : first + n]
    if spread == 0.0:
        return unblurred
    if spread >= 1.0:
        # A sum over rows, since the noise reaches from row to row.
        e = (np.arange(n)[:, None] + first - np.arange(len(log_density))) / spread
        kernel = exp(-0.5 * e * e - 0.5 * LOG_2PI - log(spread))
        top = log_density.max()
        # `_log`: a sum may be rounded to zero. Below, the ratio to the density itself is never zero.
        return np.asarray(_log(_sum_of_products(kernel.T, exp(log_density - top))) + top)
    # Else average over Gauss-Hermite nodes of the noise, which are between the rows: the log-density is
    # interpolated there, and its ratio to the unblurred density is averaged.
    mean_ratio = np.zeros(unblurred.shape)
    for node, weight in gauss_hermite(_HERMITE).nodes:
        shift = int(np.floor(node * spread))
        neighbors = zip(_OFFSETS, _lagrange(np.array(node * spread - shift)), strict=True)
        terms = [w * log_density[first + shift + i : first + shift + i + n] for i, w in neighbors]
        mean_ratio += weight * exp(total(np.array(terms), axis=0) - unblurred)
    return np.asarray(log(mean_ratio) + unblurred)


def _sum_of_products(a: Array, b: Array) -> Array:
    """Compute ``sum_j a_j b_j'`` (n, p) of rows a (m, n) and b (m, p), in order."""
    out = np.zeros((a.shape[1], b.shape[1]))
    for column, row in zip(a, b, strict=True):
        out += column[:, None] * row
    return out


def _lagrange(t: Array) -> list[Array]:
    """Return the weights of six neighbors, at `_OFFSETS`, for their polynomial at t in [0, 1]."""
    weights = []
    for i in _OFFSETS:
        weight = np.ones_like(t)
        for j in _OFFSETS:
            if i != j:
                weight = weight * (t - j) / (i - j)
        weights.append(weight)
    return weights


def _moments_of_nodes(x: Array, mass: Array) -> Gaussian:
    """Return mean and covariance of nodes x with these masses, whose sum is 1."""
    mean = total(mass * x)
    e = x - mean[:, None]
    return Gaussian(mean, total(mass * e[:, None] * e))


def _log(density: Array) -> Array:
    """Return the logarithm, of `_SMALLEST` for a smaller density, such as zero."""
    return log(np.maximum(density, _SMALLEST))


def _determinant(A: Array) -> Array:
    return np.asarray(A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])


def _inverse(A: Array) -> Array:
    """Invert a matrix (2, 2[, N]) that need not be symmetric."""
    return np.array([[A[1, 1], -A[0, 1]], [-A[1, 0], A[0, 0]]]) / _determinant(A)


@dataclass(frozen=True)
class PlanePosterior(Posterior):
    """A density of two components on a grid of nodes, one for each run."""

    planes: tuple[Plane, ...]

    def below(self, x: Array) -> Array:
        """Sum the mass below each component of x (n, M), of cells taken as normal: (n, M)."""
        columns = []
        for plane, point in zip(self.planes, x.T, strict=True):
            # The standard deviation of a cell, uniform along both of its sides: side / sqrt(12) each.
            n = len(point)  # 1 if the truth has only the first component, else 2
            sides = plane.box.basis * plane.box.step
            sd = np.sqrt(total(sides * sides) / 12.0)[:n]
            below = normal_cdf((point - plane.box.nodes.T[:, :n]) / sd)
            columns.append(total(plane.mass[:, None] * below, axis=0))
        return np.stack(columns, axis=-1)

    def within(self, x: Array) -> Array:
        """Sum the mass (M,) of the nodes nearer to the mean than x (n, M)."""
        masses = []
        for plane, point in zip(self.planes, x.T, strict=True):
            n = len(point)  # 1 if the truth has only the first component, else 2
            mean = plane.moments.mean[:n]
            cov = plane.moments.cov[:n, :n]
            of_nodes = linalg.distance(plane.box.nodes[:n] - mean[:, None], cov)
            nearer = of_nodes < linalg.distance(point - mean, cov)
            masses.append(total(plane.mass * nearer))
        return np.array(masses)

    def crps(self, x: Array) -> Array:
        """Return the CRPS (n, M) of the nodes as weighted particles, for x (n, M)."""
        scores = []
        for run, plane in enumerate(self.planes):
            # The nodes (2, N) and their mass (N,) get an axis of one run.
            nodes = ParticlePosterior(Particles(plane.box.nodes[:, None], plane.mass[None]))
            scores.append(nodes.crps(x[:, run : run + 1]))
        return np.concatenate(scores, axis=1)
