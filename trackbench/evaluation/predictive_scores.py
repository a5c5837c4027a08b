"""Predictive scores: how well a filter predicts measurements, without a truth.

Series (T + 1, M) beside those of `metrics`, for whoever asks for them:

``log_likelihood``   log p(z_k | z_1..k-1) by the filter's own method of that name
``squared_predicted_<component>``, ``error_predicted_<component>``  z_k minus its prediction
``innovations``      number of components measured, and not refused by the filter's gate
``anis``             normalized innovation squared over that number, 1 if consistent
``autocovariance_<l>``  whitened innovation times the l-th one before it, summed over the components
``held_log_likelihood``, ``squared_held_<component>``, ``error_held_<component>``  the same of
                     measurements that the filter is not given (``hold_out``)

Any filter can be asked for a prediction: it is a step without a measurement, and the measurement's
moments are those that its estimate gives by cubature (Bar-Shalom, Li & Kirubarajan 2001, section 5.4,
judge innovations). A filter that answers a mean alone has prediction errors, and no ``anis``.
Whoever is asked goes on from where it was, with the noise that it would have drawn.
"""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, Mask, all_finite, freeze
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sums import total
from trackbench.evaluation.consistency_and_calibration import side_by_side
from trackbench.evaluation.validate_output import checked_numbers
from trackbench.extension_points import foreign_parts
from trackbench.filters.base import AnyFilter, Steps, has_likelihood
from trackbench.models.base import Model
from trackbench.models.sensors.many_steps import SensorOfSteps

Kind = Literal["score", "prediction"]
"""What is wanted: the filters' own log-likelihoods; all that a prediction of each measurement tells."""
LAGS = 10
_SCORE = "log_likelihood"
_AT_ONCE = 65_536  # numbers in the covariances of predictions whose innovations are one call


def held_out(measurements: Array, every: int) -> Mask:
    """Return which measurements (T, M) are held out: every n-th existing one of each run."""
    measured = ~np.isnan(measurements).all(axis=0)
    return np.asarray(measured & (np.cumsum(measured, axis=0) % every == 0))


def visible_to_filter(measurements: Array, hold_out: int | None) -> Array:
    """Replace the measurements that are held out by NaN."""
    if not hold_out:
        return measurements
    return freeze(np.where(held_out(measurements, hold_out), np.nan, measurements))


def predictive_series(components: Sequence[str], scores: bool, hold_out: int | None) -> list[str]:
    """Return names of all predictive series; ``scores``: the filter has a log-likelihood."""
    out = [_SCORE] if scores else []
    out += ["anis", "innovations", *(f"autocovariance_{lag}" for lag in range(1, LAGS + 1))]
    heads = ["predicted"] + (["held"] if hold_out else [])
    if scores and hold_out:
        out.append(f"held_{_SCORE}")
    errors = product(heads, components, ("squared", "error"))
    return out + [f"{error}_{head}_{component}" for head, component, error in errors]


class Step(NamedTuple):
    """One step: state before and after, the whole estimate, the step, and what a gate refused."""

    before: Any
    after: Any
    estimate: Gaussian
    k: int
    refused: Array | Mask | None = None
    """1 for each run (M,), or each component (n_z, M), whose measurement was not used"""


class PredictionScorer:
    """The series of one filter over one block, step by step."""

    def __init__(
        self,
        tracker: AnyFilter,
        model: Model,
        measurements: Array,
        wanted: Sequence[str],
        hold_out: int | None,
        rng: Generator,
    ) -> None:
        self._tracker, self._model, self._rng = tracker, model, rng
        self._wanted = {"score", "prediction"}.intersection(wanted)
        self._all = measurements
        self._held_out = held_out(measurements, hold_out) if hold_out else None
        self.visible = visible_to_filter(measurements, hold_out)
        self._predicted, self._held = _Innovations(model), _Innovations(model)
        self._refused: list[Mask] = []
        self._scores: list[Array] = []
        self._held_scores: list[Array] = []
        self._held_steps: list[int] = []
        self._has_likelihood = has_likelihood(tracker)
        # The state of a plugin's filter may call something else its prediction.
        self._has_predictions = not foreign_parts(tracker)

    @property
    def disabled(self) -> bool:
        """True if no predictive score is requested."""
        return not self._wanted and self._held_out is None

    def snapshot(self, state: Any) -> Any:
        """Return the state as it is now: objects of one run change with each step."""
        if not self._tracker.loops_over_runs:
            return state
        return deepcopy(state, {id(self._model): self._model})

    def add(self, step: Step, i: int) -> None:
        """Add the step that used measurement i."""
        if self.disabled:
            return
        z = self.visible[:, i]
        if "score" in self._wanted:
            self._scores += self._log_likelihoods(step.after, z.shape[1])
        if "prediction" in self._wanted:
            self._predicted.add(self._prediction(step, z), z, step.k)
            refused = np.zeros(z.shape[1]) if step.refused is None else step.refused
            self._refused.append(np.broadcast_to(refused > 0, z.shape))
        if self._held_out is not None and self._held_out[i].any():
            # Without the measurement the estimate is the prediction.
            z = freeze(np.where(self._held_out[i], self._all[:, i], np.nan))
            self._held.add(_copy(step.estimate), z, step.k)
            self._held_steps.append(i)
            if self._has_likelihood:
                # Log-likelihood by a step aside that is given the measurement.
                after = self._aside(step, z)
                self._held_scores += self._log_likelihoods(after, z.shape[1])

    def add_steps(self, ahead: Steps, part: slice, steps: Sequence[int]) -> bool:
        """Add the steps that used the measurements of a part; False if each must be added alone."""
        if self.disabled:
            return True
        if not self._has_predictions or ahead.together is None or ahead.before is None:
            return False
        state, z = ahead.together(), self.visible[:, part]
        predicted = _finite(state.prediction)
        if predicted is None:
            return False
        if "score" in self._wanted:
            self._scores += self._log_likelihoods(state, *z.shape[1:])
        if "prediction" in self._wanted:
            self._predicted.add_steps(predicted, z, steps)
            self._refused.extend(np.zeros((z.shape[1], *z.shape[::2]), dtype=np.bool_))
        if self._held_out is not None and self._held_out[part].any():
            at = np.flatnonzero(self._held_out[part].any(axis=1))
            z = np.where(self._held_out[part][at], self._all[:, part][:, at], np.nan)
            estimate = Gaussian(ahead.estimate.mean[:, at], ahead.estimate.cov[:, :, at])
            self._held.add_steps(estimate, z, np.take(steps, at).tolist())
            self._held_steps += (at + part.start).tolist()
            if self._has_likelihood:
                z = freeze(z.reshape(len(z), -1))
                before = ahead.before(at)
                after = self._tracker.step(self._model, before, z, steps[0], self._rng)
                self._held_scores += self._log_likelihoods(after, z.shape[1])
        return True

    def series(self) -> dict[str, Array]:
        """Return values (T + 1, M) by the name of their series; of the first state there are none."""
        rows: dict[str, Array] = {}
        if self._scores:
            rows[_SCORE] = np.where(_measured(self.visible), np.stack(self._scores), np.nan)
        if "prediction" in self._wanted:
            rows |= self._of_predictions()
        if self._held_out is not None:
            rows |= self._of_held_out(self._held_out)
        return {name: after_first(values) for name, values in rows.items()}

    def _aside(self, step: Step, z: Array) -> Any:
        """Return the state after a step with other measurements."""
        before = self.snapshot(step.before)
        return self._tracker.step(self._model, before, z, step.k, self._rng)

    def _prediction(self, step: Step, z: Array) -> Gaussian:
        """Return the estimate after a step without a measurement."""
        if self._has_predictions and (stored := _finite(getattr(step.after, "prediction", None))):
            return stored
        nothing = freeze(np.full_like(z, np.nan))
        return _copy(self._tracker.estimate(self._aside(step, nothing)))

    def _log_likelihoods(self, state: Any, *batch: int) -> list[Array]:
        """Return the rows (M,) of the increments (*batch) of one or many steps."""
        if not self._has_likelihood:
            return []
        increments: Any = self._tracker.log_likelihood(state)
        checked = checked_numbers("series", {_SCORE: increments}, *batch)
        return [*checked[_SCORE].reshape(-1, self._all.shape[2])]

    def _of_predictions(self) -> dict[str, Array]:
        """Return the series (T, M) of the innovations, all steps at once."""
        nu, S = self._predicted.joined(self._all.shape[2])
        # Step 1: whiten, e = L^-1 nu with S = L L'; missing and refused components have no e, nor do
        # those of a prediction without a covariance.
        refused = np.stack(self._refused, axis=1) & ~np.isnan(nu)
        missing = np.isnan(nu) | refused
        for i in range(len(nu)):
            missing[i] |= np.isnan(S[i, i])
        number = (~missing).sum(axis=0)
        if (refused.any(axis=0) & (number > 0)).any():
            # The measurements of other sensors are used: theirs is the covariance without the refused.
            S = kalman.drop_missing_cov(S, refused)
        rows = linalg.whiten(linalg.cholesky(S), np.where(missing, 0.0, nu))
        white = np.where(missing, np.nan, np.stack(list(rows)))
        # Step 2: NIS = e' e, over the number of measured components.
        anis = _sum_of_known(np.square(white)) / number
        counts = {"anis": anis, "innovations": np.where(number, number, np.nan)}
        # Step 3: products with the whitened innovations of the last LAGS measurements.
        products = enumerate(_lagged_products(white, missing), 1)
        lagged = {f"autocovariance_{lag}": _sum_of_known(rows) for lag, rows in products}
        return self._errors("predicted", nu) | counts | lagged

    def _of_held_out(self, held_out: Mask) -> dict[str, Array]:
        """Return the series (T, M) of held-out measurements, NaN of the others."""
        nu, scores = np.full(self._all.shape, np.nan), np.full(held_out.shape, np.nan)
        if self._held_steps:
            nu[:, self._held_steps] = self._held.joined(self._all.shape[2])[0]
        rows = self._errors("held", nu)
        if self._has_likelihood:
            if self._held_scores:
                scores[self._held_steps] = self._held_scores
            rows[f"held_{_SCORE}"] = np.where(held_out, scores, np.nan)
        return rows

    def _errors(self, head: str, nu: Array) -> dict[str, Array]:
        names = self._model.sensor.components
        squares = {f"squared_{head}_{c}": e * e for c, e in zip(names, nu, strict=True)}
        return squares | {f"error_{head}_{c}": e for c, e in zip(names, nu, strict=True)}


class _Innovations:
    """Innovations of predictions, computed for many steps in one call."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._waiting: list[tuple[Gaussian, Array, int]] = []
        self._computed: list[Innovation] = []

    def add(self, predicted: Gaussian, z: Array, k: int) -> None:
        """Add the prediction of step k and its measurements (n_z, M)."""
        self._waiting.append((predicted, z, k))
        if len(self._waiting) * len(predicted.mean) * predicted.mean.size >= _AT_ONCE:
            self._compute_waiting()

    def add_steps(self, predicted: Gaussian, z: Array, steps: Sequence[int]) -> None:
        """Add the predictions of steps, means (n, T, M), and their measurements (n_z, T, M)."""
        n = len(predicted.mean)
        model = Model(self._model.motion, SensorOfSteps(self._model.sensor, steps))
        # The batch (T, M) becomes one axis.
        cov = np.broadcast_to(predicted.cov, (n, n, *z.shape[1:])).reshape(n, n, -1)
        together = Gaussian(predicted.mean.reshape(n, -1), cov)
        z = z.reshape(len(z), -1)
        self._computed.append(_innovation(model, together, z, steps[-1]))

    def joined(self, runs: int) -> tuple[Array, Array]:
        """Return the innovations (n_z, T, M) of all steps and their covariances (n_z, n_z, T, M)."""
        self._compute_waiting()
        nu = np.concatenate([i.nu for i in self._computed], axis=1)
        S = np.concatenate([i.S for i in self._computed], axis=2)
        return nu.reshape(len(nu), -1, runs), S.reshape(len(nu), len(nu), -1, runs)

    def _compute_waiting(self) -> None:
        if self._waiting:
            estimates, z, steps = zip(*self._waiting, strict=True)
            self._waiting.clear()
            means = np.stack([estimate.mean for estimate in estimates], axis=1)
            covs = side_by_side([estimate.cov for estimate in estimates])
            self.add_steps(Gaussian(means, covs), np.stack(z, axis=1), steps)


def _innovation(model: Model, predicted: Gaussian, z: Array, k: int) -> Innovation:
    """Compare z (n_z, B) with a prediction; one that is a mean alone has an innovation and no S.

    The measurement is then predicted by the sensor at the mean, ``h(F x)``.
    """
    # Imported here, since pydantic comes with the filters' keys, and a worker may need neither.
    from trackbench.filters.ukf import predicted_innovation

    alone = np.isnan(predicted.cov).any(axis=(0, 1)) & ~np.isnan(predicted.mean).any(axis=0)
    if not alone.any():
        return predicted_innovation(model, predicted, z, k)
    known = Gaussian(predicted.mean, np.where(alone, 0.0, predicted.cov))
    innovation = predicted_innovation(model, known, z, k)
    return innovation._replace(S=np.where(alone, np.nan, innovation.S))


def _copy(estimate: Gaussian) -> Gaussian:
    """Copy an estimate, as a filter may write to its own arrays at its next step."""
    return Gaussian(estimate.mean.copy(), estimate.cov.copy())


def _finite(stored: Gaussian | None) -> Gaussian | None:
    """Return a stored prediction without infinite moments, which an update would turn to NaN."""
    if stored is None or not (all_finite(stored.mean) and all_finite(stored.cov)):
        return None
    return stored


def after_first(rows: Array) -> Array:
    """Return the series (T + 1, M) of values (T, M), NaN for the first state."""
    return np.vstack([np.full_like(rows[:1], np.nan), rows])


def _measured(z: Array) -> Mask:
    """Return the runs (*batch) with a measurement, or a component of one."""
    return np.asarray(~np.isnan(z).all(axis=0))


def _lagged_products(white: Array, missing: Mask) -> Iterator[Array]:
    """Yield ``e_j e_(j-l)`` (n, T, M) for each lag l; j counts a component's known values."""
    # Known values stand before the missing ones, in the order of their steps.
    order = np.argsort(missing, axis=1, kind="stable")
    known = np.take_along_axis(white, order, axis=1)
    for lag in range(1, LAGS + 1):
        products = np.full_like(white, np.nan)
        of_known = known[:, lag:] * known[:, :-lag]
        np.put_along_axis(products, order[:, lag:], of_known, axis=1)
        yield products


def _sum_of_known(rows: Array) -> Array:
    """Sum over the components (n, T, M) of those that are known; NaN where none is."""
    known = ~np.isnan(rows)
    return np.where(known.any(axis=0), total(np.where(known, rows, 0.0), axis=0), np.nan)
