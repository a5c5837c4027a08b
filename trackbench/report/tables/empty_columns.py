"""Reasons why a column of the table `metrics` is empty, such as a truth that lacks the velocity."""

import numpy as np

from trackbench.config.requested_truth import needs_truth
from trackbench.evaluation.metric_expression import Measure
from trackbench.models.component_names import has_position_and_velocity
from trackbench.report.findings.phrases import named
from trackbench.report.tables_and_figures import Results

_WHY_NO_NEES = "is empty, as it needs a truth of the whole state, and a covariance of full rank."
_NEES_OF_POSITION = " `score: {marginals: [position]}` adds anees_position."
_WHY_NO_NEES_OF_WHOLE_TRUTH = (
    "is empty, as it needs a covariance of full rank: those here are missing, zero or not positive "
    "definite."
)
_WHY_NO_COVARIANCE = "is empty, as a program that answers the mean alone has no covariance."
_WHY_NO_ERROR = "is empty: at no scored step the truth has what it needs."


def why_empty(results: Results, m: Measure, labels: list[str]) -> str:
    """Return why no filter has a number of a measure.

    Parameters
    ----------
    results
        results folder
    m
        measure of an empty column
    labels
        filters of the table

    Returns
    -------
    str
        predicate of a sentence, such as ``is empty, as ...``. Empty if the reason is unknown, and
        without a kept run: other notes give the reason of the lost runs or of the failure
    """
    if m.other in results.labels_without_runs:
        return f"is empty, as {named(m.other)} has no such number."
    kept = _labels_with_kept_runs(results)
    if m.definition.name in ("nees", "anees") and not m.quantity:
        kept_labels = kept.intersection(labels)
        if not kept_labels:
            return ""
        if _is_recording(results):
            missing = _parts_without_truth(results, kept)
            if not missing:
                return _WHY_NO_NEES
            why = f"is empty, as {_truth_lacks(missing)}, and it is of the whole state."
            return why + _NEES_OF_POSITION if missing == ["velocity"] else why
        if kept_labels <= {*results.programs}:
            return _WHY_NO_COVARIANCE
        # The truth of a simulation has the whole state.
        return _WHY_NO_NEES_OF_WHOLE_TRUTH
    # A recording has no truth for an error that a filter with kept runs lacks.
    if needs_truth(m) and kept and _is_recording(results):
        missing = _parts_without_truth(results, kept)
        # An error of the config is of several components, and otherwise its name is that of its part.
        score = results.facts(results.points()[0]).scenario.get("score") or {}
        parts_of_error = (score.get("errors") or {}).get(m.quantity, [m.quantity])
        missing = [part for part in missing if part in parts_of_error]
        return f"is empty, as {_truth_lacks(missing)}." if missing else _WHY_NO_ERROR
    return ""


def _truth_lacks(parts: list[str]) -> str:
    """Write that the truth lacks some parts of the state, as a clause."""
    return f"the truth has no {' or '.join(parts)} at any scored step"


def _parts_without_truth(results: Results, kept: set[str]) -> list[str]:
    """Return the parts of the state that the truth of a recording has at no scored step.

    They are components, or position and velocity of a state that has both. Their errors are stored, and
    those of filters in ``kept``, which have kept runs, have a number wherever there is a truth.
    """
    points = results.points()
    components = tuple(results.facts(points[0]).components)
    parts = components
    if has_position_and_velocity(components):
        parts = ("position", "velocity")
    missing = []
    for part in parts:
        errors = []
        for point in points:
            for (label, metric), values in results.runs(point).items():
                if label in kept and metric == f"rmse_{part}":
                    errors.append(values)
        if errors and all(np.isnan(values).all() for values in errors):
            missing.append(part)
    return missing


def _is_recording(results: Results) -> bool:
    """Test whether the results are of recorded measurements, at every point of the grid."""
    targets = [results.facts(point).scenario.get("target") for point in results.points()]
    return all(isinstance(target, dict) and target.get("kind") == "measured" for target in targets)


def _labels_with_kept_runs(results: Results) -> set[str]:
    """Return the labels of the filters that have not lost all runs, at some point of the grid."""
    labels = set()
    for point in results.points():
        for (label, metric), values in results.runs(point).items():
            if metric == "lost" and (values == 0).any():
                labels.add(label)
    return labels
