from typing import Any

import numpy as np
import pytest
from scipy import stats

from trackbench.core.random_streams import RunStreams, block_stream


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
