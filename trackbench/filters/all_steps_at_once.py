"""All steps of a KF, UKF or EKF in one call of the C kernels, bit for bit those of `step`.

`linear_steps` and `nonlinear_steps` decide which filters, motions and sensors take the kernels, and
return the steps as `Steps`. The calls on arrays, with the largest sizes of the kernels, are `track` for
the linear Kalman filter, and `filter_steps` for the UKF and the EKF of a radar. Those of the IMM are in
`imm_steps_at_once.py`.
"""

from typing import NamedTuple

import numpy as np

from trackbench.core import compiled, kalman
from trackbench.core.arrays import Array, Index, all_finite, with_trailing
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sigma_points import Unscented
from trackbench.filters.base import AnyFilter, Steps
from trackbench.filters.gaussian_base import Tracked
from trackbench.models.base import Model, angle_rows
from trackbench.models.motions.steps_at_once import MotionMatrices, matrices_of_steps
from trackbench.models.sensors.compiled_sensors import MeasuredByKernel, measured_by_kernel
from trackbench.models.sensors.position import LinearSensor

_MOST_RUNS = 512
_MOST_COMPONENTS = 6
MOST_MEASURED = 2
"""Runs, and components of states and measurements, up to which the C kernel filters."""


def is_plain(tracker: AnyFilter, cls: type[AnyFilter], *free_keys: str) -> bool:
    """Test whether a filter is of this class itself, no subclass, with default values of its keys.

    The ``free_keys`` may have any value.
    """
    if type(tracker) is not cls:
        return False
    keys = {key: getattr(tracker, key) for key in free_keys}
    return bool(tracker == cls(**keys))


def linear_steps(model: Model, state: Tracked, z: Array, k: int) -> Steps | None:
    """Return the Kalman filter's steps of a small linear model, bit for bit those of `KF.step`.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Tracked
        State before the steps, with one covariance (n_x, n_x) for all runs.
    z : array (n_z, T, M)
        Measurements of the steps.
    k : int
        Number of the first of these steps.

    Returns
    -------
    Steps or None
        None for another model, or if `track` cannot filter it.
    """
    motion, sensor = model
    if not isinstance(sensor, LinearSensor):
        return None
    matrices = matrices_of_steps(motion, k, z.shape[1])
    if matrices is None:
        return None
    H = sensor.H(matrices.size)
    tracked = track(state.posterior, matrices, H, sensor.R, z)
    if tracked is None:
        return None
    posteriors, innovations, nis = tracked

    def state_after(i: int) -> Tracked:
        """Return the state after measurement i; all runs share a covariance, (n, n), and S."""
        posterior = Gaussian(posteriors.mean[:, i], posteriors.cov[:, :, i, 0])
        innovation = Innovation(innovations.nu[:, i], innovations.S[:, :, i, 0])
        return Tracked(posterior=posterior, nis=nis[i], innovation=innovation)

    def posteriors_before() -> Gaussian:
        """Return the posterior before each step, at index 0 the prior of the first one.

        The means are (n, T, M), the covariances (n, n, T, 1).
        """
        first_mean = state.posterior.mean[:, None]
        first_cov = state.posterior.cov[..., None, None]
        mean = np.concatenate([first_mean, posteriors.mean[:, :-1]], axis=1)
        cov = np.concatenate([first_cov, posteriors.cov[:, :, :-1]], axis=2)
        return Gaussian(mean, cov)

    def state_of_all_steps() -> Tracked:
        """Return one state whose batch (T, M) is all steps, with their predictions."""
        F, Q = matrices.of_each_step()
        predicted = kalman.predict(posteriors_before(), F, Q)
        innovation = innovations._replace(predicted=predicted)
        return Tracked(posterior=posteriors, nis=nis, innovation=innovation)

    def state_before(steps: Index) -> Tracked:
        """Return one state before the steps of the indices (K,), with the means (n, K M).

        The batch (K M,) has the M runs of the first of these steps, then those of the second, and so on.
        """
        before = posteriors_before()
        n = len(before.mean)
        mean = before.mean[:, steps]
        cov = np.broadcast_to(before.cov[:, :, steps], (n, n, *mean.shape[1:]))
        posterior = Gaussian(mean.reshape(n, -1), cov.reshape(n, n, -1))
        return Tracked(posterior=posterior, nis=np.full(posterior.mean.shape[1], np.nan))

    return Steps(
        estimate=posteriors,
        diagnostics={"nis": nis},
        state=state_after,
        together=state_of_all_steps,
        before=state_before,
    )


def nonlinear_steps(
    model: Model,
    state: Tracked,
    z: Array,
    k: int,
    keeps_predictions: bool,
    rule: Unscented | None = None,
) -> Steps | None:
    """Return all steps of a UKF, or of the EKF of a radar, bit for bit those of the filter's `step`.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Tracked
        State before the steps.
    z : array (n_z, T, M)
        Measurements of the steps.
    k : int
        Number of the first of these steps.
    keeps_predictions : bool
        Whether the states have the predictions. A smoother leaves them out, as it stores all states.
    rule : Unscented, optional
        Sigma points of state and noises; default: none, for the EKF.

    Returns
    -------
    Steps or None
        None unless the motion is one of `matrices_of_steps`, with several components and no angle, the
        sensor is one of `measured_by_kernel` (for the EKF a radar), and `filter_steps` can filter.
    """
    motion, sensor = model
    n = len(motion.components)
    measured = measured_by_kernel(sensor, n)
    if measured is None or (rule is None and not measured.is_radar):
        return None
    # The kernel does not shift angles of the state by whole turns. A scalar state has a faster way in
    # `step`, with other rounding.
    if angle_rows(motion) or n == 1:
        return None
    matrices = matrices_of_steps(motion, k, z.shape[1])
    if matrices is None:
        return None
    filtered = filter_steps(state.posterior, matrices, measured, z, rule)
    if filtered is None:
        return None
    states = filtered.states
    posteriors = select_steps(states, slice(1, None))  # without the first, the one before the steps

    def state_after(steps: int | slice) -> Tracked:
        """Return the state after the measurement of this index, or of several as one batch."""
        return Tracked(
            posterior=select_steps(posteriors, steps),
            nis=filtered.nis[steps],
            innovation=select_innovation(filtered.innovation, steps, keeps_predictions),
        )

    def state_of_all_steps() -> Tracked:
        """Return one state whose batch (T, M) is all steps, with the predictions if they are kept."""
        return state_after(slice(None))

    def state_before(steps: Index) -> Tracked:
        """Return one state before the steps of the indices (K,), with the means (n, K M).

        The batch (K M,) has the M runs of the first of these steps, then those of the second, and so on.
        """
        posterior = join_steps(states, steps)
        return Tracked(posterior=posterior, nis=np.full(posterior.mean.shape[1], np.nan))

    return Steps(
        estimate=posteriors,
        diagnostics={"nis": filtered.nis},
        state=state_after,
        together=state_of_all_steps,
        before=state_before,
    )


def select_steps(states: Gaussian, steps: int | slice) -> Gaussian:
    """Return the Gaussian of one step, or of several, from one with means (n, T, M)."""
    return Gaussian(states.mean[:, steps], states.cov[:, :, steps])


def select_innovation(
    innovations: Innovation, steps: int | slice, keeps_predictions: bool
) -> Innovation:
    """Return the innovation of one step, or of several, from that of all steps.

    Parameters
    ----------
    innovations : Innovation
        Innovations ``nu`` (n_z, T, M) and S (n_z, n_z, T, M) or (n_z, n_z, T, 1), perhaps with the
        predictions.
    steps : int or slice
        Index of the step, or of several: 0 is the first of the T.
    keeps_predictions : bool
        Whether the result has the prediction.

    Returns
    -------
    Innovation
        Innovation of one step, ``nu`` (n_z, M), or of T' steps, ``nu`` (n_z, T', M).
    """
    predicted = None
    if keeps_predictions and innovations.predicted is not None:
        predicted = select_steps(innovations.predicted, steps)
    return Innovation(
        nu=innovations.nu[:, steps], S=innovations.S[:, :, steps], predicted=predicted
    )


def join_steps(states: Gaussian, steps: Index) -> Gaussian:
    """Return the Gaussians before K steps, of indices (K,), as one batch (K M,), step after step.

    ``states`` has means (n, T + 1, M), of which the first is that before the first step.
    """
    n = len(states.mean)
    mean = states.mean[:, steps].reshape(n, -1)
    return Gaussian(mean, states.cov[:, :, steps].reshape(n, n, -1))


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
    is_small = n <= _MOST_COMPONENTS and n_z <= MOST_MEASURED
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

    The bytes are those of `sigma_point_steps.augmented_step` or `ekf.extended_step`, and
    `Innovation.nis`, step by step, in a small part of the time for few runs.

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
    is_small = M <= _MOST_RUNS and n <= _MOST_COMPONENTS and n_z <= MOST_MEASURED
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
