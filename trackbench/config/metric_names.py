"""Names of the metrics that an experiment has, and of those that it stores."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from typing import Any, TypeAlias, cast

import numpy as np

from trackbench.config.experiment import Point, Settings
from trackbench.core.random_streams import block_stream
from trackbench.evaluation.block import simulate
from trackbench.evaluation.consistency_and_calibration import calibration_series, sizes
from trackbench.evaluation.metric_expression import TIME_MEAN, measured
from trackbench.evaluation.predictive_scores import predictive_series
from trackbench.evaluation.run_filter import prior_of
from trackbench.extension_points import field_values, is_foreign
from trackbench.filters.base import (
    AnyFilter,
    declares_diagnostics,
    has_expectations,
    has_likelihood,
)
from trackbench.metrics import METRICS, in_window, is_reserved, joined, metric_of, metrics_of
from trackbench.models.delays import LATE_COUNTS
from trackbench.plugins.errors import guarded
from trackbench.registry import of_kind
from trackbench.scenarios.base import Scenario
from trackbench.statistics.over_runs import STATISTICS

Made: TypeAlias = AnyFilter | None
"""A filter, or None for one whose keys are mistaken."""

_PROBE_PARTICLES = 10
"""Particles that suffice to learn a filter's diagnostics."""


def stored_metrics(settings: Settings, file: str) -> frozenset[str] | None:
    """Name the metrics that a CSV file stores, without statistics; None stands for all metrics."""
    if file == "per_step.csv" and settings.per_step is not None:
        return frozenset(measured(name).base for name in settings.per_step)
    names = settings.metrics
    always = ("lost", "gated")
    return None if names is None else frozenset((*always, *(measured(n).base for n in names)))


def is_stored(stored: frozenset[str] | None, base: str) -> bool:
    """Test whether a file with these `stored_metrics` has the metric of this base name."""
    return base in stored if stored is not None else not metric_of(base)[0].on_request


@dataclass
class Names:
    """Every name in the files of a results folder."""

    series: set[str] = field(default_factory=set)
    per_run: set[str] = field(default_factory=set)
    per_step: set[str] = field(default_factory=set)
    summary: set[str] = field(default_factory=set)
    filter_numbers: set[str] = field(default_factory=lambda: {"cpu_s_per_run"})
    """numbers of filters beside the metrics: CPU times and keys"""
    efficiencies: set[str] = field(default_factory=set)
    """metrics of a filter's runs together with those of the reference"""
    windows: set[str] = field(default_factory=set)
    components: tuple[str, ...] = ()
    """names of the state's components"""
    has_delays: bool = False
    """whether measurements may arrive late"""
    has_truth: bool = True
    """whether there are errors at all"""
    unprobed: list[type] = field(default_factory=list)
    """classes of filters with mistakes or errors, whose diagnostics are unknown"""
    _added: set[object] = field(default_factory=set)

    @cached_property
    def bases(self) -> set[str]:
        """Metrics without statistic, window and step, once all are there."""
        return {measured(name).base for name in self.per_run | self.per_step}

    def of(self, role: str) -> set[str]:
        """Name the metrics that a key of this role may use."""
        return {
            "base": self.bases,
            "summary": self.summary | self.filter_numbers,
            "series": self.series,
            "per_run": self.per_run,
            "per_step": self.per_step,
            "row": self.summary,
            "efficiency": self.efficiencies,
        }[role]

    def add(
        self, settings: Settings, scenario: Scenario, counts: frozenset[str], series: frozenset[str]
    ) -> None:
        """Add the names that a filter's series give."""
        # Step 1: names of whole runs, from the scenario's metrics of series of zeros.
        self.series |= series
        nothing = np.zeros((len(scenario.steps), 1))
        with np.errstate(all="ignore"):
            of_scenario = frozenset(scenario.run_metrics(dict.fromkeys(series, nothing)))
        windows = tuple(in_window("", window) for window in scenario.windows)
        names = of_scenario, windows, tuple(sizes(scenario)), counts, series
        if names in self._added:  # as at another point of a sweep
            return
        self._added.add(names)
        # Step 2: the metrics of each series, per run in each window and per step.
        per_run = set(of_scenario)
        for one in series:
            for metric, name in metrics_of(one, counts):
                in_windows = [name + window for window in windows]
                if metric.over_steps:
                    per_run.update(in_windows)
                if metric.over_runs:
                    self.per_step.add(name)
                if metric.name == "rmse":
                    self.summary.update(f"{TIME_MEAN}({n})" for n in in_windows)
                if metric.name == "rmsd":
                    self.efficiencies.update(n.replace("rmsd", "efficiency", 1) for n in in_windows)
            # `error_series` makes these of several series.
            if one == "innovations":
                per_run.update("anis" + window for window in windows)
            if one.startswith("autocovariance_"):
                correlation = one.replace("covariance", "correlation")
                per_run.update(correlation + window for window in windows)
        # Step 3: the rows of summary.csv, statistics over the runs.
        self.per_run |= {"lost", *per_run}
        self.per_step |= {f"median({name})" for name in settings.medians if name in series}
        self.summary |= frozenset().union(*map(_summary_names, per_run))

    def could_be_diagnostic(self, name: str) -> bool:
        """Test whether a filter of unknown diagnostics may have this one."""
        is_any_foreign = any(map(is_foreign, self.unprobed))
        return bool(self.unprobed) and not is_reserved(name) and (name in METRICS or is_any_foreign)


@cache
def _summary_names(name: str) -> frozenset[str]:
    """Name the rows of summary.csv that a metric of a run is made into."""
    of = measured(name)
    means = [in_window(n, of.window) for m, n in metrics_of(of.metric) if m.per_component]
    return frozenset((*means, *(f"{statistic}({name})" for statistic in STATISTICS)))


def names_of(
    settings: Settings,
    points: Sequence[Point],
    left_out: dict[str, AnyFilter],
    with_diagnostics: bool,
) -> Names:
    """Collect the names of all filters, of those that are not run too, at every scenario.

    ``with_diagnostics`` adds the filters' diagnostics, at the first point of each scenario and the last.
    """
    names = Names(has_truth=all(p.scenario.has_truth for p in points))
    names.components = points[0].scenario.components
    names.has_delays = any(p.scenario.longest_delay for p in points)
    # Step 1: the series of every filter, at the first point of each scenario and at the last.
    first = {point.scenario: point for point in reversed(points)}
    for point in {id(p): p for p in (*first.values(), points[-1])}.values():
        names.windows |= set(point.scenario.windows)
        series_by_counts: dict[frozenset[str], set[str]] = {}
        for label, tracker in (point.filters | left_out).items():
            series = frozenset(_series(settings, point.scenario, label, tracker))
            series |= set(_predictive_series(settings, point.scenario, tracker))
            counts = frozenset() if tracker is None else tracker.summed_diagnostics
            if point.scenario.longest_delay:
                series, counts = series | LATE_COUNTS, counts | LATE_COUNTS
            if with_diagnostics:
                try:
                    series |= _diagnostics(settings, point.assumed_scenario(label), tracker)
                except Exception:  # the filter's run will report it
                    names.unprobed.append(_kind(settings, label))
            if "gated" in series and point.scenario.without_faults is not point.scenario:
                series |= {"rejected_good", "accepted_bad"}
            series_by_counts.setdefault(counts, set()).update(series)
        for counts, every in series_by_counts.items():
            names.add(settings, point.scenario, counts, frozenset(every))
    # Step 2: keys that are numbers, which may differ from point to point.
    for point in points:
        for label, tracker in (point.filters | left_out).items():
            names.filter_numbers |= _numbers(tracker) if tracker is not None else set()
            if tracker is None:
                names.filter_numbers |= {key.name for key in fields(_kind(settings, label))}
    return names


def _kind(settings: Settings, label: str) -> type:
    kind = settings.filters[label].get("kind")
    return (of_kind("filters", kind) if isinstance(kind, str) else None) or Settings


def _numbers(tracker: AnyFilter) -> set[str]:
    """Name the keys of a filter that are numbers."""
    return {key for key, x in field_values(tracker).items() if type(x) in (int, float)}


def _predictive_series(settings: Settings, scenario: Scenario, tracker: Made) -> list[str]:
    """Name the series that exist on request."""
    scores = tracker is not None and has_likelihood(tracker)
    names = predictive_series(scenario.true_sensor.components, scores, settings.hold_out)
    if scenario.has_truth:
        names += calibration_series(scenario.components, scores and settings.reference is not None)
    return names


def _series(settings: Settings, scenario: Scenario, label: str, tracker: Made) -> Iterator[str]:
    if not scenario.has_truth:
        return
    nowhere = np.zeros((len(scenario.components), 1))
    for quantity, error in scenario.errors(nowhere, nowhere).items():
        yield joined("squared", quantity)
        if len(error) == 1:
            yield joined("error", quantity)
        if scenario.without_faults is not scenario:
            yield joined("damage", quantity)
        if settings.reference is not None and label != settings.reference:
            yield joined("rmsd", quantity)
    yield from ("nees", "outside_region", *(f"nees_{name}" for name in scenario.marginals))
    if tracker is not None and has_expectations(tracker):
        for name in scenario.observables(nowhere):
            yield from (f"squared_{name}", f"error_{name}")


def _diagnostics(settings: Settings, scenario: Scenario, tracker: Made) -> set[str]:
    """Name a filter's diagnostics, if undeclared from the first step of one run."""
    if tracker is None:
        raise ValueError("mistaken")
    if declares_diagnostics(type(tracker)):
        return set(tracker.diagnostic_names)
    # Undeclared: simulate one run, and make its first step.
    data = simulate(scenario, settings.seed, 0, 1)
    model, rng = scenario.model, block_stream(settings.seed, 0)
    if "N" in _numbers(tracker):  # the memory that all particles need is still unknown
        tracker = replace(cast(Any, tracker), N=min(tracker.particle_count, _PROBE_PARTICLES))
    with guarded(), np.errstate(all="ignore"):
        state = tracker.init(model, prior_of(data, model), rng)
        k = int(scenario.steps[1])
        return set(tracker.diagnostics(tracker.step(model, state, data.measurements[:, 0], k, rng)))
