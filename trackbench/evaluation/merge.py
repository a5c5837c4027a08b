"""Blocks of one filter put together, in block order, so that sums come out the same every time."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.block import BlockResult, Tracks
from trackbench.evaluation.metrics import StepSums


class Timing(NamedTuple):
    """CPU seconds of one block's filter, and the runs it was computed for."""

    cpu_s: float
    runs: int


class FilterResult(NamedTuple):
    """One filter over all runs: values per run (M,), sums per step, kept series (T + 1, M)."""

    per_run: dict[str, Array]
    steps: dict[str, StepSums]
    kept: dict[str, Array]
    tracks: Tracks | None
    timing: list[Timing]


def merge(blocks: list[BlockResult]) -> FilterResult:
    """Concatenate per-run values and add up per-step sums, block by block in the given order."""
    steps = dict(blocks[0].steps)
    for block in blocks[1:]:
        for name, sums in block.steps.items():
            steps[name] = steps[name].plus(sums)
    return FilterResult(
        per_run={n: np.concatenate([b.per_run[n] for b in blocks]) for n in blocks[0].per_run},
        steps=steps,
        kept={n: np.concatenate([b.kept[n] for b in blocks], axis=1) for n in blocks[0].kept},
        tracks=_merged_tracks([b.tracks for b in blocks if b.tracks is not None]),
        timing=[Timing(block.cpu_s, block.width) for block in blocks],
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
