"""Comparisons of all pairs of filters at once are those of the pairs one by one."""

import numpy as np
import pytest

from trackbench.statistics.compare_all_pairs import compare_all
from trackbench.statistics.comparison import Sample, compare


@pytest.mark.parametrize("statistic", ["mean", "rms", "median", "variance"])
@pytest.mark.parametrize("runs", [2, 3, 7, 200])
def test_all_pairs_together_are_the_pairs_one_by_one(statistic: str, runs: int) -> None:
    """The same bits: equal filters, rounding, lost runs and runs without a spread are among them."""
    rng = np.random.default_rng(runs)
    base = np.exp(rng.normal(size=runs))
    values = {
        f"{share}": base * (1.0 + share * rng.normal(size=runs)) for share in (0.0, 1e-13, 0.1, 1.0)
    }
    values["lost"] = np.where(np.arange(runs) == 0, np.nan, base)
    values["constant"] = np.full(runs, 3.0)
    values["again"] = values["0.1"].copy()
    samples = {label: Sample(x, statistic) for label, x in values.items()}
    family = compare_all(samples)
    for (a, b), together in family.items():
        alone = compare(samples[a], samples[b])
        assert alone is not None
        for one, other in (
            (together.difference, alone.difference), (together.a, alone.a), (together.b, alone.b)
        ):  # fmt: skip
            assert [*map(str, one[:2])] == [*map(str, other[:2])]
            np.testing.assert_array_equal(one.influences, other.influences)
            assert one.runs == other.runs
        assert str(together.z) == str(alone.z)  # NaN, too
