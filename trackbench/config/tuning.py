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
from trackbench.statistics.sample_statistics import STATISTICS, influence, mean

SUFFIX = " (tuned)"
"""End of the label of a tuned filter."""


def tuned_label(label: str) -> str:
    """Return the label of the tuned filter beside this one."""
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
    """A tuned key and its values, each at a share of the axis from 0 to 1.

    Numbers are rounded to four digits. More digits would not show in an error, and rounding differences
    of the search then give equal values.
    """

    key: str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    whole: bool = False
    choices: tuple[object, ...] = ()

    def at(self, share: float) -> object:
        """Return the value at a share of the axis; a share outside 0 to 1 has the value of the end."""
        share = min(max(share, 0.0), 1.0)
        if self.choices:
            # Equal parts of the axis; a share of 1 belongs to the last choice.
            index = int(share * len(self.choices))
            return self.choices[min(index, len(self.choices) - 1)]
        # Step 1: the value; both ends exactly as written, whatever their digits.
        if share == 0.0:
            value = self.low
        elif share == 1.0:
            value = self.high
        else:
            value = self._between_ends(share)
        # Step 2: a whole number where no other is valid.
        if self.whole:
            return round(value)
        return value

    def _between_ends(self, share: float) -> float:
        """Return low^(1 - s) high^s on a logarithmic axis, low + s (high - low) on a linear one."""
        if self.log:
            # These functions take arrays, here of one value.
            logs = elementary.log(np.array([self.low, self.high]))
            log_low = logs[:1]
            log_high = logs[1:]
            value = float(elementary.exp(log_low + share * (log_high - log_low))[0])
        else:
            value = self.low + share * (self.high - self.low)
        # Four digits, which may round beyond an end.
        rounded = float(f"{value:.{_DIGITS}g}")
        return min(max(rounded, self.low), self.high)

    def share(self, value: object) -> float | None:
        """Return the share of the axis at which a value lies; None if the axis does not have it."""
        if self.choices:
            for i, choice in enumerate(self.choices):
                if choice == value:
                    # The middle of the choice's part of the axis.
                    return (i + 0.5) / len(self.choices)
            return None
        if not is_number(value) or not self.low <= value <= self.high:
            return None
        if not self.log:
            return (value - self.low) / (self.high - self.low)
        low, x, high = elementary.log(np.array([self.low, value, self.high])).tolist()
        return (x - low) / (high - low)

    @property
    def grain(self) -> float:
        """Distance of two shares below which they may have one value."""
        if self.choices:
            return 1.0 / len(self.choices)
        if self.whole and not self.log:
            return 1.0 / (self.high - self.low)
        return 0.0


def read_axis(key: str, written: object) -> Axis:
    """Read the axis of a key from a config: a list of choices, ``a..b`` or ``log:a..b``.

    Raises ValueError, with the mistake in words.
    """
    if " & " in key:
        raise ValueError("keys that vary together are of a grid; tune each key under its own name")
    if isinstance(written, list):
        if len(written) < 2:
            raise ValueError("a list of choices has at least two")
        if any(isinstance(value, dict | list) for value in written):
            message = "a choice is a word or a number; tune keys within it"
            raise ValueError(f"{message}, as {key}.kind: [A, B]")
        if any(value in written[:i] for i, value in enumerate(written)):
            raise ValueError("a choice is given twice")
        return Axis(key, choices=tuple(written))
    match = None
    if isinstance(written, str):
        match = re.fullmatch(RANGE, written)
    if match is None:
        raise ValueError(f"{written!r}: write a..b, log:a..b or a list of choices")
    log = bool(match.group(1))
    low = float(match.group(2))
    high = float(match.group(3))
    if not low < high or not np.isfinite([low, high]).all():
        raise ValueError(f"{written!r} does not rise from a number to a larger one")
    if log and low <= 0.0:
        raise ValueError(f"{written!r}: a logarithmic range has ends above zero")
    if max(-low, high) > _FARTHEST or (log and low < 1.0 / _FARTHEST):
        raise ValueError(f"{written!r} is too wide; ends of up to 1e100, or log:1e-100..1e100")
    return Axis(key, low, high, log)


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
        """Return the objective of a config's metric: one term, or terms with their weights."""
        weights = {metric: 1.0} if isinstance(metric, str) else metric
        return cls(weights=weights, sizes=sizes)

    @property
    def metrics(self) -> list[str]:
        """Names of the values per run that it takes."""
        return [_run_metric(_read_term(word)) for word in self.weights]

    @property
    def only_mean(self) -> str | None:
        """Name of the values per run, if the objective is the mean or rms of one error or score."""
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
        """Return the objective of the runs' values (M,) by metric, NaN for lost runs; less is better."""
        # The influences of a weighted sum are the weighted sum of its terms' influences.
        value = 0.0
        influences = np.zeros(len(per_run["lost"]))
        with np.errstate(all="ignore"):
            for word, weight in self.weights.items():
                term_value, term_influences = self._score_term(word, per_run)
                value = value + weight * term_value
                influences = influences + weight * term_influences
        lost = int((per_run["lost"] != 0).sum())
        stderr = mean(influences[~np.isnan(influences)]).stderr
        return RunEstimate(value, stderr, influences, len(influences) - lost, lost)

    def _score_term(self, word: str, per_run: Mapping[str, Array]) -> tuple[float, Array]:
        """Return the minimized value of the term ``word``, and each run's influence (M,) on it."""
        measure = _read_term(word)
        metric = measure.definition
        quantity = measure.quantity
        # Step 1: the statistic of the runs that are not lost, and each run's influence on it.
        x = per_run[_run_metric(measure)]
        is_finite = ~np.isnan(x)
        influences = np.full(len(x), np.nan)
        influences[is_finite] = influence(measure.statistic, x[is_finite])
        value = STATISTICS[measure.statistic](x[is_finite]).value
        # Step 2: make it an objective. A metric with a target: the distance to it.
        n = self.sizes[quantity] if metric.per_component else 1
        if measure.statistic in _LOCATIONS and metric.better in _TARGETS:
            deviation = value / n - _TARGETS[metric.better]
            return abs(deviation), influences * (np.sign(deviation) / n)
        # A metric that is better larger: its negative.
        if _is_maximized(measure):
            return -value, -influences
        return value, influences


def as_expression(word: str) -> str:
    """Write the term as tables do."""
    measure = _read_term(word)
    if measure.definition.per_component:
        return word
    return str(measure)


def objective_label(word: str) -> str:
    """Write the term as it is added up: a maximized one has a minus."""
    if _is_maximized(_read_term(word)):
        return f"-{word}"
    return word


def objective_target(word: str) -> float | None:
    """Return the ideal value, the distance to which is minimized; None if there is none."""
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
    return measure.statistic in _LOCATIONS and measure.definition.more_is_better


def _run_metric(measure: Measure) -> str:
    """Return the name of the values per run that the statistic is taken of."""
    if measure.definition.per_component:
        return in_window(measure.base, measure.window)
    return measure.name


def bad_terms(metric: str | Mapping[str, float] | None) -> Iterator[tuple[str, str]]:
    """Yield each term of the objective that cannot be minimized, and why.

    It is no statistic over runs, or it is a spread of a metric that is better larger.
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


def default_metric(scenario: Scenario, has_errors: bool) -> str:
    """Return the rms of the scenario's first error; without errors the predictive likelihood."""
    if not has_errors:
        return "log_score"
    return f"rms({error_names(scenario)[0]})"
