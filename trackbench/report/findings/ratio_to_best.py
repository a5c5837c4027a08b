"""Ratio of a filter to the best one with its interval: ``2.4 x (2.1 to 2.8)``, n.s., tiny, untested."""

from math import isfinite, nan

from trackbench.evaluation.metric_expression import Measure
from trackbench.report.findings import phrases
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.ranking import Ranking
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.comparison import Comparison


def marked_ratio(ranking: Ranking, candidate: Candidate, matters: float) -> str:
    """Write a filter's ratio to the best and its interval, ``2.4 x (2.1 to 2.8)``, with a mark.

    The mark is ``n.s.`` for a difference that is not significant, and ``tiny`` for a significant one
    below the share ``matters`` of the error. Of scores the text is the difference in nats.
    """
    is_score = ranking.metric.definition.is_score
    comparison = ranking.compared.get(candidate.name)
    if comparison is None:
        # The first of the order is the best; any other filter is not compared with it.
        is_best = candidate in ranking.order[:1]
        if not is_best:
            return "–"
        return "0" if is_score else "1"
    if comparison.is_equal:
        return "equal"
    value, low, high = _ratio_to_best(ranking.metric, comparison)
    if not isfinite(value):
        return "–"
    # The interval is of this pair alone, and the test is one of a family. An interval that shows a
    # difference which is not significant in the family would contradict the mark n.s.
    with_interval = not comparison.interval_contradicts
    text = _ratio_text(is_score, value, low, high, with_interval)
    if not comparison.is_tested:
        # Without a best filter the sentences say why nothing is tested.
        if ranking.best is None:
            return text
        return f"{text} {rules.UNTESTED}"
    if not comparison.sign:
        return f"{text} n.s."
    is_tiny = not is_score and abs(value - 1.0) < matters
    if is_tiny:
        return f"{text} tiny"
    return text


def _ratio_text(is_score: bool, value: float, low: float, high: float, with_interval: bool) -> str:
    """Write a ratio with its interval from ``low`` to ``high``: ``2.4 x (2.1 to 2.8)``.

    An end that is not finite, or the low end of a ratio if it is not above zero, is left out: ``2.4 x
    (at most 2.8)``. If ``is_score``, the numbers are differences of scores. The interval is left out
    unless ``with_interval``.
    """
    width = high - low
    if is_score:
        text = f"{value:.2g}"
        low_text = f"{low:.2g}"
        high_text = f"{high:.2g}"
    else:
        text = f"{phrases.multiple(value, width)} x"
        low_text = phrases.multiple(low, width)
        high_text = phrases.multiple(high, width)
    if not with_interval:
        return text
    if isfinite(width) and (is_score or low > 0.0):
        return f"{text} ({low_text} to {high_text})"
    if isfinite(width):
        return f"{text} (at most {high_text})"
    if isfinite(low):
        return f"{text} (more than {phrases.rounded(low, 2)})"
    return text


def _ratio_to_best(metric: Measure, comparison: Comparison) -> tuple[float, float, float]:
    """Return a filter's ratio to the best, and the low and high end of its 95 % interval.

    ``comparison`` is that of the filter with the best. The ends are NaN if it is not tested. Of a score
    the numbers are how far it lies below the best.
    """
    # A ratio of scores, which are logarithms, would mean nothing.
    if metric.definition.is_score:
        difference = comparison.swapped.difference  # the best minus this filter
        value = difference.value
        low, high = difference.interval()
    else:
        value = comparison.ratio.value
        low, high = comparison.ratio_interval
    if comparison.is_tested:
        return (value, low, high)
    return (value, nan, nan)


def multiple_of_best(ranking: Ranking, candidate: Candidate) -> float:
    """Return a filter's ratio to the best; of a score how far it lies below the best.

    It is NaN if the filter is not compared with the best. One that loses more runs is not.
    """
    is_best = candidate in ranking.order[:1]
    if is_best:
        return 0.0 if ranking.metric.definition.is_score else 1.0
    comparison = ranking.compared.get(candidate.name)
    if comparison is None:
        return nan
    value, _, _ = _ratio_to_best(ranking.metric, comparison)
    return value
