"""Motion and sensor of a scenario as Stone Soup models; importing this imports Stone Soup."""

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition import TransitionModel
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.types.array import CovarianceMatrix, StateVectors

from trackbench.adapters.partial_updates import Foreign
from trackbench.adapters.per_run import PerRun
from trackbench.core.arrays import Array


def models(run: PerRun) -> tuple[Foreign, Foreign]:
    """Convert the assumed motion and sensor of a filter of one run to Stone Soup models.

    A linear motion becomes a time-invariant linear model, a linear sensor a ``LinearGaussian``. The
    other models call trackbench's.

    Parameters
    ----------
    run : PerRun
        Object of one run, with its attribute ``model``. The models that call trackbench's read its ``k``
        at every step.

    Returns
    -------
    transition : stonesoup TransitionModel
        Motion, in the scenario's order of components.
    measurement : stonesoup MeasurementModel
        Sensor, in the scenario's order of components.

    Raises
    ------
    ValueError
        If the covariance of the measurement noise depends on the state.
    """
    motion: Foreign = run.model.motion
    sensor: Foreign = run.model.sensor
    x = np.zeros((len(motion.components), 1))
    # R at any state and step: a covariance with a third axis, over states, depends on the state. The
    # state is all ones, as some sensors are undefined at the origin, such as an azimuth.
    R = np.asarray(sensor.measurement(x + 1.0, 0).cov)
    if R.ndim != 2:
        raise ValueError("the sensor's noise depends on the state: write Stone Soup's own model")
    # Step 1: the motion.
    transition: Foreign
    if hasattr(motion, "F"):
        transition = LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=motion.F.copy(), covariance_matrix=CovarianceMatrix(motion.Q.copy())
        )
    else:
        transition = MotionModel(run=run)
    # Step 2: the sensor. Stone Soup's linear model only picks components of the state.
    n = len(x)
    noise = CovarianceMatrix(R.copy())
    if hasattr(sensor, "H"):
        H = sensor.H(n)
        picked_rows = H.argmax(axis=1)
        if np.array_equal(H, np.eye(n)[picked_rows]):
            return transition, LinearSensor(
                ndim_state=n, mapping=picked_rows.tolist(), noise_covar=noise
            )
    all_rows = tuple(range(n))
    return transition, SensorModel(ndim_state=n, mapping=all_rows, noise_covar=noise, run=run)


def _columns(state: Foreign) -> Array:
    """Return the vectors (n, M) of a Stone Soup state that holds M vectors, one or more."""
    return np.asarray(state.state_vector, dtype=float)


class LinearSensor(LinearGaussian):
    """A linear sensor, which ignores ``near``."""

    near: Foreign = None


class SensorModel(NonLinearGaussianMeasurement):
    """Sensor of trackbench; predicted angles lie within half a turn of ``near``, for averages."""

    run: Foreign = Property()
    near: Foreign = None

    @property
    def ndim_meas(self) -> int:
        """Number of components of the measurement."""
        return len(self.run.model.sensor.components)

    def function(self, state: Foreign, noise: Foreign = False, **kwargs: object) -> Foreign:
        """Return the measurement without noise of one state or of several side by side.

        `near` is the measurement (n_z,) of the step, set by `StoneSoup.step` before an update; None
        before the first one. Stone Soup averages and subtracts angles as numbers, which is right if they
        lie within half a turn of `near`.

        Parameters
        ----------
        state : stonesoup State
            State whose vectors are (n, M), of which M may be 1.
        noise : bool or array
            Flag or values to be added, as Stone Soup passes them; noise is not supported.
        **kwargs
            Further arguments of Stone Soup. They are ignored, as ``run.k`` is the step.

        Returns
        -------
        stonesoup StateVectors
            Measurements (n_z, M).

        Raises
        ------
        NotImplementedError
            If ``noise`` is True, or has values other than zero.
        """
        if noise is not False and noise is not None and np.any(noise):
            raise NotImplementedError("no noise is drawn from a scenario's sensor")
        sensor = self.run.model.sensor
        x = _columns(state)
        predicted = sensor.measurement(x, self.run.k).mean
        if self.near is None:
            return StateVectors(predicted)
        # z_pred = near - (near - z_pred), the difference with wrapped angles.
        near = np.repeat(self.near[:, None], x.shape[1], axis=1)
        return StateVectors(near - sensor.innovation(near, predicted))

    def jacobian(self, state: Foreign, **kwargs: object) -> Foreign:
        """Return the sensor's Jacobian (n_z, n) at the first vector of a state, without ``kwargs``."""
        H = self.run.model.sensor.jacobian(_columns(state)[:, :1], self.run.k)
        return np.asarray(H).reshape(self.ndim_meas, -1)


class MotionModel(GaussianModel, TransitionModel):
    """Motion with additive noise, from step k - 1 to step k."""

    run: Foreign = Property()

    @property
    def ndim_state(self) -> int:
        """Number of components of the state."""
        return len(self.run.model.motion.components)

    def function(self, state: Foreign, noise: Foreign = False, **kwargs: object) -> Foreign:
        """Return the next state without noise, of one state or of several side by side.

        The ``kwargs`` of Stone Soup, such as ``time_interval``, are ignored: ``run.k`` is the step.
        """
        return StateVectors(self.run.model.motion.transition(_columns(state), self.run.k).mean)

    def jacobian(self, state: Foreign, **kwargs: object) -> Foreign:
        """Return the motion's Jacobian (n, n) at the first vector of a state, without ``kwargs``."""
        F = self.run.model.motion.jacobian(_columns(state)[:, :1], self.run.k)
        return np.asarray(F).reshape(self.ndim_state, -1)

    def matrix(self, **kwargs: object) -> Foreign:
        """Return F of the current step, of a linear motion whose steps differ.

        ``run._now`` is the estimate of the step before, until `StoneSoup.step` has predicted.
        """
        return self.jacobian(self.run._now)

    def covar(self, **kwargs: object) -> Foreign:
        """Return the covariance (n, n) of the process noise, given the mean of the step before.

        ``run._now`` is the estimate of that step, until `StoneSoup.step` has predicted. ``kwargs``, such
        as ``time_interval``, are ignored: ``run.k`` is the step.
        """
        x = _columns(self.run._now)
        Q = np.asarray(self.run.model.motion.transition(x, self.run.k).cov)
        return CovarianceMatrix(Q.reshape(self.ndim_state, -1))
