"""Distribution functions against scipy's."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from trackbench.core.normal_chi2 import chi_square_cdf, normal_cdf, normal_density


def test_the_normal_distribution_function() -> None:
    z = np.linspace(-10.0, 10.0, 4001)
    np.testing.assert_allclose(normal_cdf(z), norm.cdf(z), rtol=0, atol=1e-14)
    np.testing.assert_allclose(normal_density(z), norm.pdf(z), rtol=1e-13, atol=1e-300)


@pytest.mark.parametrize("n", range(1, 10))
def test_the_chi_square_distribution_function(n: int) -> None:
    x = np.concatenate([np.linspace(0.0, 80.0, 801), [1e3, 1e6, np.inf]])
    np.testing.assert_allclose(chi_square_cdf(x, n), chi2.cdf(x, n), rtol=0, atol=1e-14)


def test_the_ends_and_what_is_no_number() -> None:
    found = normal_cdf([-np.inf, 0.0, np.inf, np.nan])
    np.testing.assert_allclose(found, [0.0, 0.5, 1.0, np.nan], atol=1e-15)
    assert np.isnan(chi_square_cdf([np.nan], 3)).all()


def test_a_value_is_the_same_beside_any_others() -> None:
    """The series ends where no term matters to anyone."""
    z = np.random.default_rng(1).normal(size=50)
    alone = np.array([normal_cdf(np.array([value]))[0] for value in z])
    assert np.array_equal(normal_cdf(np.append(z, 8.4))[:-1], alone)
