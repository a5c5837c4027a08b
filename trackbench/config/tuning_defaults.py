"""Defaults of tuning: its metric, and its number of training runs."""

from dataclasses import replace

from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.requested_truth import is_measured_in
from trackbench.scenarios.base import Scenario, error_names
from trackbench.yaml_source import Source


def with_tuning_defaults(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> Settings:
    """Return the settings with tuning's default metric and number of runs filled in.

    Without a ``training`` point nothing is tuned, and the settings stay as they are.
    """
    if training is None:
        return settings
    tuning = settings.tuning
    if tuning.metric is None:
        # The scenario of the results, and that of training, which may be the first part of recordings: a
        # scenario's `training`. Errors are measured in a scenario if a scored step has a truth. If one
        # of the two has none, the metric is one that needs none.
        scored_scenarios = (
            points[0].scenario,
            training.scenario.training or training.scenario,
        )
        has_errors = all(is_measured_in(scenario) for scenario in scored_scenarios)
        metric = default_metric(points[0].scenario, has_errors)
        tuning = replace(tuning, metric=metric)
    # Where training takes a share of each recording's time, it has all recordings.
    trains_on_time_share = training.scenario.training is not None
    if trains_on_time_share and "runs" not in (source.data.get("tuning") or {}):
        tuning = replace(tuning, runs=training.scenario.recorded_runs or tuning.runs)
    return replace(settings, tuning=tuning)


def default_metric(scenario: Scenario, has_errors: bool) -> str:
    """Return tuning's default metric: the rms of the scenario's first error, which also ranks filters.

    Without ``has_errors`` it is the predictive likelihood, which needs no truth.
    """
    if not has_errors:
        return "log_score"
    return f"rms({error_names(scenario)[0]})"
