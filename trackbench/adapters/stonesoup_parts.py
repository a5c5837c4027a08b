"""``StoneSoup``: a predictor and an updater of Stone Soup, on the scenario's own models."""

from datetime import datetime, timedelta
from typing import Any, ClassVar

import numpy as np

from trackbench.adapters.naming import Pair
from trackbench.adapters.per_run import PerRun, whole
from trackbench.core.arrays import Array

_BEGIN = datetime(2000, 1, 1)


class StoneSoup(PerRun):
    """A predictor and an updater of Stone Soup: write ``make(transition, measurement)``.

    Those of its Kalman filters, whose state is a ``GaussianState``. ``transition`` and ``measurement``
    are the models that the scenario lets a filter assume, as Stone Soup's: use them or others. A class
    that names ``state`` or ``measured`` has an order of its own, hence models of its own, and is given
    None. A missing measurement is predicted over; ``nis`` is noted.

    Times are Stone Soup's, whole microseconds.
    """

    packages: ClassVar[tuple[str, ...]] = ("stonesoup",)
    excused: ClassVar[dict[str, str]] = {}

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
        self._nis = np.nan

    def step(self, z: Array | None, dt: float) -> Pair:
        """Predict, and update with what was measured."""
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        now, self._nis = self._now.timestamp + timedelta(seconds=dt), np.nan
        self._now = self._predictor.predict(self._now, timestamp=now)
        if z is not None:
            sensor = self._updater.measurement_model or self._measurement
            seen = Detection(whole(z), timestamp=now, measurement_model=sensor)
            if self._measurement is not None:
                self._measurement.seen = z
            found = SingleHypothesis(self._now, seen)
            self._now = self._updater.update(found)
            self._nis = _nis(seen, self._now.hypothesis.measurement_prediction)
        return np.asarray(self._now.state_vector, dtype=float), np.asarray(self._now.covar)

    def diagnostics(self) -> dict[str, float]:
        """NIS."""
        return {"nis": self._nis}


def _nis(seen: Any, predicted: Any) -> float:
    nu = np.asarray(seen.state_vector - predicted.state_vector, dtype=float)
    return float((nu.T @ np.linalg.solve(np.asarray(predicted.covar, dtype=float), nu)).item())
