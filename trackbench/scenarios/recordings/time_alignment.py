"""Measurements of all runs on one clock, which begins where the filters' first states are."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.angles import near
from trackbench.core.arrays import Array, Index, fixed
from trackbench.field_types import MOST_STEPS, DataError, InvalidKeyError, Place
from trackbench.scenarios.recordings.rows import TICK, Gathered, Numbers, Rows, usual_interval

ONE_RUN = "0"
"""Name of the run of one file without names of runs."""
_MOST_NAMES = 8
_MOST_CELLS = 200_000_000
_MOST_RECORDED = 5_000_000
"""steps of a recording that are read, of which a scenario takes those up to its `last`"""
_EQUAL = 1e-6  # of an interval: a clock that strays by less has equal steps


class Clock(NamedTuple):
    """Steps (K + 1,) from the first state's on, their times, s, and how far each run (M,) is shifted.

    ``T`` is their distance, s, or None if it differs from step to step.
    """

    steps: Index
    times: Array
    shift: Array
    T: float | None


class Opened(NamedTuple):
    """First state of each run: time (M,), scans (n, s, M), and the time between the last two."""

    time: Array
    scans: Array
    apart: Array


def initial_scans(gathered: Gathered, rows: Rows, scans: int) -> Opened:
    """Take the first scans of each run that are whole, from rows in order."""
    runs = len(gathered.runs)
    # Rows with all components; where each run begins among them, and how many it has.
    whole = np.flatnonzero(np.isfinite(rows.values).all(axis=0))
    first = np.searchsorted(rows.run[whole], np.arange(runs))
    number = np.searchsorted(rows.run[whole], np.arange(runs), side="right") - first
    for m in np.flatnonzero(number < scans).tolist():
        what = f"run {gathered.runs[m]} has {number[m]} positions, and its start takes {scans}"
        raise DataError(Place(gathered.files[0], 1, 1, what))
    # The first scans of each run; the first state is that of the last of them.
    places = np.stack([whole[first + i] for i in range(scans)])
    times = rows.time[places]
    apart = times[-1] - times[-2] if scans > 1 else np.full(runs, np.nan)
    return Opened(times[-1], rows.values[:, places], apart)


def common_clock(
    gathered: Gathered,
    sensors: Sequence[Rows],
    start: Opened | None,
    T: float,
    resample: float | None,
) -> Clock:
    """Choose the steps of all runs, their first states laid over each other where the scans give them.

    Steps are the file's own, all between the first and the last of them, T s apart; or the times at
    which any run measured; or, if they are resampled, so many seconds apart. Without scans the first
    state is one step, or an interval of the usual length, before the first row.
    """
    # Step 1: time of the first state; scans shift the runs so that their first states coincide.
    if start is None:
        shift = np.zeros(len(gathered.runs))
        begin = min(float(rows.time.min()) for rows in sensors)
        begin -= _before(gathered, sensors, resample)
    else:
        shift, begin = start.time[0] - start.time, float(start.time[0])
    last = max(float((rows.time + shift[rows.run]).max()) for rows in sensors)
    # Step 2: equal steps, the file's own or resampled ones.
    spacing = 1.0 if gathered.stepped else resample
    if spacing is not None:
        steps = np.arange(_counted(gathered, np.floor((last - begin) / spacing + 0.5) + 1.0))
        times = np.asarray(steps * (T if gathered.stepped else spacing), dtype=float)
        if gathered.stepped:
            return _checked(gathered, Clock(steps + int(begin), times, shift, T))
        return _checked(gathered, Clock(steps, times + begin, shift, spacing))
    # Step 3: otherwise a step at every time at which any run measured.
    times = _union(sensors, shift, begin)
    return _checked(gathered, Clock(np.arange(len(times)), times, shift, _distance(times)))


def _counted(gathered: Gathered, number: float) -> int:
    """Return the number of steps as an integer. Raises DataError if there are too many to allocate."""
    if number > _MOST_RECORDED:
        what = (
            f"gives {number:.9g} steps, more than {MOST_STEPS}: choose runs, or a longer `resample`"
        )
        raise DataError(Place(gathered.files[0], 1, 1, what))
    return int(number)


def _before(gathered: Gathered, sensors: Sequence[Rows], resample: float | None) -> float:
    """Return how long before the first row an initial state without scans lies."""
    if gathered.stepped:
        return 1.0
    if resample is not None:
        return resample
    return usual_interval(sensors[0].time[sensors[0].run == sensors[0].run[0]])


def _union(sensors: Sequence[Rows], shift: Array, begin: float) -> Array:
    """Join the times at which any run measured, from the first state's on."""
    parts = [np.array([begin])]
    # One time for each tick, first of every sensor and then of all.
    for rows in sensors:
        times = rows.time + shift[rows.run]
        parts.append(times[np.unique(np.rint(times / TICK), return_index=True)[1]])
    times = np.concatenate(parts)
    times = times[np.unique(np.rint(times / TICK), return_index=True)[1]]
    return times[np.rint(times / TICK) >= np.rint(begin / TICK)]


def _distance(times: Array) -> float | None:
    """Return the distance of times that are equally far from each other."""
    apart = np.diff(times)
    if not len(apart):
        return None
    # Equal if each interval is the mean one within a share of _EQUAL.
    T = float((times[-1] - times[0]) / len(apart))
    return float(f"{T:.12g}") if np.abs(apart - T).max() <= _EQUAL * T else None


def _checked(gathered: Gathered, clock: Clock) -> Clock:
    if len(clock.steps) < 2:
        raise DataError(Place(gathered.files[0], 1, 1, "leaves nothing to measure after the start"))
    _counted(gathered, len(clock.steps))
    return clock


def measurement_array(
    gathered: Gathered, sensors: Sequence[Rows], clock: Clock, resampled: bool
) -> tuple[Array, Array | None]:
    """Arrange measurements (n_z, K, M) by step and run, of several rows the nearest, and arrivals.

    Those are steps (S, K, M), from 0, at which measurements of S sensors were received, if it is known.
    """
    steps, runs = len(clock.steps), len(gathered.runs)
    sizes = [len(rows.values) for rows in sensors]
    if sum(sizes) * steps * runs > _MOST_CELLS:
        what = f"{runs} runs of {steps} steps are too many: choose runs, or `resample`"
        raise InvalidKeyError(what, "target", "runs")
    out = np.full((sum(sizes), steps - 1, runs), np.nan)
    arrivals, due = None, np.arange(steps - 1.0)[:, None]
    if gathered.has_delays:
        arrivals = np.broadcast_to(due, (len(sizes), steps - 1, runs)).copy()
    moved, crowded, above = 0.0, 0, 0
    for n, (rows, size) in enumerate(zip(sensors, sizes, strict=True)):
        # Place the rows among the steps; only those after the first state are measurements.
        place, away = _placed(gathered, rows, clock)
        later = np.flatnonzero(place > 0)
        if resampled:
            # Of several rows of a step the nearest in time counts.
            nearest = _nearest(rows.run, place, away, later)
            crowded += len(later) - len(nearest)
            moved, later = max(moved, float(away[nearest].max(initial=0.0))), nearest
        # Rows of `out` from `above` on belong to this sensor.
        for c in range(size):
            out[above + c, place[later] - 1, rows.run[later]] = rows.values[c, later]
        above += size
        if arrivals is not None:
            received = np.maximum(_received(gathered, rows, clock), place) - 1
            arrivals[n, place[later] - 1, rows.run[later]] = received[later]
    if resampled:
        what = f"resampled: measurements are taken to be up to {moved:.3g} s from when they were"
        what += f", {crowded} of one step were left out" if crowded else ""
        gathered.notices.append(what)
    if arrivals is not None:
        late, longest = int((arrivals > due).sum()), int((arrivals - due).max())
        what = f"{late} measurements were received late, by {longest} steps at most"
        gathered.notices.append(what)
    return fixed(out), arrivals


def _received(gathered: Gathered, rows: Rows, clock: Clock) -> Index:
    """Find the place (R,) among the steps of the first one at which each row has been received."""
    times = rows.received + clock.shift[rows.run]
    if gathered.stepped:
        return np.rint(times).astype(np.intp) - int(clock.steps[0])
    return np.searchsorted(clock.times, times - TICK, side="left")


def _placed(gathered: Gathered, rows: Rows, clock: Clock) -> tuple[Index, Array]:
    """Find the place (R,) of each row among the steps, and how far from its time it is, s."""
    times = rows.time + clock.shift[rows.run]
    if gathered.stepped:
        return np.rint(times).astype(np.intp) - int(clock.steps[0]), np.zeros_like(times)
    # The nearest step: as many middles between steps lie before the time.
    middles = 0.5 * (clock.times[1:] + clock.times[:-1])
    place = np.searchsorted(middles, times, side="right")
    # Rows before the first state have no step.
    place[times < clock.times[0] - TICK] = -1
    return place, np.abs(clock.times[np.maximum(place, 0)] - times)


def _nearest(run: Numbers, place: Index, away: Array, among: Index) -> Index:
    """Select the row nearest to the step's time, among rows of a run in the same step."""
    # Sort by run, step and distance; take the first of each run and step.
    order = among[np.lexsort((away[among], place[among], run[among]))]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(place[order]) != 0) | (np.diff(run[order]) != 0)
    return order[first]


def with_scans(clock: Clock, gathered: Gathered, scans: int, apart: Array) -> Clock:
    """Put the steps that the scans take before the first state's."""
    used = max(0, scans - 1)
    before = np.arange(-used, 0)
    if not used:
        return clock
    if gathered.stepped:
        assert clock.T is not None
        steps = np.concatenate([clock.steps[0] + before, clock.steps])
        return clock._replace(steps=steps, times=(steps - steps[0]) * clock.T)
    # Scans before the first state are as far apart as those of the first run.
    times = np.concatenate([clock.times[0] + before * apart[0], clock.times])
    return clock._replace(steps=np.arange(len(times)), times=times)


def check_runs_of_truth(of_truth: Gathered, rows: Rows, measured: Gathered) -> None:
    """Raise DataError if runs lack a truth because their names are spelled otherwise there.

    A truth without names of runs is that of every run, which then have one origin.
    """
    path = of_truth.files[0]
    if of_truth.runs == [ONE_RUN]:
        if measured.own_origins:
            name = next(iter(measured.own_origins))
            what = f"names no runs, and run {name} has an origin of its own, far from the others"
            way = "give the truth a column `run`, or choose runs near each other by `runs`"
            raise DataError(Place(path, 1, 1, f"{what}: {way}"))
        return
    known = {of_truth.runs[number] for number in np.unique(rows.run).tolist()}
    without = [name for name in measured.runs if name not in known]
    if not without:
        return
    # Names that differ by zeros before them, spaces or capital letters may well be the same run's.
    others = {_spelled_alike(name): name for name in of_truth.runs if name not in measured.runs}
    alike = [
        (name, others[_spelled_alike(name)]) for name in without if _spelled_alike(name) in others
    ]
    shown = ", ".join(without[:_MOST_NAMES]) + ", ..." * (len(without) > _MOST_NAMES)
    there = ", ".join(of_truth.runs[:_MOST_NAMES]) + ", ..." * (len(of_truth.runs) > _MOST_NAMES)
    if len(without) == len(measured.runs):
        what = f"has no run {shown}; there are {there}: give runs one name in both files"
        raise DataError(Place(path, 1, 1, what))
    if alike:
        name, other = alike[0]
        what = f"has no run {name!r}, but {other!r} ({len(without)} runs have no truth: {shown})"
        way = "write the name alike in both files, or leave the run out by `runs`"
        raise DataError(Place(path, 1, 1, f"{what}: {way}"))


def _spelled_alike(name: str) -> str:
    """Return a run's name without zeros before numbers, signs, spaces and capital letters."""
    words = re.findall(r"[^\W\d_]+|[0-9]+", name.casefold())
    return " ".join(word.lstrip("0") or "0" if word.isdigit() else word for word in words)


def truth_at(
    gathered: Gathered,
    rows: Rows,
    clock: Clock,
    runs: list[str],
    gap: float | None,
    angles: Sequence[int] = (),
) -> Array:
    """Interpolate states (n, K + 1, M) at the steps; a truth without runs is that of every run.

    Between two rows that are at most ``gap`` apart (s, or steps) a state lies on the straight line, and
    the rows ``angles`` turn the shorter way; NaN elsewhere. Raises DataError if there is none at all.
    """
    out = np.full((len(rows.values), len(clock.steps), len(runs)), np.nan)
    steps = clock.steps.astype(float) if gathered.stepped else clock.times
    number = {name: i for i, name in enumerate(gathered.runs)}
    shared = gathered.runs == [ONE_RUN]
    for m, name in enumerate(runs):
        i = 0 if shared else number.get(name)
        if i is not None:
            # The run's rows, shifted in time as its measurements are.
            of_run = slice(*np.searchsorted(rows.run, [i, i + 1]))
            at, values = rows.time[of_run] + clock.shift[m], rows.values[:, of_run]
            out[:, :, m] = _between(at, values, steps, gap, angles)
    has_truth = np.isfinite(out).any(axis=(0, 1))
    if not has_truth.any():
        hint = "" if gap is not None else ": name a `truth_gap` within which it is interpolated"
        raise DataError(Place(gathered.files[0], 1, 1, f"has no truth at any step{hint}"))
    without = [name for name, has in zip(runs, has_truth, strict=True) if not has]
    if without:
        shown = ", ".join(without[:_MOST_NAMES]) + ", ..." * (len(without) > _MOST_NAMES)
        some = f"{len(without)} of {len(runs)} runs have none at any step ({shown})"
        gathered.notices.append(f"{some}: errors are those of the others")
    return fixed(out)


def _between(
    at: Array, values: Array, times: Array, gap: float | None, angles: Sequence[int]
) -> Array:
    """Interpolate values (n, K) at ``times`` of a curve through (n, R) at ``at``, in order."""
    after = np.clip(np.searchsorted(at, times), 1, max(len(at) - 1, 1))
    out = np.full((len(values), len(times)), np.nan)
    if len(at) > 1 and gap is not None:
        # Interpolate between rows that are near enough: v = v_0 + s (v_1 - v_0).
        wide = at[after] - at[after - 1]
        share = (times - at[after - 1]) / np.where(wide > 0.0, wide, 1.0)
        inside = (wide <= gap + TICK) & (share >= 0.0) & (share <= 1.0)
        ahead = near(values[:, after], values[:, after - 1], angles)
        line = values[:, after - 1] + share * (ahead - values[:, after - 1])
        out[:, inside] = line[:, inside]
    # At a row's own time its values count.
    for row in (np.minimum(after, len(at) - 1), after - 1):
        same = np.abs(at[row] - times) < TICK
        out[:, same] = values[:, row[same]]
    return out
