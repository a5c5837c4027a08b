"""All steps of a KF, UKF or EKF in one call of the C kernels, bit for bit those of `step`.

This file decides which filters, motions and sensors take the kernels, and returns the steps as `Steps`.
The calls on arrays, with the largest sizes of the kernels, are in `core/compiled_steps.py`.
"""

import numpy as np

from trackbench.core import compiled_steps, kalman
from trackbench.core.arrays import Array, Index
from trackbench.core.compiled_steps import filter_steps
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sigma_points import Unscented
from trackbench.filters.base import AnyFilter, Steps
from trackbench.filters.gaussian_base import Tracked
from trackbench.models.base import Model, angle_rows
from trackbench.models.motions.steps_at_once import matrices_of_steps
from trackbench.models.sensors.compiled_sensors import measured_by_kernel
from trackbench.models.sensors.position import LinearSensor


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
        None for another model, or if `core.compiled_steps.track` cannot filter it.
    """
    motion, sensor = model
    if not isinstance(sensor, LinearSensor):
        return None
    matrices = matrices_of_steps(motion, k, z.shape[1])
    if matrices is None:
        return None
    H = sensor.H(matrices.size)
    tracked = compiled_steps.track(state.posterior, matrices, H, sensor.R, z)
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
    """Return the innovation of one step, or of several, from one with nu (n_z, T, M).

    It has the prediction only if ``keeps_predictions`` says so.
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
