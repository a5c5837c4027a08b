"""Tuning in a config: its settings, the axis of each tuned key, and the objective."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Interval

from trackbench.core import elementary
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.field_types import Count, Finite, is_number
from trackbench.metrics import in_window
from trackbench.scenarios.base import Scenario, error_names
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.over_runs import STATISTICS, influence, mean

SUFFIX = " (tuned)"
"""What the label of a tuned filter ends with."""


def tuned_label(label: str) -> str:
    """Label of the tuned filter beside this one."""
    return label + SUFFIX


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """Metric of tuning, number of training runs, and budget of each filter."""

    metric: str | dict[str, Finite] | None = None
    """objective over the training runs: minimize `rms(rmse_position)`, or the distance of `anees` to 1;
    maximize `log_score`; or minimize a weighted sum, {rms(rmse_position): 1, anees: 20}; default: the
    rms of the first error, or `log_score` of data without ground truth"""
    runs: Count = 100
    """training runs, shared by all filters and separate from the runs of the results"""
    evaluations: Annotated[int, Interval(ge=2, le=10_000)] = 40
    """number of settings that each filter may try"""
    scenario: dict[str, object] | None = None
    """training scenario: keys that replace the scenario's, {target: {kind: random-legs, ...}}, a path,
    or {use: path, key: value}; default: the scenario itself"""


_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
RANGE = rf"(log:)?({_NUMBER})\.\.({_NUMBER})"
"""Pattern of the ends of an axis, linear or logarithmic."""
_DIGITS = 4
_FARTHEST = 1e100
"""Largest end of a range, and inverse of the smallest of a logarithmic one, for the figures' sake."""


@dataclass(frozen=True)
class Axis:
    """A key and its values, laid out over the shares from 0 to 1.

    Numbers are rounded to four digits: so many are seen in an error at most, and a last bit of the
    search makes no other filter.
    """

    key: str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    whole: bool = False
    choices: tuple[object, ...] = ()

    def at(self, share: float) -> object:
        """Return the value at a share; beyond 0 and 1 that at the end."""
        share = min(max(share, 0.0), 1.0)
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        # The ends exactly as written, whatever their digits.
        if share in (0.0, 1.0):
            value = self.high if share else self.low
            return round(value) if self.whole else value
        # On a logarithmic axis low^(1 - s) high^s, on a linear one low + s (high - low).
        if self.log:
            logs = elementary.log(np.array([self.low, self.high]))
            value = float(elementary.exp(logs[:1] + share * (logs[1:] - logs[:1]))[0])
        else:
            value = self.low + share * (self.high - self.low)
        # Four digits, which may round beyond an end.
        value = min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)
        return round(value) if self.whole else value

    def share(self, value: object) -> float | None:
        """Return the place of a value on the axis; None if it is outside."""
        if self.choices:
            places = [i for i, choice in enumerate(self.choices) if choice == value]
            return (places[0] + 0.5) / len(self.choices) if places else None
        if not is_number(value) or not self.low <= value <= self.high:
            return None
        if not self.log:
            return (value - self.low) / (self.high - self.low)
        low, x, high = elementary.log(np.array([self.low, value, self.high])).tolist()
        return (x - low) / (high - low)

    @property
    def grain(self) -> float:
        """Shares that are nearer than this to each other may be the same value."""
        if self.choices:
            return 1.0 / len(self.choices)
        return 1.0 / (self.high - self.low) if self.whole and not self.log else 0.0


def read_axis(key: str, written: object) -> Axis:
    """Read the axis of a key; raises ValueError in words."""
    if isinstance(written, list):
        if len(written) < 2:
            raise ValueError("a list of choices has at least two")
        if any(value in written[:i] for i, value in enumerate(written)):
            raise ValueError("a choice is given twice")
        return Axis(key, choices=tuple(written))
    match = re.fullmatch(RANGE, written) if isinstance(written, str) else None
    if match is None:
        raise ValueError(f"{written!r}: write a..b, log:a..b or a list of choices")
    log, low, high = bool(match.group(1)), float(match.group(2)), float(match.group(3))
    if not low < high or not np.isfinite([low, high]).all():
        raise ValueError(f"{written!r} does not rise from a number to a larger one")
    if log and low <= 0.0:
        raise ValueError(f"{written!r}: a logarithmic range has ends above zero")
    if max(-low, high) > _FARTHEST or (log and low < 1.0 / _FARTHEST):
        raise ValueError(f"{written!r} is too wide; ends of up to 1e100, or log:1e-100..1e100")
    return Axis(key, low, high, log)


_LOCATIONS = ("mean", "median")
_TARGETS = {"one": 1.0, "zero": 0.0}
"""Statistics that say where a metric lies, and where it is to be if not as low as can be."""


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
        """Names of the values per run that it takes."""
        return [_per_run(_read(word)) for word in self.weights]

    def score(self, per_run: Mapping[str, Array]) -> RunEstimate:
        """Return the objective of values (M,) by name, NaN for lost runs; smaller is better."""
        # The influences of a weighted sum are the weighted sum of its terms' influences.
        with np.errstate(all="ignore"):
            terms = [self._term(word, per_run) for word in self.weights]
            weights = list(self.weights.values())
            value, influences = 0.0, np.zeros(len(per_run["lost"]))
            for weight, (part, moved) in zip(weights, terms, strict=True):
                value, influences = value + weight * part, influences + weight * moved
        lost = int((per_run["lost"] != 0).sum())
        stderr = mean(influences[~np.isnan(influences)]).stderr
        return RunEstimate(value, stderr, influences, len(influences) - lost, lost)

    def _term(self, word: str, per_run: Mapping[str, Array]) -> tuple[float, Array]:
        """Return the minimized value and its influences: a value, or its distance to a target."""
        m = _read(word)
        metric, quantity = m.family
        # Step 1: the statistic of the runs that are not lost, and each run's influence on it.
        x = per_run[_per_run(m)]
        finite = ~np.isnan(x)
        influences = np.full(len(x), np.nan)
        influences[finite] = influence(m.statistic, x[finite])
        value = STATISTICS[m.statistic](x[finite]).value
        # Step 2: make it an objective. A metric with a target: the distance to it.
        n = self.sizes[quantity] if metric.per_component else 1
        if m.statistic in _LOCATIONS and metric.better in _TARGETS:
            off = value / n - _TARGETS[metric.better]
            return abs(off), influences * (np.sign(off) / n)
        # A metric that is better larger: its negative.
        if _is_made_large(m):
            return -value, -influences
        return value, influences


def as_expression(word: str) -> str:
    """Write the term as tables do."""
    m = _read(word)
    return word if m.family[0].per_component else str(m)


def objective_label(word: str) -> str:
    """Write the term as it is added up: what is made large has a minus."""
    return f"-{word}" if _is_made_large(_read(word)) else word


def _read(word: str) -> Measure:
    """Parse the term; of ANEES and of log scores the mean is meant."""
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
    return f"rms({error_names(scenario)[0]})"
