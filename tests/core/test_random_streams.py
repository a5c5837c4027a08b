from typing import Any

import numpy as np
import pytest
from scipy import stats

from trackbench.core.random_streams import _TRAINING_DATA, RunStreams, aside_stream, block_stream
from trackbench.core.random_variates import is_erlang
from trackbench.filters.external_lines import run_seeds


def test_a_run_does_not_depend_on_the_runs_beside_it() -> None:
    def draws(runs: range) -> list[np.ndarray]:
        rng = RunStreams(7, runs)
        return [
            rng.standard_normal((3, len(runs))),
            rng.random((300, len(runs))),  # more than one chunk
            rng.standard_normal((600, len(runs))),
            rng.standard_gamma(2.5, (2, len(runs))),
        ]

    alone = draws(range(5, 6))
    for one, many in zip(alone, draws(range(3, 9)), strict=True):
        np.testing.assert_array_equal(one[..., 0], many[..., 2])


def test_runs_and_blocks_are_independent_streams() -> None:
    rng = RunStreams(7, range(2000))
    x = rng.standard_normal((2, 2000))
    assert stats.kstest(x.ravel(), "norm").pvalue > 1e-3
    # Neighboring runs, and a block's stream beside the runs', are uncorrelated (5 sigma).
    assert abs(np.corrcoef(x[0, :-1], x[0, 1:])[0, 1]) < 5 / np.sqrt(2000)
    block = block_stream(7, 0).standard_normal(2000)
    assert abs(np.corrcoef(x[0], block)[0, 1]) < 5 / np.sqrt(2000)
    assert not np.array_equal(block, block_stream(7, 1).standard_normal(2000))


@pytest.mark.parametrize("size", [5, (), None, (3, 5)])
@pytest.mark.parametrize("draw", ["random", "standard_normal"])
def test_a_shape_without_the_runs_is_refused_in_a_line(size: Any, draw: str) -> None:
    with pytest.raises(ValueError, match=r"whose last axis is the 4 runs"):
        getattr(RunStreams(1, range(4)), draw)(size)
    assert getattr(RunStreams(1, range(4)), draw)(4).shape == (4,)


def test_streams_beside_the_data_are_others_for_each_number_and_for_training() -> None:
    """No two of them draw the same numbers: runs of an evaluation and of training, of each number."""
    first_runs: dict[str, RunStreams] = {}
    for name, run in (("evaluated", 0), ("training", -1)):
        streams = RunStreams(7, [run])
        first_runs[f"{name}: data"] = streams
        for number in (0, 1, 2, 2**32 - 1):
            first_runs[f"{name}: beside {number}"] = streams.beside(number)
    drawn = {name: tuple(rng.random((4, 1))[:, 0]) for name, rng in first_runs.items()}
    # The filters' noise begins at streams of its own, too.
    for block in (0, -1):
        drawn[f"noise of block {block}"] = tuple(block_stream(7, block).random(4))
        drawn[f"aside of block {block}"] = tuple(aside_stream(7, block).random(4))
    assert len({*drawn.values()}) == len(drawn)


def test_streams_beside_are_those_of_the_runs() -> None:
    alone, many = (RunStreams(7, runs).beside(3).random((2, len(runs))) for runs in ([5], [4, 5]))
    np.testing.assert_array_equal(alone[:, 0], many[:, 1])


@pytest.mark.parametrize("shape", [1, 2.0, 7, 8.0])
def test_gamma_variates_of_a_small_whole_shape_are_sums_of_exponentials(shape: float) -> None:
    """Up to eight, on every machine the same; of the uniform variates of the run's own stream."""
    u = RunStreams(7, range(3)).random((int(shape), 5, 3))
    found = RunStreams(7, range(3)).standard_gamma(shape, (5, 3))
    np.testing.assert_allclose(found, -np.log(1.0 - u).sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("shape", [0.5, 2.5, 9.0])
def test_gamma_variates_of_other_shapes_are_numpys(shape: float) -> None:
    found = RunStreams(7, range(2000)).standard_gamma(shape, (2000,))
    assert stats.kstest(found, "gamma", (shape,)).pvalue > 1e-3
    assert not is_erlang(shape)


def test_seeds_of_runs_are_others_in_each_block_and_for_each_seed() -> None:
    """For generators outside of Python: run m of a block has its own, however many runs there are."""
    seeds = [run_seeds(block_stream(s, block), 50) for s in (7, 8) for block in (0, 1, -1)]
    assert len({seed for of_block in seeds for seed in of_block}) == 6 * 50
    assert run_seeds(block_stream(7, 0), 3) == seeds[0][:3]
    stream = block_stream(7, 0)
    stream.random(10)
    assert run_seeds(stream, 50) == seeds[0]
    assert all(0 <= seed < 2**32 for seed in seeds[0])


def test_training_runs_count_from_minus_one_down() -> None:
    """The first is the first stream of its kind, so that stored tunings come out again."""
    training = RunStreams(7, [-1, -2]).random((3, 2))
    kind = _TRAINING_DATA
    np.testing.assert_array_equal(RunStreams(7, [0, 1], (kind, kind)).random((3, 2)), training)
