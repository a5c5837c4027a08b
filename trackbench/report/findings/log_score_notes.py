"""Notes on mean log scores of a recorded run that a few outlying steps lower."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.phrases import listed, rounded
from trackbench.report.tables_and_figures import Results

_FEWEST_STEPS = 20
"""Steps with a score from which on a note may be written: one of them is then few."""
_OUTLYING = 12.0
"""Distance of a step's log score below the median, in usual distances, that is outlying."""
_FEW = 0.05
"""Largest share of the steps that are few."""
_COSTLY_NATS = 0.2
"""Cost of a few steps, in nats of the mean log score, from which on it is noted."""
_COSTLY_SUM = 10.0
"""Cost of a few steps, in nats of the sum of log scores, from which on it is noted.

Of a consistent filter's 20 to 50 steps any lies as far below the median with a probability of 0.003 at
most, for up to 4 measured components. Of fewer steps the usual distance is hardly known.
"""
_WAY = "If they are outliers, compare with a `gate` or with `robust: {kind: student-t, df: 4}`."
_WAY_OF_HELD_OUT = (
    "If they are outliers, delete these rows, or compare with `robust: {kind: student-t, df: 4}`. A "
    "gate changes nothing: it cannot reject what is held out."
)


class _Cost(NamedTuple):
    """A few steps that make most of what a filter's log score loses."""

    steps: int
    """number of these few steps"""
    measured: int
    """number of steps with a score"""
    nats: float
    """what they cost of the mean log score"""


def costly_steps_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Write notes that name the filters whose mean log score a few outlying steps lower much.

    One note is on the log score of the measurements that filters are given, and one on that of the
    held-out measurements. The list is empty if there are no such filters.
    """
    given = _note_on_few_steps(results, candidates, "log_score")
    held_out = _note_on_few_steps(results, candidates, "held_log_score", is_held_out=True)
    return [note for note in (given, held_out) if note]


def _note_on_few_steps(
    results: Results, candidates: Sequence[Candidate], metric: str, is_held_out: bool = False
) -> str:
    """Write the note on one log score, the ``metric``; empty if a few steps lower that of no filter.

    ``is_held_out`` is True for the score of the held-out measurements.
    """
    texts = []
    has_gate = False
    # That of the lowest score of all filters.
    worst_step = 0
    lowest_score = inf
    for candidate in candidates:
        # Score of each step (T,) of the recorded run, NaN where a step has none.
        scores = results.judged_steps(candidate.point).get((candidate.label, metric))
        facts = results.facts(candidate.point)
        if scores is None or facts.judged is None or not np.isfinite(scores).any():
            continue
        cost = _cost_of_few_steps(scores[np.isfinite(scores)])
        if cost is None:
            continue
        steps = f"{cost.steps} of {counted(cost.measured, 'step')}"
        texts.append(f"{candidate.name} by {rounded(cost.nats, 2)} nats ({steps})")
        has_gate |= facts.accepted_nis(candidate.label) is not None
        index = int(np.nanargmin(scores))
        if scores[index] < lowest_score:
            lowest_score = float(scores[index])
            first_step, _ = facts.judged
            worst_step = first_step + index
    if not texts:
        return ""
    held_out = "held-out " if is_held_out else ""
    way = _WAY_OF_HELD_OUT if is_held_out else _WAY
    if has_gate and not is_held_out:
        way += " What a gate rejects counts in this score, too."
    return (
        f"A few {held_out}steps lower mean {held_out}log scores: {listed(texts)}; the worst is step "
        f"{worst_step}. {way}"
    )


def _cost_of_few_steps(scores: Array) -> _Cost | None:
    """Return by how much a few outlying steps lower the mean of log scores (T,); None if it is little.

    The cost is the sum of their distances below the median, divided by T. It is also None if the
    outlying steps are not few, or if there are too few steps in all.
    """
    if len(scores) < _FEWEST_STEPS:
        return None
    below = np.median(scores) - scores
    # The usual distance below the median is itself a median, which a few steps do not change.
    usual = float(np.median(below[below > 0.0])) if (below > 0.0).any() else 0.0
    outlying = below > _OUTLYING * usual
    number = int(outlying.sum())
    lost_nats = float(below[outlying].sum())
    nats = lost_nats / len(scores)
    if not 0 < number <= _FEW * len(scores) or nats < _COSTLY_NATS or lost_nats < _COSTLY_SUM:
        return None
    return _Cost(steps=number, measured=len(scores), nats=nats)
