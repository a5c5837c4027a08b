"""Names of the metrics that an experiment has: every name in the files of its results folder."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cache, cached_property

import numpy as np

from trackbench.component_parts import is_foreign
from trackbench.config.diagnostic_names import Built, diagnostic_names, numeric_keys
from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.evaluation.calibration_series import calibration_series
from trackbench.evaluation.error_series import error_series_names
from trackbench.evaluation.metric_expression import TIME_MEAN, measured
from trackbench.evaluation.predictive_and_held_out_scores import predictive_series
from trackbench.filters.base import AnyFilter, has_likelihood
from trackbench.metrics import METRICS, in_window, is_reserved, metrics_of
from trackbench.models.delays import LATE_COUNTS
from trackbench.registry import of_kind
from trackbench.scenarios.base import Scenario
from trackbench.statistics.sample_statistics import STATISTICS


@dataclass
class Names:
    """Every name in the files of a results folder."""

    series: set[str] = field(default_factory=set)
    """series over time from which metrics are computed, such as ``squared_position``"""
    per_run: set[str] = field(default_factory=set)
    """metrics of per_run.csv, each in every window: ``rmse_position[turns]``"""
    per_step: set[str] = field(default_factory=set)
    """metrics of per_step.csv, without windows"""
    summary: set[str] = field(default_factory=set)
    """rows of summary.csv, such as ``mean(rmse_position)``"""
    filter_numbers: set[str] = field(default_factory=lambda: {"cpu_s_per_run"})
    """numbers of filters beside the metrics: CPU times and keys"""
    efficiencies: set[str] = field(default_factory=set)
    """metrics of a filter's runs together with those of the reference"""
    windows: set[str] = field(default_factory=set)
    """windows of steps; the empty name is that of all scored steps"""
    components: tuple[str, ...] = ()
    """names of the state's components"""
    has_delays: bool = False
    """whether measurements may arrive late"""
    has_truth: bool = True
    """whether there are errors at all"""
    unprobed: list[type] = field(default_factory=list)
    """classes of filters with mistakes or errors, whose diagnostics are unknown"""
    _added: set[object] = field(default_factory=set)
    """inputs whose names `add` has added, so that equal ones cost nothing"""

    @cached_property
    def bases(self) -> set[str]:
        """Metrics without statistic, window and step; to be read once every filter is added."""
        return {measured(name).base for name in self.per_run | self.per_step}

    def names_of_role(self, role: str) -> set[str]:
        """Name the metrics that may be requested in this role, such as those of a file (``per_run``).

        ``role`` is one that `_role_and_name` gives, which is none of the roles ``rank``, ``expression``
        and ``comparison`` of requests.
        """
        return {
            "base": self.bases,  # names without statistic, window and step
            "summary": self.summary | self.filter_numbers,  # with CPU times and filters' keys
            "series": self.series,
            "per_run": self.per_run,
            "per_step": self.per_step,
            "row": self.summary,  # rows of summary.csv alone, of which `until` names some
            "efficiency": self.efficiencies,
        }[role]

    def add(
        self, settings: Settings, scenario: Scenario, summed: frozenset[str], series: frozenset[str]
    ) -> None:
        """Add the names of metrics that follow from a filter's ``series``.

        ``summed`` are the filter's diagnostics that are summed over the steps of a run, not averaged.
        """
        # Step 1: names of whole runs, from the scenario's metrics of series of zeros.
        self.series |= series
        zeros = np.zeros((len(scenario.steps), 1))
        with np.errstate(all="ignore"):
            scenario_metrics = frozenset(scenario.run_metrics(dict.fromkeys(series, zeros)))
        window_suffixes = tuple(in_window("", window) for window in scenario.windows)
        # Points of a sweep mostly give the same names.
        inputs = (scenario_metrics, window_suffixes, summed, series)
        if inputs in self._added:
            return
        self._added.add(inputs)
        # Step 2: the metrics of each series, per run in each window and per step.
        per_run = set(scenario_metrics)
        for series_name in series:
            for metric, name in metrics_of(series_name, summed):
                names_in_windows = [name + suffix for suffix in window_suffixes]
                if metric.over_steps:
                    per_run.update(names_in_windows)
                if metric.over_runs:
                    self.per_step.add(name)
                # Numbers over steps: the mean over a window's steps of the RMSE, and efficiencies.
                if metric.name == "rmse":
                    self.summary.update(f"{TIME_MEAN}({n})" for n in names_in_windows)
                if metric.name == "rmsd":
                    efficiencies = [n.replace("rmsd", "efficiency", 1) for n in names_in_windows]
                    self.efficiencies.update(efficiencies)
            # `error_series` makes these metrics of several series together.
            if series_name == "innovations":
                per_run.update("anis" + suffix for suffix in window_suffixes)
            if series_name.startswith("autocovariance_"):
                correlation = series_name.replace("covariance", "correlation")
                per_run.update(correlation + suffix for suffix in window_suffixes)
        # Step 3: the rows of summary.csv, statistics over the runs.
        self.per_run.add("lost")
        self.per_run |= per_run
        self.per_step |= {f"median({name})" for name in settings.medians if name in series}
        for name in per_run:
            self.summary |= _summary_names(name)

    def could_be_diagnostic(self, name: str) -> bool:
        """Test whether a filter whose diagnostics are unknown may have one of this name.

        Diagnostics of the package's filters are declared metrics. A plugin's filter may have others.
        """
        if not self.unprobed or is_reserved(name):
            return False
        return name in METRICS or any(is_foreign(cls) for cls in self.unprobed)


@cache
def _summary_names(name: str) -> frozenset[str]:
    """Name the rows of summary.csv that are computed from a metric of per_run.csv."""
    rows = [f"{statistic}({name})" for statistic in STATISTICS]
    measure = measured(name)
    for metric, metric_name in metrics_of(measure.metric):
        if metric.per_component:  # the ANEES is a row by itself, without a statistic
            rows.append(in_window(metric_name, measure.window))
    return frozenset(rows)


def names_of(
    settings: Settings,
    points: Sequence[Point],
    left_out: dict[str, AnyFilter],
    with_diagnostics: bool,
) -> Names:
    """Collect the names of the metrics of all filters in every scenario.

    ``points`` are those of the grid. ``left_out`` are filters that are not run, by label; their metrics
    may still be named. ``with_diagnostics`` adds the filters' diagnostics, for which some filters make
    a step.
    """
    names = Names(
        components=points[0].scenario.components,
        has_delays=any(point.scenario.longest_delay for point in points),
        has_truth=all(point.scenario.has_truth for point in points),
    )
    # Step 1: the series of every filter. They follow from the scenario, so that its first point is
    # enough. Diagnostics may also follow from keys of filters that the grid varies: the last point adds
    # those.
    for point in _first_points_and_last(points):
        scenario = point.scenario
        has_faults = scenario.without_faults is not scenario
        names.windows |= set(scenario.windows)
        series_by_summed: dict[frozenset[str], set[str]] = {}
        for label, tracker in (point.filters | left_out).items():
            has_reference = settings.reference is not None and label != settings.reference
            series = set(error_series_names(scenario, has_faults, has_reference, tracker))
            series |= set(_predictive_series(settings, scenario, tracker))
            summed: frozenset[str] = frozenset()
            if tracker is not None:  # None: the filter has mistakes
                summed = tracker.summed_diagnostics
            if scenario.longest_delay:
                series |= LATE_COUNTS
                summed = summed | LATE_COUNTS
            if with_diagnostics:
                try:
                    series |= diagnostic_names(settings, point.assumed_scenario(label), tracker)
                except Exception:  # the filter's run will report it
                    names.unprobed.append(_filter_class(settings, label))
            if "gated" in series and has_faults:
                series |= {"rejected_good", "accepted_bad"}
            series_by_summed.setdefault(summed, set()).update(series)
        # Filters that sum the same diagnostics over the steps are added together.
        for summed, series in series_by_summed.items():
            names.add(settings, scenario, summed, frozenset(series))
    # Step 2: keys that are numbers, which may differ from point to point. A table may show them. For a
    # filter with mistakes all keys count.
    for point in points:
        for label, tracker in (point.filters | left_out).items():
            if tracker is None:
                keys = {field.name for field in fields(_filter_class(settings, label))}
            else:
                keys = numeric_keys(tracker)
            names.filter_numbers |= keys
    return names


def _first_points_and_last(points: Sequence[Point]) -> list[Point]:
    """Return the first point of each scenario, and the last of all, each once."""
    # Of the points with one scenario, the dictionary keeps the last in reversed order: the first.
    first_by_scenario = {point.scenario: point for point in reversed(points)}
    chosen_points = list(first_by_scenario.values())
    if not any(point is points[-1] for point in chosen_points):
        chosen_points.append(points[-1])
    return chosen_points


def _filter_class(settings: Settings, label: str) -> type:
    """Find the class of a filter's kind.

    For an unknown kind, which is reported elsewhere, `Settings` stands in. The callers need a dataclass
    with fields that is no plugin's: a filter of it could have diagnostics of the package alone.
    """
    kind = settings.filters[label].get("kind")
    cls = None
    if isinstance(kind, str):
        cls = of_kind("filters", kind)
    return cls or Settings


def _predictive_series(settings: Settings, scenario: Scenario, tracker: Built) -> list[str]:
    """Name a filter's series of predictions, such as ``log_likelihood``.

    They are computed only if a metric needs them.
    """
    has_scores = tracker is not None and has_likelihood(tracker)
    names = predictive_series(scenario.true_sensor.components, has_scores, settings.hold_out)
    if scenario.has_truth:
        has_likelihood_ratio = has_scores and settings.reference is not None
        names += calibration_series(scenario.components, has_likelihood_ratio)
    return names
