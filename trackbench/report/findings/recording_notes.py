"""Notes below the ranking of one recorded run: ANIS outside its band, closed gates, costly steps.

Those on single sensors are in `sensor_notes`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.report.findings.phrases import listed, rounded
from trackbench.report.findings.ranking import Candidate, Ranking
from trackbench.report.findings.sensor_notes import sensor_notes
from trackbench.report.tables_and_figures import Results
from trackbench.results.read_csv import Columns
from trackbench.statistics.consistency_bands import nis_band

_FEWEST_STEPS = 50
"""Steps with a score, or measurements that a gate refused, from which on a note may be written."""
_REJECTS_MOST = 0.5
"""Share of the measurements from which on a gate rejects most of them."""
_OUTLYING = 12.0
"""Distance of a step's log score below the median, in usual distances, that is outlying."""
_FEW = 0.05
"""Largest share of the steps that are few."""
_COSTLY_NATS = 0.2
"""Cost of a few steps, in nats of the mean log score, from which on it is noted."""


def recording_notes(results: Results, ranking: Ranking) -> list[str]:
    """Write the notes on one recorded run; none for several runs, or simulated ones."""
    candidates = [*ranking.order, *ranking.losing]
    # Only a recorded run has ``judged``, the first and last step that count.
    if ranking.runs != 1 or any(results.facts(c.point).judged is None for c in candidates):
        return []
    notes = _anis_notes(results, candidates)
    of_sensors = sensor_notes(results, candidates, ranking.metric.definition.is_score)
    notes += of_sensors.notes
    notes += _gate_notes(results, [c for c in candidates if c not in of_sensors.explained])
    if ranking.metric.definition.is_score:
        notes += _costly_steps_notes(results, ranking.order)
    return notes


def _anis_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Name the filters whose ANIS is outside the 95 % band of a consistent filter, without a truth.

    With a truth the ranking judges the NEES instead. The results are those of one recorded run.
    """
    # Texts of the filters by the side of the band on which their ANIS lies, and by the band.
    groups: dict[tuple[str, str], list[str]] = {}
    for candidate in candidates:
        runs = results.runs(candidate.point)
        label = candidate.label
        if (label, "nees") in runs or (label, "anis") not in runs:
            continue
        # The values of the only run: its ANIS, and how many measured components it averages.
        anis = float(runs[label, "anis"][0])
        components = float(runs.get((label, "innovations"), np.zeros(1))[0])
        if not (np.isfinite(anis) and components > 0.0):
            continue
        accepted = results.facts(candidate.point).accepted_nis(label)
        low, high = nis_band(components, accepted)
        if low <= anis <= high:
            continue
        side = "above" if anis > high else "below"
        band = f"{low:.3f} to {high:.3f}"
        groups.setdefault((side, band), []).append(f"{candidate.name} {rounded(anis, 3)}")
    notes = []
    for (side, band), texts in groups.items():
        nearness = "farther from" if side == "above" else "nearer to"
        notes.append(
            f"ANIS {side} the 95 % band of a consistent filter ({band}): {listed(texts)}. Measurements "
            f"are {nearness} the predictions than the covariances say."
        )
    return notes


def _gate_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Write a note for each filter whose gate rejects all that is measured at most of the steps.

    The results are those of one recorded run.
    """
    notes = []
    for candidate in candidates:
        label = candidate.label
        # How many measurements of the only run the gate refused.
        refused_number = results.runs(candidate.point).get((label, "gated"), np.zeros(1))[0]
        if not refused_number >= _FEWEST_STEPS:
            continue
        rows = results.columns("per_step", candidate.point).where(filter=label)
        steps, gated = _series(rows.where(metric="gated"))
        # A step has a NIS if the filter used any of its measurements.
        used_steps, _ = _series(rows.where(metric="nis"))
        refused_steps = steps[(gated > 0.0) & ~np.isin(steps, used_steps)]
        measured_steps = len(refused_steps) + len(used_steps)
        if not measured_steps or len(refused_steps) <= _REJECTS_MOST * measured_steps:
            continue
        share = 100.0 * len(refused_steps) / measured_steps
        # Most of the refused steps come after the last step with a measurement that was used.
        last_used = max(used_steps.tolist(), default=-1.0)
        since = ""
        if (refused_steps > last_used).sum() > 0.5 * len(refused_steps) and len(used_steps):
            since = f", all of them after step {last_used:.0f}"
        notes.append(
            f"The gate of {candidate.name} rejected {share:.0f} % of the measurements{since}: its "
            "process noise or the sensor's sigma is too small, or it lost the target."
        )
    return notes


def _series(rows: Columns) -> tuple[Array, Array]:
    """Return steps and values (n,) of the rows of per_step.csv that have a value."""
    known = np.isfinite(rows["value"])
    return rows["step"][known], rows["value"][known]


class _Cost(NamedTuple):
    """A few steps that make most of what a filter's log score loses."""

    steps: int
    """number of these few steps"""
    measured: int
    """number of steps with a score"""
    nats: float
    """what they cost of the mean log score"""


def _costly_steps_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
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
