"""Mixing of models against the Markov chain and against direct sums."""

import numpy as np
import pytest

from trackbench.core.distributions import Gaussian
from trackbench.core.imm_probabilities_and_mixing import pad, predict_weights, update_weights
from trackbench.core.kalman import Innovation
from trackbench.core.mixtures import combine

TRANSITION = np.array(
    [[0.9, 0.1, 0.0], [0.2, 0.5, 0.3], [0.05, 0.15, 0.8]]
)  # asymmetric on purpose


def test_without_data_the_weights_follow_the_markov_chain() -> None:
    w = np.array([[1.0, 0.2], [0.0, 0.3], [0.0, 0.5]])
    expected = w.copy()
    for _ in range(7):
        w, mixing = predict_weights(w, TRANSITION)
        expected = TRANSITION.T @ expected
        np.testing.assert_allclose(w, expected)
        np.testing.assert_allclose(mixing.sum(axis=0), 1.0)


def test_mixing_weights_are_those_of_bayes() -> None:
    w = np.array([[0.2], [0.3], [0.5]])
    after, mixing = predict_weights(w, TRANSITION)
    for i in range(3):
        for j in range(3):
            assert mixing[i, j, 0] == pytest.approx(TRANSITION[i, j] * w[i, 0] / after[j, 0])


def test_an_unreachable_model_keeps_its_own_estimate() -> None:
    w, mixing = predict_weights(np.array([[1.0], [0.0]]), np.eye(2))
    np.testing.assert_array_equal(w, [[1.0], [0.0]])
    np.testing.assert_array_equal(mixing[:, 1, 0], [0.0, 1.0])


def test_weights_survive_a_huge_likelihood_ratio() -> None:
    w = update_weights(np.full((2, 1), 0.5), np.array([[10_000.0], [2.0]]))
    assert np.isfinite(w).all()
    assert w.sum() == pytest.approx(1.0)
    assert w[0, 0] < 1e-300


def test_combined_moments_are_the_mixture_s(rng: np.random.Generator) -> None:
    w = np.array([[0.3], [0.7]])
    a = Gaussian(np.array([[0.0], [1.0]]), np.diag([1.0, 2.0]))
    b = Gaussian(np.array([[3.0], [-1.0]]), np.diag([0.5, 4.0]))
    got = combine([a, b], w)
    mean = 0.3 * a.mean[:, 0] + 0.7 * b.mean[:, 0]
    second = sum(
        v * (s.cov + np.outer(s.mean, s.mean)) for v, s in zip((0.3, 0.7), (a, b), strict=True)
    )
    np.testing.assert_allclose(got.mean[:, 0], mean)
    np.testing.assert_allclose(got.cov[:, :, 0], second - np.outer(mean, mean))


@pytest.mark.parametrize("unbiased", [True, False])
def test_padding_fills_with_the_longer_state_or_with_zeros(unbiased: bool) -> None:
    short = Gaussian(np.ones((2, 1)), np.eye(2))
    long = Gaussian(np.full((3, 1), 5.0), np.full((3, 3), 1.0) + np.eye(3))
    got = pad(short, long, ((0, 1), (0, 1)), unbiased)
    np.testing.assert_array_equal(got.mean[:, 0], [1.0, 1.0, 5.0 if unbiased else 0.0])
    np.testing.assert_array_equal(np.diag(got.cov[:, :, 0]), [1.0, 1.0, 2.0 if unbiased else 0.0])
    np.testing.assert_array_equal(
        pad(long, short, ((0, 1), (0, 1)), unbiased).mean[:, 0], [5.0, 5.0]
    )


def test_weights_stay_as_predicted_where_no_model_explains_the_data() -> None:
    predicted = np.array([[0.2, 0.5], [0.8, 0.5]])
    nis = np.array([[np.inf, 0.0], [np.inf, np.inf]])
    found = update_weights(predicted, nis)
    np.testing.assert_array_equal(found[:, 0], predicted[:, 0])
    np.testing.assert_allclose(found[:, 1], [1.0, 0.0], atol=1e-300)


def test_a_hundred_small_pivots_do_not_underflow(rng: np.random.Generator) -> None:
    """The product of their roots is 1e-400; probabilities are those of sums of logarithms."""
    factors = np.array([[1.0], [1.7]]) ** 0.1
    S = [np.eye(100)[..., None] * np.square(1e-4 * f) for f in factors]
    nu = 1e-4 * rng.standard_normal((100, 1))
    judged = [Innovation(nu, cov).nis_and_scale() for cov in S]
    nis, mantissa, exponent = (np.stack(rows) for rows in zip(*judged, strict=True))
    w = update_weights(np.full((2, 1), 0.5), nis, mantissa, exponent)
    logs = [
        -0.5 * float((nu**2).sum() / v) - 50.0 * np.log(v) for v in np.square(1e-4 * factors[:, 0])
    ]
    expected = 1.0 / (1.0 + np.exp(logs[0] - logs[1]))
    assert w[1, 0] == pytest.approx(expected, rel=1e-10)
    assert 1e-6 < w[1, 0] < 1.0 - 1e-6


def test_an_impossible_model_of_infinite_density_does_not_spoil_the_weights() -> None:
    predicted = np.array([[0.3], [0.0], [0.7]])
    nis = np.array([[4000.0], [1.0], [4001.0]])
    weights = update_weights(predicted, nis)
    assert weights[1] == 0.0
    assert np.isclose(weights.sum(), 1.0)
