"""Predictive scores: how well a filter predicts measurements, without a truth; held-out measurements.

Series (T + 1, M) on request, beside those of `metrics`:

``log_likelihood``   log p(z_k | z_1..k-1) by the filter's own method of that name
``squared_predicted_<component>``, ``error_predicted_<component>``  z_k minus its prediction
``innovations``      number of components measured, and not refused by the filter's gate
``anis``             normalized innovation squared over that number, 1 if consistent
``autocovariance_<l>``  whitened innovation times the l-th one before it, summed over the components
``held_log_likelihood``, ``squared_held_<component>``, ``error_held_<component>``  the same of
                     measurements that the filter is not given (``hold_out``)

A prediction of any filter is a step without a measurement. The moments of the measurement follow from
its estimate by cubature (Bar-Shalom, Li & Kirubarajan 2001, section 5.4, judge innovations): the
predicted measurement is the mean of h over N(mean, covariance), by the same rule for every filter. The
errors of a filter that never updates (``uses_measurements`` is False) are ``z - h(mean)``, those of its
path. A filter that returns a mean without a covariance has prediction errors, and no ``anis``. The
filter then goes on from its state before the prediction, and draws the same noise as without it.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.component_parts import foreign_parts
from trackbench.core.arrays import Array, Mask, all_finite
from trackbench.core.distributions import Gaussian
from trackbench.core.read_only import freeze
from trackbench.evaluation.anis_and_autocorrelation import LAGS, innovation_series
from trackbench.evaluation.innovations import Innovations
from trackbench.evaluation.state_copies import make_state_copier
from trackbench.evaluation.validate_returned_arrays import checked_numbers
from trackbench.filters.base import AnyFilter, Steps, has_likelihood
from trackbench.models.base import Model
from trackbench.models.motions.unequal_intervals import put_side_by_side

Kind = Literal["score", "prediction"]
"""Requested series: the filters' own log-likelihoods; all series from predictions of measurements."""
_SCORE = "log_likelihood"


def predictive_series(components: Sequence[str], scores: bool, hold_out: int | None) -> list[str]:
    """Return the names of all predictive series of measurements.

    Parameters
    ----------
    components
        components of the measurements
    scores
        True if the filter has a log-likelihood
    hold_out
        n if every n-th measurement is held out; None if none is

    Returns
    -------
    list of str
        names such as ``log_likelihood``, ``anis`` and ``squared_predicted_range``
    """
    names = []
    if scores:
        names.append(_SCORE)
    names += ["anis", "innovations"]
    names += [f"autocovariance_{lag}" for lag in range(1, LAGS + 1)]
    heads = ["predicted"]
    if hold_out:
        heads.append("held")
        if scores:
            names.append(f"held_{_SCORE}")
    for head in heads:
        for component in components:
            names += [f"squared_{head}_{component}", f"error_{head}_{component}"]
    return names


class Step(NamedTuple):
    """One step of a filter."""

    before: Any
    """state before the step"""
    after: Any
    """state after the step"""
    estimate: Gaussian
    """estimate after the step, with all components of the filter's state"""
    k: int
    """number of the step"""
    refused: Array | Mask | None = None
    """1 for each run (M,), or each component (n_z, M), whose measurement was not used"""


class PredictionScorer:
    """Predictive series of one filter over one block, computed step by step."""

    def __init__(
        self,
        tracker: AnyFilter,
        model: Model,
        measurements: Array,
        wanted: Sequence[str],
        hold_out: int | None,
        rng: Generator,
    ) -> None:
        """Begin before the first step.

        ``measurements`` (n_z, T, M) are all that the filter could be given; if ``hold_out`` is n, every
        n-th one is held out. ``wanted`` are the requested series: "score" for log-likelihoods,
        "prediction" for all that is computed from predicted measurements. The scores need additional
        steps of the filter, whose states are not used again. ``rng`` draws the noise of these steps.
        ``tracker`` is the filter, and ``model`` the one that it assumes.
        """
        self._tracker = tracker
        self._model = model
        self._rng = rng
        self._wanted = {"score", "prediction"}.intersection(wanted)
        self._all = measurements
        self._held_out = held_out(measurements, hold_out) if hold_out else None
        self.visible = visible_to_filter(measurements, hold_out)
        """measurements (n_z, T, M) that the filter is given"""
        # A filter that never updates is judged by its path, however wide its covariance has become: its
        # prediction errors are taken at the predicted mean.
        errors_at_mean = not tracker.uses_measurements
        # Innovations of the measurements that the filter is given, and of those that are held out.
        self._predicted = Innovations(model, errors_at_mean)
        self._held = Innovations(model, errors_at_mean)
        # By step: refused components (n_z, M), and log-likelihoods (M,) of the given measurements.
        self._refused: list[Mask] = []
        self._scores: list[Array] = []
        # By step with a held-out measurement: log-likelihoods (M,), and the step's index.
        self._held_scores: list[Array] = []
        self._held_steps: list[int] = []
        self._has_likelihood = has_likelihood(tracker)
        # States of the package's filters have the attribute `prediction`, or none of that name. In the
        # state of a plugin's filter the attribute may be something else.
        self._has_predictions = not foreign_parts(tracker)
        self._copy_state = make_state_copier(tracker, model)

    @property
    def disabled(self) -> bool:
        """True if no predictive score is requested."""
        return not self._wanted and self._held_out is None

    def add(self, step: Step, i: int) -> None:
        """Add the step that was given the measurements ``visible[:, i]``.

        Parameters
        ----------
        step
            states of the filter before and after the step, and its estimate
        i
            index of the step from 0, that of the first measurement
        """
        # Nothing is requested.
        if self.disabled:
            return
        z = self.visible[:, i]
        if "score" in self._wanted:
            self._scores += self._log_likelihoods(step.after, z.shape[1])
        if "prediction" in self._wanted:
            self._predicted.add(self._prediction(step, z), z, step.k)
            # What a gate refused: 1 for each run (M,), or for each component (n_z, M).
            refused = step.refused
            if refused is None:
                refused = np.zeros(z.shape[1])  # nothing was refused
            # If a run is marked, all components of its measurement were refused. NaN marks none.
            self._refused.append(np.broadcast_to(refused > 0, z.shape))
        if self._held_out is not None and self._held_out[i].any():
            # Only the held-out measurements of the step. The filter has not been given them, so that its
            # estimate is the prediction of them.
            z = freeze(np.where(self._held_out[i], self._all[:, i], np.nan))
            self._held.add(_copy(step.estimate), z, step.k)
            self._held_steps.append(i)
            if self._has_likelihood:
                # Log-likelihood by a step aside that is given the measurement.
                after = self._step_aside(step, z)
                self._held_scores += self._log_likelihoods(after, z.shape[1])

    def add_steps(self, many: Steps, piece: slice, steps: Sequence[int]) -> bool:
        """Add the steps that a filter made in one call.

        Parameters
        ----------
        many
            S steps of the filter
        piece
            indices of the steps, which were given the measurements ``visible[:, piece]``
        steps
            numbers of the S steps

        Returns
        -------
        bool
            False if each step must be added alone; then none of the steps has been added
        """
        if self.disabled:
            return True
        # The scores need one state of all these steps, with its predictions.
        if not self._has_predictions or many.together is None or many.before is None:
            return False
        state = many.together()
        z = self.visible[:, piece]
        predicted = _finite(state.prediction)
        if predicted is None:
            return False
        if "score" in self._wanted:
            self._scores += self._log_likelihoods(state, *z.shape[1:])
        if "prediction" in self._wanted:
            n_z, count, runs = z.shape
            self._predicted.add_steps(predicted, z, steps)
            # Filters that make many steps in one call have no gate: nothing is refused.
            self._refused.extend(np.zeros((count, n_z, runs), dtype=np.bool_))
        if self._held_out is not None and self._held_out[piece].any():
            # `visible` lacks the held-out measurements, and `_all` has them.
            is_held = self._held_out[piece]
            # Steps with a held-out measurement in any run.
            index = np.flatnonzero(is_held.any(axis=1))
            held = np.where(is_held[index], self._all[:, piece][:, index], np.nan)
            estimate = Gaussian(many.estimate.mean[:, index], many.estimate.cov[:, :, index])
            self._held.add_steps(estimate, held, np.take(steps, index).tolist())
            self._held_steps += (index + piece.start).tolist()
            if self._has_likelihood:
                # The runs of these steps are filtered side by side. In a filter that has `before` only
                # the motion may differ from step to step. `put_side_by_side` gives each run the motion
                # of its step, so that the number of the step given here, `steps[0]`, does not matter.
                side_by_side_z = freeze(held.reshape(len(held), -1))
                before = many.before(index)
                motion, sensor = self._model
                held_steps = np.take(steps, index).tolist()
                model = Model(put_side_by_side(motion, held_steps, held.shape[2]), sensor)
                after = self._tracker.step(model, before, side_by_side_z, steps[0], self._rng)
                self._held_scores += self._log_likelihoods(after, side_by_side_z.shape[1])
        return True

    def series(self) -> dict[str, Array]:
        """Return values (T + 1, M) by the name of their series, NaN for the first state.

        The names are those of `predictive_series`.
        """
        rows: dict[str, Array] = {}
        if self._scores:
            # A step without a measurement has no likelihood.
            rows[_SCORE] = np.where(_measured(self.visible), np.stack(self._scores), np.nan)
        if "prediction" in self._wanted:
            runs = self._all.shape[2]  # M
            # Innovations (n_z, T, M) of all steps, their covariances, and a mask (n_z, T, M) of the
            # components that the filter's gate refused.
            nu, S = self._predicted.joined(runs)
            refused = np.stack(self._refused, axis=1)
            rows |= self._errors("predicted", self._predicted.errors(runs))
            rows |= innovation_series(nu, S, refused)
        if self._held_out is not None:
            rows |= self._held_out_series(self._held_out)
        return {name: with_nan_first(values) for name, values in rows.items()}

    def _step_aside(self, step: Step, z: Array) -> Any:
        """Return the state after the step if it is given z (n_z, M) instead of its own measurements."""
        before = self._copy_state(step.before)
        return self._tracker.step(self._model, before, z, step.k, self._rng)

    def _prediction(self, step: Step, z: Array) -> Gaussian:
        """Return the prediction of the step: the estimate after the step without a measurement.

        z (n_z, M) are the step's measurements, of which only the shape matters.
        """
        # Many filters store the prediction in their state.
        if self._has_predictions:
            stored = _finite(getattr(step.after, "prediction", None))
            if stored is not None:
                return stored
        # Otherwise the filter makes the step once more, from the state before it.
        no_measurement = freeze(np.full_like(z, np.nan))
        return _copy(self._tracker.estimate(self._step_aside(step, no_measurement)))

    def _log_likelihoods(self, state: Any, *batch: int) -> list[Array]:
        """Return the filter's log-likelihood increments of one or many steps, a row (M,) for each step.

        ``batch`` is the shape of the increments. There are none if the filter has no log-likelihood.
        """
        if not self._has_likelihood:
            return []
        increments: Any = self._tracker.log_likelihood(state)
        checked = checked_numbers("series", {_SCORE: increments}, *batch)
        return [*checked[_SCORE].reshape(-1, self._all.shape[2])]

    def _held_out_series(self, held_out: Mask) -> dict[str, Array]:
        """Return the series (T, M) of the measurements in ``held_out`` (T, M); NaN for all others."""
        errors = np.full(self._all.shape, np.nan)
        # Only steps at which a measurement of any run is held out have been added. Runs that hold out
        # none at such a step were added with NaN, so that their errors are NaN.
        if self._held_steps:
            errors[:, self._held_steps] = self._held.errors(self._all.shape[2])
        series = self._errors("held", errors)
        if self._has_likelihood:
            scores = np.full(held_out.shape, np.nan)
            if self._held_scores:
                scores[self._held_steps] = self._held_scores
            series[f"held_{_SCORE}"] = np.where(held_out, scores, np.nan)
        return series

    def _errors(self, head: str, errors: Array) -> dict[str, Array]:
        """Return the squared and signed prediction errors (n_z, T, M) of each component by series.

        ``head`` is the word in their names: ``predicted``, or ``held`` for held-out measurements.
        """
        components = self._model.sensor.components
        # The order of the names is that of the columns in files: all squares come first.
        series: dict[str, Array] = {}
        for component, error in zip(components, errors, strict=True):
            series[f"squared_{head}_{component}"] = error * error
        for component, error in zip(components, errors, strict=True):
            series[f"error_{head}_{component}"] = error
        return series


def _copy(estimate: Gaussian) -> Gaussian:
    """Copy an estimate, as a filter may write to its own arrays at its next step."""
    return Gaussian(estimate.mean.copy(), estimate.cov.copy())


def _finite(stored: Gaussian | None) -> Gaussian | None:
    """Return the stored prediction if it is finite; None otherwise, as infinite moments turn to NaN."""
    if stored is None or not (all_finite(stored.mean) and all_finite(stored.cov)):
        return None
    return stored


def held_out(measurements: Array, every: int) -> Mask:
    """Return which measurements (T, M) are held out: every n-th existing one of each run."""
    measured = ~np.isnan(measurements).all(axis=0)
    return np.asarray(measured & (np.cumsum(measured, axis=0) % every == 0))


def visible_to_filter(measurements: Array, hold_out: int | None) -> Array:
    """Replace the measurements (n_z, T, M) that are held out by NaN.

    If ``hold_out`` is n, every n-th existing measurement of a run is held out; none if it is None.
    """
    if not hold_out:
        return measurements
    return freeze(np.where(held_out(measurements, hold_out), np.nan, measurements))


def with_nan_first(rows: Array) -> Array:
    """Return the series (T + 1, M) of values (T, M), NaN for the first state."""
    return np.vstack([np.full_like(rows[:1], np.nan), rows])


def _measured(z: Array) -> Mask:
    """Return which runs (*batch) have at least one component of a measurement."""
    return np.asarray(~np.isnan(z).all(axis=0))
