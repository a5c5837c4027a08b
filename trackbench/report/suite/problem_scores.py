"""Scores of one problem of a suite: filters compared with the best, the reference and the bound."""

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, nan

import numpy as np

from trackbench.config.filters_that_fit import shown_label
from trackbench.config.suite_problem_configs import FittedProblem
from trackbench.report.findings.candidates import Candidate, candidates_of
from trackbench.report.findings.consistency_words import consistency, first_indefinite_steps
from trackbench.report.findings.ranking import Ranking, ranking_of
from trackbench.report.findings.ranking_columns import cpu_seconds
from trackbench.report.findings.ranking_metrics import leading_metric
from trackbench.report.mean_or_rms_of_metric import compared_statistic
from trackbench.report.suite.score_words import is_first, word_of_score
from trackbench.report.suite.scores import (
    BOUND,
    FILTER,
    NO_SUCH_ERROR,
    REFERENCE,
    SMOOTHER,
    ProblemRuns,
    Ratio,
    Score,
)
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.collapsed_runs import collapsed_runs
from trackbench.statistics.comparison import Comparison, compare
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.indefinite_covariances import indefinite_runs
from trackbench.statistics.sample_statistics import mean


def score_problem(problem: FittedProblem, results: Results) -> tuple[list[Score], ProblemRuns]:
    """Return the scores of a problem's filters, reference and bound, and the errors of each run.

    Filters are compared with the best filter, smoothers with the best smoother. The results of a tuned
    filter also have its tuned copy. The copy takes the filter's label and place here.

    Parameters
    ----------
    problem
        problem with its roster
    results
        the problem's results folder
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
    bound = bound_of_rms(results, metric)
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
            reasons[roster_labels.get(label, label)] = failed.get(label, NO_SUCH_ERROR)
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
        word=word_of_score(ranking, candidate),
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
    if is_first(ranking, candidate):
        return Ratio(value=1.0, low=1.0, high=1.0)
    # The ranking does not compare filters that lose more runs.
    comparison = ranking.compared.get(candidate.name) or compare(candidate.sample, best.sample)
    if comparison is None:
        return Ratio()
    return Ratio.of(comparison)


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


def bound_of_rms(results: Results, metric: str) -> RunEstimate | None:
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
