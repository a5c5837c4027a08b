"""The test of one recording's differences: its level on simulated series, and by hand."""

import numpy as np
import pytest

from trackbench.core.arrays import Array
from trackbench.statistics.series import series_mean

REPEATS = 600


def simulated(kind: str, T: int, rng: np.random.Generator) -> Array:
    """Return a series (T,) with mean zero."""
    normal = rng.standard_t(3, T + 200) if kind == "heavy tails" else rng.standard_normal(T + 200)
    if kind == "moving average":
        return (normal[1:] + 0.8 * normal[:-1])[-T:]
    r = {"white": 0.0, "0.5": 0.5, "0.8": 0.8, "-0.5": -0.5, "heavy tails": 0.5}[kind]
    x = normal.copy()
    for k in range(1, len(x)):
        x[k] += r * x[k - 1]
    return x[-T:]


@pytest.mark.parametrize("T", [100, 600])
@pytest.mark.parametrize("kind", ["white", "0.5", "0.8", "-0.5", "moving average", "heavy tails"])
def test_five_percent_of_series_without_a_difference_are_rejected(kind: str, T: int) -> None:
    rng = np.random.default_rng([201, T, len(kind)])
    rejected = sum(abs(series_mean(simulated(kind, T, rng)).z) > 1.96 for _ in range(REPEATS))
    # 3.5 to 6.5 %, and four standard errors of the simulation.
    margin = 4.0 * np.sqrt(0.05 * 0.95 / REPEATS)
    assert 0.035 - margin < rejected / REPEATS < 0.065 + margin


def test_the_error_is_that_of_the_long_run() -> None:
    """Of an autoregression of 0.8 it is five times that of white noise."""
    rng = np.random.default_rng(202)
    errors = [series_mean(simulated("0.8", 2000, rng)).stderr for _ in range(50)]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(5.0 / np.sqrt(2000), rel=0.1)


def test_what_can_be_said_without_spread_or_steps() -> None:
    assert series_mean(np.zeros(100))[:3] == (0.0, 0.0, 0.0)
    assert series_mean(np.full(100, -2.0))[:3] == (-2.0, 0.0, -np.inf)
    assert np.isnan(series_mean(np.arange(49.0)).z)
    x = np.random.default_rng(203).standard_normal(200)
    gaps = np.insert(x, [3, 50, 200], np.nan)
    assert series_mean(gaps) == series_mean(x)
