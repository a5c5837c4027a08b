"""Filters that a column of a table marks as the best."""

from collections.abc import Sequence
from math import isfinite

import numpy as np

from trackbench.evaluation.metric_expression import Measure
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.candidates import Candidate, candidate_of
from trackbench.report.findings.ranking import ranking_of
from trackbench.statistics import significance_rules as rules


def best_labels(evaluator: Evaluator, labels: Sequence[str], m: Measure) -> list[str]:
    """Return the filters that are marked as best in the column of a measure.

    If each run has a value, they are the filters that the ranking marks. All filters of the experiment
    count in the correction for the number of tests. A CPU time or the number of a step has no value per
    run: the least number is marked.

    Parameters
    ----------
    evaluator
        results at one point of the grid
    labels
        filters of the table
    m
        measure of the column, without a filter

    Returns
    -------
    list of str
        labels among ``labels``. There is none for a measure of which neither the least nor the highest
        is best, for numbers that are zero in every run unless they are shares of runs, and for a step in
        fewer than five runs. Gains and win rates over another filter are never marked
    """
    lower_is_better = m.is_cpu_time or m.definition.better == "lower"
    # The ranking compares the metric itself, in the metric's better direction. A gain or win rate, of
    # which more is better whatever the metric, is another number.
    if not (lower_is_better or m.definition.is_score) or m.relation in ("gain", "win_rate"):
        return []
    # Case 1: runs have values, and the filters are ranked by them.
    candidates: dict[str, Candidate] = {}
    others = [label for label in evaluator.results.filters if label not in labels]
    for label in (*labels, *others):
        # `m.plain` is the measure without the filter that the column compares with.
        candidate = candidate_of(evaluator, m.plain.of(label))
        if candidate is not None:
            candidates[label] = candidate
    rivals = [candidates[label] for label in labels if label in candidates]
    if len(rivals) > 1:
        # If all filters have the same number, none is the best.
        if len({rival.overall.value for rival in rivals}) == 1:
            return []
        unranked = [candidates[label] for label in candidates if label not in labels]
        ranking = ranking_of(rivals, m.metric, unranked=unranked)
        # A share of runs that is zero is an answer; other numbers that are zero in every run are so by
        # construction.
        if ranking.best is not None and not m.is_share:
            values_of_runs = ranking.best.sample.values
            if not values_of_runs[np.isfinite(values_of_runs)].any():
                return []
        return [candidate.label for candidate in ranking.marked]
    # Case 2: fewer than two filters have values of their runs; the least number is the best.
    runs = max(map(len, evaluator.runs.values()), default=0)
    if runs < rules.FEWEST_RUNS and not m.is_cpu_time:
        return []
    values = {}
    for label in labels:
        value = evaluator.stored_or_evaluated(m.of(label)).value
        if isfinite(value):
            values[label] = value
    least = min(values.values(), default=0.0)
    if least == 0.0 and not m.is_share:
        return []
    best = [label for label, value in values.items() if value == least]
    # If all filters have the least number, none is better than another.
    if lower_is_better and len(best) < len(values):
        return best
    return []
