"""Merge the finished blocks of a filter into its results over all runs."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby, islice

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.block_result import Tracks
from trackbench.evaluation.filter_result import FilterResult, Timing
from trackbench.evaluation.series_sums import StepSums
from trackbench.execution.block_file import ArrayPath, PackedArray, PackedBlock

_AT_A_TIME = 64
"""Blocks that are merged together: their numbers are in memory twice meanwhile."""


def merge(blocks: Iterable[PackedBlock]) -> FilterResult:
    """Join the values per run and add up the sums per step, block by block in the given order."""
    # A path begins with the kind of array: "per_run", "steps" (sums), "kept" (stored series), "tracks".
    # By the path of an array: its pieces, each after the number of the piece's first run.
    parts: dict[ArrayPath, list[tuple[int, Array]]] = {}
    first_run = 0
    sums: dict[ArrayPath, Array] = {}
    timing: list[Timing] = []
    for group in _groups_alike(blocks):
        layout = group[0].layout
        # A row has all numbers of a block.
        rows = np.stack([block.numbers for block in group])
        _add_sums(sums, layout, rows)
        runs = 0
        for array in layout:
            # All arrays that are no sums have the runs as their last axis.
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
        else:  # stored series are in all blocks, and tracks in those of the first runs
            joined[path] = np.concatenate([piece for _, piece in pieces], axis=-1)
    return FilterResult(
        per_run=_named(joined, "per_run"),
        steps=_step_sums(sums),
        run_series=_named(joined, "kept"),
        tracks=_tracks(_named(joined, "tracks")),
        timing=timing,
    )


def _with_gaps(pieces: Sequence[tuple[int, Array]], runs: int) -> Array:
    """Join a metric's values per run (M,); NaN in the blocks that lack the metric.

    A metric that occurs in some runs only, such as the first step with an indefinite covariance, is
    missing in a block without such a run. ``pieces`` are values, each after the number of the first run,
    and ``runs`` is M.
    """
    joined = np.full(runs, np.nan)
    for first, piece in pieces:
        joined[first : first + len(piece)] = piece
    return joined


def _groups_alike(blocks: Iterable[PackedBlock]) -> Iterator[list[PackedBlock]]:
    """Yield lists of consecutive blocks whose arrays have the same names and shapes.

    A list has at most `_AT_A_TIME` blocks.
    """
    for _, alike in groupby(blocks, key=lambda block: block.layout):
        while group := list(islice(alike, _AT_A_TIME)):
            yield group


def _add_sums(sums: dict[ArrayPath, Array], layout: Sequence[PackedArray], rows: Array) -> None:
    """Add the sums per step of some blocks to ``sums``, one block after the other.

    ``rows`` has the numbers of a block in each row, and ``layout`` the places of the arrays in a row.
    The arrays of the sums are neighbors there, so that all are added at once.
    """
    arrays = [array for array in layout if array.path[0] == "steps"]
    if not arrays:
        return
    start = arrays[0].start
    end = arrays[-1].end
    # Begin with -0.0: its sum with any number is that number, also with -0.0.
    before = [sums.get(array.path, np.full(array.shape, -0.0)) for array in arrays]
    total = np.concatenate(before)
    for row in rows[:, start:end]:
        total += row
    for array in arrays:
        sums[array.path] = total[array.start - start : array.end - start]


def _join_runs(rows: Array, array: PackedArray) -> Array:
    """Join an array of several blocks along the runs, its last axis.

    ``rows`` has the numbers of a block in each row, and ``array`` the place of the array in a row.
    """
    B = len(rows)
    blocks = rows[:, array.start : array.end].reshape(B, *array.shape)
    *others, runs = array.shape
    # The axis of the blocks is moved before that of the runs: then both become one.
    return np.moveaxis(blocks, 0, -2).reshape(*others, B * runs)


def _named(arrays: Mapping[ArrayPath, Array], group: str) -> dict[str, Array]:
    """Return the arrays of a group, such as ``per_run``, by name."""
    return {path[1]: array for path, array in arrays.items() if path[0] == group}


def _step_sums(sums: Mapping[ArrayPath, Array]) -> dict[str, StepSums]:
    """Return the sums per step by series, from arrays by path: ``("steps", "squared_x", "total")``."""
    names = dict.fromkeys(name for _, name, _ in sums)
    steps: dict[str, StepSums] = {}
    for name in names:
        fields = {field: sums["steps", name, field] for field in StepSums._fields}
        steps[name] = StepSums(**fields)
    return steps


def _tracks(arrays: Mapping[str, Array]) -> Tracks | None:
    """Return the tracks of all blocks, from their joined arrays by name; None if no block has any."""
    if not arrays:
        return None
    return Tracks(
        truth=arrays["truth"],
        measurements=arrays["measurements"],
        mean=arrays["mean"],
        cov=arrays.get("cov"),
    )
