"""Sentences on what the best filters cost, and whether their covariances are calibrated."""

from collections.abc import Sequence
from itertools import islice
from math import inf
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from trackbench.report.findings.phrases import listed, named, two_digits, verb
from trackbench.report.findings.ranking import Candidate, Ranking
from trackbench.report.results import Results
from trackbench.report.table import rounded
from trackbench.report.verdicts.cpu_times import SCATTER
from trackbench.statistics import rules
from trackbench.statistics.estimates import collapsed_in_words
from trackbench.statistics.over_runs import interval, mean

_SECONDS = ((1.0, "s"), (1e3, "ms"), (1e6, "µs"))


class Time(NamedTuple):
    """CPU seconds of a run."""

    value: float
    candidate: Candidate
    looped: str
    """a word of those that are filtered run by run, whose time is not the method's"""

    @property
    def name(self) -> str:
        """Return the filter's."""
        return f"{self.candidate.name}{self.looped}"

    def __str__(self) -> str:
        scale, unit = next(((s, u) for s, u in _SECONDS if self.value * s >= 1.0), _SECONDS[-1])
        return f"{two_digits(self.value * scale)} {unit}"

    def above(self, other: "Time") -> bool:
        """Return whether this time is longer than the other beyond the scatter of CPU times."""
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
    worse = _times(results, [rival.filter for rival in standing.worse])
    faster = [time for time in worse if cheapest.above(time)]
    if faster:
        ratio = two_digits(cheapest.value / faster[0].value)
        return f"; the fastest of the others, {faster[0].name}, is {ratio} times as fast"
    if worse and all(time.above(cheapest) for time in worse):
        return ", less than any that is worse"
    return ""


def calibration(results: Results, standing: Ranking) -> str:
    """Return which best filters are calibrated, overconfident or underconfident, with numbers."""
    words: dict[str, list[str]] = {}
    for candidate in standing.among_the_best:
        anees = consistency(results, candidate)
        if anees is not None:
            words.setdefault(anees[0], []).append(f"{candidate.name} ({anees[1]})")
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
    words: dict[str, int] = {}
    for candidate in candidates:
        anees = consistency(results, candidate)
        if anees is not None:
            words[anees[0]] = words.get(anees[0], 0) + 1
    parts = [f"{_said(word)} at {n} of {len(candidates)}" for word, n in words.items()]
    return [*lines, f"{named(candidates[0].label)} is {', '.join(parts)}."] if parts else lines


def _said(word: str) -> str:
    return f"calibrated within {100 * rules.NEAR:g} %" if word == "calibrated" else word


def consistency(results: Results, candidate: Candidate) -> tuple[str, str] | None:
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
    if words := collapsed_in_words(values):
        return "overconfident", words
    anees = mean(values)
    if anees.value == inf:
        return "overconfident", f"{word} infinite"
    # Judge by the 95 % interval of the mean over the runs.
    low, high = interval("mean", values)
    judged = rules.credibility(low, high)
    return (judged, f"{word} {rounded(*anees, 3)}") if judged else None


def _times(results: Results, candidates: Sequence[Candidate]) -> list[Time]:
    """Return the shortest first; those of the same length in the order of their filters."""
    times = []
    for candidate in candidates:
        looped = " (run by run)" if candidate.label in results.loops_over_runs else ""
        rows = results.columns("timing", candidate.point).where(filter=candidate.label)
        for row in islice(rows.records(), 1):
            times.append(Time(float(row["cpu_s_per_run"]), candidate, looped))
    return sorted(times, key=attrgetter("value"))
