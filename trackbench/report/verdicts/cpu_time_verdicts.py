"""Verdicts on CPU times: those of one machine, in a file and tables of their own.

Two filters are compared by the ratio of their times in each repeat: its median, and the median's rank
interval. On other machines, and in other executions, it scattered by up to a factor of `SCATTER`.
So the interval is widened by that factor to both sides. A claim holds if the whole widened interval
agrees with it, and fails if no part of it does. A printed number differs if it lies outside.
"""

from collections import Counter
from dataclasses import replace
from math import inf, isnan, nan
from typing import Any, NamedTuple

from trackbench.config.published_numbers_and_claims import Claim, Published, PublishedNumber
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_verdicts import point_of
from trackbench.results.file_names import TIME_VERDICTS
from trackbench.statistics.cpu_time_ratio import repeats_of
from trackbench.statistics.sample_statistics import interval, median
from trackbench.statistics.verdict_rules import NOT_MEASURED, UNDECIDED

SCATTER = 2.0
"""Factor by which a ratio of two filters' times may differ on another machine or at another time."""


class TimeVerdict(NamedTuple):
    """A number or claim about CPU times, the verdict, the measured ratio and its 95 % interval."""

    row: PublishedNumber | Claim
    word: str
    measured: float
    """ratio of two filters' times, or the seconds of one; NaN if it is not measured"""
    low: float
    high: float
    """ends of the 95 % interval, which is not widened by `SCATTER` here"""
    wanted: tuple[float, float]
    """least and largest ratio (or seconds) that agree with the row"""
    filters: str
    """label, or both labels: ``HDEPF / PF``"""
    operations: str
    """operations of each filter per run and step, in words"""

    @property
    def statement(self) -> str:
        """Claim, or what the number is of."""
        row = self.row
        if isinstance(row, Claim):
            return row.claim
        return f"{row.filter}: {row.metric}"


def without_times(published: Published) -> Published:
    """Return the published rows that are not about CPU times."""
    numbers = [row for row in published.numbers if not _is_of_time(row)]
    claims = [row for row in published.claims if not _is_of_time(row)]
    return replace(published, numbers=numbers, claims=claims)


def _is_of_time(row: PublishedNumber | Claim) -> bool:
    return any(m.is_cpu_time for m in row.expressions)


def time_verdicts(results: Results) -> list[TimeVerdict]:
    """Compare the measured CPU times with the published numbers, then with the claims."""
    verdicts: list[TimeVerdict] = []
    for number in results.published.numbers:
        if _is_of_time(number):
            # The filter whose time divides that of the label; empty if the number is a time itself.
            other = number.expression.other if number.expression else ""
            # A number that no filter of the experiment measures gets the verdict "not measured".
            for label in number.labels or [""]:
                verdicts.append(_judge(results, number, label, other))
    for claim in results.published.claims:
        if _is_of_time(claim):
            verdicts.append(_judge_claim(results, claim))
    return verdicts


def _judge_claim(results: Results, claim: Claim) -> TimeVerdict:
    """Judge a claim: it has the worst verdict of its comparisons.

    The times of ``claim.left`` are compared with those of each filter of the claim's right side. If that
    is a number, they are compared with those of the filter that the expression itself names, as
    ``ratio(cpu_s_per_run, PF)`` does.
    """
    other = claim.expression.other if claim.expression else ""
    verdicts = [_judge(results, claim, claim.left, right) for right in claim.rights or [other]]
    # A claim against several filters holds if it does against each of them.
    worst_first = ("fails", NOT_MEASURED, UNDECIDED, "holds")
    return min(verdicts, key=lambda verdict: worst_first.index(verdict.word))


def _judge(results: Results, row: PublishedNumber | Claim, left: str, right: str) -> TimeVerdict:
    """Judge a published number or claim about CPU times.

    It is about the time of the filter ``left`` divided by that of ``right``, or about the time of
    ``left`` itself, in seconds, if ``right`` is empty.
    """
    # Step 1: CPU seconds of each filter's repeats, and its operations; both lists stay empty for a
    # folder without measured times.
    point = point_of(results, row.point)
    timing: dict[str, dict[str, Any]] = {}
    if point is not None:
        for record in results.columns("timing", point).records():
            timing[record["filter"]] = record
    labels = [label for label in (left, right) if label]
    seconds = []
    operations = []
    for label in labels:
        if label in timing:
            record = timing[label]
            seconds.append(repeats_of(record))
            counts = [f"{record.get(name, '-')} {name}" for name in _OPERATIONS]
            operations.append(f"{label} {', '.join(counts)}")
    # Step 2: the ratio (or the seconds) of each repeat: its median, and the median's rank interval. The
    # verdict is by this interval, widened by SCATTER to allow for another machine or another time.
    wanted = _wanted_range(row)
    value = nan
    low = nan
    high = nan
    # Every filter has a row in timing.csv, with repeats. A number that names no filter is not measured.
    all_timed = left != "" and len(seconds) == len(labels) and all(map(len, seconds))
    word = UNDECIDED if all_timed else NOT_MEASURED
    # Each repeat gives a ratio, so both filters need equally many; an interval needs at least two.
    repeats = {len(times) for times in seconds}
    if wanted is not None and all_timed and len(repeats) == 1 and max(repeats) > 1:
        ratios = seconds[0]
        if right:
            ratios = ratios / seconds[1]
        value = median(ratios).value
        low, high = interval("median", ratios)
        word = _word(row, low / SCATTER, high * SCATTER, *wanted)
    return TimeVerdict(
        row=row,
        word=word,
        measured=value,
        low=low,
        high=high,
        wanted=wanted or (nan, nan),
        filters=" / ".join(labels),
        operations="; ".join(operations),
    )


_OPERATIONS = ("likelihoods", "covariances")
"""Columns of timing.csv that count a filter's operations."""


def _wanted_range(row: PublishedNumber | Claim) -> tuple[float, float] | None:
    """Return the least and the largest ratio (or seconds) that agree with a published row.

    Return None if the row is not about a CPU time or a ratio of two.
    """
    relation = row.expression.relation if row.expression else ""
    if not all(m.is_cpu_time for m in row.expressions):
        return None
    if isinstance(row, PublishedNumber):
        # A published value that is a text is a word on a bias.
        if isinstance(row.value, str) or relation not in ("", "ratio", "gain"):
            return None
        # A gain of p percent is a ratio of 1 - p / 100.
        ratio = row.value
        if relation == "gain":
            ratio = 1.0 - ratio / 100.0
        return ratio, ratio
    # A ratio that is itself compared with that of other filters would be a ratio of ratios.
    if relation not in ("", "ratio") or (relation and row.rights):
        return None
    # A claim that the left side is equal (~) to the factor, below or above it.
    if row.relation == "~":
        return row.factor * (1.0 - row.tolerance), row.factor * (1.0 + row.tolerance)
    if row.relation == "<":
        return 0.0, row.factor
    return row.factor, inf


def _word(row: PublishedNumber | Claim, low: float, high: float, least: float, most: float) -> str:
    """Return the word of the verdict by the measured interval of a ratio, ``low`` to ``high``.

    `SCATTER` has widened this interval. It is NaN if there are too few repeats for one. The published
    row is true of ratios from ``least`` to ``most``.
    """
    if isnan(low):
        return UNDECIDED
    is_outside = high <= least or low >= most
    is_inside = least <= low and high <= most
    if isinstance(row, PublishedNumber):
        # A setting was fitted to this number, which therefore confirms nothing.
        if row.chosen:
            return UNDECIDED
        if is_outside:
            return "differs"
        return "compatible"  # the widened interval is too wide for an agreement within 10 %
    if is_outside:
        return "fails"
    if is_inside:
        return "holds"
    return UNDECIDED


def time_line(results: Results) -> list[str]:
    """Return a list of one line that counts the verdicts on times; empty if there is no verdict."""
    words = Counter(verdict.word for verdict in time_verdicts(results))
    if not words:
        return []
    counts = ", ".join(f"{number} {word}" for word, number in words.items())
    return [f"CPU times, on this machine: {counts}; {TIME_VERDICTS} has them"]
