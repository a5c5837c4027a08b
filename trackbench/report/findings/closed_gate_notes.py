"""Notes on gates that reject most of the measurements of a recorded run."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.findings.candidates import Candidate
from trackbench.report.tables_and_figures import Results
from trackbench.results.rows_and_columns import Columns

_FEWEST_REFUSED = 50
"""Measurements that a gate refused from which on a note may be written."""
_REJECTS_MOST = 0.5
"""Share of the measurements from which on a gate rejects most of them."""


def gate_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Write a note for each filter whose gate rejects all that is measured at most of the steps.

    The results are those of one recorded run.
    """
    notes = []
    for candidate in candidates:
        label = candidate.label
        # How many measurements of the only run the gate refused; NaN if the run is lost.
        refused_number = results.runs(candidate.point).get((label, "gated"), np.zeros(1))[0]
        if not refused_number >= _FEWEST_REFUSED:  # NaN is not, either
            continue
        rows = results.columns("per_step", candidate.point).where(filter=label)
        steps, gated = _series(rows.where(metric="gated"))
        # A step has a NIS if the filter used any of its measurements.
        used_steps, _ = _series(rows.where(metric="nis"))
        refused_steps = steps[(gated > 0.0) & ~np.isin(steps, used_steps)]
        measured_steps = len(refused_steps) + len(used_steps)
        if not measured_steps or len(refused_steps) <= _REJECTS_MOST * measured_steps:
            continue
        # The note counts all measurements of a step as one.
        percent_refused = 100.0 * len(refused_steps) / measured_steps
        # The last step with a measurement that was used is named if most refused steps come after it.
        # Some measurements before it may be rejected, too.
        last_used = max(used_steps.tolist(), default=-1.0)
        since = ""
        if (refused_steps > last_used).sum() > 0.5 * len(refused_steps) and len(used_steps):
            since = f", among them all those after step {last_used:.0f}"
        notes.append(
            f"The gate of {candidate.name} rejected {percent_refused:.0f} % of the measurements{since}: "
            "its process noise or the sensor's sigma is too small, or it lost the target."
        )
    return notes


def _series(rows: Columns) -> tuple[Array, Array]:
    """Return steps and values (n,) of the rows of per_step.csv that have a value."""
    known = np.isfinite(rows["value"])
    return rows["step"][known], rows["value"][known]
