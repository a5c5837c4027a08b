"""Delays of a sensor's measurements behind the truth, or ahead of it, and the notes on them."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.errors import joined
from trackbench.models.sensors.steps_at_once import is_equal_at_every_step
from trackbench.scenarios.recordings.truth_check_distances import (
    MOST_STEPS,
    Sample,
    median_distance,
    normalized_distances,
    normalized_errors,
)

MOST_STEPS_OF_DELAY = 5_000
"""Most steps of a sensor's sample from which a delay that was found is estimated."""
_LONGEST_DELAY = 2.0
_LONGEST_DELAY_STEPS = 10
"""Longest delay that is tried first, in s, and in usual steps if they are longer."""
_LONGEST_SET_DELAYS = (120.0, 900.0)
_LONGEST_SET_DELAYS_STEPS = (50, 250)
"""Longest delays that are tried next, as of a clock that was set by hand, in s and in usual steps."""
_ZONE_STEP = 1800.0
_ZONES = 28
"""Offsets of time zones, s, and their number on either side: they are tried last."""
_DELAYS = 20
"""Number of delays that are tried on either side, and between the best one's neighbors."""
_ZOOMS = 2
"""Number of searches between the best delay's neighbors, each of a step 10 times smaller."""
_FEWEST_OF_DELAY = 30
"""Measurements from which on a delay is looked for."""
_LEAST_SHARE_OF_DELAY = 0.2
"""Share of the measurements that must have a truth after a long delay, too."""
_EXPLAINED_BY_DELAY = 0.6
"""Share of the median distances that remains at most if a delay explains them."""
_MOST_REMAINING_OF_DELAY = 1.35
"""Median distance, in standard deviations, that remains at most after a long delay.

It is twice that of a normal law: sigmas may be half as large as they should.
"""
_LEAST_MISFIT = 0.9
"""Median distance, in standard deviations, from which on long delays are tried.

That of a normal law is 0.67: sigmas are right then, and there is nothing to explain.
"""
_MOST_RUNS = 5
_FEW_STEPS = 50
"""Most runs, and most steps of a sensor that takes one step at a time, in the search of a delay."""
_INTERVALS_OF_SLOPE = 5.0
"""Usual intervals on either side, at most, over which speeds are averaged."""
_ITERATIONS = 10
_OUTLYING = 4.0
"""Iterations of the estimate of a delay, and standard deviations from which on an error is left out."""
_MEDIAN_OF_NORMAL = 0.6745
"""Median distance of a normal law from its mean, in standard deviations."""


class StepClock(NamedTuple):
    """Numbers and times (K,) of the steps of a recording, s, or steps if it is ``counts_steps``."""

    steps: Index
    times: Array
    counts_steps: bool = False


class DelayNote(NamedTuple):
    """Note on a delay of the sensors called ``names``."""

    text: str
    names: Sequence[str]
    remaining: float
    """median distance after the delay, in standard deviations: the largest of all sensors"""


def delay_notes(
    samples: Sequence[Sample],
    truth: Array,
    clock: StepClock,
    components: Sequence[str],
    angles: Sequence[str],
    in_one_file: bool,
) -> list[DelayNote]:
    """Return notes on the sensors whose measurements agree much better with an earlier or a later truth.

    ``samples`` are those of the sensors, also of steps without a truth. ``truth`` (n_x, K, M) is that of
    all K steps of ``clock``. ``components`` are those of the truth, and ``angles`` those that are
    angles. If the sensors are ``in_one_file``, they have one clock, and so are tried together.
    """
    if not samples or len(clock.times) < 2:
        return []
    runs = np.flatnonzero(np.isfinite(truth).any(axis=(0, 1)))[:_MOST_RUNS]
    truth = truth[..., runs]
    angle_rows = [row for row, name in enumerate(components) if name in angles]
    groups = [samples]
    if not in_one_file:
        groups = [[sample] for sample in samples]
    notes = []
    for group in groups:
        # Short delays are searched where the truth is known without one.
        with_truth = []
        for sample in group:
            has_truth = np.isfinite(truth[:, sample.indices]).any(axis=(0, 2))
            with_truth.append(_at_steps(sample, np.flatnonzero(has_truth)))
        few = _Delayable(
            [_thinned(sample, runs, MOST_STEPS) for sample in with_truth], truth, clock, angle_rows
        )
        all_times = few._replace(samples=[_thinned(sample, runs, MOST_STEPS) for sample in group])
        delay = _search_delay(few, all_times)
        if delay is None:
            continue
        many = few._replace(
            samples=[_thinned(sample, runs, MOST_STEPS_OF_DELAY) for sample in group]
        )
        delay = _estimate_delay(many, delay)
        whose = joined([sample.name for sample in group])
        direction = "behind" if delay > 0.0 else "ahead of"
        # A long delay has three digits, as that of a time zone: 12600 s.
        digits = 3 if abs(delay) >= 100.0 else 2
        number = f"{float(f'{abs(delay):.{digits}g}'):g}"
        unit = " steps" if clock.counts_steps else " s"
        text = (
            f"the measurements of {whose} seem to be some {number}{unit} {direction} "
            f"{group[0].reference}"
        )
        remaining = 0.0
        for sample in many.samples:
            delayed = _truth_before(truth, clock.times, sample.indices, delay, angle_rows)
            distances = normalized_distances(sample._replace(truth=delayed))
            remaining = max(remaining, median_distance(distances))
        notes.append(DelayNote(text, [sample.name for sample in group], remaining))
    return notes


class _Delayable(NamedTuple):
    """Measurements of sensors that have one clock, and the truth (n_x, K, M) at all K steps."""

    samples: Sequence[Sample]
    truth: Array
    clock: StepClock
    angle_rows: Sequence[int]
    """components of the truth that are angles"""

    def errors(self, delay: float) -> dict[str, Array]:
        """Return the errors of each component in standard deviations, if measurements have this delay.

        They are NaN where the truth is unknown. All sensors with this component follow each other.
        """
        by_component: dict[str, list[Array]] = {}
        for sample in self.samples:
            earlier = _truth_before(
                self.truth, self.clock.times, sample.indices, delay, self.angle_rows
            )
            errors = normalized_errors(sample._replace(truth=earlier))
            for name, row in zip(sample.sensor.components, errors, strict=True):
                by_component.setdefault(name, []).append(row)
        return {name: np.concatenate(rows) for name, rows in by_component.items()}


class _Misfits(NamedTuple):
    """Mean logs of the components' median distances from the truth."""

    with_delay: float
    without_delay: float
    """that of the same measurements"""
    share: float
    """least share of a component's measurements that have a truth with the delay"""


_NO_MISFITS = _Misfits(with_delay=np.inf, without_delay=np.inf, share=0.0)


def _search_delay(measured: _Delayable, at_all_times: _Delayable) -> float | None:
    """Return the delay of measurements behind the truth, s or steps, that explains their distances.

    Short delays are tried first, so that on a closed way none is found that is a whole round longer.
    Those of time zones are tried with measurements ``at_all_times``, also of times without a truth. None
    if no delay explains the distances.
    """
    without_delay = measured.errors(0.0)
    misfit_without_delay = _misfits(without_delay, without_delay).with_delay
    if not np.isfinite(misfit_without_delay):
        return None

    def misfits(delay: float) -> _Misfits:
        return _misfits(measured.errors(delay), without_delay)

    clock = measured.clock
    interval = float(np.median(np.diff(clock.times)))
    # Step 1: short delays, as of processing. A sensor whose sigma is wrong may have them, too.
    span = _LONGEST_DELAY_STEPS * interval
    if not clock.counts_steps:
        span = max(span, _LONGEST_DELAY)
    delay = _best_delay(misfits, np.linspace(-span, span, 2 * _DELAYS + 1))
    if delay is not None and _is_explained(misfits(delay)):
        return delay
    # Step 2: long delays, by which measurements must fit that are far away without one.
    if misfit_without_delay <= np.log(_LEAST_MISFIT):
        return None
    for steps, seconds in zip(_LONGEST_SET_DELAYS_STEPS, _LONGEST_SET_DELAYS, strict=True):
        span = steps * interval
        if not clock.counts_steps:
            span = max(span, seconds)
        delay = _best_delay(misfits, np.linspace(-span, span, 2 * _DELAYS + 1))
        if delay is not None and _is_explained(misfits(delay), is_long=True):
            return delay
    # Step 3: time zones. A summer time that is forgotten is an hour.
    if clock.counts_steps:
        return None
    without_delay_at_all_times = at_all_times.errors(0.0)

    def misfits_at_all_times(delay: float) -> _Misfits:
        return _misfits(at_all_times.errors(delay), without_delay_at_all_times)

    zones = _ZONE_STEP * np.arange(-_ZONES, _ZONES + 1)
    best = min(zones.tolist(), key=lambda zone: misfits_at_all_times(zone).with_delay)
    span = _LONGEST_SET_DELAYS[0]
    delay = _best_delay(misfits_at_all_times, best + np.linspace(-span, span, 2 * _DELAYS + 1))
    if delay is not None and _is_explained(misfits_at_all_times(delay), is_long=True):
        return delay
    return None


def _misfits(errors: dict[str, Array], without_delay: dict[str, Array]) -> _Misfits:
    """Return the misfits of ``errors`` with a delay, and of those of the same measurements without it.

    If too few measurements have a truth with the delay and without it, all those that have one without
    it are taken. The misfits are infinite if a component has too few measurements with a truth.
    """
    logs = []
    logs_without_delay = []
    shares = []
    for name, error in errors.items():
        known = np.isfinite(error)
        known_without_delay = np.isfinite(without_delay[name])
        in_common = known & known_without_delay
        if min(known.sum(), known_without_delay.sum()) < _FEWEST_OF_DELAY:
            return _NO_MISFITS
        if in_common.sum() < _FEWEST_OF_DELAY:
            in_common = known_without_delay
        # The medians are kept above 0, for the log.
        logs.append(np.log(max(float(np.median(np.abs(error[known]))), 1e-12)))
        common = np.abs(without_delay[name][in_common])
        logs_without_delay.append(np.log(max(float(np.median(common)), 1e-12)))
        shares.append(float(known.sum() / known_without_delay.sum()))
    return _Misfits(
        with_delay=float(np.mean(logs)),
        without_delay=float(np.mean(logs_without_delay)),
        share=min(shares),
    )


def _is_explained(misfits: _Misfits, is_long: bool = False) -> bool:
    """Test whether a delay explains the distances of measurements from the truth.

    After a long delay (``is_long``) enough of them must have a truth and must fit it: of many delays one
    may bring measurements nearer that are far away for another reason.
    """
    if misfits.with_delay > misfits.without_delay + np.log(_EXPLAINED_BY_DELAY):
        return False
    if not is_long:
        return True
    return (
        misfits.with_delay <= np.log(_MOST_REMAINING_OF_DELAY)
        and misfits.share >= _LEAST_SHARE_OF_DELAY
    )


def _best_delay(misfits: Callable[[float], _Misfits], delays: Array) -> float | None:
    """Return the delay of the least misfit; None if it is the first or the last of the tried ``delays``.

    The search goes on between the neighbors of the best delay.
    """
    for zoom in range(_ZOOMS):
        best = int(np.argmin([misfits(delay).with_delay for delay in delays.tolist()]))
        if zoom == 0 and best in (0, len(delays) - 1):
            return None  # the best delay may lie beyond those that are tried
        best = min(max(best, 1), len(delays) - 2)
        delays = np.linspace(delays[best - 1], delays[best + 1], _DELAYS)
    return float(delays[int(np.argmin([misfits(delay).with_delay for delay in delays.tolist()]))])


def _estimate_delay(measured: _Delayable, delay: float) -> float:
    """Return the delay of least squared errors, s or steps, by Gauss-Newton from the ``delay`` found.

    The delay of the least median distance, which outliers do not disturb, is much less accurate.
    """
    times = measured.clock.times
    interval = float(np.median(np.diff(times)))
    # The step of the difference quotients. A short one would show the errors of the truth, and not the
    # speed: positions with errors of 8 m each second have speeds with errors of 11 m/s.
    h = max(0.05 * interval, min(_INTERVALS_OF_SLOPE * interval, 0.5 * abs(delay)))
    start = delay
    for _ in range(_ITERATIONS):
        errors = measured.errors(delay)
        earlier = measured.errors(delay - h)
        later = measured.errors(delay + h)
        gradient = 0.0
        curvature = 0.0
        for name, error in errors.items():
            slope = (later[name] - earlier[name]) / (2.0 * h)
            known = np.isfinite(error) & np.isfinite(slope)
            sigma = np.median(np.abs(error[known])) / _MEDIAN_OF_NORMAL
            # Where an angle jumps by 2 pi, an error or a slope is none.
            known &= np.abs(error) <= _OUTLYING * sigma
            known &= np.abs(slope) <= 10.0 * np.median(np.abs(slope[known])) + 1e-12
            gradient += float((error[known] * slope[known]).sum()) / max(sigma, 1e-12) ** 2
            curvature += float((slope[known] ** 2).sum()) / max(sigma, 1e-12) ** 2
        if not curvature > 0.0:
            return start
        change = -gradient / curvature
        delay += change
        if abs(change) < 1e-3 * abs(delay):
            break
    return delay


def _at_steps(sample: Sample, chosen: Index) -> Sample:
    """Return a sample of its steps with the numbers ``chosen`` alone."""
    return sample._replace(
        truth=sample.truth[:, chosen],
        z=sample.z[:, chosen],
        steps=sample.steps[chosen],
        indices=sample.indices[chosen],
    )


def _thinned(sample: Sample, runs: Index, most_steps: int) -> Sample:
    """Return a sample with the numbered ``runs`` alone, and with at most ``most_steps`` steps.

    A sensor that differs from step to step predicts one step at a time: `_FEW_STEPS` are kept then. Of
    the kept steps the sample has the numbers, ``steps``, and the ``indices`` among all of the recording.
    """
    most = most_steps if is_equal_at_every_step(sample.sensor) else _FEW_STEPS
    kept = np.linspace(0, len(sample.steps) - 1, min(len(sample.steps), most)).astype(int)
    thinned = _at_steps(sample, kept)
    return thinned._replace(truth=thinned.truth[..., runs], z=thinned.z[..., runs])


def _truth_before(
    truth: Array, times: Array, chosen: Index, delay: float, angle_rows: Sequence[int]
) -> Array:
    """Interpolate the truth (n_x, K, M) at the times of the ``chosen`` steps less the ``delay``.

    The result (n_x, number of chosen steps, M) is NaN outside the known truth. ``times`` (K,) are those
    of the truth, in the unit of the delay. ``angle_rows`` are the components that are angles.
    """
    wanted = times[chosen] - delay
    earlier = np.full((len(truth), len(chosen), truth.shape[2]), np.nan)
    for m in range(truth.shape[2]):
        for row, values in enumerate(truth[:, :, m]):
            known = np.isfinite(values)
            if known.sum() < 2:
                continue
            known_values = values[known]
            if row in angle_rows:
                known_values = np.unwrap(known_values)
            earlier[row, :, m] = np.interp(
                wanted, times[known], known_values, left=np.nan, right=np.nan
            )
    return earlier
