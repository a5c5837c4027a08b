"""Blocks of one filter put together, in block order, so that sums come out the same every time."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.block import BlockResult, Tracks
from trackbench.evaluation.error_series import StepSums
from trackbench.evaluation.timing import Measured


class Timing(NamedTuple):
    """CPU seconds of one block's filter, and the runs it was computed for."""

    cpu_s: float
    runs: int


class FilterResult(NamedTuple):
    """One filter over all runs: values per run (M,), sums per step, kept series (T + 1, M)."""

    per_run: dict[str, Array]
    steps: dict[str, StepSums]
    run_series: dict[str, Array]
    tracks: Tracks | None
    timing: list[Timing]
    measured: Measured | None = None
    """its CPU times beside the other filters'"""


def merge(blocks: Iterable[BlockResult]) -> FilterResult:
    """Concatenate per-run values and add up per-step sums, block by block in the given order."""
    # Collect the parts of each metric and series, and add up the sums per step.
    per_run: dict[str, list[Array]] = {}
    steps: dict[str, StepSums] = {}
    kept: dict[str, list[Array]] = {}
    tracks: list[Tracks] = []
    timing: list[Timing] = []
    for block in blocks:
        for name, values in block.per_run.items():
            per_run.setdefault(name, []).append(values)
        for name, sums in block.steps.items():
            steps[name] = steps[name].plus(sums) if name in steps else sums
        for name, values in block.run_series.items():
            kept.setdefault(name, []).append(values)
        if block.tracks is not None:
            tracks.append(block.tracks)
        timing.append(Timing(block.cpu_s, block.width))
    # Join the parts along the runs.
    return FilterResult(
        per_run={name: np.concatenate(parts) for name, parts in per_run.items()},
        steps=steps,
        run_series={name: np.concatenate(parts, axis=1) for name, parts in kept.items()},
        tracks=_merged_tracks(tracks),
        timing=timing,
    )


def _merged_tracks(parts: list[Tracks]) -> Tracks | None:
    if not parts:
        return None
    covs = [p.cov for p in parts if p.cov is not None]
    return Tracks(
        truth=np.concatenate([p.truth for p in parts], axis=-1),
        measurements=np.concatenate([p.measurements for p in parts], axis=-1),
        mean=np.concatenate([p.mean for p in parts], axis=-1),
        cov=np.concatenate(covs, axis=-1) if covs else None,
    )
