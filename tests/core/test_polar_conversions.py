"""Conversions against Gauss-Hermite integration of the moments they stand for, and against draws."""

import numpy as np
import pytest

from trackbench.core.polar_conversions import Conversion, Polar, convert, position

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(60)
WEIGHTS = WEIGHTS / WEIGHTS.sum()

CASES = [
    pytest.param(1.0124e7, 0.2, 2e-3, id="10124 km, 2 mrad"),
    pytest.param(2.5e5, 50.0, np.deg2rad(15.0), id="250 km, 15 deg"),
    pytest.param(5.0e4, 0.2, 2e-3, id="50 km, 2 mrad"),
]


def expectation(values: np.ndarray, *weights: np.ndarray) -> np.ndarray:
    """Sum over the leading quadrature axes."""
    for w in weights:
        values = np.tensordot(w, values, axes=(0, 0))
    return values


def off_axis(r: np.ndarray, w: np.ndarray, shrink: float) -> tuple[np.ndarray, np.ndarray]:
    """``r (cos w, sin w) - shrink``, along the axis without the cancellation of two large numbers."""
    return (r - shrink) - 2.0 * r * np.sin(0.5 * w) ** 2, r * np.sin(w)


@pytest.mark.parametrize(("r", "sigma_r", "sigma_a"), CASES)
@pytest.mark.parametrize("conversion", ["ucm", "mucm"])
def test_moments_given_the_measurement(
    conversion: Conversion, r: float, sigma_r: float, sigma_a: float
) -> None:
    """Covariance given the measurement: of the error (UCM), about the mean (MUCM)."""
    s = sigma_a**2
    z = Polar(np.array([r]), np.array([0.0]), sigma_r**2, s)
    found = convert(conversion, z)
    grow = {"ucm": 0.5 * s, "mucm": -0.5 * s}[conversion]
    wr, wa = np.meshgrid(sigma_r * NODES, sigma_a * NODES, indexing="ij")
    along, across = off_axis(r - wr, wa, r)
    along = along - r * np.expm1(grow)
    assert found.mean[0, 0] - r == pytest.approx(r * np.expm1(grow), rel=1e-6)
    if conversion == "mucm":
        assert abs(expectation(along, WEIGHTS, WEIGHTS)) < 1e-9 * r
    for i, e in ((0, along), (1, across)):
        assert found.cov[i, i, 0] == pytest.approx(
            float(expectation(e * e, WEIGHTS, WEIGHTS)), rel=1e-6
        )
    assert abs(found.cov[0, 1, 0]) < 1e-12 * found.cov[1, 1, 0]


@pytest.mark.parametrize(("r", "sigma_r", "sigma_a"), CASES)
def test_ducm_averages_the_error_over_the_prediction(
    r: float, sigma_r: float, sigma_a: float
) -> None:
    """E[(z - p)(z - p)'] over the true position, known to v_r and v_a, and over the noise."""
    s, v_a, v_r = sigma_a**2, (0.3 * sigma_a) ** 2, (0.7 * sigma_r) ** 2
    z = Polar(np.array([r]), np.array([0.4]), sigma_r**2, s)
    predicted = Polar(np.array([1.001 * r]), np.array([0.0]), np.array([v_r]), np.array([v_a]))
    cov = convert("ducm", z, predicted).cov[..., 0]
    # The error is quadratic in both ranges, for which few nodes are exact.
    few, few_weights = np.polynomial.hermite_e.hermegauss(6)
    few_weights = few_weights / few_weights.sum()
    rt, at, wr, wa = np.meshgrid(
        1.001 * r + np.sqrt(v_r) * few,
        np.sqrt(v_a) * NODES,
        sigma_r * few,
        sigma_a * NODES,
        indexing="ij",
    )
    grown = rt * np.expm1(0.5 * s) + np.exp(0.5 * s) * wr
    full = np.exp(0.5 * s) * (rt + wr)
    along, across = grown - 2.0 * full * np.sin(0.5 * wa) ** 2, full * np.sin(wa)
    x = along * np.cos(at) - across * np.sin(at)
    y = along * np.sin(at) + across * np.cos(at)
    for i, a in enumerate((x, y)):
        for j, b in enumerate((x, y)):
            exact = float(expectation(a * b, few_weights, WEIGHTS, few_weights, WEIGHTS))
            assert cov[i, j] == pytest.approx(exact, rel=1e-6, abs=1e-12 * cov[1, 1])


@pytest.mark.parametrize(("r", "sigma_r", "sigma_a"), CASES)
def test_ccm_is_first_order(r: float, sigma_r: float, sigma_a: float) -> None:
    """Mean and covariance of the conversion linearized at the measurement."""
    a = 0.7
    found = convert("ccm", Polar(np.array([r]), np.array([a]), sigma_r**2, sigma_a**2))
    J = np.array([[np.cos(a), -r * np.sin(a)], [np.sin(a), r * np.cos(a)]])
    np.testing.assert_allclose(found.mean[:, 0], position(np.array(r), np.array(a)), rtol=1e-12)
    exact = J @ np.diag([sigma_r**2, sigma_a**2]) @ J.T
    np.testing.assert_allclose(found.cov[..., 0], exact, rtol=1e-6)


def test_ducm_uses_the_measurement_until_the_prediction_is_sharper() -> None:
    z = Polar(np.array([1e6, 1e6]), np.array([0.1, 0.1]), 0.04, 4e-6)
    predicted = Polar(z.r + 5.0, z.a + 0.2, np.array([1.0, 1.0]), np.array([5e-6, 1e-6]))
    cov = convert("ducm", z, predicted).cov
    np.testing.assert_allclose(cov[..., 0], convert("ducm", z).cov[..., 0], rtol=1e-12)
    assert abs(cov[0, 1, 1] / convert("ducm", z).cov[0, 1, 1] - 1.0) > 0.1


@pytest.mark.parametrize(("r", "sigma_r", "sigma_a"), CASES)
def test_what_is_unbiased(
    r: float, sigma_r: float, sigma_a: float, rng: np.random.Generator
) -> None:
    """UCM in Cartesian coordinates, CCM in range; and neither of them in the other."""
    n = 200_000
    z = Polar(
        r + sigma_r * rng.standard_normal(n),
        sigma_a * rng.standard_normal(n),
        sigma_r**2,
        sigma_a**2,
    )

    def z_score(error: np.ndarray) -> float:
        return float(error.mean() / (error.std() / np.sqrt(n)))

    ucm, ccm = convert("ucm", z).mean, convert("ccm", z).mean
    assert abs(z_score(ucm[0] - r)) < 3
    assert abs(z_score(ucm[1])) < 3
    assert abs(z_score(np.sqrt(np.square(ccm).sum(axis=0)) - r)) < 3
    assert z_score(ccm[0] - r) < -10
    assert z_score(np.sqrt(np.square(ucm).sum(axis=0)) - r) > 10
