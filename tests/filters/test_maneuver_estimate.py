"""Estimated inputs against an augmented Kalman filter with a diffuse acceleration."""

import numpy as np
import pytest

from trackbench.core.distributions import Gaussian
from trackbench.filters.adaptive_kf.per_axis import axis_step
from trackbench.filters.input_estimation import Hypotheses, empty_hypotheses
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity

T, R, RUNS, WINDOW = 2.0, np.array([[9.0]]), 5, 12
CV = ConstantVelocity(q=0.0).axis(T)
CA = ConstantAcceleration(q=0.0).axis(T)


def start(rng: np.random.Generator) -> Gaussian:
    cov = np.array([[9.0, 4.5], [4.5, 4.5]])[:, :, None, None]
    return Gaussian(rng.standard_normal((2, 2, RUNS)), np.broadcast_to(cov, (2, 2, 1, RUNS)))


def run(
    rng: np.random.Generator, steps: int, gap: int | None = None
) -> tuple[list[Gaussian], list[np.ndarray], Hypotheses]:
    """Posteriors of the quiescent filter, measurements, and the hypotheses after the last step."""
    state, found = start(rng), empty_hypotheses(WINDOW, 1, RUNS)
    states, seen = [state], [np.full((2, RUNS), np.nan)]
    g = np.array([T**2 / 2, T])
    for k in range(1, steps + 1):
        z = 3.0 * rng.standard_normal((2, RUNS)) + 0.4 * k**2
        if k == gap:
            z[:, 0] = np.nan
        state, innovation = axis_step(state, CV, z, R)
        found = found.update(k, CV.F, g, state, innovation, R)
        states.append(state)
        seen.append(z)
        if k < steps:
            found = found.add_onset(k)
    return states, seen, found


def diffuse(state: Gaussian, zs: list[np.ndarray], spread: float) -> Gaussian:
    """A constant-acceleration filter from the onset's posterior with a vast acceleration variance."""
    mean = np.concatenate([state.mean, np.zeros((1, 2, RUNS))])
    cov = np.zeros((3, 3, 1, RUNS))
    cov[:2, :2], cov[2, 2] = state.cov, spread
    augmented = Gaussian(mean, cov)
    for z in zs:
        augmented, _ = axis_step(augmented, CA, z, R)
    return augmented


@pytest.mark.parametrize("onset", [9, 12, 18])
@pytest.mark.parametrize("gap", [None, 15])
def test_input_and_augmented_state_are_those_of_a_diffuse_filter(
    onset: int, gap: int | None, rng: np.random.Generator
) -> None:
    steps = 20
    states, seen, found = run(rng, steps, gap)
    expected = diffuse(states[onset], seen[onset + 1 :], spread=1e7)
    slot = np.full(RUNS, onset % WINDOW)
    np.testing.assert_array_equal(found.onset(slot, steps), onset)
    chosen = found.select(slot, np.arange(RUNS))
    augmented = chosen.augment(states[-1])
    # A finite prior variance v biases by L / v, of order 1e-6 here.
    np.testing.assert_allclose(chosen.u, expected.mean[2], rtol=2e-5, atol=2e-5)
    np.testing.assert_allclose(augmented.mean, expected.mean, rtol=2e-5, atol=2e-4)
    np.testing.assert_allclose(
        np.broadcast_to(augmented.cov, expected.cov.shape), expected.cov, rtol=2e-4, atol=1e-6
    )


def test_significance_of_noise_alone_is_chi_square(rng: np.random.Generator) -> None:
    """Mean 2 and variance 4 for one onset of a consistent filter without an input."""
    runs, steps = 20_000, 10
    P = np.array([[9.0, 4.5], [4.5, 9.0]])
    x = np.linalg.cholesky(P) @ rng.standard_normal((2, 2 * runs))
    truth = x.reshape(2, 2, runs)
    state = Gaussian(np.zeros((2, 2, runs)), np.broadcast_to(P[:, :, None, None], (2, 2, 1, runs)))
    found, g = empty_hypotheses(WINDOW, 1, runs), np.array([T**2 / 2, T])
    for k in range(1, steps + 1):
        truth = np.einsum("ij,jab->iab", CV.F, truth)
        state, innovation = axis_step(state, CV, truth[0] + 3.0 * rng.standard_normal((2, runs)), R)
        found = found.update(k, CV.F, g, state, innovation, R)
    zeta = found.significance()[0]
    assert abs(zeta.mean() - 2.0) < 4.0 * np.sqrt(4.0 / runs)
    assert abs((zeta > 6.0).mean() - np.exp(-3.0)) < 4.0 * np.sqrt(np.exp(-3.0) / runs)


def test_a_restart_forgets_older_onsets(rng: np.random.Generator) -> None:
    states, seen, found = run(rng, 10)
    where = np.array([True, False, False, True, False])
    fresh = found.reset(where, 10).add_onset(10)
    assert not fresh.significance()[:, where].any()
    _, innovation = axis_step(states[-1], CV, seen[-1], R)
    later = fresh.update(11, CV.F, np.array([T**2 / 2, T]), states[-1], innovation, R)
    ages = 11 - later.onset(later.slot_of(WINDOW, 11), 11)
    np.testing.assert_array_equal(ages[where], 1)
    np.testing.assert_array_equal(ages[~where], 11)  # the first step was 1: the onset of step 0
