"""The truth at the times of the measurements, from rows at times of their own."""

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.keys import DataError, Place
from trackbench.scenarios.recordings.recording import Clock
from trackbench.scenarios.recordings.rows import TICK, Gathered, Rows


def truth_at(
    found: Gathered, rows: Rows, clock: Clock, runs: list[str], gap: float | None
) -> Array:
    """States (n, K + 1, M) at the steps; a truth without runs of its own is that of every run.

    Between two rows that are at most ``gap`` apart (s, or steps) a state lies on the straight line; NaN
    elsewhere. Raises DataError if there is none at any step.
    """
    out = np.full((len(rows.values), len(clock.steps), len(runs)), np.nan)
    steps = clock.steps.astype(float) if found.stepped else clock.times
    number = {name: i for i, name in enumerate(found.runs)}
    shared = found.runs == ["0"]
    for m, name in enumerate(runs):
        i = 0 if shared else number.get(name)
        if i is not None:
            own = slice(*np.searchsorted(rows.run, [i, i + 1]))
            at, values = rows.time[own] + clock.shift[m], rows.values[:, own]
            out[:, :, m] = _between(at, values, steps, gap)
    if not np.isfinite(out).any():
        hint = "" if gap is not None else ": name a `truth_gap` within which it is interpolated"
        raise DataError(Place(found.files[0], 1, 1, f"has no truth at any step{hint}"))
    return fixed(out)


def _between(at: Array, values: Array, times: Array, gap: float | None) -> Array:
    """Values (n, K) at ``times`` of a curve through (n, R) at ``at``, in order."""
    after = np.clip(np.searchsorted(at, times), 1, max(len(at) - 1, 1))
    out = np.full((len(values), len(times)), np.nan)
    if len(at) > 1 and gap is not None:
        wide = at[after] - at[after - 1]
        share = (times - at[after - 1]) / np.where(wide > 0.0, wide, 1.0)
        inside = (wide <= gap + TICK) & (share >= 0.0) & (share <= 1.0)
        line = values[:, after - 1] + share * (values[:, after] - values[:, after - 1])
        out[:, inside] = line[:, inside]
    for near in (np.minimum(after, len(at) - 1), after - 1):
        same = np.abs(at[near] - times) < TICK
        out[:, same] = values[:, near[same]]
    return out
