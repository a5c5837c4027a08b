"""Ranks, their agreement and rank intervals are scipy's, without the import of scipy.stats."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tests.conftest import ROOT
from trackbench.report.figures.critical_difference import (
    critical_difference,
    mean_ranks,
    range_quantile,
)
from trackbench.report.verdicts.rank_agreement import kendall

FEW = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=2, max_size=12)


@given(FEW)
def test_the_agreement_of_two_orders(pairs: list[tuple[int, int]]) -> None:
    a, b = zip(*pairs, strict=True)
    assert kendall(a, b) == pytest.approx(stats.kendalltau(a, b).statistic, rel=1e-15, nan_ok=True)


@pytest.mark.parametrize("k", [2, 3, 5, 11, 40])
@pytest.mark.parametrize("level", [0.9, 0.95, 0.99])
def test_the_range_of_normals(k: int, level: float) -> None:
    found = stats.studentized_range.ppf(level, k, np.inf)
    assert range_quantile(level, k) == pytest.approx(found, rel=1e-10)


def test_the_critical_difference_is_demsars() -> None:
    """Demsar 2006, table 5a, and the example of section 3.2.4 with four classifiers on 14 data sets."""
    for alpha, printed in (
        (0.05, (1.960, 2.343, 2.569, 2.728)),
        (0.1, (1.645, 2.052, 2.291, 2.459)),
    ):
        for k, q in enumerate(printed, 2):
            expected = q * np.sqrt(k * (k + 1) / (6 * 14))
            assert critical_difference(k, 14, alpha) == pytest.approx(expected, rel=3e-4)


def test_mean_ranks(rng: np.random.Generator) -> None:
    values = rng.integers(0, 5, (7, 50)).astype(float)
    values[2, 3] = np.nan
    found = stats.rankdata(np.where(np.isnan(values), np.inf, values), axis=0).mean(axis=1)
    assert np.array_equal(mean_ranks(values), found)


def test_a_run_with_all_of_them_imports_no_scipy_stats(tmp_path: Path) -> None:
    code = (
        "import sys; sys.argv[1:] = ['run', 'hdepf', '--runs', '8', '--set', 'block=fit', "
        f"'--out', {str(tmp_path / 'out')!r}, '--engine', 'serial', '--only', 'PF', '--only', 'UKF']\n"
        "from trackbench.cli.app import app\n"
        "try:\n    app()\nexcept SystemExit as done:\n    assert not done.code\n"
        "assert 'matplotlib' in sys.modules and 'scipy.stats' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True)
    assert (tmp_path / "out" / "figures" / "ranks.svg").is_file()
