"""Merge the finished blocks of a filter into its results over all runs."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby, islice, product

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.block_result import Tracks
from trackbench.evaluation.result_over_all_runs import FilterResult, Timing
from trackbench.evaluation.series_sums import StepSums
from trackbench.execution.block_file import ArrayPath, PackedArray, PackedBlock

_AT_A_TIME = 64
"""Largest number of blocks that are merged together.

Only so many are in memory at once, unless they have stored series or tracks: these are joined at the
end.
"""


def merge(blocks: Iterable[PackedBlock], runs: int) -> FilterResult:
    """Join the values per run and add up the sums per step, block by block in the given order.

    ``runs`` is the number M of runs of all blocks.
    """
    values = _RunValues(runs)
    sums: dict[ArrayPath, Array] = {}
    # Pieces of stored series and of tracks, by the path of their array.
    pieces: dict[ArrayPath, list[Array]] = {}
    timing: list[Timing] = []
    for group in _groups_alike(blocks):
        # Arrays of a kind are neighbors in a block; the first name of an array's path is its kind.
        for kind, neighbors in groupby(group[0].layout, key=lambda array: array.path[0]):
            arrays = list(neighbors)
            if kind == "per_run":
                values.fill(arrays, group)
            elif kind == "steps":
                _add_sums(sums, arrays, group)
            else:  # "kept" for a stored series, or "tracks"
                for array, block in product(arrays, group):
                    piece = block.numbers[array.start : array.end].reshape(array.shape)
                    pieces.setdefault(array.path, []).append(piece)
        timing += [Timing(cpu_s=block.cpu_s, runs=block.width) for block in group]
    # The runs are the last axis. Stored series are in all blocks, and tracks in those of the first runs.
    joined = {path: np.concatenate(parts, axis=-1) for path, parts in pieces.items()}
    return FilterResult(
        per_run=values.by_metric(),
        steps=_step_sums(sums),
        run_series=_named(joined, "kept"),
        tracks=_tracks(_named(joined, "tracks")),
        timing=timing,
    )


class _RunValues:
    """Values of all metrics per run, which blocks fill in one after the other.

    A metric that occurs in some runs only, such as the first step with an indefinite covariance, is
    missing in a block without such a run. Its values of this block stay NaN.
    """

    def __init__(self, runs: int) -> None:
        self._values = np.empty((0, runs))  # a row (M,) for each metric
        self._rows: dict[str, int] = {}  # number of the row by the name of the metric
        self._filled = 0  # number of runs whose values are there

    def fill(self, arrays: Sequence[PackedArray], blocks: Sequence[PackedBlock]) -> None:
        """Fill in the next blocks. ``arrays`` are the places of the metrics among their numbers."""
        for array in arrays:
            self._rows.setdefault(array.path[1], len(self._rows))
        missing = len(self._rows) - len(self._values)
        if missing:
            empty = np.full((missing, self._values.shape[1]), np.nan)
            self._values = np.concatenate([self._values, empty])
        rows = [self._rows[array.path[1]] for array in arrays]
        start = arrays[0].start
        end = arrays[-1].end
        (width,) = arrays[0].shape  # number of runs of a block
        for block in blocks:
            runs = slice(self._filled, self._filled + width)
            self._values[rows, runs] = block.numbers[start:end].reshape(len(rows), width)
            self._filled += width

    def by_metric(self) -> dict[str, Array]:
        """Return the values (M,) of each metric by its name."""
        return {metric: self._values[row] for metric, row in self._rows.items()}


def _groups_alike(blocks: Iterable[PackedBlock]) -> Iterator[list[PackedBlock]]:
    """Yield lists of consecutive blocks whose arrays have the same names and shapes.

    A list has at most `_AT_A_TIME` blocks.
    """
    for _, alike in groupby(blocks, key=lambda block: block.layout):
        while group := list(islice(alike, _AT_A_TIME)):
            yield group


def _add_sums(
    sums: dict[ArrayPath, Array], arrays: Sequence[PackedArray], blocks: Sequence[PackedBlock]
) -> None:
    """Add the sums per step of some blocks to ``sums``, one block after the other.

    ``arrays`` are the places of the sums among the numbers of each block. They are neighbors there, so
    that all are added at once.
    """
    start = arrays[0].start
    end = arrays[-1].end
    for array in arrays:
        if array.path not in sums:
            # Begin with -0.0: its sum with any number is that number, also with -0.0.
            sums[array.path] = np.full(array.shape, -0.0)
    total = np.concatenate([sums[array.path] for array in arrays])
    for block in blocks:
        total += block.numbers[start:end]
    for array in arrays:
        sums[array.path] = total[array.start - start : array.end - start]


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
