"""Scores of a suite: one record for each problem and filter, and what follows over all problems.

The error of a filter is divided by that of the best filter of the same problem, over the runs that
neither loses. Over problems the ratios are summarized by their geometric mean, each ratio limited to
`WORST`. A filter that loses significantly more runs than another, or cannot be run, counts as `WORST`.
The logarithm of this mean, to the base `WORST`, is one minus the area under the filter's performance
profile [1]_ between 1 and `WORST` on a logarithmic axis, so that figure and number agree. Below the
limit the order of the filters does not depend on which filter is the best.

.. [1] E. D. Dolan, J. J. More: Benchmarking optimization software with performance profiles,
   Mathematical Programming 91, 2002.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np

from trackbench.core.arrays import Array
from trackbench.csv_writer import write_csv
from trackbench.statistics.comparison import Comparison
from trackbench.statistics.estimates import RunEstimate
from trackbench.tuning.record_of_trials import Record

WORST = 10.0
"""Ratio to the best from which on a filter counts as useless for the problem."""
FILTER = "filter"
SMOOTHER = "smoother"
REFERENCE = "reference"
BOUND = "bound"
"""Roles of a score."""
RESAMPLINGS = 200
"""Resamplings of the runs for the bands of performance profiles."""


@dataclass(frozen=True, kw_only=True)
class Ratio:
    """Ratio of two errors with its 95 % interval; NaN where there is none."""

    value: float = nan
    low: float = nan
    high: float = nan

    @classmethod
    def of(cls, comparison: Comparison) -> "Ratio":
        """Return the ratio of two filters with the interval of its test.

        The ratio of two errors that are both zero in every run is 1.
        """
        if comparison.is_equal and comparison.a.value == comparison.b.value == 0.0:
            return cls(value=1.0, low=1.0, high=1.0)
        low, high = comparison.ratio_interval
        return cls(value=comparison.ratio.value, low=low, high=high)

    @classmethod
    def to_bound(cls, error: RunEstimate, bound: float) -> "Ratio":
        """Return the ratio of an error to a bound, which is exact."""
        low, high = error.interval()
        return cls(value=error.value / bound, low=low / bound, high=high / bound)


NO_SUCH_ERROR = "has no such error"
"""Reason of a filter that was run and does not measure the error by which filters are ranked."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Cell of a suite: a filter on a problem."""

    group: str
    problem: str
    problem_class: str
    label: str
    role: str
    """filter, smoother, reference or bound"""
    metric: str = ""
    """with its statistic over the runs, as ``rms(rmse_position)``"""
    error: float = nan
    stderr: float = nan
    ratio_to_best: Ratio = field(default_factory=Ratio)
    ratio_to_reference: Ratio = field(default_factory=Ratio)
    """to the error of the reference filter, or without one to the bound"""
    word: str = ""
    """best, no significant difference, worse, loses more runs, untested"""
    runs: int = 0
    lost: int = 0
    collapsed: int = 0
    """runs with a mean squared error far beyond what the covariance says"""
    without_spread: int = 0
    """those of them whose covariance has no spread at some step, as of particles at one point"""
    indefinite: int = 0
    """runs whose covariance is not positive definite at some step; they do not count as collapsed"""
    first_indefinite_step: float = nan
    """first of these steps in any run"""
    consistency: str = ""
    """word on the covariance, such as overconfident; empty if the runs have neither NEES nor NIS"""
    anees: float = nan
    """mean over the runs of the NEES per component of the state, 1 for a consistent filter"""
    anees_stderr: float = nan
    cpu_s: float = nan
    """CPU seconds of a run"""
    reason: str = ""
    """why the filter has no error here"""
    failed: bool = False
    """True if it was run and has no error: it raised, or lost all runs"""

    @property
    def has_error(self) -> bool:
        """True if the filter has an error on the problem."""
        return not self.reason

    @property
    def is_left_out(self) -> bool:
        """True if the scenario does not fit the filter."""
        return bool(self.reason) and not self.failed

    @property
    def has_raised(self) -> bool:
        """True if the filter was run and raised an exception, so that no run of it was scored."""
        return self.failed and self.runs == 0 and self.reason != NO_SUCH_ERROR

    @property
    def limited_ratio(self) -> float:
        """Ratio to the best, at most `WORST`; `WORST` without a fair error."""
        if self.reason or self.word == LOSES_MORE or not self.ratio_to_best.value <= WORST:
            return WORST
        # It is below 1 if the filter is better than the first of the ranking on their common runs.
        return max(self.ratio_to_best.value, 1.0)


BEST = "best"
LOSES_MORE = "loses more runs"
"""Words of a score, beside those of `significance_rules`."""


@dataclass(frozen=True, kw_only=True)
class ProblemRuns:
    """Errors of each run of a problem, to resample: values (M,) by filter, NaN where lost."""

    statistic: str
    """over the runs, by which filters are compared: mean or rms"""
    values: Mapping[str, Array]
    gains: Mapping[str, Comparison] = field(default_factory=dict)
    """comparison of each tuned filter with the untuned one: the difference is tuned minus untuned"""
    tuning: Mapping[str, Record] = field(default_factory=dict)
    """trials of each tuned filter"""


@dataclass(frozen=True, kw_only=True)
class SuiteScores:
    """All scores of a suite's group."""

    group: str
    title: str
    scores: list[Score]
    runs: Mapping[str, ProblemRuns]
    """errors of each run, by problem"""
    tuned: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """labels of the filters that are tuned on a problem, by problem"""
    added: tuple[str, ...] = ()
    """labels of the user's own filters"""
    linear: frozenset[str] = frozenset()
    """problems with a linear motion and a linear sensor"""
    not_computed: tuple[Score, ...] = ()
    """scores of the user's own filters on problems that none of them runs on, with the reasons"""

    @cached_property
    def resampled(self) -> Array:
        """Ratios of the filters over resampled runs; see `resampled_ratios`."""
        return resampled_ratios(self)

    def of_role(self, role: str) -> list[Score]:
        """Return the scores with this role: `FILTER`, `SMOOTHER`, `REFERENCE` or `BOUND`."""
        return [score for score in self.scores if score.role == role]

    def labels(self, role: str) -> list[str]:
        """Return the labels with this role, in the roster's order."""
        return list(dict.fromkeys(score.label for score in self.of_role(role)))

    @property
    def problems(self) -> list[str]:
        """Return the problems in the suite's order."""
        return list(dict.fromkeys(score.problem for score in self.scores))

    @property
    def classes(self) -> dict[str, str]:
        """Return the class of each problem."""
        return {score.problem: score.problem_class for score in self.scores}


HEADER = (
    *("group", "problem", "class", "filter", "role", "metric", "error", "stderr"),
    *("ratio_to_best", "low", "high", "word"),
    *("ratio_to_reference", "reference_low", "reference_high"),
    *("runs", "lost", "collapsed", "consistency", "reason"),
)
"""Columns of scores.csv, which are the same bytes on every machine; costs.csv has the CPU times."""


def write_scores(folder: Path, groups: Sequence[SuiteScores]) -> None:
    """Write scores.csv, and costs.csv with the CPU time of each filter's run."""
    rows = []
    costs = []
    for group in groups:
        for score in [*group.scores, *group.not_computed]:
            best = score.ratio_to_best
            reference = score.ratio_to_reference
            numbers = [score.error, score.stderr, best.value, best.low, best.high]
            error, stderr, ratio, low, high = map(_cell, numbers)
            rows.append(
                [
                    *(score.group, score.problem, score.problem_class, score.label, score.role),
                    *(score.metric, error, stderr, ratio, low, high, score.word),
                    *map(_cell, (reference.value, reference.low, reference.high)),
                    *(score.runs, score.lost, score.collapsed, score.consistency, score.reason),
                ]
            )
            if isfinite(score.cpu_s):
                costs.append([score.group, score.problem, score.label, score.role, score.cpu_s])
    write_csv(folder / "scores.csv", [*HEADER], rows)
    write_csv(folder / "costs.csv", ["group", "problem", "filter", "role", "cpu_s_per_run"], costs)


def _cell(number: float) -> float | str:
    """Round a number to seven digits, as in summary.csv; an empty text for NaN."""
    if np.isnan(number):
        return ""
    return float(f"{number:.7g}")


def ratio_matrix(group: SuiteScores, role: str = FILTER) -> tuple[list[str], list[str], Array]:
    """Return labels, problems, and the ratios to the best (labels, problems), limited to `WORST`.

    A ratio is the filter's error over that of the problem's best filter, or a smoother's over that of
    its best smoother. Without a score it is `WORST`. ``role`` is `FILTER` or `SMOOTHER`.
    """
    labels = group.labels(role)
    problems = [p for p in group.problems if any(s.problem == p for s in group.of_role(role))]
    ratios = np.full((len(labels), len(problems)), WORST)
    for score in group.of_role(role):
        ratios[labels.index(score.label), problems.index(score.problem)] = score.limited_ratio
    return labels, problems, ratios


def typical_ratios(group: SuiteScores, without_class: str = "") -> dict[str, float]:
    """Return each filter's geometric mean of its limited ratios to the best, over the problems.

    A ratio is the filter's error over that of the best filter of the problem, 1 at least and `WORST` at
    most.

    Parameters
    ----------
    without_class
        class of problems that is left out; none if it is empty

    Returns
    -------
    dict[str, float]
        means by label; empty if no problem is left.
    """
    labels, problems, ratios = ratio_matrix(group)
    columns = [i for i, name in enumerate(problems) if group.classes[name] != without_class]
    if not columns:
        return {}
    means = np.exp(np.mean(np.log(ratios[:, columns]), axis=1))
    return dict(zip(labels, means.tolist(), strict=True))


def typical_ratio_where_run(group: SuiteScores, label: str) -> float:
    """Return the geometric mean of a filter's limited ratios over the problems that it was run on.

    NaN if it was run on none. A failure counts as `WORST`.
    """
    ratios = [
        score.limited_ratio
        for score in group.of_role(FILTER)
        if score.label == label and not score.is_left_out
    ]
    if not ratios:
        return nan
    return float(np.exp(np.mean(np.log(ratios))))


def ordered_labels(group: SuiteScores) -> list[str]:
    """Return the filters by their typical ratio, the best first."""
    typical = typical_ratios(group)
    return sorted(typical, key=lambda label: typical[label])


def relative_costs(group: SuiteScores) -> dict[str, float]:
    """Return each filter's CPU time divided by that of the fastest filter, the median over problems."""
    ratios: dict[str, list[float]] = {}
    for problem in group.problems:
        times = {
            score.label: score.cpu_s
            for score in group.of_role(FILTER)
            if score.problem == problem and isfinite(score.cpu_s) and score.cpu_s > 0.0
        }
        fastest = min(times.values(), default=nan)
        for label, seconds in times.items():
            ratios.setdefault(label, []).append(seconds / fastest)
    return {label: float(np.median(values)) for label, values in ratios.items()}


def profile(ratios: Array, factors: Array) -> Array:
    """Return the share of problems on which each filter is within each factor of the best.

    Parameters
    ----------
    ratios
        ratios to the best (labels, problems); `WORST` or more is never within a factor
    factors
        factors (F,)

    Returns
    -------
    Array
        shares (labels, F)
    """
    within = (ratios[:, :, None] <= factors) & (ratios[:, :, None] < WORST)
    return within.mean(axis=1)


def resampled_ratios(group: SuiteScores, seed: int = 0) -> Array:
    """Return the limited ratios (RESAMPLINGS, labels, problems) over runs drawn with replacement.

    A ratio is the filter's error over that of the filter that is best in the drawn runs, `WORST` at
    most. All filters of a problem get the same drawn runs. A filter that loses significantly more runs
    than another, or was not run, keeps the ratio `WORST`.
    """
    labels, problems, ratios = ratio_matrix(group)
    rng = np.random.default_rng(seed)
    resampled = np.empty((RESAMPLINGS, len(labels), len(problems)))
    for b in range(RESAMPLINGS):
        for j, name in enumerate(problems):
            drawn = _resample_problem(group.runs[name], labels, ratios[:, j], rng)
            resampled[b, :, j] = np.minimum(drawn, WORST)
    return resampled


def profile_bands(group: SuiteScores, factors: Array) -> tuple[Array, Array]:
    """Return 95 % bands (labels, F) of the performance profiles, over resampled runs."""
    shares = np.array([profile(ratios, factors) for ratios in group.resampled])
    return np.quantile(shares, 0.025, axis=0), np.quantile(shares, 0.975, axis=0)


def _resample_problem(
    runs: ProblemRuns, labels: Sequence[str], ratios: Array, rng: np.random.Generator
) -> Array:
    """Return the ratios to the best (labels,) over runs of one problem, drawn with replacement.

    ``ratios`` (labels,) are those over all runs. A filter with the ratio `WORST` keeps it, and all do if
    there are fewer than two runs or the drawn runs have no best error.
    """
    statistic = _STATISTICS[runs.statistic]  # mean or rms
    M = max((len(values) for values in runs.values.values()), default=0)
    if M < 2:
        return ratios
    drawn = rng.integers(0, M, M)
    errors = np.full(len(labels), inf)
    for i, label in enumerate(labels):
        values = runs.values.get(label)
        # A filter that failed, is useless here, or has other runs is not compared.
        if values is None or not ratios[i] < WORST or len(values) != M:
            continue
        chosen = values[drawn]
        finite = chosen[np.isfinite(chosen)]
        if len(finite):
            errors[i] = statistic(finite)
    best = float(errors.min())
    if not 0.0 < best < inf:
        return ratios
    return np.where(ratios < WORST, errors / best, ratios)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


_STATISTICS: dict[str, Callable[[Array], float]] = {
    "mean": lambda values: float(np.mean(values)),
    "rms": _rms,
}
