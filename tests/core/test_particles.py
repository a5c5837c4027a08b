import numpy as np

from trackbench.core import particle_weights
from trackbench.core.particle_weights import read_likelihood
from trackbench.core.particles import Particles


def test_weights_survive_any_level_of_log_likelihood() -> None:
    w, dead, _ = particle_weights.normalize(
        np.array([[-1e6, -1e6 + np.log(3.0)], [5000.0, 4000.0]])
    )
    np.testing.assert_allclose(w, [[0.25, 0.75], [1.0, 0.0]], atol=1e-12)
    assert not dead.any()


def test_dead_runs_are_uniform_and_marked_and_broken_ones_stay_broken() -> None:
    w, dead, _ = particle_weights.normalize(
        np.array([[-np.inf, -np.inf], [np.nan, 0.0], [-np.inf, 0.0]])
    )
    np.testing.assert_array_equal(dead, [True, False, False])
    np.testing.assert_array_equal(w[0], [0.5, 0.5])
    assert np.isnan(w[1]).all()
    np.testing.assert_allclose(w[2], [0.0, 1.0], atol=1e-300)


def test_a_particle_without_weight_has_exactly_none() -> None:
    """A cloud of which one particle is left has no spread at all, not one that a clip sets."""
    log_w = np.array([[0.0, -690.0, -701.0, -1e5] * 20, [0.0, -1e4, -1e4, -1e5] * 20])
    log_w[1, 4:] = -1e4
    w, _, _ = particle_weights.normalize(log_w)
    assert (w[:, 2:4] == 0.0).all()
    assert (w[0, :2] > 0.0).all()
    cloud = Particles(np.arange(160.0).reshape(1, 2, 80), w)
    assert cloud.moments().cov[0, 0, 0] > 0.0
    assert cloud.moments().cov[0, 0, 1] == 0.0


def test_readings_of_a_likelihood_are_what_float64_would_have_seen() -> None:
    log_lik = np.array([[0.0, -700.0, -744.0, -746.0, -1e5]])
    with np.errstate(under="ignore"):
        naive = np.exp(log_lik)
    np.testing.assert_allclose(np.exp(read_likelihood(log_lik, "naive")), naive)
    assert np.isneginf(read_likelihood(log_lik, "naive")[0, 3:]).all()
    np.testing.assert_allclose(np.exp(read_likelihood(log_lik, "floor")), naive + 1e-99)
    np.testing.assert_array_equal(read_likelihood(log_lik, "log"), log_lik)


def test_moments_keep_their_digits_far_from_the_origin(rng: np.random.Generator) -> None:
    x = rng.standard_normal((2, 3, 500)) + 1e7
    w = rng.random((3, 500))
    w /= w.sum(axis=1, keepdims=True)
    moments = Particles(x, w).moments()
    for m in range(3):
        exact = np.cov(x[:, m] - 1e7, aweights=w[m], ddof=0)
        np.testing.assert_allclose(moments.cov[..., m], exact, rtol=1e-6, atol=1e-8)
