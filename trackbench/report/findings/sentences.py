"""Conclusions of an experiment in a few sentences, each decided by its runs.

They name the best filter and those without a significant difference from it, metrics by which another
one is better, filters that lose more runs, the cost of the best and its calibration.
"""

from collections import Counter
from collections.abc import Sequence
from itertools import islice
from math import inf, isfinite
from operator import attrgetter
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from trackbench.evaluation.statistics import Estimate, interval, mean, without_rounding
from trackbench.report.estimates import in_words
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import (
    listed,
    metric_words,
    named,
    percent,
    two_digits,
    verb,
    with_unit,
)
from trackbench.report.findings.plugin_ranks import plugin_ranks
from trackbench.report.findings.ranking import Candidate, Ranking, ranking_metrics, rankings
from trackbench.report.paired import Pair
from trackbench.report.results import Results
from trackbench.report.table import rounded
from trackbench.report.verdicts.cpu_times import SCATTER
from trackbench.report.verdicts.rules import NEAR

Credibility: TypeAlias = Literal["calibrated", "overconfident", "underconfident"]
_SECONDS = ((1.0, "s"), (1e3, "ms"), (1e6, "µs"))


class Time(NamedTuple):
    """CPU seconds of a run."""

    value: float
    candidate: Candidate
    looped: str
    """a word of those that are looped over in Python, whose time is not the method's"""

    @property
    def name(self) -> str:
        """Return the filter's."""
        return f"{self.candidate.name}{self.looped}"

    def __str__(self) -> str:
        scale, unit = next(((s, u) for s, u in _SECONDS if self.value * s >= 1.0), _SECONDS[-1])
        return f"{two_digits(self.value * scale)} {unit}"

    def above(self, other: "Time") -> bool:
        """Return whether it is longer beyond what times scatter."""
        return self.value > SCATTER * other.value


def cost(results: Results, standing: Ranking) -> str:
    """Return the CPU time of the best filter, or the cheapest of several, beside that of the others."""
    as_good = _times(results, standing.among_the_best)
    if not as_good:
        return ""
    cheapest, most = as_good[0], as_good[-1]
    # One best filter; several of which one is clearly cheapest; or several, as a range.
    if len(as_good) == 1:
        text = f"A run of {cheapest.name} takes {cheapest} of CPU time"
    elif all(time.above(cheapest) for time in as_good[1:]):
        text = f"The cheapest of these is {cheapest.name}: {cheapest} of CPU time a run, against"
        text += f" {most} of {most.name}"
    else:
        return f"A run takes {cheapest} ({cheapest.name}) to {most} ({most.name}) of CPU time."
    return f"{text}{_beside_worse(results, cheapest, standing)}."


def _beside_worse(results: Results, cheapest: Time, standing: Ranking) -> str:
    """Return whether one that is worse is faster; nothing where that is inconclusive."""
    worse = _times(results, [c for c, _ in standing.worse])
    faster = [time for time in worse if cheapest.above(time)]
    if faster:
        ratio = two_digits(cheapest.value / faster[0].value)
        return f"; the fastest of the others, {faster[0].name}, is {ratio} times as fast"
    if worse and all(time.above(cheapest) for time in worse):
        return ", less than any that is worse"
    return ""


def calibration(results: Results, standing: Ranking) -> str:
    """Return which best filters are calibrated, overconfident or underconfident, with numbers."""
    words: dict[Credibility, list[str]] = {}
    for candidate in standing.among_the_best:
        found = consistency(results, candidate)
        if found is not None:
            words.setdefault(found[0], []).append(f"{candidate.name} ({found[1]})")
    parts = [f"{listed(names)} {verb(names)} {_said(word)}" for word, names in words.items()]
    return f"{'; '.join(parts)}." if parts else ""


def over_points(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Return the cost and calibration of one filter at several points of the grid."""
    times, lines = _times(results, candidates), []
    if times:
        ends = dict.fromkeys(f"{two_digits(t.value * 1e3)}" for t in (times[0], times[-1]))
        name = f"{named(times[0].candidate.label)}{times[0].looped}"
        lines = [f"A run of {name} takes {' to '.join(ends)} ms of CPU time."]
    # Count the points at which the filter is calibrated, overconfident or underconfident.
    words: dict[Credibility, int] = {}
    for candidate in candidates:
        found = consistency(results, candidate)
        if found is not None:
            words[found[0]] = words.get(found[0], 0) + 1
    parts = [f"{_said(word)} at {n} of {len(candidates)}" for word, n in words.items()]
    return [*lines, f"{named(candidates[0].label)} is {', '.join(parts)}."] if parts else lines


def _said(word: Credibility) -> str:
    return f"calibrated within {100 * NEAR:g} %" if word == "calibrated" else word


def consistency(results: Results, candidate: Candidate) -> tuple[Credibility, str] | None:
    """Return in a word whether the NEES is consistent, with the number; None if undecided."""
    runs = results.runs(candidate.point)
    name = next((n for n in ("nees", "anis") if (candidate.label, n) in runs), None)
    if name is None:
        return None
    # NEES over the number of components, or ANIS: 1 if consistent.
    n = results.facts(candidate.point).sizes[""] if name == "nees" else 1
    values = runs[candidate.label, name]
    values = values[~np.isnan(values)] / n
    word = name.upper() if name == "anis" else "ANEES"
    found = mean(values)
    if found.value == inf:
        return "overconfident", f"{word} infinite"
    # Judge by the 95 % interval of the mean over the runs.
    low, high = interval("mean", values)
    return _judged(low, high, f"{word} {rounded(*Estimate(*found), 3)}")


def _judged(low: float, high: float, number: str) -> tuple[Credibility, str] | None:
    if not isfinite(low + high):
        return None
    if low >= 1.0 - NEAR and high <= 1.0 + NEAR:
        return "calibrated", number
    if low > 1.0:
        return "overconfident", number
    return ("underconfident", number) if high < 1.0 else None


def _times(results: Results, candidates: Sequence[Candidate]) -> list[Time]:
    """Return the shortest first; those of the same length in the order of their filters."""
    found = []
    for candidate in candidates:
        looped = " (looped over in Python)" if candidate.label in results.loops_over_runs else ""
        rows = results.columns("timing", candidate.point).where(filter=candidate.label)
        for row in islice(rows.records(), 1):
            found.append(Time(float(row["cpu_s_per_run"]), candidate, looped))
    return sorted(found, key=attrgetter("value"))


HOW_DECIDED = (
    "Filters differ significantly if their mean difference per run on common runs does, at 5 % with "
    "Holm's correction over all pairs. One that loses significantly more runs than another is unranked."
)


def answer(results: Results) -> list[str]:
    """Return sentences on the filters of a results folder, a line each; none if nothing is decided."""
    found = rankings(results)
    # One ranking: sentences on its best filter. Several: at how many points each is best.
    if len(found) == 1:
        lines = [
            _best_sentence(found[0]),
            _other_metrics(results, found[0]),
            _losing(found),
            _failed(results),
        ]
        lines += [
            *plugin_ranks(results),
            cost(results, found[0]),
            calibration(results, found[0]),
        ]
    else:
        lines = [
            _over_points(found),
            _losing(found),
            _failed(results),
            *plugin_ranks(results),
            *_leader_sentence(results, found),
        ]
    if found and max(standing.runs for standing in found) == 1:
        lines.append("One run has no standard error: which filter is best is inconclusive.")
    return [line for line in lines if line]


def _best_sentence(standing: Ranking) -> str:
    best, words = standing.best, metric_words(standing.metric)
    if best is None:
        return ""
    if not standing.ties and not standing.worse:
        return f"The mean {words} per run of {best.name} is {_value(standing)}."
    text = f"{best.name} has the {_extreme(standing)} mean {words} per run, {_value(standing)}"
    if standing.chosen:
        text = f"With each filter at the best of the grid's values, {text}"
    if standing.ties:
        names = [c.name for c, _ in standing.ties]
        text += (
            f"; {listed(names)} {_show(names)} no significant difference ({_tie_margin(standing)})"
        )
    return f"{text}; {_worse_clause(standing)}." if standing.worse else f"{text}."


def _show(names: Sequence[str]) -> str:
    return "shows" if len(names) == 1 else "show"


def _extreme(standing: Ranking) -> str:
    return "largest" if standing.more_is_better else "smallest"


def _value(standing: Ranking) -> str:
    """Return ``43.3 ± 0.2 m over 400 runs``, and how far it is above the reference."""
    best, reference = standing.best, standing.reference
    assert best is not None
    left = int(np.isfinite(best.values).sum())
    kept = "" if left == len(best.values) else " that it keeps"
    text = f"{with_unit(rounded(*best.mean, 4), standing.metric)} over {left} runs{kept}"
    if reference is None or standing.metric.family[0].is_score:
        return text
    # The reference is named only if the best is significantly above it on common runs.
    own, least = best.common_runs(reference)
    if not interval("mean", without_rounding(own, least))[0] > 0.0:
        return text
    above = percent(mean(own).value / mean(least).value - 1.0)
    return f"{text}, {above} above the reference {reference.name}"


def _tie_margin(standing: Ranking) -> str:
    """Return how much worse the filters without a significant difference may be: upper 95 % limit."""
    assert standing.best is not None
    # Differences per run, positive where the other filter is worse.
    sign = -1.0 if standing.more_is_better else 1.0
    apart = [
        sign * without_rounding(*other.common_runs(standing.best)) for other, _ in standing.ties
    ]
    apart = [differences for differences in apart if np.any(differences)]
    if not apart:
        return "equal in every run"
    # The largest upper limit of the mean differences.
    most = max(interval("mean", differences)[1] for differences in apart)
    if standing.metric.family[0].is_score:
        return f"at most {most:.2g} nats smaller, 95 %"
    return f"at most {percent(most / standing.best.mean.value)} larger, 95 %"


def _worse_clause(standing: Ranking) -> str:
    """Return how much worse the other filters are, the nearest first."""
    assert standing.nearest is not None
    nearest, pair = standing.nearest
    apart = "smaller" if standing.more_is_better else "larger"
    by = f"by {_difference(standing, pair)}"
    n = len(standing.worse)
    if n == 1:
        return f"that of {nearest.name} is {apart} {by}"
    other = "remaining" if standing.ties else "other"
    return f"those of the {other} {n} are {apart}, the nearest ({nearest.name}) {by}"


def _difference(standing: Ranking, pair: Pair) -> str:
    """Return ``0.97 ± 0.08 m (2.2 %)``; of scores no share."""
    text = with_unit(rounded(abs(pair.difference), pair.stderr, 3), standing.metric)
    if standing.best is None or standing.metric.family[0].is_score:
        return text
    return f"{text} ({percent(abs(pair.difference) / standing.best.mean.value)})"


def _other_metrics(results: Results, standing: Ranking) -> str:
    """Return the other metrics by which another filter is better than the best."""
    better: dict[str, list[str]] = {}
    for metric in ranking_metrics(results)[1:] if standing.best is not None else []:
        for other in rankings(results, metric):
            # Another filter leads by this metric, and the best by the first metric is worse.
            worse = [c.name for c, _ in other.worse]
            if other.best and standing.best and standing.best.name in worse:
                better.setdefault(other.best.name, []).append(metric_words(other.metric))
    parts = [f"by {listed(words)} {name} is" for name, words in better.items()]
    return f"But {', '.join(parts[:2])} better." if parts else ""


def _over_points(found: Sequence[Ranking]) -> str:
    """Return at how many points each filter is among the best."""
    counts = Counter(c.label for standing in found for c in standing.among_the_best)
    # Filters by the number of points at which they are among the best.
    by_count: dict[int, list[str]] = {}
    for label, n in counts.most_common():
        by_count.setdefault(n, []).append(named(label))
    if not by_count:
        return ""
    paths = " and ".join(phrases.axis(path) for path in found[0].scene)
    (most, leaders), *rest = by_count.items()
    of = f"{most} of the {len(found)}" if most < len(found) else f"all {most}"
    text = f"By mean {metric_words(found[0].metric)} per run {listed(leaders)} {verb(leaders)} best, or"
    text += f" without a significant difference from the best, at {of} values of {paths}"
    return "; ".join([text, *(f"{listed(labels)} at {n}" for n, labels in rest)]) + "."


def _leader_sentence(results: Results, found: Sequence[Ranking]) -> list[str]:
    """Return cost and calibration of the filter that is best at most points, if any."""
    leaders: dict[str, list[Candidate]] = {}
    for candidate in (c for standing in found for c in standing.among_the_best):
        leaders.setdefault(candidate.label, []).append(candidate)
    # A single filter must lead: two with as many points have no leader.
    ranked = sorted(leaders.values(), key=len, reverse=True)
    if not ranked or (ranked[1:] and len(ranked[1]) == len(ranked[0])):
        return []
    return over_points(results, ranked[0])


def _losing(found: Sequence[Ranking]) -> str:
    """Return the filters that lose more runs than another, at the point where each loses most."""
    most: dict[str, Candidate] = {}
    # Each filter at the point where it loses most runs.
    for candidate in sorted((c for s in found for c in s.losing), key=lambda c: -c.losses):
        most.setdefault(candidate.label, candidate)
    if not most:
        return ""
    shown = list(most.values())
    if all(c.losses == len(c.lost) for c in shown):
        names = [c.name for c in shown]
        return f"{listed(names)} {verb(names, 'loses', 'lose')} every run."
    losses = [f"{c.name} {in_words(c.losses, len(c.lost), '')}" for c in shown]
    return f"Not ranked, for more lost runs than others have: {listed(losses)}."


def _failed(results: Results) -> str:
    failed = [named(label) for label in dict.fromkeys(row["filter"] for row in results.failed)]
    return f"{listed(failed)} failed and cannot be compared." if failed else ""
