"""``FilterPy``: any Kalman filter of filterpy, as an object that a method makes."""

import inspect
from typing import Any, ClassVar

import numpy as np

from trackbench.adapters.component_order import Pair
from trackbench.adapters.partial_measurements import measured_part, partial_update
from trackbench.adapters.per_run import PerRun
from trackbench.core.arrays import Array, Mask
from trackbench.core.mixtures import log_mixture
from trackbench.filters.base import WrongReturnError

_BANK = "filters"
"""Where filterpy's IMM keeps its filters."""


class FilterPy(PerRun):
    """An object of filterpy per run: write ``make(dt)``, which gives it.

    ``KalmanFilter``, ``ExtendedKalmanFilter``, ``UnscentedKalmanFilter``, ``CubatureKalmanFilter``,
    ``IMMEstimator`` and whatever else has ``x``, ``P``, ``predict`` and ``update``. Its ``x`` and ``P``
    are set to the scenario's prior, whatever ``make`` gave them. What ``update`` wants beside z, such
    as an extended filter's ``HJacobian`` and ``Hx``, is a mapping beside the object: ``return ekf,
    {"HJacobian": jacobian, "Hx": h}``. A missing measurement is predicted over, and what is missing of
    one left out of an object with ``R`` (in an IMM, of filters with ``H``).

    ``nis`` is noted of a filter with an innovation, ``mode`` (weight of all models but the first) of an
    IMM; the log score is that of the object's own innovations ``y`` and ``S``.
    """

    packages: ClassVar[tuple[str, ...]] = ("filterpy",)

    def make(self, dt: float) -> Any:
        """The object for steps of dt seconds, or the object and the keywords of its ``update``."""
        raise NotImplementedError(f"{type(self).__name__} has no make(dt)")

    def start(self, mean: Array, cov: Array) -> None:
        """Make the object, and set the state of it and of the filters in it."""
        self._object, self._keywords = self._making(self.dt)
        self._by_dt, self._noted = {self.dt: self._object}, {"nis": np.nan}
        self._there: Mask | None = None
        for part in (*_within(self._object), self._object):
            if np.size(part.x) != len(mean):
                what = f"make(dt) gives a filter of {np.size(part.x)} components, not {len(mean)}"
                raise WrongReturnError("make", f"{what}: name them in `state`")
            # In the object's own form: a column for some, a vector for others.
            part.x, part.P = mean.reshape(np.shape(part.x)).copy(), cov.copy()
        self._takes_dt = "dt" in inspect.signature(self._object.predict).parameters

    def predict(self, dt: float) -> Pair:
        """The object's own prediction."""
        self._noted, self._there = dict.fromkeys(self._noted, np.nan), None
        if dt not in self._by_dt:
            self._by_dt[dt], _ = self._making(dt)
        own = self._object
        if dt != self.dt or len(self._by_dt) > 1:
            _retimed(own, self._by_dt[dt])
        own.predict(**({"dt": dt} if self._takes_dt else {}))
        return own.x, own.P

    def update(self, z: Array) -> Pair:
        """The object's own update."""
        own, self._there = self._object, np.asarray(z == z)
        self._predicted = getattr(own, "cbar", None)
        each = _within(own) or (own,)
        if self._there.all():
            own.update(_as_state(z, each[0]), **self._keywords)
        else:
            with partial_update(each, z, self._there, self._keywords) as (part, keywords):
                own.update(_as_state(part, each[0]), **keywords)
        if hasattr(own, "mu"):
            self._noted = {"mode": 1.0 - float(own.mu[0])}
        elif hasattr(own, "SI"):
            self._noted = {"nis": self._nis()}
        return own.x, own.P

    def _nis(self) -> float:
        y, there = np.ravel(self._object.y), self._there
        if there is None or there.all():
            return float(y @ self._object.SI @ y)
        return measured_part(y, self._object.S, there).nis.item()

    def log_likelihood(self) -> float:
        """By the innovation of the object; of an IMM by those of its filters and their weights."""
        own, there = self._object, self._there
        each = _within(own) or (own,)
        if there is None or not all(hasattr(one, "y") and hasattr(one, "S") for one in each):
            return float("nan")
        told = [measured_part(one.y, one.S, there).log_likelihood for one in each]
        weights = np.ones(1) if len(told) == 1 else self._predicted
        if weights is None:
            return float("nan")
        return log_mixture(np.asarray(weights)[:, None], np.array(told)).item()

    def diagnostics(self) -> dict[str, float]:
        """NIS, or the weight of an IMM's models."""
        return self._noted

    def _making(self, dt: float) -> tuple[Any, dict[str, Any]]:
        made = self.make(dt)
        own, keywords = made if isinstance(made, tuple) else (made, {})
        for name in ("x", "P", "predict", "update"):
            if not hasattr(own, name):
                what = f"make(dt) gives a {type(own).__name__}, which has no {name}"
                raise WrongReturnError("make", what)
        return own, keywords


def _as_state(z: Array, one: Any) -> Array:
    """z in the form of the object's state, a column or a vector."""
    return z.reshape((-1, *[1] * (np.ndim(one.x) - 1)))


def _within(own: Any) -> tuple[Any, ...]:
    """The filters of an IMM."""
    return tuple(getattr(own, _BANK, ()))


def _retimed(own: Any, other: Any) -> None:
    """Give a filter, and those within it, the motion of one that was made for another interval."""
    for one, of in zip((own, *_within(own)), (other, *_within(other)), strict=True):
        for name in ("F", "Q", "B"):
            if hasattr(of, name):
                setattr(one, name, getattr(of, name))
