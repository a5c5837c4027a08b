"""Merge the finished blocks of a filter into its results over all runs."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby, islice

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.block import Tracks
from trackbench.evaluation.error_series import StepSums
from trackbench.evaluation.summary import FilterResult, Timing
from trackbench.execution.block_file import ArrayPath, PackedArray, PackedBlock

_AT_A_TIME = 64
"""Blocks that are merged together: their numbers are in memory twice meanwhile."""


def merge(blocks: Iterable[PackedBlock]) -> FilterResult:
    """Join the values per run and add up the sums per step, block by block in the given order."""
    parts: dict[ArrayPath, list[tuple[int, Array]]] = {}  # pieces after the first run of each
    first_run = 0
    sums: dict[ArrayPath, Array] = {}
    timing: list[Timing] = []
    for group in _groups_alike(blocks):
        layout = group[0].layout
        rows = np.stack([block.numbers for block in group])
        _add_sums(sums, layout, rows)
        runs = 0
        for array in layout:
            if array.path not in sums:
                piece = _join_runs(rows, array)
                parts.setdefault(array.path, []).append((first_run, piece))
                if array.path[0] == "per_run":
                    runs = piece.shape[-1]
        first_run += runs
        timing += [Timing(cpu_s=block.cpu_s, runs=block.width) for block in group]
    joined = {}
    for path, pieces in parts.items():
        if path[0] == "per_run":
            joined[path] = _with_gaps(pieces, first_run)
        else:
            joined[path] = np.concatenate([piece for _, piece in pieces], axis=-1)
    return FilterResult(
        per_run=_named(joined, "per_run"),
        steps=_step_sums(sums),
        run_series=_named(joined, "kept"),
        tracks=_tracks(_named(joined, "tracks")),
        timing=timing,
    )


def _with_gaps(pieces: Sequence[tuple[int, Array]], runs: int) -> Array:
    """Join a metric's values per run (M,); NaN in the blocks that lack it, as where it did not occur.

    ``pieces`` are values after the number of their first run, and ``runs`` is M.
    """
    joined = np.full(runs, np.nan)
    for first, piece in pieces:
        joined[first : first + len(piece)] = piece
    return joined


def _groups_alike(blocks: Iterable[PackedBlock]) -> Iterator[list[PackedBlock]]:
    """Yield consecutive blocks with the same layout, at most `_AT_A_TIME` at once."""
    for _, alike in groupby(blocks, key=lambda block: block.layout):
        while group := list(islice(alike, _AT_A_TIME)):
            yield group


def _add_sums(sums: dict[ArrayPath, Array], layout: Sequence[PackedArray], rows: Array) -> None:
    """Add the sums per step of some blocks, one block after the other.

    ``rows`` has the numbers of a block in each row, and ``layout`` the places of the arrays in it.
    """
    arrays = [array for array in layout if array.path[0] == "steps"]
    if not arrays:
        return
    start = arrays[0].start
    end = arrays[-1].end
    # -0.0 is the number that changes no other by being added, not even a negative zero.
    before = [sums.get(array.path, np.full(array.shape, -0.0)) for array in arrays]
    total = np.concatenate(before)
    for row in rows[:, start:end]:
        total += row
    for array in arrays:
        sums[array.path] = total[array.start - start : array.end - start]


def _join_runs(rows: Array, array: PackedArray) -> Array:
    """Join an array of several blocks along the runs, its last axis.

    ``rows`` has the numbers of a block in each row.
    """
    B = len(rows)
    blocks = rows[:, array.start : array.end].reshape(B, *array.shape)
    *others, runs = array.shape
    return np.moveaxis(blocks, 0, -2).reshape(*others, B * runs)


def _named(arrays: Mapping[ArrayPath, Array], group: str) -> dict[str, Array]:
    """Return the arrays of a group, such as ``per_run``, by name."""
    return {path[1]: array for path, array in arrays.items() if path[0] == group}


def _step_sums(sums: Mapping[ArrayPath, Array]) -> dict[str, StepSums]:
    """Return the sums per step by series."""
    names = dict.fromkeys(name for _, name, _ in sums)
    steps: dict[str, StepSums] = {}
    for name in names:
        fields = {field: sums["steps", name, field] for field in StepSums._fields}
        steps[name] = StepSums(**fields)
    return steps


def _tracks(arrays: Mapping[str, Array]) -> Tracks | None:
    """Return the tracks of all blocks; None if no block has any."""
    if not arrays:
        return None
    return Tracks(
        truth=arrays["truth"],
        measurements=arrays["measurements"],
        mean=arrays["mean"],
        cov=arrays.get("cov"),
    )
