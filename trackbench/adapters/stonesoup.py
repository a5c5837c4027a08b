"""``StoneSoup``: adapter for a predictor and an updater of Stone Soup, imported when the first runs."""

from copy import copy
from datetime import datetime, timedelta

import numpy as np

from trackbench.adapters.filter_state_components import Pair
from trackbench.adapters.partial_updates import (
    PARTIAL_UNSUPPORTED,
    Foreign,
    inflate_missing,
    measured_part,
)
from trackbench.adapters.per_run import PerRun
from trackbench.core.arrays import Array, Mask
from trackbench.core.kalman import Innovation

_BEGIN = datetime(2000, 1, 1)  # any time: only differences of times matter


class StoneSoup(PerRun):
    """A Stone Soup predictor and updater per run: write ``make(transition, measurement)``.

    The state is a ``GaussianState``, as in Stone Soup's Kalman filters. The adapter predicts over a
    missing measurement, and leaves missing components out of a sensor with a ``noise_covar``. The
    diagnostic is ``nis``. The log score comes from the updater's predicted measurement. Times are
    Stone Soup's, whole microseconds.
    """

    def make(self, transition: Foreign, measurement: Foreign) -> tuple[Foreign, Foreign]:
        """Return a predictor and an updater.

        Parameters
        ----------
        transition : stonesoup TransitionModel or None
            Motion that the filter assumes. None if the class sets its attribute `state` or `measured`,
            the names of its components in its own order: its models must have this order, too.
        measurement : stonesoup MeasurementModel or None
            Sensor that the filter assumes. None if the class sets `state` or `measured`.

        Returns
        -------
        tuple
            A Stone Soup predictor and an updater, with these models or others.
        """
        raise NotImplementedError(f"{type(self).__name__} has no make(transition, measurement)")

    def start(self, mean: Array, cov: Array) -> None:
        """Make the predictor and the updater, and the first state N(mean, cov).

        ``mean`` (n,) and ``cov`` (n, n) are the moments of the prior in the filter's order.
        """
        from stonesoup.types.array import CovarianceMatrix, StateVector
        from stonesoup.types.state import GaussianState

        from trackbench.adapters.stonesoup_models import models

        # The scenario's models have the scenario's order of components. A class that sets `state` or
        # `measured` has its own order, and gets None in their place.
        transition: Foreign = None
        self._measurement: Foreign = None
        has_own_order = bool(self.state or self.measured)
        if not has_own_order:
            transition, self._measurement = models(self)
        self._predictor, self._updater = self.make(transition, self._measurement)
        self._now: Foreign = GaussianState(
            StateVector(mean), CovarianceMatrix(cov), timestamp=_BEGIN
        )
        self._innovation: Innovation | None = None

    def step(self, z: Array | None, dt: float) -> Pair:
        """Predict over dt seconds, and update with the measured components of z.

        ``z`` (n_z,) is NaN where a component is missing, and None without a measurement. Return the mean
        (n,) and the covariance (n, n).
        """
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        # Step 1: predict to the time of the measurement.
        now = self._now.timestamp + timedelta(seconds=dt)
        self._innovation = None
        self._now = self._predictor.predict(self._now, timestamp=now)
        if z is not None:
            # Step 2: update, with no weight on missing components.
            is_measured = np.asarray(z == z)  # NaN, a missing component, differs from itself
            # `_measurement` is the scenario's sensor, or None if the class names components of its own.
            # An updater may have a model by itself; otherwise it takes that of the detection.
            sensor = self._updater.measurement_model or self._measurement
            if not is_measured.all():
                sensor = _without_missing(sensor, is_measured)
                z = np.where(is_measured, z, 0.0)
            detection = Detection(z, timestamp=now, measurement_model=sensor)
            if self._measurement is not None:
                # Predicted angles then lie within half a turn of the measured ones. Only the models of
                # `stonesoup_models` read this attribute.
                sensor.near = z
            self._now = self._updater.update(SingleHypothesis(self._now, detection))
            # Step 3: keep the innovation for the NIS and the log score.
            predicted = self._now.hypothesis.measurement_prediction
            nu = np.asarray(detection.state_vector - predicted.state_vector, dtype=float)
            self._innovation = measured_part(nu, predicted.covar, is_measured)
        return np.asarray(self._now.state_vector, dtype=float), np.asarray(self._now.covar)

    def diagnostics(self) -> dict[str, float]:
        """Return the NIS of the last step; NaN if there was no measurement."""
        if self._innovation is None:
            return {"nis": np.nan}
        return {"nis": self._innovation.nis.item()}

    def log_likelihood(self) -> float:
        """Return the log-density of the last z under its prediction; NaN if there was no measurement."""
        if self._innovation is None:
            return np.nan
        return self._innovation.log_likelihood.item()


def _without_missing(sensor: Foreign, is_measured: Mask) -> Foreign:
    """Copy the measurement model, with no weight on the components that ``is_measured`` (n_z,) lacks."""
    from stonesoup.types.array import CovarianceMatrix

    if not hasattr(sensor, "noise_covar"):
        raise ValueError(PARTIAL_UNSUPPORTED)
    inflated_sensor = copy(sensor)
    R = np.asarray(sensor.noise_covar, dtype=float)
    inflated_sensor.noise_covar = CovarianceMatrix(inflate_missing(R, is_measured))
    return inflated_sensor
