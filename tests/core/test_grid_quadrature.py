"""The exact posterior: against refinement, against simple cases, and as a floor."""

import numpy as np
import pytest

from tests.conftest import make_filter, per_run, track
from tests.papers import merwe
from trackbench.core.arrays import Array
from trackbench.core.grid_quadrature import Panel, refined, weights_up_to
from trackbench.evaluation.simulated_runs import simulate
from trackbench.models.likelihood import log_likelihood
from trackbench.scenarios.tracking import Tracking

EXACT = make_filter("grid", nodes=64)
"""Half of the default nodes, a quarter of the work: the first test says that nothing is lost by it."""


@pytest.mark.parametrize(("R", "tolerance"), [(1e-5, 1e-9), (0.1, 1e-6), (1.0, 1e-6)])
def test_halving_the_default_grid_changes_nothing(R: float, tolerance: float) -> None:
    """In posterior standard deviations, at the worst step of the worst run."""
    scenario = merwe(R=R)
    fine = track(scenario, make_filter("grid"), runs=12)
    coarse = track(scenario, EXACT, runs=12)
    nees = fine.nees[1:]
    error = fine.mean[0, 1:] - _truth(scenario, 12)[0, 1:]
    deviation = np.abs(error) / np.sqrt(nees)
    change = np.abs(fine.mean[0, 1:] - coarse.mean[0, 1:]) / deviation
    assert change.max() < tolerance


def test_posterior_is_consistent() -> None:
    """NEES of an exact posterior has mean one."""
    nees = track(merwe(R=0.1), make_filter("grid", nodes=40), runs=400).nees[1:]
    per_run_mean = nees.mean(axis=0)
    assert abs(per_run_mean.mean() - 1) < 4 * per_run_mean.std() / 20


def test_equals_importance_sampling_of_the_joint_posterior() -> None:
    """Three steps, two million draws of the whole path from the prior, weighted by the likelihood."""
    scenario = merwe(R=1.0, T=4)
    seen = _simulated(scenario, 3)
    exact = track(scenario, EXACT, runs=3)
    rng = np.random.Generator(np.random.SFC64(5))
    model = scenario.model
    x = np.ones((1, 3, 300_000))
    log_w = np.zeros(x.shape[1:])
    for i, k in enumerate(scenario.steps[1:]):
        x = model.motion.transition(x, int(k)).sample(rng)
        log_w += log_likelihood(model.sensor, seen.measurements[:, i], x, int(k))
        w = np.exp(log_w - log_w.max(axis=1, keepdims=True))
        w /= w.sum(axis=1, keepdims=True)
        mean = (w * x[0]).sum(axis=1)
        stderr = np.sqrt((w**2 * (x[0] - mean[:, None]) ** 2).sum(axis=1))
        assert (np.abs(mean - exact.mean[0, i + 1]) < 4 * stderr).all()


@pytest.mark.parametrize(
    ("kind", "lowest"), [("pf", 3.2), ("apf", 2.6), ("rpf", 3.2), ("upf", 3.2)]
)
def test_particle_filters_tend_to_it(kind: str, lowest: float) -> None:
    """R = 0.1: the typical distance to the exact mean falls like N^-1/2, by 4 for 16 times N.

    The rms is owned by the few steps where the truth is far in the prior's tail. The second-stage
    weights p(z|x) / p(z|mu) of the APF are unbounded where p(z|mu) is small: it is slower.
    """
    scenario, runs = merwe(R=0.1), 24
    exact = track(scenario, EXACT, runs).mean
    few, many = (
        np.median(np.abs(track(scenario, make_filter(kind, N=N), runs).mean - exact)[0, 1:])
        for N in (200, 3200)
    )
    # A median of 24 x 49 distances, correlated within a run, is known to about 5 % each.
    assert lowest < few / many < 4.8


@pytest.mark.parametrize("R", [1e-5, 0.1])
def test_no_filter_beats_it(R: float) -> None:
    scenario, runs = merwe(R=R), 100
    floor = np.square(per_run(scenario, EXACT, runs))
    others = {
        "pf": {"N": 100},
        "apf": {"N": 100},
        "rpf": {"N": 100},
        "upf": {"N": 20},
        "epf": {"N": 20},
        "ekf": {},
        "ukf": {},
        "pfde": {},
        "hdepf": {},
        "inversion": {},
    }
    for kind, keys in others.items():
        gap = np.square(per_run(scenario, make_filter(kind, **keys), runs)) - floor
        assert gap.mean() > -3 * gap.std(ddof=1) / np.sqrt(runs), kind


def _simulated(scenario: Tracking, runs: int):
    return simulate(scenario, 1, 0, runs)


def _truth(scenario: Tracking, runs: int) -> np.ndarray:
    return _simulated(scenario, runs).truth


def test_partial_weights_integrate_polynomials_exactly() -> None:
    t = np.linspace(-1.0, 1.0, 7)
    nodes, weights = np.polynomial.legendre.leggauss(9)
    got = weights_up_to(t, 9)
    for power in range(9):
        exact = (t ** (power + 1) - (-1.0) ** (power + 1)) / (power + 1)
        np.testing.assert_allclose(got @ nodes**power, exact, atol=1e-14)
    np.testing.assert_allclose(weights_up_to(np.ones(1), 9)[0], weights)


def test_a_gamma_noise_of_any_shape_and_a_falling_motion() -> None:
    """Against a brute-force sum on a dense grid, two steps after a known state."""
    for keys in ({"gamma_shape": 2.5}, {"phi1": -0.5}, {"phi1": 0.0}):
        scenario = merwe(R=0.5, T=3, **keys)
        seen, exact = _simulated(scenario, 2), track(scenario, EXACT, 2)
        x = np.linspace(-12, 14, 3001)
        density = None
        for i, k in enumerate(scenario.steps[1:]):
            motion, sensor = scenario.model
            if density is None:
                predicted = np.exp(motion.transition(np.ones((1, 1)), int(k)).log_prob(x[None]))
                predicted = np.tile(predicted, (2, 1))
            else:
                kernel = np.exp(motion.transition(x[None, :, None], int(k)).log_prob(x[None, None]))
                predicted = density @ kernel
            nu = (
                seen.measurements[0, i][:, None] - sensor.measurement(x[None, None], int(k)).mean[0]
            )
            density = predicted * np.exp(-0.5 * nu**2 / scenario.sensor.R)
            density /= density.sum(axis=1, keepdims=True)
            np.testing.assert_allclose(density @ x, exact.mean[0, i + 1], atol=2e-3)


@pytest.mark.parametrize("other_density", [1e9, np.nan])
def test_a_refined_density_does_not_depend_on_the_other_runs(other_density: float) -> None:
    """It lost all digits beside a run of a density that is 1e15 times as large."""
    n = 16
    x = np.polynomial.legendre.leggauss(n)[0][:, None]
    density = 1e-6 * np.exp(-np.square(x))
    alone = _refined(x, density)
    beside = _refined(np.repeat(x, 2, axis=1), np.hstack([density, np.full((n, 1), other_density)]))
    np.testing.assert_array_equal(beside[:, 0], alone[:, 0])


def _refined(x: Array, density: Array) -> Array:
    """Return the density (64, M) of panels from -1 to 1 that have it (n, M) at the nodes x (n, M)."""
    end = np.ones(x.shape[1])
    (panel,) = refined((Panel(low=-end, high=end, x=x, density=density),), 64)
    return panel.density
