"""A scenario's motion and sensor as Stone Soup's models. Imports Stone Soup."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition import TransitionModel
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.types.array import CovarianceMatrix, StateVectors

from trackbench.core.arrays import Array


def models(of: Any) -> tuple[Any, Any]:
    """Transition and measurement model of what a filter of one run was given.

    ``of`` has ``model`` and, at every step, ``k``. A linear motion becomes a time-invariant linear
    model, a linear sensor a `LinearGaussian`; all others ask ours.
    """
    motion, sensor = of.model
    x = np.zeros((len(motion.components), 1))
    R = np.asarray(sensor.measurement(x + 1.0, 0).cov)
    if R.ndim != 2:
        raise ValueError("the sensor's noise depends on the state: write Stone Soup's own model")
    noise, size = CovarianceMatrix(R.copy()), len(x)
    return _transition(of, motion), (
        Projecting(ndim_state=size, mapping=_selected(sensor, size), noise_covar=noise)
        if hasattr(sensor, "H")
        else Seeing(ndim_state=size, mapping=tuple(range(size)), noise_covar=noise, of=of)
    )


def _selected(sensor: Any, n: int) -> Sequence[int]:
    return [int(row.argmax()) for row in sensor.H(n)]


def _transition(of: Any, motion: Any) -> Any:
    if not hasattr(motion, "F"):
        return Moving(of=of)
    return LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=motion.F.copy(), covariance_matrix=CovarianceMatrix(motion.Q.copy())
    )


def _columns(state: Any) -> Array:
    return np.asarray(state.state_vector, dtype=float)


class Projecting(LinearGaussian):
    """A linear sensor; ``seen`` is as for `Seeing`, and not looked at."""

    seen: Any = None


class Seeing(NonLinearGaussianMeasurement):
    """Any sensor. Predicted angles lie within half a turn of ``seen``, so that they may be averaged."""

    of: Any = Property()
    seen: Any = None

    @property
    def ndim_meas(self) -> int:
        """Components of the measurement."""
        return len(self.of.model.sensor.components)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """The measurement without its noise, of one state or of several side by side."""
        if noise is not False and noise is not None and np.any(noise):
            raise NotImplementedError("no noise is drawn from a scenario's sensor")
        sensor, x = self.of.model.sensor, _columns(state)
        found = sensor.measurement(x, self.of.k).mean
        if self.seen is not None:
            seen = np.repeat(self.seen[:, None], x.shape[1], axis=1)
            found = seen - sensor.innovation(seen, found)
        return StateVectors(found)

    def jacobian(self, state: Any, **kwargs: Any) -> Any:
        """The sensor's own."""
        found = self.of.model.sensor.jacobian(_columns(state)[:, :1], self.of.k)
        return np.asarray(found).reshape(self.ndim_meas, -1)


class Moving(GaussianModel, TransitionModel):
    """Any motion whose noise is added; from step k - 1 to step k, whatever the times say."""

    of: Any = Property()

    @property
    def ndim_state(self) -> int:
        """Components of the state."""
        return len(self.of.model.motion.components)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """The next state without its noise, of one state or of several side by side."""
        return StateVectors(self.of.model.motion.transition(_columns(state), self.of.k).mean)

    def jacobian(self, state: Any, **kwargs: Any) -> Any:
        """The motion's own."""
        found = self.of.model.motion.jacobian(_columns(state)[:, :1], self.of.k)
        return np.asarray(found).reshape(self.ndim_state, -1)

    def matrix(self, **kwargs: Any) -> Any:
        """Of a linear motion, whose steps differ, that of the step that is being made."""
        return self.jacobian(self.of._now)

    def covar(self, **kwargs: Any) -> Any:
        """Covariance of the noise at the last state's mean."""
        x = _columns(self.of._now)
        found = np.asarray(self.of.model.motion.transition(x, self.of.k).cov)
        return CovarianceMatrix(found.reshape(self.ndim_state, -1))
