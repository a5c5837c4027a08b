"""Interacting multiple models: mixing, and the moments of a mixture (Blom & Bar-Shalom 1988)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import chain, pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from trackbench.core import compiled, elementary, linalg
from trackbench.core.angles import mean_direction, near
from trackbench.core.arrays import Array, Index, all_finite, count_operations, with_trailing
from trackbench.core.compiled_steps import MeasuredByKernel
from trackbench.core.distributions import Gaussian, Symmetric
from trackbench.core.kalman import Innovation, MotionMatrices
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total

_ROUNDING = 1e-9  # of a covariance

Common: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]
"""Indices of the components that two states share, in the one and in the other."""


def predict_weights(weights: Array, transition: Array) -> tuple[Array, Array]:
    """Predict the model probabilities and compute the mixing probabilities.

    Parameters
    ----------
    weights : (r, M)
        Probabilities mu_i of the r models.
    transition : (r, r)
        Probabilities p_ij of a switch from model i to model j.

    Returns
    -------
    after : (r, M)
        Predicted probabilities, ``c_j = sum_i p_ij mu_i``.
    mixing : (r, r, M)
        ``mu_{i|j} = p_ij mu_i / c_j`` at [i, j]; the identity where c_j is zero.
    """
    joint = transition[:, :, None] * weights[:, None]
    after = total(joint, axis=0)
    # A model that cannot be reached continues from its own estimate.
    reachable = after > 0.0
    mixing = joint / np.where(reachable, after, 1.0)
    stay = np.eye(len(weights))[:, :, None]
    return after, np.where(reachable, mixing, stay)


def update_weights(
    predicted: Array, nis: Array, mantissa: Array | float = 1.0, exponent: Array | int = 0
) -> Array:
    """Update model probabilities by Gaussian likelihoods ``exp(-nis / 2) / sqrt(det S)``.

    Parameters
    ----------
    predicted, nis : (r, M)
        Predicted probabilities, and NIS, of each model.
    mantissa, exponent : (r, M)
        ``sqrt(det S) = mantissa 2^exponent`` of each model; default: 1 of all.

    Returns
    -------
    (r, M)
        Probabilities; the prediction for a run without any positive probability.
    """
    # Subtract the least NIS of the possible models, so that one likelihood does not underflow.
    is_possible = predicted > 0.0
    least = np.where(is_possible, nis, np.inf).min(axis=0)
    # Likewise divide by the least power of two, which changes no ratio.
    scale = np.ldexp(mantissa, exponent - np.min(exponent, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        # An impossible model may have a smaller NIS, and its density may be infinite: 0 times it is NaN.
        excess = np.where(is_possible, nis - least, 0.0)
        w = predicted / scale * elementary.exp(-0.5 * excess)
        return np.where(least == np.inf, predicted, w / total(w, axis=0))


def log_mixture(weights: Array, log_densities: Array) -> Array:
    """Return the log (M,) of a mixture of densities with weights (r, M), from their logs (r, M)."""
    with np.errstate(divide="ignore"):
        terms = elementary.log(weights) + log_densities
    value = terms[0]
    for term in terms[1:]:
        value = elementary.logaddexp(value, term)
    return value


def combine(
    states: Sequence[Gaussian],
    weights: Array,
    without_spread: Sequence[Sequence[int]] = (),
    angles: Sequence[int] = (),
) -> Gaussian:
    """Combine a mixture of Gaussians to its moments.

    ``m = sum_j w_j m_j`` and ``P = sum_j w_j (P_j + (m_j - m) (m_j - m)')``.

    Parameters
    ----------
    states : sequence of Gaussian
        r states, means (n, M), covariances (n, n[, M]).
    weights : (r, M)
        Their weights.
    without_spread : sequence of sequences of int
        Components of each state whose ``m_j - m`` is taken as zero; default: none.
    angles : sequence of int
        Components that are angles: the means are first shifted by whole turns to within half a turn of
        their mean direction.

    Returns
    -------
    Gaussian
        Mean (n, M) and covariance (n, n, M).
    """
    if angles:
        states = brought_together(states, weights, angles)
    terms = list(zip(weights, states, strict=True))
    # m = sum_j w_j m_j
    mean = np.asarray(sum(w * s.mean for w, s in terms))
    cov = np.zeros((len(mean), *mean.shape))
    # P = sum_j w_j (P_j + e e') with e = m_j - m
    for j, (w, s) in enumerate(terms):
        kernels = None if without_spread else compiled.kernels
        # The kernel adds the term to cov, unless it cannot read the memory of an argument.
        if kernels and kernels.mix(w, s.mean, s.cov, mean, cov):
            continue
        e = s.mean - mean
        if without_spread:
            e[list(without_spread[j])] = 0.0
        cov += w * (with_trailing(s.cov, 1, leading=2) + linalg.outer(e, e))
    return Gaussian(mean, cov)


def brought_together(
    states: Sequence[Gaussian], weights: Array, angles: Sequence[int]
) -> list[Gaussian]:
    """Shift the angles of r means by whole turns to within half a turn of their mean direction.

    ``weights`` (r, M) are those of the states. The direction is on the turn of the first mean.
    """
    means = np.stack([state.mean for state in states], axis=-1)
    center = mean_direction(means, weights.T, states[0].mean, angles)
    return [Gaussian(near(state.mean, center, angles), state.cov) for state in states]


def given_later(
    predicted: Sequence[Gaussian], mixing: Array, later: Gaussian, angles: Sequence[int] = ()
) -> tuple[list[Gaussian], Array]:
    """Condition each of r predictions on later measurements (Heskes & Zoeter 2002).

    Their likelihood is ``later(x) / mixed(x)``, by the smoothed and the predicted mixture of all r. It
    is taken as 1 in a run where it would widen a prediction.

    Parameters
    ----------
    predicted : sequence of Gaussian
        r predictions, means (n, M), covariances (n, n, M).
    mixing : array (r, M)
        Their weights in the predicted mixture.
    later : Gaussian
        Smoothed moments of the same step.
    angles : sequence of int
        Components that are angles.

    Returns
    -------
    conditioned : list of Gaussian
        The r predictions given the later measurements.
    log_c : array (r, M)
        Logarithm of the likelihood of the later measurements under each prediction.
    """
    mixed = combine(predicted, mixing, angles=angles)
    # A component that the motion leaves without noise is given unit noise in every term, which cancels.
    added = np.eye(len(mixed.mean))[..., None] * (linalg.diagonal(mixed.cov) == 0.0)
    mixed_cov = mixed.cov + added
    later_cov = later.cov + added
    mixed_precision = linalg.inverse(mixed_cov)
    later_precision = linalg.inverse(later_cov)
    mixed_mean = mixed.mean
    later_mean = later.mean
    conditioned = []
    log_ratios = []
    is_proper = np.ones(later.mean.shape[1], dtype=np.bool_)
    for prediction in predicted:
        p = Gaussian(prediction.mean, prediction.cov + added)
        # Step 1: P = (P_i^-1 + P_later^-1 - P_mixed^-1)^-1,
        # m = m_i + P (P_later^-1 (m_later - m_i) - P_mixed^-1 (m_mixed - m_i)).
        P = linalg.inverse(linalg.inverse(p.cov) + later_precision - mixed_precision)
        later_mean = near(later_mean, p.mean, angles)
        mixed_mean = near(mixed_mean, p.mean, angles)
        by_later = linalg.matvec(later_precision, later_mean - p.mean)
        by_mixed = linalg.matvec(mixed_precision, mixed_mean - p.mean)
        given = Gaussian(p.mean + linalg.matvec(P, by_later - by_mixed), P)
        # Step 2: c_i = N_i(x) later(x) / (mixed(x) given_i(x)) at any x.
        x = p.mean
        above = p.log_prob(x) + Gaussian(later_mean, later_cov).log_prob(x)
        below = Gaussian(mixed_mean, mixed_cov).log_prob(x) + given.log_prob(x)
        is_narrower = linalg.diagonal(P) <= (1.0 + _ROUNDING) * linalg.diagonal(p.cov)
        is_proper &= is_narrower.all(axis=0) & np.isfinite(above - below)
        conditioned.append(given)
        log_ratios.append(above - below)
    # Step 3: keep the predictions of the runs in which one of them would become wider.
    results = []
    for given, prediction in zip(conditioned, predicted, strict=True):
        mean = np.where(is_proper, given.mean, prediction.mean)
        cov = np.where(is_proper, given.cov - added, prediction.cov)
        results.append(Gaussian(mean, cov))
    return results, np.where(is_proper, np.stack(log_ratios), 0.0)


class LinearModel(NamedTuple):
    """Matrices of a linear model over T steps: those of the motion, H (n_z, n), R (n_z, n_z)."""

    motion: MotionMatrices
    H: Array
    R: Array


class Interacting(NamedTuple):
    """T steps of r interacting models, in M runs; axes of steps and runs come last."""

    states: tuple[Gaussian, ...]
    """posteriors of each model: means (n, T + 1, M), covariances (n, n, T + 1, M); first given"""
    weights: Array
    """weights (r, T + 1, M); the first are given"""
    predicted_weights: Array
    """weights (r, T, M) before each measurement"""
    innovations: tuple[Innovation, ...]
    """innovation of each model: nu (n_z, T, M), S (n_z, n_z, T, M), and the prediction"""
    nis: Array
    """mean NIS (T, M)"""
    estimate: Gaussian
    """moments of the mixture: mean (n, T, M), covariance (n, n, T, M)"""


def interact(
    states: Sequence[Gaussian],
    weights: Array,
    models: Sequence[LinearModel],
    transition: Array,
    z: Array,
    radar: MeasuredByKernel | None = None,
) -> Interacting | None:
    """Filter all steps of interacting linear models with a constant sensor (Blom & Bar-Shalom 1988).

    The sensor may be a radar, whose Jacobian takes the place of H. The bytes are those of
    `predict_weights`, `combine`, `kalman.predict`, `kalman.update` and `update_weights` step by step, in
    a small part of the time for few runs.

    Parameters
    ----------
    states : sequence of Gaussian
        Posterior of each of the r models before the first step, means (n, M), covariances (n, n, M).
    weights : array (r, M)
        Weights of the models before the first step.
    models : sequence of LinearModel
        Matrices of each model; H, R and ``motion.numbers`` are those of the first.
    transition : array (r, r)
        Probabilities p_ij of a switch from model i to model j.
    z : array (n_z, T, M)
        Measurements.
    radar : MeasuredByKernel, optional
        The sensor, if it is a radar.

    Returns
    -------
    Interacting or None
        None if there are no C kernels, r or n is above 6, n_z above 2, a component is missing (NaN) in
        some of the runs only, or a run diverges.
    """
    n_z, T, M = z.shape
    r = len(models)
    n = models[0].motion.size
    missing = np.isnan(z)
    if not compiled.kernels or max(r, n) > _MOST_COMPILED or n_z > 2:
        return None
    if (missing != missing[..., :1]).any():
        return None
    # Step 1: arrays with the axes of steps and runs last, the first step's from before.
    means = np.empty((r, n, T + 1, M))
    covs = np.empty((r, n, n, T + 1, M))
    all_weights = np.empty((r, T + 1, M))
    for j, state in enumerate(states):
        means[j, :, 0] = state.mean
        covs[j, :, :, 0] = with_trailing(state.cov, 1, leading=2)
    all_weights[:, 0] = weights
    predicted_means = np.empty((r, n, T, M))
    predicted_covs = np.empty((r, n, n, T, M))
    predicted_weights = np.empty((r, T, M))
    nu = np.empty((r, n_z, T, M))
    S = np.empty((r, n_z, n_z, T, M))
    nis = np.empty((T, M))
    estimate = Gaussian(np.empty((n, T, M)), np.empty((n, n, T, M)))
    # Step 2: all steps.
    motions = MotionMatrices(
        F=np.stack([model.motion.F for model in models]),
        Q=np.stack([model.motion.Q for model in models]),
        numbers=models[0].motion.numbers,
    )
    matrices = [
        models[0].H,
        models[0].R,
        transition,
        z,
    ]
    sensor = radar or MeasuredByKernel(R=models[0].R)
    is_finite = compiled.kernels.interact(
        *motions.arguments(),
        *[np.ascontiguousarray(matrix, dtype=np.float64) for matrix in matrices],
        *elementary.exp_tables(),
        *sensor.arguments(),
        *(means, covs, all_weights, predicted_means, predicted_covs, predicted_weights),
        *(nu, S, nis, estimate.mean, estimate.cov),
        *(sensor.is_radar, r, n, n_z, M),
    )
    # A NaN that is no missing measurement is that of a run that diverges.
    has_nu = (np.isnan(nu) == missing).all()
    if not (is_finite and has_nu and all_finite(means) and all_finite(covs)):
        return None
    count_operations("covariances", predicted_weights, component_axes=0)
    innovations = []
    for j in range(r):
        prediction = Gaussian(predicted_means[j], predicted_covs[j])
        innovations.append(Innovation(nu=nu[j], S=S[j], predicted=prediction))
    return Interacting(
        states=tuple(map(Gaussian, means, covs)),
        weights=all_weights,
        predicted_weights=predicted_weights,
        innovations=tuple(innovations),
        nis=nis,
        estimate=estimate,
    )


_MOST_COMPILED = 6
"""Models, and components of their states, up to which the C kernel filters."""


@dataclass(frozen=True)
class GaussianMixture(Symmetric):
    """A mixture, in each of M runs, of r Gaussians with weights (r,), means (n,), covariances (n, n)."""

    weights: Array
    parts: tuple[Gaussian, ...]
    runs: int

    @cached_property
    def _moments(self) -> Gaussian:
        states = [Gaussian(component.mean[:, None], component.cov) for component in self.parts]
        return combine(states, self.weights[:, None])

    @property
    def mean(self) -> Array:
        """Mean (n, M)."""
        return np.tile(self._moments.mean, (1, self.runs))

    @property
    def cov(self) -> Array:
        """Covariance (n, n)."""
        return self._moments.cov[..., 0]

    @property
    def mode(self) -> Array:
        """Mean of the part at whose mean the density is highest, for each run (n, M)."""
        # The parts' means (n,) are points; `log_prob` takes them as (n, 1).
        heights = [float(self.log_prob(part.mean[:, None])[0]) for part in self.parts]
        highest = self.parts[int(np.argmax(heights))]
        return np.tile(highest.mean[:, None], (1, self.runs))

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw the part of each state, then the state (n, M, *trailing)."""
        u = rng.random((self.runs, *trailing))
        # Each part draws all the states (n, M, *trailing). A state is that of part j if its u is between
        # the sums of the weights before part j and up to it.
        x = self.parts[0].sample(rng, self.runs, *trailing)
        below = self.weights[0]
        for weight, part in zip(self.weights[1:], self.parts[1:], strict=True):
            x = np.where(u >= below, part.sample(rng, self.runs, *trailing), x)
            below = below + weight
        return x

    def log_prob(self, x: Array) -> Array:
        """Compute ``log sum_j w_j N(x; m_j, P_j)``."""
        axes = x.ndim - 1
        logs = [Gaussian(with_trailing(p.mean, axes), p.cov).log_prob(x) for p in self.parts]
        return log_mixture(with_trailing(self.weights, axes), np.stack(logs))

    def intervals(self, deviations: float) -> list[tuple[Array, Array]]:
        """Return disjoint intervals (M,), (M,) of a scalar within so many deviations of the means.

        They end wherever a part's does, so that nodes resolve a narrow part within a wide one.
        """
        reach = [deviations * float(np.sqrt(part.cov[0, 0])) for part in self.parts]
        ends = [(p.mean[0] - r, p.mean[0] + r) for p, r in zip(self.parts, reach, strict=True)]
        cuts = sorted({float(end) for end in chain.from_iterable(ends)})
        intervals = []
        for a, b in pairwise(cuts):
            if any(low <= a and b <= high for low, high in ends):
                intervals.append((np.full(self.runs, a), np.full(self.runs, b)))
        return intervals


def pad(state: Gaussian, other: Gaussian, shared: Common, unbiased: bool) -> Gaussian:
    """Fill a state up to the components of another model's state, to mix with it.

    Components that only this state has are dropped.

    Parameters
    ----------
    state, other : Gaussian
        State of a model (n, M), and that of the other model (m, M).
    shared : tuple of tuples of int
        Indices of the shared components in ``state`` and in ``other``, from `common_components`.
    unbiased : bool
        Components that only the other model has come from its mean and covariance (Yuan, Bar-Shalom et
        al. 2012); else they are zero.

    Returns
    -------
    Gaussian
        Mean (m, M), covariance (m, m, M).
    """
    source, target = shared
    m = len(other.mean)
    runs = state.mean.shape[1]
    if source == target == tuple(range(m)):
        if len(state.mean) == m:
            return state
        return Gaussian(state.mean[:m], state.cov[:m, :m])
    # Step 1: copy the shared components.
    mean = np.zeros((m, runs))
    cov = np.zeros((m, m, runs))
    mean[list(target)] = state.mean[list(source)]
    state_cov = with_trailing(state.cov, 1, leading=2)
    cov[_block(target)] = state_cov[_block(source)]
    # Step 2: fill the others from the other model.
    if unbiased:
        rest = tuple(i for i in range(m) if i not in target)
        mean[list(rest)] = other.mean[list(rest)]
        cov[_block(rest)] = with_trailing(other.cov, 1, leading=2)[_block(rest)]
    return Gaussian(mean, cov)


@cache
def _block(components: tuple[int, ...]) -> tuple[Index, ...]:
    """Return the index of these rows and columns of a covariance."""
    return np.ix_(components, components)


@cache
def common_components(names: tuple[str, ...], other_names: tuple[str, ...]) -> Common:
    """Find the components that two models share, by the ``names`` of each model's components.

    Return their indices in ``names``, and those in ``other_names``, in the order of the other model.
    """
    shared = [name for name in other_names if name in names]
    source = tuple(names.index(name) for name in shared)
    target = tuple(other_names.index(name) for name in shared)
    return source, target
