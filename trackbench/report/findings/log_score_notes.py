"""Notes on mean log scores of a recorded run that a few outlying steps lower."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.phrases import listed, rounded
from trackbench.report.tables_and_figures import Results

_FEWEST_STEPS = 50
"""Steps with a score from which on a note may be written."""
_OUTLYING = 12.0
"""Distance of a step's log score below the median, in usual distances, that is outlying."""
_FEW = 0.05
"""Largest share of the steps that are few."""
_COSTLY_NATS = 0.2
"""Cost of a few steps, in nats of the mean log score, from which on it is noted."""


class _Cost(NamedTuple):
    """A few steps that make most of what a filter's log score loses."""

    steps: int
    """number of these few steps"""
    measured: int
    """number of steps with a score"""
    nats: float
    """what they cost of the mean log score"""


def costly_steps_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Write a note that names the filters whose mean log score a few outlying steps lower much.

    The list is empty if there are no such filters.
    """
    texts = []
    has_gate = False
    for candidate in candidates:
        # Log score of each step (T,) of the recorded run, NaN where a step has none.
        scores = results.judged_steps(candidate.point).get((candidate.label, "log_score"))
        cost = None if scores is None else _cost_of_few_steps(scores[np.isfinite(scores)])
        if cost is not None:
            steps = f"{cost.steps} of {counted(cost.measured, 'step')}"
            texts.append(f"{candidate.name} by {rounded(cost.nats, 2)} nats ({steps})")
            has_gate |= results.facts(candidate.point).accepted_nis(candidate.label) is not None
    if not texts:
        return []
    way = "If they are outliers, compare with a `gate` or with `robust: {kind: student-t, df: 4}`."
    if has_gate:
        way += " What a gate rejects counts in this score, too."
    return [f"A few steps lower mean log scores: {listed(texts)}. {way}"]


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
    nats = float(below[outlying].sum()) / len(scores)
    if not 0 < number <= _FEW * len(scores) or nats < _COSTLY_NATS:
        return None
    return _Cost(steps=number, measured=len(scores), nats=nats)
