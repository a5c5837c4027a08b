"""Delays of a sensor's measurements behind the truth, or ahead of it, and the notes on them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.errors import joined
from trackbench.models.sensors.steps_at_once import is_equal_at_every_step
from trackbench.scenarios.recordings.truth_check_distances import (
    MOST_STEPS,
    Sample,
    normalized_distances,
)

_LONGEST_DELAY = 2.0
_LONGEST_DELAY_STEPS = 10
"""Longest delay that is tried, in s, and in usual steps if they are longer."""
_DELAYS = 20
"""Number of delays that are tried on either side, and between the best one's neighbors."""
_FEWEST_OF_DELAY = 30
"""Measurements from which on a delay is looked for."""
_EXPLAINED_BY_DELAY = 0.6
"""Share of the median distances that remains at most if a delay explains them."""
_MOST_RUNS = 5
_FEW_STEPS = 50
"""Most runs, and most steps of a sensor that takes one step at a time, in the search of a delay."""


class StepClock(NamedTuple):
    """Numbers and times (K,) of the steps of a recording, s, or steps if it is ``counts_steps``."""

    steps: Index
    times: Array
    counts_steps: bool = False


def delay_notes(
    samples: Sequence[Sample],
    truth: Array,
    clock: StepClock,
    components: Sequence[str],
    angles: Sequence[str],
    in_one_file: bool,
) -> list[str]:
    """Return texts on the sensors whose measurements agree much better with an earlier or a later truth.

    ``samples`` are those of the sensors, ``truth`` (n_x, K, M) is that of all K steps of ``clock``.
    ``components`` are those of the truth, and ``angles`` those that are angles. If the sensors are
    ``in_one_file``, they have one clock, and so are tried together.
    """
    if not samples or len(clock.times) < 2:
        return []
    runs = np.flatnonzero(np.isfinite(truth).any(axis=(0, 1)))[:_MOST_RUNS]
    truth = truth[..., runs]
    samples = [_thinned(sample, runs) for sample in samples]
    groups = [samples]
    if not in_one_file:
        groups = [[sample] for sample in samples]
    interval = float(np.median(np.diff(clock.times)))
    span = _LONGEST_DELAY_STEPS * interval
    if not clock.counts_steps:
        span = max(span, _LONGEST_DELAY)
    angle_rows = [row for row, name in enumerate(components) if name in angles]
    texts = []
    for group in groups:

        def misfit(delay: float, group: list[Sample] = group) -> float:
            """Return the mean log of the components' median distances, if measurements have this delay.

            It is in s, or steps. The misfit is infinite if too few measurements have a truth.
            """
            by_component: dict[str, list[Array]] = {}
            for sample in group:
                earlier = _truth_before(truth, clock.times, sample.indices, delay, angle_rows)
                distances = normalized_distances(sample._replace(truth=earlier))
                for name, row in zip(sample.sensor.components, distances, strict=True):
                    by_component.setdefault(name, []).append(row[np.isfinite(row)])
            medians = []
            for rows in by_component.values():
                known = np.concatenate(rows)
                if len(known) < _FEWEST_OF_DELAY:
                    return np.inf
                medians.append(max(float(np.median(known)), 1e-12))  # above 0, for the log
            return float(np.log(medians).mean())

        misfit_without_delay = misfit(0.0)
        if not np.isfinite(misfit_without_delay):
            continue
        # Search a coarse grid of delays, and then a fine one between the neighbors of the best.
        delays = np.linspace(-span, span, 2 * _DELAYS + 1)
        best = int(np.argmin([misfit(delay) for delay in delays.tolist()]))
        if best in (0, len(delays) - 1):
            continue  # the best delay may lie beyond the grid
        nearer = np.linspace(delays[best - 1], delays[best + 1], _DELAYS)
        misfits = [misfit(delay) for delay in nearer.tolist()]
        delay = float(nearer[int(np.argmin(misfits))])
        if min(misfits) > misfit_without_delay + np.log(_EXPLAINED_BY_DELAY):
            continue
        whose = joined([sample.name for sample in group])
        direction = "behind" if delay > 0.0 else "ahead of"
        unit = " steps" if clock.counts_steps else " s"
        texts.append(
            f"the measurements of {whose} seem to be some {abs(delay):.2g}{unit} {direction} the "
            "truth: check the clocks of both"
        )
    return texts


def _thinned(sample: Sample, runs: Index) -> Sample:
    """Return a sample with the numbered ``runs`` alone, and with at most `MOST_STEPS` steps.

    A sensor that differs from step to step predicts one step at a time: `_FEW_STEPS` are kept then. Of
    the kept steps the sample has the numbers, ``steps``, and the ``indices`` among all of the recording.
    """
    most = MOST_STEPS if is_equal_at_every_step(sample.sensor) else _FEW_STEPS
    kept = np.linspace(0, len(sample.steps) - 1, min(len(sample.steps), most)).astype(int)
    return sample._replace(
        truth=sample.truth[:, kept][..., runs],
        z=sample.z[:, kept][..., runs],
        steps=sample.steps[kept],
        indices=sample.indices[kept],
    )


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
