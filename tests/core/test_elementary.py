"""Elementary functions against numpy's, which may differ in the last bits, and exact ones."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from scipy.stats import chi2, norm

from trackbench.core import elementary, elementary_tables
from trackbench.core.cumulative_probabilities import chi_square_cdf, normal_cdf, normal_density

TINY, HUGE = np.finfo(float).tiny, np.finfo(float).max
AWKWARD = np.array([0.0, -0.0, 1.0, -1.0, 5e-324, TINY, HUGE, np.inf, -np.inf, np.nan])


def ulps(got: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference in units of the last place."""
    return float((np.abs(got - expected) / np.spacing(np.abs(expected))).max())


def test_exp_is_right_to_the_rounding_of_its_argument(rng: np.random.Generator) -> None:
    for largest in (1e-3, 1.0, 40.0, 700.0):
        x = rng.uniform(-largest, largest, 100_000)
        error = np.abs(elementary.exp(x) / np.exp(x) - 1.0)
        assert (error < 1.2e-15 + 3e-16 * np.abs(x)).all()


def test_log_is_right_to_the_last_bits_and_near_one_in_itself(rng: np.random.Generator) -> None:
    x = np.exp(rng.uniform(-700.0, 700.0, 100_000))
    assert ulps(elementary.log(x), np.log(x)) <= 3.0
    near = 1.0 + rng.uniform(-1e-3, 1e-3, 100_000)
    assert np.abs(elementary.log(near) - np.log(near)).max() < 1e-17
    assert elementary.log(np.array([1.0]))[0] == 0.0


@pytest.mark.parametrize("largest", [1e-6, 4.0, 1e5, 1e6])
def test_cosine_and_sine(largest: float, rng: np.random.Generator) -> None:
    a = rng.uniform(-largest, largest, 100_000)
    c, s = elementary.cos_sin(a)
    assert np.abs(c - np.cos(a)).max() < 2.3e-16
    assert np.abs(s - np.sin(a)).max() < 2.3e-16
    if largest < 1e-3:
        assert ulps(s, np.sin(a)) <= 1.0


def test_arctan2_everywhere_and_near_the_axis(rng: np.random.Generator) -> None:
    y, x = rng.standard_normal((2, 100_000)) * np.exp(rng.uniform(-20.0, 20.0, (2, 100_000)))
    assert ulps(elementary.arctan2(y, x), np.arctan2(y, x)) <= 3.0
    x, y = np.abs(x), np.abs(x) * rng.uniform(-0.03, 0.03, len(x))
    assert ulps(elementary.arctan2(y, x), np.arctan2(y, x)) <= 1.0


def test_a_value_does_not_depend_on_those_beside_it(rng: np.random.Generator) -> None:
    """In a piece that is narrow as a whole, or not; that has a zero in it, or not."""
    x = rng.uniform(0.5, 2.0, 999)
    y = x * rng.uniform(-0.03, 0.03, 999)
    alone = elementary.arctan2(y, x)
    beside = elementary.arctan2(np.append(y, 1.0), np.append(x, -1.0))
    np.testing.assert_array_equal(beside[:-1], alone)
    for function, odd in ((elementary.exp, -800.0), (elementary.log, 0.0)):
        np.testing.assert_array_equal(function(np.append(x, odd))[:-1], function(x))
    c, _ = elementary.cos_sin(np.append(x, 1.0))
    np.testing.assert_array_equal(c[:-1], elementary.cos_sin(x)[0])


def test_where_numpy_has_no_numbers_there_are_none_either() -> None:
    with np.errstate(all="ignore"):
        exp, log = np.exp(AWKWARD), np.log(AWKWARD)
        np.testing.assert_allclose(elementary.exp(AWKWARD), exp, rtol=1e-15)
        np.testing.assert_allclose(elementary.log(AWKWARD), log, rtol=1e-15)
        assert np.isnan(elementary.cos_sin(np.array([np.inf, np.nan]))).all()
    np.testing.assert_array_equal(elementary.exp(np.array([-708.1, 709.8])), [0.0, np.inf])
    y, x = np.array([0.0, 0.0, 1.0, -1.0, np.nan]), np.array([0.0, -1.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(elementary.arctan2(y, x), np.arctan2(y, x))


def test_functions_made_of_them(rng: np.random.Generator) -> None:
    x = rng.uniform(-3.0, 3.0, 10_000)
    np.testing.assert_allclose(elementary.expm1(x), np.expm1(x), rtol=4e-15)
    np.testing.assert_allclose(elementary.expm1(1e-9 * x), np.expm1(1e-9 * x), rtol=1e-15)
    np.testing.assert_allclose(elementary.sinh(x), np.sinh(x), rtol=4e-15)
    low = np.array([-np.inf, 0.0, -1e9, -227.9])
    expected = np.logaddexp(low, -227.9)
    np.testing.assert_allclose(elementary.logaddexp(low, -227.9), expected, rtol=1e-15, atol=1e-16)
    assert np.isnan(elementary.logaddexp(np.array([np.nan]), 0.0)).all()
    np.testing.assert_allclose(elementary.power(np.abs(x), 0.7), np.abs(x) ** 0.7, rtol=1e-14)
    np.testing.assert_allclose(elementary.power(x, 3.0), x**3, rtol=1e-15)
    np.testing.assert_array_equal(elementary.power(x, 0.0), 1.0)
    for a in (0.01, 0.5, 1.0, 2.5, 3.0, 40.0):
        assert elementary.log_gamma(a) == pytest.approx(math.lgamma(a), abs=1e-13)


def test_shapes_and_numbers_and_results_in_place(rng: np.random.Generator) -> None:
    x = rng.uniform(0.1, 2.0, (3, 5000, 2))
    strided = x.transpose(2, 0, 1)
    np.testing.assert_array_equal(elementary.exp(strided), elementary.exp(x).transpose(2, 0, 1))
    out = strided.copy(order="F")
    assert elementary.log(out, out=out) is out
    np.testing.assert_array_equal(out, elementary.log(strided))
    assert elementary.exp(0.5) == elementary.exp(np.array([0.5]))[0]
    assert elementary.cos_sin(0.5)[1] == elementary.cos_sin(np.array([0.5]))[1][0]
    assert elementary.exp(np.empty((0, 3))).shape == (0, 3)


def test_tables_are_rounded_correctly() -> None:
    """Against Decimal's own exp and ln, whose error is below its last digit."""
    at_edge, inverse = elementary_tables.logarithms()
    with localcontext() as context:
        context.prec = 60
        for j in (1, 777, 8191, 16_383):
            exact = (Decimal(2).ln() * j / elementary_tables.POWERS).exp()
            assert elementary_tables.powers_of_two()[j] == float(exact)
        for j in (0, 1, 4095, 4096, 4097, 8191):
            edge = Decimal(
                3,
            ) / 4 + Decimal(j) / (2 * elementary_tables.LOGS)
            if j > elementary_tables.LOGS // 2:
                edge = 1 + Decimal(j - elementary_tables.LOGS // 2) / elementary_tables.LOGS
            assert at_edge[j] == float(edge.ln())
            assert inverse[j] == 1.0 / float(edge)
    cosines, sines = elementary_tables.circle()
    quarter = elementary_tables.ANGLES // 4
    assert (cosines[0], sines[quarter], sines[2 * quarter]) == (1.0, 1.0, 0.0)
    np.testing.assert_array_equal(np.roll(sines, -quarter), cosines)
    np.testing.assert_allclose(sines**2 + cosines**2, 1.0, rtol=3e-16)
    assert elementary_tables.arctangents()[-1] == math.pi / 4


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


def test_whole_powers_of_negative_numbers_are_numbers() -> None:
    x = np.array([-2.5, -1.0, -0.5, -0.0, 0.0, 0.5, 1.0, 3.0])
    for y in (17, 18.0, 40, 101, 0, 1, 16):
        np.testing.assert_allclose(elementary.power(x, y), x**y, rtol=1e-13)
    assert elementary.power(-1.0, 1001) == -1.0
    assert elementary.power(-1.0, 1_000_000) == 1.0
    # An exponent for each base, whole or not.
    y = np.array([17.0, 0.0, 2.0, 3.0, 0.0, 0.5, -3.0, 1.5])
    np.testing.assert_allclose(elementary.power(x, y), x**y, rtol=1e-14)
    assert np.isnan(elementary.power(np.array([-1.0, -2.0]), 0.3)).all()
    assert np.isnan(elementary.power(np.array([-1.0]), np.array([0.5]))).all()


def test_angles_and_powers_of_zeros_and_infinities_are_those_of_numpy() -> None:
    ends = np.array([np.inf, -np.inf, 2.0, -2.0, 1e300, np.nan])
    y, x = (a.ravel() for a in np.meshgrid(ends, ends))
    np.testing.assert_allclose(elementary.arctan2(y, x), np.arctan2(y, x), rtol=1e-15)
    bases = np.array([0.0, -0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5, np.inf, -np.inf, np.nan])
    y, x = (a.ravel() for a in np.meshgrid([*bases, 3.0, -3.0, 17.0], bases))
    with np.errstate(all="ignore"):
        expected = np.power(x, y)
    powers = elementary.power(x, y)
    np.testing.assert_allclose(powers, expected, rtol=1e-13)
    is_number = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(powers)[is_number], np.signbit(expected)[is_number])
    assert elementary.power(-0.0, -1.0) == -np.inf


def test_the_hyperbolic_sine_of_an_argument_whose_exponential_is_infinite() -> None:
    x = np.array([709.0, 710.0, -710.4, 711.0, -np.inf])
    expected = [math.sinh(709.0), math.sinh(710.0), math.sinh(-710.4), np.inf, -np.inf]
    np.testing.assert_allclose(elementary.sinh(x), expected, rtol=1e-12)
