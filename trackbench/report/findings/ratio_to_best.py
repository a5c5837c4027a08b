"""Ratio of a filter to the best one: ``2.4 x (2.1 to 2.8)``, n.s., tiny; ``within a factor of 1.24``."""

from collections.abc import Sequence
from math import exp, expm1, inf, isfinite, nan

from trackbench.evaluation.metric_expression import Measure
from trackbench.report import rounded_numbers
from trackbench.report.findings import phrases
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.phrases import listed
from trackbench.report.findings.ranking import Ranking, Rival
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.comparison import Comparison

_WITHIN_ONE_PERCENT = 1.01
"""Multiple of the best error up to which an error is called within 1 %."""
_MOST_NATS = 700.0
"""Difference of log scores whose exponential is a finite number; larger ones count as this one."""


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
    if not is_score and share_of_difference(ranking.metric, comparison) < matters:
        return f"{text} tiny"
    return text


def share_of_difference(metric: Measure, comparison: Comparison) -> float:
    """Return how far a filter is from the best, as a share of the best error, or of its density.

    A log score is the logarithm of a density. ``comparison`` is that of the filter with the best. The
    share is NaN if the best error is zero.
    """
    value, _, _ = _ratio_to_best(metric, comparison)
    if metric.definition.is_score:
        return expm1(min(abs(value), _MOST_NATS))
    return abs(value - 1.0)


def distance_in_parentheses(metric: Measure, comparison: Comparison) -> str:
    """Write the ratio of an error to the best one, ``(1.24 x)``, or the nats below the best score.

    ``comparison`` is that of the filter with the best. The text is empty if the best error is zero.
    """
    is_score = metric.definition.is_score
    value, low, high = _ratio_to_best(metric, comparison)
    if not isfinite(value):
        return ""
    text = _ratio_text(is_score, value, low, high, with_interval=False)
    return f"({text} nats)" if is_score else f"({text})"


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
        text = f"{rounded_numbers.multiple(value, width)} x"
        low_text = rounded_numbers.multiple(low, width)
        high_text = rounded_numbers.multiple(high, width)
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


def distance_from_best(ranking: Ranking, rival: Rival) -> float:
    """Return a filter's error over that of the best; for a score, the best density over the filter's.

    A log score is the logarithm of a density. The result is infinite if the best error is zero.
    """
    value = rival.difference.value
    if ranking.metric.definition.is_score:
        return exp(min(abs(value), _MOST_NATS))
    ratio = rival.comparison.ratio.value
    return ratio if isfinite(ratio) else inf


def within_in_words(ranking: Ranking, rival: Rival) -> str:
    """Write within what factor of the best an error is, or within how many nats a score.

    The text is ``within 1 %``, ``within a factor of 1.24`` or ``within 0.31 nats``. The factor is the
    ratio as the ranking's table has it, rounded alike.
    """
    if ranking.metric.definition.is_score:
        return f"within {phrases.rounded(abs(rival.difference.value), 2)} nats"
    # At least 1, as the rival is behind the best in the order, and less is better of every error.
    multiple_of_best = distance_from_best(ranking, rival)
    if multiple_of_best < _WITHIN_ONE_PERCENT:
        return "within 1 %"
    return f"within a factor of {rounded_numbers.multiple(multiple_of_best, inf)}"


def distances_in_words(ranking: Ranking, rivals: Sequence[Rival]) -> str:
    """Write how far filters are from the best: ``at 55.9 times``; ``3.2 and 4 nats below``."""
    if ranking.metric.definition.is_score:
        nats = [phrases.rounded(abs(rival.difference.value), 2) for rival in rivals]
        return f"{listed(nats)} nats below"
    ratios = [distance_from_best(ranking, rival) for rival in rivals]
    # Without the width of an interval a ratio has three digits.
    texts = [rounded_numbers.multiple(ratio, width=inf) for ratio in ratios if isfinite(ratio)]
    # A ratio is infinite if the error of the best is zero. Then all of them are.
    if len(texts) < len(ratios):
        return "as the error of the best is zero"
    return f"at {listed(texts)} times its error"
