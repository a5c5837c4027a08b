"""The number that tuning makes small, from a filter's values per run."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.evaluation.statistics import STATISTICS, influence, mean
from trackbench.metrics import joined
from trackbench.scenarios.base import Scenario, in_window

_LOCATIONS = ("mean", "median")
_TARGETS = {"one": 1.0, "zero": 0.0}
"""Statistics that say where a metric lies, and where it is to be if not as low as can be."""


class Score(NamedTuple):
    """Number of lost runs, and the metric of the others with each run's influence (M,).

    Smaller is better.
    """

    lost: int
    value: float
    influences: Array
    """NaN of lost runs"""

    @property
    def stderr(self) -> float:
        """Return the standard error of the value."""
        return mean(self.influences[~np.isnan(self.influences)]).stderr


class Objective(NamedTuple):
    """A weighted sum of statistics over runs, and the state's components by the name of each NEES."""

    weights: Mapping[str, float]
    sizes: Mapping[str, int]

    @classmethod
    def of(cls, metric: str | Mapping[str, float], sizes: Mapping[str, int]) -> "Objective":
        """Return the objective as a config writes it."""
        return cls({metric: 1.0} if isinstance(metric, str) else metric, sizes)

    @property
    def metrics(self) -> list[str]:
        """Return names of the values per run that it takes."""
        return [_per_run(_read(word)) for word in self.weights]

    def score(self, per_run: Mapping[str, Array]) -> Score:
        """Return the score of values (M,) by name, NaN for lost runs."""
        with np.errstate(all="ignore"):
            terms = [self._term(word, per_run) for word in self.weights]
            weights = list(self.weights.values())
            value, influences = 0.0, np.zeros(len(per_run["lost"]))
            for weight, (part, moved) in zip(weights, terms, strict=True):
                value, influences = value + weight * part, influences + weight * moved
        return Score(int((per_run["lost"] != 0).sum()), value, influences)

    def _term(self, word: str, per_run: Mapping[str, Array]) -> tuple[float, Array]:
        """Return the minimized value and its influences: a value, or its distance to a target."""
        m = _read(word)
        found, quantity = m.family
        x = per_run[_per_run(m)]
        there = ~np.isnan(x)
        influences = np.full(len(x), np.nan)
        influences[there] = influence(m.statistic, x[there])
        value = STATISTICS[m.statistic](x[there]).value
        n = self.sizes[quantity] if found.per_component else 1
        if m.statistic in _LOCATIONS and found.better in _TARGETS:
            off = value / n - _TARGETS[found.better]
            return abs(off), influences * (np.sign(off) / n)
        if _is_made_large(m):
            return -value, -influences
        return value, influences


def as_expression(word: str) -> str:
    """Return the term as tables write it."""
    m = _read(word)
    return word if m.family[0].per_component else str(m)


def objective_label(word: str) -> str:
    """Return the term as it is added up: what is made large has a minus."""
    return f"-{word}" if _is_made_large(_read(word)) else word


def _read(word: str) -> Measure:
    """Return the term; of ANEES and of log scores the mean is meant."""
    m = measured(word)
    plain = m.is_row and (m.family[0].per_component or m.family[0].is_score)
    return m._replace(statistic="mean") if plain else m


def _is_made_large(m: Measure) -> bool:
    return m.statistic in _LOCATIONS and m.family[0].more_is_better


def _per_run(m: Measure) -> str:
    """Name of the values per run that it is of."""
    return in_window(m.base, m.window) if m.family[0].per_component else m.name


def bad_terms(metric: str | Mapping[str, float] | None) -> Iterator[tuple[str, str]]:
    """Yield terms that are no statistic over runs, and why."""
    for word in [metric] if isinstance(metric, str) else metric or ():
        m = _read(word)
        if not m.is_over_runs:
            yield (
                word,
                f"{word!r} is no statistic over runs, such as rms(rmse_position), anees, log_score",
            )
        elif m.family[0].more_is_better and m.statistic not in _LOCATIONS:
            better = measured(word)._replace(statistic="mean")
            yield word, f"{word!r}: of a metric that is better larger take {better}"


def default_metric(scenario: Scenario) -> str:
    """Return the rms of the scenario's first error; without a truth the predictive likelihood."""
    if not scenario.has_truth:
        return "log_score"
    nowhere = np.zeros((len(scenario.components), 1))
    return f"rms({joined('rmse', next(iter(scenario.errors(nowhere, nowhere))))})"
