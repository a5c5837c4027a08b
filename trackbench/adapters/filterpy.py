"""``FilterPy``: adapter for any Kalman filter of filterpy."""

import inspect

import numpy as np

from trackbench.adapters.filter_state_components import Pair
from trackbench.adapters.partial_updates import Foreign, Functions, measured_part, partial_update
from trackbench.adapters.per_run import PerRun
from trackbench.core.arrays import Array, Mask
from trackbench.core.mixtures import log_mixture
from trackbench.filters.base import WrongReturnError


class FilterPy(PerRun):
    """A filterpy object per run: write ``make(dt)``, which returns it.

    The object is a ``KalmanFilter``, ``ExtendedKalmanFilter``, ``UnscentedKalmanFilter``,
    ``CubatureKalmanFilter``, ``IMMEstimator`` or any other with ``x``, ``P``, ``predict`` and
    ``update``. trackbench sets its ``x`` and ``P`` to the scenario's prior. It predicts over a
    missing measurement, and leaves missing components out of an object with ``R`` (in an IMM, of
    filters with ``H``). The diagnostics are ``nis`` of a filter with an innovation, and ``mode``
    (weight of all models but the first) of an IMM. The log score comes from the object's
    innovations ``y`` and ``S``.
    """

    def make(self, dt: float) -> Foreign:
        """Return the object for steps of dt seconds.

        Parameters
        ----------
        dt : float
            Seconds from one step to the next.

        Returns
        -------
        object or tuple
            The filterpy object. If its ``update`` takes further arguments, such as an extended filter's
            ``HJacobian`` and ``Hx``, the object and a dict of them:
            ``return ekf, {"HJacobian": jacobian, "Hx": h}``.
        """
        raise NotImplementedError(f"{type(self).__name__} has no make(dt)")

    def start(self, mean: Array, cov: Array) -> None:
        """Make the object, and set its state and those of the filters in it to mean (n,), cov (n, n)."""
        self._object, self._keywords = self._make(self.dt)
        # By interval: objects that `predict` makes for other intervals, to take their motion.
        self._object_by_dt: dict[float, Foreign] = {}
        self._diagnostics = {"nis": np.nan}
        self._is_measured: Mask | None = None
        for part in (*_imm_filters(self._object), self._object):
            if np.size(part.x) != len(mean):
                message = (
                    f"make(dt) gives a filter of {np.size(part.x)} components, not {len(mean)}"
                )
                raise WrongReturnError("make", f"{message}: name them in `state`")
            # In the object's own form: a column for some, a vector for others.
            part.x = mean.reshape(np.shape(part.x)).copy()
            part.P = cov.copy()
        self._takes_dt = "dt" in inspect.signature(self._object.predict).parameters

    def predict(self, dt: float) -> Pair:
        """Call the object's prediction over dt seconds; return its mean and covariance."""
        # Without an update diagnostics are NaN, and no component is measured.
        self._diagnostics = dict.fromkeys(self._diagnostics, np.nan)
        self._is_measured = None
        # For another interval than the first, an object made for this interval gives the motion. After
        # that the motion must be set for every interval, also the first.
        if dt != self.dt or self._object_by_dt:
            if dt not in self._object_by_dt:
                self._object_by_dt[dt], _ = self._make(dt)
            _copy_motion(self._object_by_dt[dt], self._object)
        if self._takes_dt:
            self._object.predict(dt=dt)
        else:
            self._object.predict()
        return self._object.x, self._object.P

    def update(self, z: Array) -> Pair:
        """Call the object's update, with the measured components of z; return its mean and covariance.

        ``z`` (n_z,) is NaN where a component is missing.
        """
        target = self._object
        # Step 1: update. The filters of an IMM are restricted to the measured components, too.
        self._is_measured = np.asarray(z == z)  # NaN, a missing component, differs from itself
        self._predicted_weights = getattr(target, "cbar", None)  # those of an IMM's models
        parts = _imm_filters(target) or (target,)
        if self._is_measured.all():
            target.update(_in_form_of_state(z, parts[0]), **self._keywords)
        else:
            restricted = partial_update(parts, z, self._is_measured, self._keywords)
            with restricted as (z_restricted, keywords):
                target.update(_in_form_of_state(z_restricted, parts[0]), **keywords)
        # Step 2: diagnostics of an IMM, or of a filter with an innovation.
        if hasattr(target, "mu"):
            self._diagnostics = {"mode": 1.0 - float(target.mu[0])}  # all models but the first
        elif hasattr(target, "SI"):
            self._diagnostics = {"nis": self._nis()}
        return target.x, target.P

    def _nis(self) -> float:
        """Return the NIS of the measured components, y' S^-1 y, of the last update.

        ``_is_measured`` (n_z,) marks these components; it is None until an update sets it.
        """
        # The object's innovation y, with covariance S and its inverse SI.
        y = np.ravel(self._object.y)
        is_measured = self._is_measured
        if is_measured is None or is_measured.all():
            return float(y @ self._object.SI @ y)
        return measured_part(y, self._object.S, is_measured).nis.item()

    def log_likelihood(self) -> float:
        """Return the log-density of the innovation, of an IMM that of the mixture of its filters.

        It is NaN without an update, and for an object that has no innovation.
        """
        is_measured = self._is_measured
        parts = _imm_filters(self._object) or (self._object,)
        if is_measured is None or not all(hasattr(p, "y") and hasattr(p, "S") for p in parts):
            return float("nan")
        # sum_i c_i N(y_i; 0, S_i), with the predicted weights c_i of an IMM's models.
        log_likelihoods = []
        for part in parts:
            innovation = measured_part(part.y, part.S, is_measured)
            log_likelihoods.append(innovation.log_likelihood)
        weights = np.ones(1) if len(parts) == 1 else self._predicted_weights
        if weights is None:  # an object with filters and without `cbar`
            return float("nan")
        return log_mixture(np.asarray(weights)[:, None], np.array(log_likelihoods)).item()

    def diagnostics(self) -> dict[str, float]:
        """Return the ``nis``; of an IMM the ``mode``, the weight of all its models but the first."""
        return self._diagnostics

    def _make(self, dt: float) -> tuple[Foreign, Functions]:
        """Call `make` for steps of dt seconds; return the object, and further arguments of its update.

        Raises WrongReturnError for an object that is no filter.
        """
        returned = self.make(dt)
        target, keywords = returned if isinstance(returned, tuple) else (returned, {})
        for name in ("x", "P", "predict", "update"):
            if not hasattr(target, name):
                message = f"make(dt) gives a {type(target).__name__}, which has no {name}"
                raise WrongReturnError("make", message)
        return target, keywords


def _in_form_of_state(z: Array, target: Foreign) -> Array:
    """Return z as a column if the object's state is a column, else as a vector."""
    further_axes = np.ndim(target.x) - 1
    return z.reshape((-1, *[1] * further_axes))


def _imm_filters(target: Foreign) -> tuple[Foreign, ...]:
    """Return the filters of an IMM; none of another object."""
    return tuple(vars(target).get("filters", ()))


def _copy_motion(source: Foreign, target: Foreign) -> None:
    """Copy the motion (F, Q, B) of ``source`` to ``target``, of an IMM also that of its filters."""
    sources = (source, *_imm_filters(source))
    targets = (target, *_imm_filters(target))
    for source_part, target_part in zip(sources, targets, strict=True):
        for name in ("F", "Q", "B"):
            if hasattr(source_part, name):
                setattr(target_part, name, getattr(source_part, name))
