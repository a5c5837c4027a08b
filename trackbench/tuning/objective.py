"""The number that tuning makes small, from a filter's values per run."""

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.statistics import STATISTICS, influence, mean
from trackbench.metrics import joined
from trackbench.scenarios.base import Scenario

_STATISTIC = re.compile(rf"({'|'.join(STATISTICS)})\((.+)\)")
_LARGER_IS_BETTER = ("log_score", "held_log_score")


class Score(NamedTuple):
    """How many runs were lost, and of the others the metric and each run's influence (M,) on it.

    Smaller is better; a setting that loses fewer runs comes first, whatever its error.
    """

    lost: int
    value: float
    influences: Array
    """NaN of lost runs"""

    @property
    def rank(self) -> tuple[int, float]:
        """What orders settings."""
        return self.lost, self.value if np.isfinite(self.value) else np.inf

    @property
    def stderr(self) -> float:
        """Standard error of the value."""
        return mean(self.influences[~np.isnan(self.influences)]).stderr


class Objective(NamedTuple):
    """A weighted sum of statistics over runs, and the state's components by the name of each NEES."""

    weights: Mapping[str, float]
    sizes: Mapping[str, int]

    @classmethod
    def of(cls, metric: str | Mapping[str, float], sizes: Mapping[str, int]) -> "Objective":
        """As a config writes it."""
        return cls({metric: 1.0} if isinstance(metric, str) else metric, sizes)

    @property
    def metrics(self) -> list[str]:
        """Names of the values per run that it takes."""
        return [name for _, name in map(_parts, self.weights)]

    def score(self, per_run: Mapping[str, Array]) -> Score:
        """Of values (M,) by name, NaN where a run is lost."""
        with np.errstate(all="ignore"):
            terms = [self._term(word, per_run) for word in self.weights]
            weights = list(self.weights.values())
            value, influences = 0.0, np.zeros(len(per_run["lost"]))
            for weight, (part, moved) in zip(weights, terms, strict=True):
                value, influences = value + weight * part, influences + weight * moved
        return Score(int((per_run["lost"] != 0).sum()), value, influences)

    def _term(self, word: str, per_run: Mapping[str, Array]) -> tuple[float, Array]:
        statistic, name = _parts(word)
        x = per_run[name]
        there = ~np.isnan(x)
        influences = np.full(len(x), np.nan)
        influences[there] = influence(statistic, x[there])
        value = STATISTICS[statistic](x[there]).value
        if word.startswith("anees"):
            n = self.sizes[name.partition("[")[0].removeprefix("nees").removeprefix("_")]
            off = value / n - 1.0
            return abs(off), influences * (np.sign(off) / n)
        if name.partition("[")[0] in _LARGER_IS_BETTER:
            return -value, -influences
        return value, influences


def as_expression(word: str) -> str:
    """The term as tables write it."""
    return f"mean({word})" if word.partition("[")[0] in _LARGER_IS_BETTER else word


def made_small(word: str) -> str:
    """The term as it is added up: what is made large has a minus."""
    return f"-{word}" if word.partition("[")[0] in _LARGER_IS_BETTER else word


def _parts(word: str) -> tuple[str, str]:
    """Statistic, and name of the values per run."""
    match = _STATISTIC.fullmatch(word)
    if match:
        return match.group(1), match.group(2)
    return "mean", word.removeprefix("a") if word.startswith("anees") else word


def bad_terms(metric: str | Mapping[str, float] | None) -> Iterator[tuple[str, str]]:
    """Terms that are no statistic over runs, and why."""
    for word in [metric] if isinstance(metric, str) else metric or ():
        plain = word.startswith("anees") or word.partition("[")[0] in _LARGER_IS_BETTER
        if not plain and not _STATISTIC.fullmatch(word):
            yield (
                word,
                f"{word!r} is no statistic over runs, such as rms(rmse_position), anees, log_score",
            )


def default_metric(scenario: Scenario) -> str:
    """The rms of the scenario's first error; without a truth the predictive likelihood."""
    if not scenario.has_truth:
        return "log_score"
    nowhere = np.zeros((len(scenario.components), 1))
    return f"rms({joined('rmse', next(iter(scenario.errors(nowhere, nowhere))))})"
