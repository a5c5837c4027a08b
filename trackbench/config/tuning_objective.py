"""Objective of tuning: the number over the training runs that the search minimizes."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.metrics import in_window
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.sample_statistics import STATISTICS, influence, mean

_LOCATIONS = ("mean", "median")
"""Statistics of a metric's location."""
_TARGETS = {"one": 1.0, "zero": 0.0}
"""Targets of the metrics that are not to be as small or as large as possible."""


class Objective(NamedTuple):
    """A weighted sum of statistics over runs, which tuning minimizes."""

    weights: Mapping[str, float]
    """weight of each term, such as ``rms(rmse_position)``"""
    sizes: Mapping[str, int]
    """number of the state's components in each NEES, by its name"""

    @classmethod
    def of(cls, metric: str | Mapping[str, float], sizes: Mapping[str, int]) -> "Objective":
        """Return the objective of the key `metric` of tuning: one term, or terms with their weights.

        ``sizes`` are the numbers of the state's components in each NEES, by the name of the NEES.
        """
        weights = {metric: 1.0} if isinstance(metric, str) else metric
        return cls(weights=weights, sizes=sizes)

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics per run from which the terms are computed."""
        return [_run_metric(_read_term(word)) for word in self.weights]

    @property
    def only_mean(self) -> str | None:
        """Name of the metric per run whose mean or rms is the objective; None for other objectives.

        Such an objective has one term, and minimizes or maximizes the metric: it has no target.
        """
        if len(self.weights) != 1:
            return None
        ((word, weight),) = self.weights.items()
        if weight <= 0.0:
            return None
        measure = _read_term(word)
        is_minimized = measure.definition.better == "lower"
        if measure.statistic not in ("mean", "rms") or not (is_minimized or _is_maximized(measure)):
            return None
        return _run_metric(measure)

    def score(self, per_run: Mapping[str, Array]) -> RunEstimate:
        """Estimate the objective, which is better if it is smaller, with its standard error.

        ``per_run`` has the values of the runs (M,) by metric, NaN for lost runs.
        """
        # The influences of a weighted sum are the weighted sum of its terms' influences.
        value = 0.0
        influences = np.zeros(len(per_run["lost"]))
        with np.errstate(all="ignore"):
            for word, weight in self.weights.items():
                term_value, term_influences = self._score_term(word, per_run)
                value = value + weight * term_value
                influences = influences + weight * term_influences
        lost = int((per_run["lost"] != 0).sum())
        # The standard error of a statistic is that of the mean of the runs' influences on it.
        stderr = mean(influences[~np.isnan(influences)]).stderr
        return RunEstimate(
            value=value,
            stderr=stderr,
            influences=influences,
            runs=len(influences) - lost,
            lost=lost,
        )

    def score_on_results(
        self, runs: Mapping[tuple[str, str], Array], label: str
    ) -> RunEstimate | None:
        """Estimate the objective for the filter ``label`` on the runs of results.

        ``runs`` has the values (M,) of the runs by filter and metric. None if the filter was not run, or
        failed.
        """
        values_by_metric = {}
        for (filter_label, metric), values in runs.items():
            if filter_label == label:
                values_by_metric[metric] = values
        needed = {*self.metrics, "lost"}
        if not needed <= values_by_metric.keys():
            return None
        return self.score(values_by_metric)

    def _score_term(self, word: str, per_run: Mapping[str, Array]) -> tuple[float, Array]:
        """Return the minimized value of the term ``word``, and each run's influence (M,) on it.

        ``per_run`` has the values of the runs (M,) by metric, NaN for lost runs. The influence of a lost
        run is NaN.
        """
        measure = _read_term(word)
        metric = measure.definition
        quantity = measure.quantity
        # Step 1: the statistic of the runs that are not lost, and each run's influence on it.
        x = per_run[_run_metric(measure)]
        is_finite = ~np.isnan(x)
        influences = np.full(len(x), np.nan)
        influences[is_finite] = influence(measure.statistic, x[is_finite])
        value = STATISTICS[measure.statistic](x[is_finite]).value
        # Step 2: make it an objective. A metric with a target: the distance to it. For an ANEES, x is
        # the NEES of each run, so its mean is divided by the number n of components.
        n = self.sizes[quantity] if metric.per_component else 1
        if measure.statistic in _LOCATIONS and metric.better in _TARGETS:
            deviation = value / n - _TARGETS[metric.better]
            return abs(deviation), influences * (np.sign(deviation) / n)
        # A metric that is better larger: its negative.
        if _is_maximized(measure):
            return -value, -influences
        return value, influences


def as_expression(word: str) -> str:
    """Write the term as an expression of summary.csv: ``mean(log_score)`` for the term ``log_score``.

    ``anees`` is a row of that file already.
    """
    measure = _read_term(word)
    if measure.definition.per_component:
        return word
    return str(measure)


def objective_label(word: str) -> str:
    """Write the term as the objective adds it up: with a minus before it if it is maximized."""
    if _is_maximized(_read_term(word)):
        return f"-{word}"
    return word


def objective_target(word: str) -> float | None:
    """Return the target of the term, such as 1 for ``anees``; None if it has none.

    Tuning minimizes the distance to the target.
    """
    measure = _read_term(word)
    if measure.statistic not in _LOCATIONS:
        return None
    return _TARGETS.get(measure.definition.better)


def _read_term(word: str) -> Measure:
    """Parse the term; ANEES and log scores stand for their means."""
    measure = measured(word)
    metric = measure.definition
    if measure.is_row and (metric.per_component or metric.is_score):
        return measure._replace(statistic="mean")
    return measure


def _is_maximized(measure: Measure) -> bool:
    """Test whether the term is the mean or median of a metric that is better if it is larger."""
    return measure.statistic in _LOCATIONS and measure.definition.more_is_better


def _run_metric(measure: Measure) -> str:
    """Return the name in per_run.csv of the metric whose values the term's statistic is taken of."""
    # An ANEES is a mean of the NEES.
    if measure.definition.per_component:
        return in_window(measure.base, measure.window)
    return measure.name


def bad_terms(metric: str | Mapping[str, float] | None) -> Iterator[tuple[str, str]]:
    """Yield each term of the objective that cannot be minimized, and why.

    Such a term is no statistic over runs. Or it is one of a metric that is better if it is larger, and
    neither its mean nor its median, for example its standard deviation. ``metric`` is the key of tuning;
    None, if it is not set, has no terms.
    """
    words = [metric] if isinstance(metric, str) else metric or ()
    for word in words:
        measure = _read_term(word)
        if not measure.is_over_runs:
            yield (
                word,
                f"{word!r} is no statistic over runs, such as rms(rmse_position), anees, log_score",
            )
        elif measure.definition.more_is_better and measure.statistic not in _LOCATIONS:
            better = measured(word)._replace(statistic="mean")
            yield word, f"{word!r}: of a metric that is better larger take {better}"
