"""Merged blocks against sums and lists that are made run by run, in plain Python."""

import numpy as np
import pytest

from trackbench.core.arrays import Array
from trackbench.evaluation.block_result import BlockResult, Tracks
from trackbench.evaluation.series_sums import StepSums
from trackbench.execution import merge_finished_blocks
from trackbench.execution.block_file import pack
from trackbench.execution.merge_finished_blocks import merge

STEPS = 3


def random_block(rng: np.random.Generator, runs: int, shown: int, names: str) -> BlockResult:
    """Make a block whose series ``names`` (a letter each) have sums per step."""

    def numbers(*shape: int) -> Array:
        return rng.standard_normal(shape) * 10.0 ** rng.integers(-9, 9, shape)

    tracks = None
    if shown:
        tracks = Tracks(
            truth=numbers(2, STEPS, shown),
            measurements=numbers(1, STEPS - 1, shown),
            mean=numbers(2, STEPS, shown),
            cov=numbers(2, 2, STEPS, shown),
        )
    return BlockResult(
        per_run={"rmse": numbers(runs), "lost": np.zeros(runs)},
        steps={name: StepSums(*numbers(3, STEPS)) for name in names},
        run_series={"nees": numbers(STEPS, runs)},
        tracks=tracks,
        cpu_s=runs / 7,
        width=runs,
    )


def test_a_metric_that_some_blocks_lack_is_nan_in_their_runs() -> None:
    rng = np.random.default_rng(1)
    blocks = [random_block(rng, runs, 0, "a") for runs in (3, 2, 4)]
    blocks[1].per_run["first_indefinite_step"] = np.array([np.nan, 5.0])
    merged = merge(map(pack, blocks), sum(block.width for block in blocks))
    first = merged.per_run["first_indefinite_step"]
    np.testing.assert_array_equal(first, [np.nan] * 4 + [5.0] + [np.nan] * 4)


@pytest.mark.parametrize("at_a_time", [1, 2, 64])
def test_runs_stay_in_order_and_sums_are_added_one_by_one(
    at_a_time: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(merge_finished_blocks, "_AT_A_TIME", at_a_time)
    rng = np.random.default_rng(0)
    # Tracks in the first blocks alone; a series that some blocks lack; fewer runs in the last block.
    shapes = [(4, 4, "ab"), (4, 1, "ab"), (4, 0, "a"), (4, 0, "ab"), (4, 0, "ab"), (2, 0, "ab")]
    blocks = [random_block(rng, runs, shown, names) for runs, shown, names in shapes]
    merged = merge(map(pack, blocks), sum(block.width for block in blocks))
    assert merged.tracks is not None
    for name in ("rmse", "lost"):
        expected = [x for block in blocks for x in block.per_run[name]]
        assert merged.per_run[name].tolist() == expected
    for step in range(STEPS):
        expected = [x for block in blocks for x in block.run_series["nees"][step]]
        assert merged.run_series["nees"][step].tolist() == expected
    for name in "ab":
        for field in StepSums._fields:
            for step in range(STEPS):
                values = [
                    getattr(block.steps[name], field)[step]
                    for block in blocks
                    if name in block.steps
                ]
                total = values[0]
                for value in values[1:]:
                    total += value
                assert getattr(merged.steps[name], field)[step] == total
    for field, array in merged.tracks._asdict().items():
        first, second = (getattr(block.tracks, field) for block in blocks[:2])
        assert (array[..., :4] == first).all()
        assert (array[..., 4:] == second).all()
    assert [timing.runs for timing in merged.timing] == [4, 4, 4, 4, 4, 2]


def test_a_negative_zero_is_kept() -> None:
    """Otherwise a stored number would change its sign with the number of blocks."""
    block = random_block(np.random.default_rng(0), 2, 0, "a")
    zero = np.full(STEPS, -0.0)
    block = block._replace(steps={"a": StepSums(zero, zero, zero)})
    assert np.signbit(merge([pack(block), pack(block)], 4).steps["a"].total).all()
