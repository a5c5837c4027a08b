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
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np

from trackbench.config.filters_that_fit import FittedProblem, shown_label
from trackbench.core.arrays import Array
from trackbench.csv_writer import write_csv
from trackbench.report.compared_mean_or_rms import compared_statistic
from trackbench.report.findings.candidates import Candidate, candidates_of
from trackbench.report.findings.consistency_words import consistency, first_indefinite_steps
from trackbench.report.findings.ranking import Ranking, leading_metric, ranking_of
from trackbench.report.findings.ranking_columns import cpu_seconds
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.collapsed_runs import collapsed_runs
from trackbench.statistics.comparison import Comparison, compare
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.indefinite_covariances import indefinite_runs
from trackbench.statistics.sample_statistics import mean
from trackbench.statistics.significance_rules import ALIKE, BETTER, UNTESTED, WORSE
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


def score_problem(problem: FittedProblem, results: Results) -> tuple[list[Score], ProblemRuns]:
    """Return the scores of a problem's filters, reference and bound, and the errors of each run.

    Filters are compared with the best filter, smoothers with the best smoother. The results of a tuned
    filter also have its tuned copy. The copy takes the filter's label and place here.

    Parameters
    ----------
    problem : problem with its roster
    results : the problem's results folder
    """
    # A suite takes no `grid` from an experiment, so that its results have a single point.
    (point,) = results.points()
    metric = leading_metric(results)  # of per_run.csv; empty if no filter has one to rank by
    statistic = "mean"  # without a metric there is no error, and the statistic has no effect
    if metric:
        statistic = compared_statistic(results.config, metric)
    candidates = {c.label: c for c in candidates_of(results, [point], metric, statistic)}
    reference = results.config.get("reference") or ""
    reference_candidate = candidates.get(reference)
    smoothers = {f"{label}, smoothed" for label in results.config.get("smoothed", ())}
    # Label of the filter in the roster, by the label of its tuned copy in the results. The filters
    # themselves are hidden.
    roster_labels = {shown_label(problem, label): label for label in problem.tuned}
    hidden = set(problem.tuned)
    shown = {label: candidate for label, candidate in candidates.items() if label not in hidden}
    words_on_consistency = consistency(results, [*shown.values()])
    # Without a reference filter, rms errors are divided by the bound, if there is one.
    bound = _bound(results, metric)
    scores: list[Score] = []
    gains: dict[str, Comparison] = {}
    # Step 1: filters and smoothers, ranked apart.
    for role in (FILTER, SMOOTHER):
        ranked = [
            candidate
            for label, candidate in shown.items()
            if label != reference and (label in smoothers) == (role == SMOOTHER)
        ]
        if not ranked:
            continue
        ranking = ranking_of(ranked, metric)
        for candidate in ranked:
            word = words_on_consistency[candidate]
            score = _score_candidate(problem, results, ranking, candidate, role, word)
            to_reference = _ratio_to_reference(candidate, reference_candidate, bound)
            label = roster_labels.get(candidate.label, candidate.label)
            scores.append(replace(score, label=label, ratio_to_reference=to_reference))
            if candidate.label in roster_labels and label in candidates:
                gain = compare(candidate.sample, candidates[label].sample)
                if gain is not None:
                    gains[label] = gain
    # Step 2: the reference and the bound.
    if reference_candidate is not None:
        error = reference_candidate.overall
        scores.append(
            replace(
                _blank_score(problem, reference_candidate.label, REFERENCE),
                metric=f"{statistic}({metric})",
                error=error.value,
                stderr=error.stderr,
                runs=len(reference_candidate.lost),
                lost=reference_candidate.losses,
                consistency=words_on_consistency[reference_candidate],
                cpu_s=cpu_seconds(results, reference_candidate),
            )
        )
    if bound is not None:
        scores.append(
            replace(
                _blank_score(problem, str(results.config["bound"]), BOUND),
                metric=f"rms({metric})",
                error=bound.value,
                stderr=bound.stderr,
            )
        )
    # Step 3: filters that have no error here, with the reason. Some do not fit the problem, and are left
    # out. Any other was run, and failed or has no such error.
    reasons = dict(problem.left_out)  # by label
    failed = {row["filter"]: str(row["reason"]) for row in results.failed}
    for label in results.filters:
        if label not in candidates and label not in hidden:
            reasons[roster_labels.get(label, label)] = failed.get(label, "has no such error")
    for label, why in reasons.items():
        role = FILTER
        if label == reference:
            role = REFERENCE
        elif label in smoothers:
            role = SMOOTHER
        is_left_out = label in problem.left_out
        # A score that is ``failed`` is that of a filter which was run and has no error.
        scores.append(
            replace(_blank_score(problem, label, role), reason=why, failed=not is_left_out)
        )
    values = {
        roster_labels.get(label, label): candidate.sample.values
        for label, candidate in shown.items()
        if label != reference and label not in smoothers
    }
    return scores, ProblemRuns(
        statistic=statistic, values=values, gains=gains, tuning=results.tuning
    )


def left_out_scores(problem: FittedProblem, labels: Sequence[str]) -> list[Score]:
    """Return the scores of filters that are left out of a problem, which have the reason alone.

    ``labels`` are those of the filters, all of which the problem leaves out.
    """
    return [
        replace(_blank_score(problem, label, FILTER), reason=problem.left_out[label])
        for label in labels
    ]


def _blank_score(problem: FittedProblem, label: str, role: str) -> Score:
    """Return the score of a filter on a problem, without any number yet.

    ``role`` is `FILTER`, `SMOOTHER`, `REFERENCE` or `BOUND`.
    """
    return Score(
        group=problem.group,
        problem=problem.name,
        problem_class=problem.settings.class_,
        label=label,
        role=role,
    )


def _score_candidate(
    problem: FittedProblem,
    results: Results,
    ranking: Ranking,
    candidate: Candidate,
    role: str,
    consistency_word: str,
) -> Score:
    """Return the score of a filter, compared with the best of its ranking.

    ``candidate`` is the filter in the ``results`` of the problem. ``role`` is `FILTER` or `SMOOTHER`.
    ``consistency_word`` says how its covariance is, such as ``overconfident``.
    """
    overall = candidate.overall
    runs = results.runs(candidate.point)
    # The NEES of each run (M,), a mean over its steps. Without any the counts of collapsed and
    # indefinite runs are zero.
    nees = runs.get((candidate.label, "nees"), np.full(0, nan))
    # The nameless size is the number of components of the whole state.
    size = results.facts(candidate.point).sizes.get("", 1)
    anees = mean(nees[~np.isnan(nees)] / size)
    # Runs whose covariance is not positive definite at some step. They do not count as collapsed.
    first_indefinite = first_indefinite_steps(results, candidate)
    is_indefinite = indefinite_runs(nees, first_indefinite)
    first_step = nan
    if is_indefinite.any() and first_indefinite is not None:
        first_step = float(np.nanmin(first_indefinite))
    definite_nees = nees[~is_indefinite]
    reason = ""  # why there is no error
    if not isfinite(overall.value):
        if candidate.losses == len(candidate.lost):
            reason = "lost all runs"
        elif np.isnan(candidate.sample.values).all():
            reason = "error is not measured"
        else:
            reason = "infinite error"
    return replace(
        _blank_score(problem, candidate.label, role),
        metric=f"{candidate.sample.statistic}({ranking.metric.metric})",
        error=overall.value,
        stderr=overall.stderr,
        ratio_to_best=_ratio_to_best(ranking, candidate),
        word=_word(ranking, candidate),
        runs=len(candidate.lost),
        lost=candidate.losses,
        # Runs whose NEES per component is far above 1: the covariance is far too small. An infinite NEES
        # is one of these, of a covariance without any spread at some step.
        collapsed=collapsed_runs(definite_nees / size),
        without_spread=int(np.isinf(definite_nees).sum()),
        indefinite=int(is_indefinite.sum()),
        first_indefinite_step=first_step,
        consistency=consistency_word,
        anees=anees.value,
        anees_stderr=anees.stderr,
        cpu_s=cpu_seconds(results, candidate),
        reason=reason,
        failed=bool(reason),
    )


def _ratio_to_best(ranking: Ranking, candidate: Candidate) -> Ratio:
    """Divide the error by that of the best filter; NaN if they cannot be compared."""
    if not ranking.order:  # no filter has an error that can be ranked
        return Ratio()
    best = ranking.order[0]
    if _is_first(ranking, candidate):
        return Ratio(value=1.0, low=1.0, high=1.0)
    # The ranking does not compare filters that lose more runs.
    comparison = ranking.compared.get(candidate.name) or compare(candidate.sample, best.sample)
    if comparison is None:
        return Ratio()
    return Ratio.of(comparison)


def _word(ranking: Ranking, candidate: Candidate) -> str:
    """Return how the filter compares with the best, as the ranking decides it.

    It is `LOSES_MORE`, `BEST`, `UNTESTED`, `WORSE` or `BETTER` (significantly), or `ALIKE` (no
    significant difference). A filter can be better than the first of the ranking on the runs that
    neither of them loses.
    """
    if candidate in ranking.losing:
        return LOSES_MORE
    if _is_first(ranking, candidate):
        return BEST
    comparison = ranking.compared.get(candidate.name)
    if comparison is None or not (comparison.is_tested or comparison.is_equal):
        return UNTESTED
    # The errors of a suite are better if they are lower.
    if comparison.sign > 0:
        return WORSE
    if comparison.sign < 0:
        return BETTER
    return ALIKE


def _is_first(ranking: Ranking, candidate: Candidate) -> bool:
    """Test whether a filter is the first of its ranking.

    The ranking of a recording may have a copy of the candidate, over the steps that all filters have.
    """
    return bool(ranking.order) and ranking.order[0].name == candidate.name


def _ratio_to_reference(
    candidate: Candidate, reference: Candidate | None, bound: RunEstimate | None
) -> Ratio:
    """Divide the error by that of the reference filter, or without one by the bound.

    The bound is one of the rms error, so that another statistic has no ratio to it.
    """
    if reference is not None:
        comparison = compare(candidate.sample, reference.sample)
        if comparison is None:  # they have no run in common
            return Ratio()
        return Ratio.of(comparison)
    if bound is None or candidate.sample.statistic != "rms":
        return Ratio()
    return Ratio.to_bound(candidate.sample.overall, bound.value)


def _bound(results: Results, metric: str) -> RunEstimate | None:
    """Return the stored lower bound of the rms of ``metric``, an error; None without a bound.

    It is the first row of the bound in summary.csv.
    """
    label = results.config.get("bound")
    if not label:
        return None
    rows = results.columns("summary").where(filter=label, metric=f"rms({metric})").records()
    for row in rows:
        stderr = row["stderr"]
        # A bound without a standard error is exact.
        bound_stderr = stderr if isfinite(stderr) else 0.0
        return RunEstimate(row["value"], bound_stderr, None, int(row.get("runs", 0)))
    return None


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
    without_class : class of problems that is left out; none if it is empty

    Returns
    -------
    Means by label; empty if no problem is left.
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
    ratios : ratios to the best (labels, problems); `WORST` or more is never within a factor
    factors : factors (F,)

    Returns
    -------
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
