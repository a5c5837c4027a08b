"""Metrics that need a truth where it is recorded: check that a scored step has one."""

from collections.abc import Sequence
from functools import cached_property

from trackbench.config.added_tables_and_figures import exhibits_without_tuning
from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.stored_metrics import stored_metrics
from trackbench.evaluation.metric_expression import Measure
from trackbench.metrics import is_of_prediction
from trackbench.scenarios.base import Scenario, error_names
from trackbench.scenarios.scored_truth import (
    advise_scored_steps,
    describe_unscored_truth,
    steps_with_truth,
)
from trackbench.yaml_source import Keys, Source

SERIES_OF_ERRORS = (
    "squared",
    "error",
    "nees",
    "outside_region",
    "pit",
    "coverage",
    "crps",
    "nci",
    "damage",
)
"""Series that compare an estimate with the truth."""
_METRICS_OF_ERRORS = ("peak", "diverged", "beyond_10_sigma", "recovery_s", "not_recovered")
"""Numbers of a run that a scenario computes from errors."""


def needs_truth(measure: Measure) -> bool:
    """Test whether a metric compares estimates with the truth."""
    if is_of_prediction(measure.quantity):
        return False
    metric = measure.definition
    return metric.series in SERIES_OF_ERRORS or metric.name in _METRICS_OF_ERRORS


class RequestedTruth:
    """Truth that is recorded at the scored steps of an experiment's scenarios."""

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        """Take the scenarios of the grid's points."""
        self._scenarios = list(dict.fromkeys(scenarios))

    @cached_property
    def _is_recorded(self) -> bool:
        """True if the truth of every scenario is recorded, so that it may be missing."""
        return all(scenario.recorded_truth is not None for scenario in self._scenarios)

    @cached_property
    def why_missing(self) -> str:
        """Reason why no error is measured in any scenario; empty if one may be."""
        if not self._scenarios or not self._is_recorded:
            return ""
        reasons = [_why_missing(scenario) for scenario in self._scenarios]
        return reasons[0] if all(reasons) else ""

    def add_problem(self, source: Source) -> None:
        """Add the mistake that no scored step has a truth, at the key that chooses the scored steps.

        The caller has found `why_missing`: every scenario of the grid has a recorded truth (not None),
        and in none a scored step has one. The advice is for the first scenario.
        """
        scenario = self._scenarios[0]
        way = "ask for predictions alone, such as mean(log_score)"
        keys: Keys = ("scenario", "target", "truth")
        truth = scenario.recorded_truth
        assert truth is not None
        has_truth = steps_with_truth(truth)
        for key in ("train", "steps"):
            place = ("scenario", "score", key)
            if source.is_set(place):
                keys = place
                if has_truth.any():
                    choice = advise_scored_steps(key, scenario.steps, scenario.times, has_truth)
                    way = f"{choice}, or {way}"
                break
        source.add_problem(keys, f"{self.why_missing}; {way}")

    def why_unmeasured(self, measure: Measure) -> str | None:
        """Explain that no step of a metric's window has a truth, in any scenario; None if one has."""
        if not self._is_recorded or not needs_truth(measure):
            return None
        if any(_has_truth_in(scenario, measure.window) for scenario in self._scenarios):
            return None
        return f"'{measure.name}' is not measured: no step of the window has a truth; leave it out"


def is_measured_in(scenario: Scenario) -> bool:
    """Test whether errors are measured in a scenario: it has a truth at a scored step."""
    return scenario.has_truth and not (
        scenario.recorded_truth is not None and _why_missing(scenario)
    )


def shows_default_errors(settings: Settings, points: Sequence[Point]) -> bool:
    """Test whether the experiment names no tables and so has the default one, which shows errors."""
    names_table = bool(exhibits_without_tuning(settings.tables))
    if names_table or not points[0].scenario.has_truth:
        return False
    stored = stored_metrics(settings, "summary.csv")
    return stored is None or not stored.isdisjoint(error_names(points[0].scenario))


def _why_missing(scenario: Scenario) -> str:
    """Explain that no scored step of a scenario with a recorded truth has one; empty if one has."""
    truth = scenario.recorded_truth
    assert truth is not None
    # The window without a name has the scored steps.
    return describe_unscored_truth(scenario.times, steps_with_truth(truth), scenario.windows[""])


def _has_truth_in(scenario: Scenario, window: str) -> bool:
    """Test whether a step of a scenario's window has a recorded truth; a missing window has none."""
    truth = scenario.recorded_truth
    assert truth is not None
    in_window = scenario.windows.get(window)
    return in_window is not None and bool((steps_with_truth(truth) & in_window).any())
