"""``StoneSoup``: a predictor and an updater of Stone Soup, on the scenario's own models."""

from copy import copy
from datetime import datetime, timedelta
from typing import Any, ClassVar

import numpy as np

from trackbench.adapters.component_order import Pair
from trackbench.adapters.partial_measurements import (
    PARTIAL_UNSUPPORTED,
    inflate_missing,
    measured_part,
)
from trackbench.adapters.per_run import PerRun
from trackbench.core.arrays import Array, Mask
from trackbench.core.kalman import Innovation

_BEGIN = datetime(2000, 1, 1)


class StoneSoup(PerRun):
    """A predictor and an updater of Stone Soup: write ``make(transition, measurement)``.

    Those of its Kalman filters, whose state is a ``GaussianState``. ``transition`` and ``measurement``
    are the models that the scenario lets a filter assume, as Stone Soup's: use them or others. A class
    that names ``state`` or ``measured`` has an order of its own, hence models of its own, and is given
    None. A missing measurement is predicted over, and what is missing of one left out by a sensor with
    a ``noise_covar``. ``nis`` is noted; the log score is that of the updater's predicted measurement.

    Times are Stone Soup's, whole microseconds.
    """

    packages: ClassVar[tuple[str, ...]] = ("stonesoup",)
    contract_exemptions: ClassVar[dict[str, str]] = {}

    def make(self, transition: Any, measurement: Any) -> tuple[Any, Any]:
        """A predictor and an updater."""
        raise NotImplementedError(f"{type(self).__name__} has no make(transition, measurement)")

    def start(self, mean: Array, cov: Array) -> None:
        """Make both, and the first state."""
        from stonesoup.types.array import CovarianceMatrix, StateVector
        from stonesoup.types.state import GaussianState

        from trackbench.adapters.stonesoup_models import models

        self._measurement: Any
        is_own = bool(self.state or self.measured)
        transition, self._measurement = (None, None) if is_own else models(self)
        self._predictor, self._updater = self.make(transition, self._measurement)
        self._now: Any = GaussianState(StateVector(mean), CovarianceMatrix(cov), timestamp=_BEGIN)
        self._told: Innovation | None = None

    def step(self, z: Array | None, dt: float) -> Pair:
        """Predict, and update with what was measured."""
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        now, self._told = self._now.timestamp + timedelta(seconds=dt), None
        self._now = self._predictor.predict(self._now, timestamp=now)
        if z is not None:
            there = np.asarray(z == z)
            sensor = self._updater.measurement_model or self._measurement
            if not there.all():
                sensor, z = _half(sensor, there), np.where(there, z, 0.0)
            seen = Detection(z, timestamp=now, measurement_model=sensor)
            if self._measurement is not None:
                sensor.seen = z
            self._now = self._updater.update(SingleHypothesis(self._now, seen))
            predicted = self._now.hypothesis.measurement_prediction
            nu = np.asarray(seen.state_vector - predicted.state_vector, dtype=float)
            self._told = measured_part(nu, predicted.covar, there)
        return np.asarray(self._now.state_vector, dtype=float), np.asarray(self._now.covar)

    def diagnostics(self) -> dict[str, float]:
        """NIS."""
        return {"nis": np.nan if self._told is None else self._told.nis.item()}

    def log_likelihood(self) -> float:
        """By the predicted measurement."""
        return float("nan") if self._told is None else self._told.log_likelihood.item()


def _half(sensor: Any, there: Mask) -> Any:
    """The measurement model without what is missing."""
    from stonesoup.types.array import CovarianceMatrix

    if not hasattr(sensor, "noise_covar"):
        raise ValueError(PARTIAL_UNSUPPORTED)
    out = copy(sensor)
    R = np.asarray(sensor.noise_covar, dtype=float)
    out.noise_covar = CovarianceMatrix(inflate_missing(R, there))
    return out
