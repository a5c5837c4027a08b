"""The Kalman filter: a step reads on from `GaussianFilter.step` to `KF.update` to `core/kalman.py`."""

from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np

from trackbench.core import compiled_steps, kalman
from trackbench.core.arrays import Array, Index
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation, Updated
from trackbench.filters.base import Steps
from trackbench.filters.gaussian_base import GaussianFilter, Tracked
from trackbench.models.base import Differentiable, Model
from trackbench.models.derivatives import jacobian_at
from trackbench.models.motions.irregular import matrices_of_steps
from trackbench.models.sensors.position import LinearSensor
from trackbench.registry import register


@register("filters", "kf")
@dataclass(frozen=True, kw_only=True)
class KF(GaussianFilter):
    """Kalman filter for a linear motion and a linear sensor (adaptive-kf paper, eqs. 8-12).

    The covariance does not depend on the data: it and the gain are computed once for all runs.
    """

    requires: ClassVar[tuple[str, ...]] = ("motion.F|linear", "sensor.H|linear")
    is_linear: ClassVar[bool] = True

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict with F and Q, update with H and R."""
        # A cast, because isinstance of a Protocol at every step takes as long as the step.
        motion, sensor = cast(Differentiable, model)
        # Step 1: m^- = F m, P^- = F P F' + Q.
        transition = motion.transition(state.mean, k)
        F = jacobian_at(motion, state, k)
        predicted = kalman.predict(state, F, transition.cov, transition.mean)
        # Step 2: the innovation nu = z - H m^-.
        measurement = sensor.measurement(predicted.mean, k)
        nu = sensor.innovation(z, measurement.mean)
        # Step 3: S = H P^- H' + R, K = P^- H' S^-1;
        # m = m^- + K nu, P = (I - K H) P^- (I - K H)' + K R K'.
        H = jacobian_at(sensor, predicted, k)
        return kalman.update(predicted, nu, H, measurement.cov)

    def all_steps(self, model: Model, state: Tracked, z: Array, k: int) -> Steps | None:
        """Filter all measurements z (n_z, T, M) in one call; None unless this is a plain KF.

        The sensor must also be constant, and the model small.
        """
        # A plain KF has all other keys at their defaults.
        if type(self) is not KF or self != KF(smooth=self.smooth):
            return None
        return linear_steps(model, state, z, k)


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
        """Return the state after measurement i."""
        posterior = Gaussian(posteriors.mean[:, i], posteriors.cov[:, :, i, 0])
        innovation = Innovation(innovations.nu[:, i], innovations.S[:, :, i, 0])
        return Tracked(posterior=posterior, nis=nis[i], innovation=innovation)

    def posteriors_before() -> Gaussian:
        """Return the posterior before each step: means (n, T, M), covariances (n, n, T, 1)."""
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
        """Return one state before the steps of these indices, whose batch is each step's runs."""
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
