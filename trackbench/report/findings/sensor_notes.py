"""Notes on single sensors of a recorded run: rejected by a gate, or far from all predictions."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.models.sensors.stacked import sensor_name
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.phrases import listed, rounded
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import PointFacts
from trackbench.results.rows_and_columns import Columns

_FEWEST_OF_SENSOR = 10
"""Measurements of a sensor from which on something is said about it."""
_REJECTED_MUCH = 0.5
"""Share of a sensor's measurements beyond which a gate rejects a large part of them."""
_OTHERS_REJECTED = 0.2
"""Share of the other sensors' measurements up to which a gate rejects few of them."""
_FAR_SIGMAS = 5.0
"""Median prediction error, in standard deviations of the sensor, that is far."""
_FAR_RATIO = 4.0
"""Ratio to the median prediction error of the sensors that are predicted well."""
_NEAR_SIGMAS = 3.0
"""Median prediction error up to which a sensor is predicted well."""
_BEYOND_ANIS = 4.0
"""ANIS of a step from which on its measurements are beyond the filter's covariance."""
_SIGMAS = {"range": ("sigma_range", 1.0), "bearing": ("sigma_bearing_mrad", 1e-3)}
"""Keys of a landmark's standard deviations, with the factor to m or rad, by measured component."""
_WRONG_PLACE = "the place `at` may be wrong, or two of the landmarks may be exchanged"
_OTHER_CAUSE = "check the sigma, the place, the units and the clock"


class SensorNotes(NamedTuple):
    """Notes on single sensors, and the filters whose closed gate they explain."""

    notes: list[str]
    explained: list[Candidate]
    """filters whose gate rejects most measurements of a sensor that a note names"""


def sensor_notes(
    results: Results, candidates: Sequence[Candidate], is_by_score: bool
) -> SensorNotes:
    """Name the sensors whose measurements a gate rejects, or the filters predict badly.

    ``is_by_score`` is true if the log score ranks the filters. There are no notes for a single sensor,
    and none if the results have no prediction errors of the steps.

    The result also has the filters whose gate a note is about, so that no other note on their gates is
    needed. A note on bad predictions is not about a gate.
    """
    notes = []
    explained = []
    predictions = []
    for candidate in candidates:
        errors = _prediction_errors(results, candidate)
        if errors is None:
            continue
        predictions.append(errors)
        note = _gate_note(errors)
        if note:
            notes.append(note)
            explained.append(candidate)
    # A gate shows a bad sensor best, since its filter goes on without these measurements. Only if no
    # gate does, the sizes of the prediction errors are examined.
    if not notes:
        notes = _far_note(predictions)
    if notes and is_by_score:
        notes[-1] += (
            " The log score counts these measurements, so it may rank the wrong filter first."
        )
    return SensorNotes(notes=notes, explained=explained)


class _PredictionErrors(NamedTuple):
    """Prediction errors of one filter, for S sensors and the K steps at which any of them measured."""

    candidate: Candidate
    facts: PointFacts
    rejected: Array
    """number of sensors (K,) that the filter's gate rejects, infinite for all of a step"""
    anis: Array
    """mean normalized square (K,) of the innovations that are not rejected, NaN without any"""
    sizes: Array
    """largest error (S, K) of a sensor's components, in usual errors; NaN without a measurement"""
    has_gate: bool
    """whether the filter has a gate"""
    in_sigmas: Array
    """largest error (S, K) of a landmark's components, in its standard deviations; else NaN"""

    def names(self, chosen: Mask) -> list[str]:
        """Return the names of the sensors for which the mask ``chosen`` (S,) is True."""
        recorded_names = (self.facts.scenario.get("target") or {}).get("sensors") or ()
        return [sensor_name(number, recorded_names) for number in np.flatnonzero(chosen).tolist()]

    def cause(self, chosen: Mask) -> str:
        """Write what may be wrong about the sensors for which the mask ``chosen`` (S,) is True."""
        sensors = self.facts.scenario["sensor"]
        kinds = {sensors[number].get("kind") for number in np.flatnonzero(chosen).tolist()}
        return _WRONG_PLACE if kinds == {"landmark"} else _OTHER_CAUSE


def _prediction_errors(results: Results, candidate: Candidate) -> _PredictionErrors | None:
    """Read the prediction errors of a filter; None for one sensor, or if they are not stored.

    Of S sensors a measured component is named by the sensor's number, from 1, and the quantity, such as
    ``2.range``.
    """
    facts = results.facts(candidate.point)
    sensors = facts.scenario.get("sensor")
    if not isinstance(sensors, list) or len(sensors) < 2:
        return None
    rows = results.columns("per_step", candidate.point).where(filter=candidate.label)
    # Step 1: absolute errors (K,) of each component, at the K steps at which any of them was measured.
    # The run is the only one, so a stored mean over the runs is the error itself.
    series = {name: _known(rows, f"bias_predicted_{name}") for name in facts.measured}
    steps = np.unique(np.concatenate([each_steps for each_steps, _ in series.values()]))
    if not len(steps):
        return None
    errors = {name: np.abs(_at_steps(steps, *known)) for name, known in series.items()}
    # Step 2: the usual error of each quantity, such as range or bearing: the lower quartile over the
    # sensors of their median errors, which a few bad sensors hardly change.
    medians: dict[str, list[float]] = {}
    for name, error in errors.items():
        if np.isfinite(error).any():
            medians.setdefault(name.partition(".")[2], []).append(float(np.nanmedian(error)))
    usual = {quantity: _lower_quartile(np.array(each)) for quantity, each in medians.items()}
    # Step 3: the largest error (S, K) of each sensor's components, in usual errors and in sigmas.
    sizes = np.full((len(sensors), len(steps)), np.nan)
    in_sigmas = np.full_like(sizes, np.nan)
    for name, error in errors.items():
        number, _, quantity = name.partition(".")
        row = int(number) - 1
        if usual.get(quantity, 0.0) > 0.0:
            sizes[row] = np.fmax(sizes[row], error / usual[quantity])
        sigma = _sigma(sensors[row], quantity)
        if sigma is not None:
            in_sigmas[row] = np.fmax(in_sigmas[row], error / sigma)
    # Step 4: how many sensors the gate rejects at each step. Only one with `gate_by: sensor` may reject
    # some of them; any other rejects all that is measured.
    rejected = np.nan_to_num(_at_steps(steps, *_known(rows, "gated")))
    keys = facts.filters.get(candidate.label, {})
    if isinstance(keys.get("filter"), dict):  # a filter around another one
        keys = keys["filter"]
    if keys.get("gate_by") != "sensor":
        rejected = np.where(rejected > 0.0, np.inf, 0.0)
    return _PredictionErrors(
        candidate=candidate,
        facts=facts,
        rejected=rejected,
        anis=_at_steps(steps, *_known(rows, "anis")),
        sizes=sizes,
        has_gate=keys.get("gate") is not None,
        in_sigmas=in_sigmas,
    )


def _sigma(sensor: Mapping[str, Any], quantity: str) -> float | None:
    """Return the standard deviation of a landmark's range or bearing, m or rad; None if unknown.

    ``sensor`` has the config's keys of the sensor, and ``quantity`` is "range" or "bearing". None for
    any other kind of sensor or quantity.
    """
    key, factor = _SIGMAS.get(quantity, ("", 0.0))
    value = sensor.get(key)
    if sensor.get("kind") != "landmark" or not isinstance(value, float | int):
        return None
    return factor * value


def _gate_note(errors: _PredictionErrors) -> str:
    """Write that the filter's gate rejects a large part of some sensors' measurements; empty if not.

    The text is also empty if the gate rejects many measurements of the other sensors: then the filter
    may be wrong.
    """
    # Step 1: which sensors (S, K) the gate rejects. The results have their number only, and those with
    # the largest errors at a step are taken. The rank of a sensor's error is 0 for the largest.
    sizes = np.nan_to_num(errors.sizes, nan=-1.0)  # a sensor that did not measure comes last
    rank = np.argsort(np.argsort(-sizes, axis=0), axis=0)
    is_measured = np.isfinite(errors.sizes)
    is_rejected = is_measured & (rank < errors.rejected)
    # Step 2: the number of measurements of each sensor (S,), and of those that are rejected.
    measured = is_measured.sum(axis=1)
    rejected = is_rejected.sum(axis=1)
    has_enough = measured >= _FEWEST_OF_SENSOR
    is_closed = has_enough & (rejected > _REJECTED_MUCH * measured)
    others = has_enough & ~is_closed
    if not is_closed.any() or not others.any():
        return ""
    share_of_others = float(rejected[others].sum() / measured[others].sum())
    if share_of_others > _OTHERS_REJECTED:
        return ""
    # Step 3: the text, with the percentage of each of these sensors.
    shares = 100.0 * rejected[is_closed] / measured[is_closed]
    texts = []
    for name, share in zip(errors.names(is_closed), shares.tolist(), strict=True):
        texts.append(f"{name} ({share:.0f} %)")
    return (
        f"The gate of {errors.candidate.name} rejected most measurements of {listed(texts)}, and "
        f"{100.0 * share_of_others:.0f} % of the others: {errors.cause(is_closed)}."
    )


def _far_note(predictions: Sequence[_PredictionErrors]) -> list[str]:
    """Write a note on landmarks whose measurements are far from the predictions of the best filter.

    The best filter is the one that agrees best with the sensors that it predicts well. The list is empty
    if no landmark is far.
    """
    # Step 1: the best filter. The lower quartile of its sensors' median errors, in sigmas, is the least.
    best = None
    least = np.inf
    for errors in predictions:
        medians = _medians(errors.in_sigmas)
        known = medians[np.isfinite(medians)]
        if len(known) > 1 and _lower_quartile(known) < least:
            best = errors
            least = _lower_quartile(known)
    if best is None:
        return []
    # Step 2: bad sensors (S,): their median error is large, and most of their measurements are of steps
    # that contradict the filter's covariance. The second condition leaves out a filter that has not seen
    # a landmark for a long time: it has large errors, but a large covariance, too. A step of which all
    # measurements are rejected has no ANIS, and counts as a contradiction.
    # ``in_sigmas`` (S, K) are the errors of S sensors at the K steps of the run, and ``anis`` is (K,).
    medians = _medians(best.in_sigmas)
    is_known = np.isfinite(medians)
    is_beyond = ~(best.anis <= _BEYOND_ANIS)
    is_measured = np.isfinite(best.in_sigmas)
    shares = (is_measured & is_beyond).sum(axis=1) / np.maximum(is_measured.sum(axis=1), 1)
    is_bad = is_known & (shares > 0.5)
    is_bad[is_known] &= medians[is_known] > _FAR_SIGMAS
    if not is_bad.any():
        return []
    # Step 3: far sensors (S,) are bad, also in comparison with those that are predicted well.
    is_far = is_bad.copy()
    is_far[is_known] &= medians[is_known] > _FAR_RATIO * least
    others = is_known & ~is_far
    largest_median = np.inf
    if is_far.any() and others.any():
        largest_median = float(medians[others].max())
    # Step 4: if the other sensors are not predicted well either, none can be named.
    if largest_median > _NEAR_SIGMAS:
        # A wrong landmark bends the path of a filter without a gate, and then others seem wrong.
        worst = rounded(float(medians[is_bad].max()), 2)
        message = (
            "a landmark may be in a wrong place, or the motion has larger errors than its Q says"
        )
        way = ""
        if not any(errors.has_gate for errors in predictions):
            way = (
                " Add a filter with `gate: 0.999, gate_by: sensor`: a note then names the landmarks"
            )
            way += " that its gate rejects."
        return [
            f"The landmarks do not fit together: {best.candidate.name} predicts some of them by "
            f"{worst} sigma off (median); {message}.{way}"
        ]
    texts = []
    for name, median in zip(best.names(is_far), medians[is_far].tolist(), strict=True):
        texts.append(f"{name} ({rounded(median, 2)} sigma)")
    return [
        f"Most measurements of {listed(texts)} are far from the predictions of "
        f"{best.candidate.name}, and those of the others are within "
        f"{rounded(largest_median, 2)} sigma (medians): "
        f"{best.cause(is_far)}."
    ]


def _medians(sizes: Array) -> Array:
    """Return the median (S,) of each sensor's known errors (S, K), NaN with too few of them."""
    medians = np.full(len(sizes), np.nan)
    for row, of_sensor in enumerate(sizes):
        known = of_sensor[np.isfinite(of_sensor)]
        if len(known) >= _FEWEST_OF_SENSOR:
            medians[row] = np.median(known)
    return medians


def _lower_quartile(values: Array) -> float:
    """Return the value that a quarter of the values lie below."""
    return float(np.quantile(values, 0.25, method="lower"))


def _known(rows: Columns, metric: str) -> tuple[Array, Array]:
    """Return steps and values (n,) of a metric's rows of per_step.csv that have a value."""
    series = rows.where(metric=metric)
    known = np.isfinite(series["value"])
    return series["step"][known], series["value"][known]


def _at_steps(steps: Array, known_steps: Array, values: Array) -> Array:
    """Return the values (K,) at the ``steps`` (K,), which ascend; NaN at a step without a value.

    ``values`` (n,) are those at ``known_steps`` (n,). Those at other steps are left out.
    """
    at_steps = np.full(len(steps), np.nan)
    is_among = np.isin(known_steps, steps)
    at_steps[np.searchsorted(steps, known_steps[is_among])] = values[is_among]
    return at_steps
