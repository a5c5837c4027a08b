"""All steps of a filter in one call of the C kernels.

`track` has the linear Kalman filter, `filter_steps` the UKF and the EKF of a radar, and `interact` the
interacting multiple models. `filters/all_steps_at_once.py` decides which filters and models take them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core import compiled, elementary, elementary_tables
from trackbench.core.arrays import Array, Index, all_finite, with_trailing
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sigma_points import Unscented

_MOST_RUNS = 512
_MOST_COMPONENTS = 6
_MOST_MEASURED = 2
"""Runs, and components of states and measurements, up to which the C kernel filters."""
_MOST_COMPILED = 6
"""Models, and components of their states, up to which the C kernel filters."""


class MotionMatrices(NamedTuple):
    """Matrices of a linear motion over T steps; those of steps of equal length are stored once."""

    F: Array
    """the K different transition matrices (K, n, n)"""
    Q: Array
    """the K covariances (K, n, n) of the process noise"""
    numbers: Index
    """which of the K each step has (T,)"""

    @property
    def size(self) -> int:
        """Number n of components of a state."""
        return self.F.shape[-1]

    def arguments(self) -> tuple[Array, Array, Index]:
        """Return F and Q (K, n, n) and which of the K each step has (T,), as the C kernels take them."""
        F = np.ascontiguousarray(self.F, dtype=np.float64)
        Q = np.ascontiguousarray(self.Q, dtype=np.float64)
        return F, Q, np.ascontiguousarray(self.numbers, dtype=np.int64)

    def of_each_step(self) -> tuple[Array, Array]:
        """Return F and Q (n, n, T, 1) of each step, or (n, n) if all steps have the same.

        The last axis of length one is that of the runs, which share the matrices.
        """
        if len(self.F) == 1:
            return self.F[0], self.Q[0]
        F = np.ascontiguousarray(np.moveaxis(self.F[self.numbers], 0, -1))
        Q = np.ascontiguousarray(np.moveaxis(self.Q[self.numbers], 0, -1))
        return F[..., None], Q[..., None]


class MeasuredByKernel(NamedTuple):
    """Sensor of the C kernels, which measures components of the state, or is a radar.

    A radar measures range and azimuth of the positions, which are the components 0 and 2.
    """

    R: Array
    """noise covariance (n_z, n_z)"""
    rows: tuple[int, ...] = ()
    """measured components of the state, unless this is a radar"""
    place: tuple[float, ...] | None = None
    """position of the radar, m; None if the sensor is none"""

    @property
    def is_radar(self) -> bool:
        """True if the sensor is a radar."""
        return self.place is not None

    def arguments(self) -> tuple[Index, Array, Array, Array]:
        """Return the arrays that the kernels take: rows, place, table of the arctangent, and pi.

        The rows are the state's measured components, and the place (2,) is the position of a radar.
        """
        # The kernels read the place of a radar, or else the rows. The unused one gets any numbers.
        place = np.array(self.place if self.place is not None else (0.0, 0.0))
        rows = np.array(self.rows or (0, 2), dtype=np.intp)
        arctangents, pi = elementary_tables.arctangent_tables()
        return rows, place, arctangents, pi


def track(
    prior: Gaussian, motion: MotionMatrices, H: Array, R: Array, z: Array
) -> tuple[Gaussian, Innovation, Array] | None:
    """Filter all steps of a linear model with a constant sensor: posteriors, innovations and NIS.

    The bytes are those of `predict`, `update` and `Innovation.nis` step by step, in a fraction of the
    time for few runs.

    Parameters
    ----------
    prior : Gaussian
        Estimate before the first prediction: mean (n, M), one covariance (n, n) for all runs.
    motion : MotionMatrices
        Transition matrices and noise covariances of the T steps.
    H, R : (n_z, n), (n_z, n_z)
        Measurement matrix and noise covariance.
    z : (n_z, T, M)
        Measurements.

    Returns
    -------
    tuple or None
        Posteriors, means (n, T, M) and covariances (n, n, T, 1); innovations, nu (n_z, T, M) and S
        (n_z, n_z, T, 1); NIS (T, M). None if there are no C kernels, n > 6, n_z > 2, the covariance
        is per run, a component is missing (NaN) in some of the runs only, or a run diverges.
    """
    n_z, T, M = z.shape
    n = motion.size
    missing = np.isnan(z)
    # The kernel's arrays have room for so many components.
    is_small = n <= _MOST_COMPONENTS and n_z <= _MOST_MEASURED
    if not compiled.kernels or not is_small or prior.cov.ndim > 2:
        return None
    if (missing != missing[..., :1]).any():
        return None
    means = np.empty((T + 1, n, M))
    covs = np.empty((T + 1, n, n))
    means[0] = prior.mean
    covs[0] = prior.cov
    # The kernel turns the measurements into innovations.
    nu = np.empty((T, n_z, M))
    S = np.empty((T, n_z, n_z))
    nis = np.empty((T, M))
    nu[:] = z.swapaxes(0, 1)
    matrices = [np.ascontiguousarray(A, dtype=np.float64) for A in (H, R)]
    compiled.kernels.track(*motion.arguments(), *matrices, means, covs, S, nu, nis, n, n_z, M)
    # A NaN that is no missing measurement is that of a run that diverges.
    has_nis = np.isnan(nis) == missing.all(axis=0)
    has_nu = np.isnan(nu.swapaxes(0, 1)) == missing
    if not (all_finite(means) and has_nis.all() and has_nu.all()):
        return None
    # One update of a covariance per step (T,), since all runs share the covariance.
    count_operations("covariances", nis[:, 0], component_axes=0)
    # Steps become an axis of the batch.
    posterior = Gaussian(means[1:].swapaxes(0, 1), np.moveaxis(covs[1:], 0, -1)[..., None])
    innovation = Innovation(nu.swapaxes(0, 1), np.moveaxis(S, 0, -1)[..., None])
    return posterior, innovation, nis


class FilteredSteps(NamedTuple):
    """T steps of a filter with one Gaussian, in M runs; axes of steps and runs come last."""

    states: Gaussian
    """posteriors: means (n, T + 1, M), covariances (n, n, T + 1, M); the first is the given one"""
    innovation: Innovation
    """innovations: nu (n_z, T, M), S (n_z, n_z, T, M), and the predictions"""
    nis: Array
    """NIS (T, M)"""


def filter_steps(
    prior: Gaussian,
    motion: MotionMatrices,
    measured: MeasuredByKernel,
    z: Array,
    rule: Unscented | None = None,
) -> FilteredSteps | None:
    """Filter all steps of a linear motion and a sensor of the kernels.

    The bytes are those of `ukf.augmented_step` or `ekf.extended_step`, and `Innovation.nis`, step by
    step, in a small part of the time for few runs.

    Parameters
    ----------
    prior : Gaussian
        Posterior before the first step: mean (n, M), covariance (n, n[, M]).
    motion : MotionMatrices
        Transition matrices and covariances of the process noise of the T steps.
    measured : MeasuredByKernel
        The sensor, which must be a radar if there is no ``rule``. With one it may be either kind.
    z : array (n_z, T, M)
        Measurements; NaN where a component is missing.
    rule : Unscented, optional
        Sigma points of state and noises, for the UKF; default: none, for the EKF.

    Returns
    -------
    FilteredSteps or None
        None if there are no C kernels, M, n or n_z is above the kernel's limits, or a step needs numpy:
        a run diverges, or a difference of covariances has lost its digits.
    """
    n_z, T, M = z.shape
    n = motion.size
    is_small = M <= _MOST_RUNS and n <= _MOST_COMPONENTS and n_z <= _MOST_MEASURED
    if not compiled.kernels or not is_small:
        return None
    weights = np.empty(0)
    cov_weights = np.empty(0)
    scale = 0.0
    if rule is not None:
        size = 2 * n + n_z
        scale = float(np.sqrt(rule.spread(size)))
        weights, cov_weights = rule.weights(size)
    means = np.empty((n, T + 1, M))
    covs = np.empty((n, n, T + 1, M))
    means[:, 0] = prior.mean
    covs[:, :, 0] = with_trailing(prior.cov, 1, leading=2)
    predicted = Gaussian(np.empty((n, T, M)), np.empty((n, n, T, M)))
    nu = np.empty((n_z, T, M))
    S = np.empty((n_z, n_z, T, M))
    nis = np.empty((T, M))
    is_done = compiled.kernels.filter_steps(
        *motion.arguments(),
        np.ascontiguousarray(measured.R, dtype=np.float64),
        weights,
        cov_weights,
        *measured.arguments(),
        np.ascontiguousarray(z, dtype=np.float64),
        means,
        covs,
        predicted.mean,
        predicted.cov,
        nu,
        S,
        nis,
        scale,
        measured.is_radar,
        n,
        n_z,
        M,
    )
    # A NaN that is no missing measurement is that of a run that diverges.
    missing = np.isnan(z)
    has_nu = np.array_equal(np.isnan(nu), missing)
    has_nis = np.array_equal(np.isnan(nis), missing.all(axis=0))
    if not (is_done and has_nu and has_nis and all_finite(S)):
        return None
    # One update of a covariance per step and run (T, M).
    count_operations("covariances", nis, component_axes=0)
    innovation = Innovation(nu=nu, S=S, predicted=predicted)
    return FilteredSteps(states=Gaussian(means, covs), innovation=innovation, nis=nis)


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
        Matrices of each model. All must have the same H and R, and the same ``motion.numbers``, the
        indices of F and Q at each step: those of the first model are used.
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
    if not compiled.kernels or max(r, n) > _MOST_COMPILED or n_z > _MOST_MEASURED:
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
    # One update of a covariance per model, step and run (r, T, M).
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
