"""Innovations of a filter, computed from its predictions of measurements, many steps at once."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.covariances_of_steps import stack_covariances
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.models.base import Model
from trackbench.models.sensors.steps_at_once import SensorOfSteps

_AT_ONCE = 65_536
"""Numbers in the covariances of the predictions whose innovations are computed in one call."""


class Innovations:
    """Innovations of predictions, computed for many steps in one call."""

    def __init__(self, model: Model, errors_at_mean: bool = False) -> None:
        """Begin without predictions; ``model`` is the one that the filter assumes.

        The predicted measurement is the mean of h over the predicted Gaussian, by cubature. With
        ``errors_at_mean`` the `errors` are those of h at the predicted mean instead. That is for a
        filter that never updates, whose covariance grows without a limit.
        """
        self._model = model
        self._errors_at_mean = errors_at_mean
        # Steps that wait for a call: predicted state, measurements and number of each.
        self._waiting: list[tuple[Gaussian, Array, int]] = []
        # By call: the innovations and the prediction errors of its steps.
        self._computed: list[Innovation] = []
        self._errors: list[Array] = []

    def add(self, predicted: Gaussian, z: Array, k: int) -> None:
        """Add the predicted state and the measurements of a step.

        The step waits until there are enough for one call.

        Parameters
        ----------
        predicted
            predicted mean (n, M) and covariance (n, n[, M])
        z
            measurements (n_z, M), NaN where a component is missing
        k
            number of the step
        """
        self._waiting.append((predicted, z, k))
        # Numbers in covariances (n, n, M) of all waiting steps; the size of the mean is n M.
        if len(self._waiting) * len(predicted.mean) * predicted.mean.size >= _AT_ONCE:
            self._compute_waiting()

    def add_steps(self, predicted: Gaussian, z: Array, steps: Sequence[int]) -> None:
        """Add predictions of many steps, and their measurements.

        Parameters
        ----------
        predicted
            predicted means (n, S, M) and covariances (n, n, S, M) or (n, n, S, 1)
        z
            measurements (n_z, S, M), NaN where a component is missing
        steps
            numbers of the S steps
        """
        self._compute_waiting()  # the steps that were added before come first
        n = len(predicted.mean)
        model = Model(self._model.motion, SensorOfSteps(self._model.sensor, steps))
        # The batch (T, M) becomes one axis.
        cov = np.broadcast_to(predicted.cov, (n, n, *z.shape[1:])).reshape(n, n, -1)
        together = Gaussian(predicted.mean.reshape(n, -1), cov)
        z = z.reshape(len(z), -1)
        # `SensorOfSteps` has the numbers of the steps: the one given here matters to no sensor.
        innovation = _innovation(model, together, z, steps[-1])
        self._computed.append(innovation)
        # Innovations are z less the mean of h over the predicted Gaussian. A filter that never updates
        # is judged by z - h(predicted mean), the error of its path, however wide its covariance is.
        if self._errors_at_mean:
            measured = model.sensor.measurement(together.mean, steps[-1])
            self._errors.append(model.sensor.innovation(z, measured.mean))
        else:
            self._errors.append(innovation.nu)

    def joined(self, runs: int) -> tuple[Array, Array]:
        """Return the innovations of all steps and their covariances.

        Parameters
        ----------
        runs
            number of runs, M

        Returns
        -------
        nu : array (n_z, T, M)
            innovations, in the units of the measurement
        S : array (n_z, n_z, T, M)
            their covariances, NaN for a prediction without a covariance
        """
        self._compute_waiting()
        nu = np.concatenate([i.nu for i in self._computed], axis=1)
        S = np.concatenate([i.S for i in self._computed], axis=2)
        n_z = len(nu)
        return nu.reshape(n_z, -1, runs), S.reshape(n_z, n_z, -1, runs)

    def errors(self, runs: int) -> Array:
        """Return the prediction errors (n_z, T, M) of all steps.

        They are the innovations, or with ``errors_at_mean`` the errors z - h(predicted mean). ``runs``
        is M.
        """
        self._compute_waiting()
        errors = np.concatenate(self._errors, axis=1)
        return errors.reshape(len(errors), -1, runs)

    def _compute_waiting(self) -> None:
        """Compute the innovations of the steps that were added one by one."""
        if self._waiting:
            estimates, z, steps = zip(*self._waiting, strict=True)
            self._waiting.clear()  # first, as `add_steps` computes the waiting ones
            means = np.stack([estimate.mean for estimate in estimates], axis=1)
            covs = stack_covariances([estimate.cov for estimate in estimates])
            self.add_steps(Gaussian(means, covs), np.stack(z, axis=1), steps)


def _innovation(model: Model, predicted: Gaussian, z: Array, k: int) -> Innovation:
    """Return the innovations of measurements z (n_z, B) at step k, with covariances S, from predictions.

    If a predicted state has a mean and no covariance, the measurement is predicted by the sensor at the
    mean, and S is NaN.
    """
    # Imported here, since pydantic comes with the filters' keys, and a worker may need neither.
    from trackbench.filters.sigma_point_steps import predicted_innovation

    mean_only = np.isnan(predicted.cov).any(axis=(0, 1)) & ~np.isnan(predicted.mean).any(axis=0)
    if not mean_only.any():
        return predicted_innovation(model, predicted, z, k)
    without_spread = Gaussian(predicted.mean, np.where(mean_only, 0.0, predicted.cov))
    innovation = predicted_innovation(model, without_spread, z, k)
    return innovation._replace(S=np.where(mean_only, np.nan, innovation.S))
