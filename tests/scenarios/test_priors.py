"""Uniform and mixture priors, and a prior in a filter's model, against exact answers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from tests.commands import trackbench
from trackbench import api
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian, Uniform
from trackbench.core.mixtures import GaussianMixture
from trackbench.core.random_streams import block_stream
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.models.augmented_priors import augment_prior

CONFIG = """name: prior
runs: 6
scenario:
  kind: tracking
  last: 5
  target: {kind: driven, motion: {kind: ar1, phi: 0.9, q: 0.5}}
  sensor: {kind: scalar, sigma: 1.4142135623730951}
  start: START
filters: {FILTERS}
tables:
  errors: {kind: metrics, columns: {RMSE: rms(rmse)}}
"""
MIXTURE = """
    kind: mixture
    parts:
      - {weight: 1, mean: {x: -4}, sigma: {x: 0.5}}
      - {weight: 3, mean: {x: 3}, sigma: {x: 2}}
      - {weight: 2, mean: {x: 3.5}, sigma: {x: 0.3}}"""
WEIGHTS, MEANS, SIGMAS = np.array([1, 3, 2]) / 6, np.array([-4, 3, 3.5]), np.array([0.5, 2, 0.3])
UNIFORM = "{kind: uniform, low: {x: -3}, high: {x: 5}}"
PHI, Q, R = 0.9, 0.5, 2.0


def output(tmp_path: Path, start: str, filters: str, runs: int = 6) -> tuple[Any, dict[str, Any]]:
    """Return simulated data and each filter's output."""
    path = tmp_path / "prior.yaml"
    path.write_text(CONFIG.replace("START", start).replace("FILTERS", filters))
    point = load(path).points[0]
    data = simulate(point.scenario, 1, 0, runs)
    out = {}
    for label, tracker in point.filters.items():
        assume = point.assumed.get(label)
        task = BlockTask(point.scenario, tracker, 1, 0, runs, runs, assume=assume)
        out[label] = run_filter(task, data)
    return data, out


def scalar_kf(z: Array, m: Array, P: Array) -> tuple[Array, Array, Array]:
    """Return means, variances (T, r) and log evidence (r,) of r scalar Kalman filters."""
    means, variances, evidence = [], [], np.zeros(len(m))
    for value in z:
        m, P = PHI * m, PHI * PHI * P + Q
        evidence += norm.logpdf(value, m, np.sqrt(P + R))
        m, P = m + P / (P + R) * (value - m), P * R / (P + R)
        means.append(m)
        variances.append((P, evidence.copy()))
    every, logs = zip(*variances, strict=True)
    return np.array(means), np.array(every), np.array(logs)


def test_mixture_prior_of_a_linear_model_is_the_mixture_of_kalman_filters(tmp_path: Path) -> None:
    filters = "G: {kind: grid}, PF: {kind: pf, N: 20000}, KF: {kind: kf}"
    data, out = output(tmp_path, MIXTURE, filters)
    for run in range(6):
        means, _, logs = scalar_kf(data.measurements[0, :, run], MEANS, SIGMAS**2)
        w = WEIGHTS * np.exp(logs - logs.max(axis=1, keepdims=True))
        exact = (w * means).sum(axis=1) / w.sum(axis=1)
        np.testing.assert_allclose(out["G"].mean[0, 1:, run], exact, atol=1e-8)
        # A bootstrap filter's error is some standard deviations over the root of N.
        assert np.abs(out["PF"].mean[0, 1:, run] - exact).max() < 8 * 3 / np.sqrt(20000)
        # The Kalman filter starts from the moments of the mixture.
        m = WEIGHTS @ MEANS
        P = WEIGHTS @ (SIGMAS**2 + (MEANS - m) ** 2)
        matched, _, _ = scalar_kf(data.measurements[0, :, run], np.array([m]), np.array([P]))
        np.testing.assert_allclose(out["KF"].mean[0, 1:, run], matched[:, 0], atol=1e-12)
        assert np.abs(matched[:, 0] - exact).max() > 0.05


def test_uniform_prior_on_the_grid_is_a_sum(tmp_path: Path) -> None:
    data, out = output(tmp_path, UNIFORM, "G: {kind: grid}, KF: {kind: ekf}")
    x = np.linspace(-12.0, 14.0, 5201)
    kernel = norm.pdf(x[:, None], PHI * x, np.sqrt(Q)) * (x[1] - x[0])
    for run in range(6):
        # Half the height at a jump makes the trapezoidal rule exact there.
        p = np.where(np.abs(x - 1) < 4 - 1e-9, 1.0, 0.0)
        p[np.isclose(np.abs(x - 1), 4)] = 0.5
        for k, z in enumerate(data.measurements[0, :, run]):
            p = kernel @ p * norm.pdf(z, x, np.sqrt(R))
            p /= p.sum()
            np.testing.assert_allclose(out["G"].mean[0, k + 1, run], p @ x, atol=1e-5)
        matched, _, _ = scalar_kf(
            data.measurements[0, :, run], np.array([1.0]), np.array([64 / 12])
        )
        np.testing.assert_allclose(out["KF"].mean[0, 1:, run], matched[:, 0], atol=1e-12)
    assert (np.abs(data.truth[0, 0] - 1) <= 4).all()


P1, P2 = np.array([[2.0, 0.5], [0.5, 1.0]]), np.diag([0.3, 4.0])
PRIORS = {
    "uniform": Uniform(np.array([-1.0, 2.0]), np.array([3.0, 2.5]), 2),
    "mixture": GaussianMixture(
        np.array([0.3, 0.7]),
        (Gaussian(np.array([0.0, 1.0]), P1), Gaussian(np.array([4.0, -2.0]), P2)),
        2,
    ),
}


@pytest.mark.parametrize("name", PRIORS)
def test_draws_have_the_stated_moments(name: str) -> None:
    prior, N = PRIORS[name], 40_000
    x = prior.sample(block_stream(3, 0), N)
    assert x.shape == (2, 2, N)
    for run in range(2):
        e = x[:, run] - prior.mean[:, [run]]
        assert (np.abs(e.mean(axis=1)) < 5 * np.sqrt(np.diag(prior.cov) / N)).all()
        products = e[:, None] * e[None]
        error = products.std(axis=-1) / np.sqrt(N)
        assert (np.abs(products.mean(axis=-1) - prior.cov) < 5 * error).all()


def test_densities() -> None:
    x = np.random.default_rng(1).normal(size=(2, 2, 7))
    parts = [([0, 1], P1, 0.3), ([4, -2], P2, 0.7)]
    exact = sum(w * multivariate_normal(m, P).pdf(np.moveaxis(x, 0, -1)) for m, P, w in parts)
    np.testing.assert_allclose(PRIORS["mixture"].log_prob(x), np.log(exact), rtol=1e-12)
    inside = np.array([[0.0, 0.0], [2.25, 2.75]])
    np.testing.assert_allclose(PRIORS["uniform"].log_prob(inside), [-np.log(2.0), -np.inf])
    np.testing.assert_array_equal(PRIORS["mixture"].mode[:, 0], [4, -2])


def test_further_components_leave_the_prior_as_it_is() -> None:
    prior = augment_prior(PRIORS["uniform"], (0.5,))
    x = prior.sample(block_stream(3, 0), 5000)
    assert x.shape == (3, 2, 5000)
    assert (x[0] >= -1).all()
    assert (x[0] <= 3).all()
    np.testing.assert_allclose(np.diag(prior.cov), [16 / 12, 0.25 / 12, 0.25])
    at = np.array([[0.0], [2.25], [1.0]])
    np.testing.assert_allclose(prior.log_prob(at), -np.log(2) + norm.logpdf(1.0, 0, 0.5))


WRONG = "assume: {start: {kind: given, mean: {x: 3}, sigma: {x: 0.5}}}"


def test_nees_of_a_wrong_prior_is_that_of_the_exact_recursion(tmp_path: Path) -> None:
    runs, start = 4000, "{kind: gaussian, sigma: {x: 1}}"
    data, out = output(tmp_path, start, f"KF: {{kind: kf}}, W: {{kind: kf, {WRONG}}}", runs)
    # The filter's variance P and gain K, and the error's true mean b and variance S.
    P, b, S = 0.25, 3.0, 1.0
    for k in range(6):
        if k:
            P = PHI * PHI * P + Q
            K = P / (P + R)
            b, P = (1 - K) * PHI * b, (1 - K) * P
            S = (1 - K) ** 2 * (PHI * PHI * S + Q) + K * K * R
        nees = out["W"].nees[k]
        assert abs(nees.mean() - (S + b * b) / P) < 5 * nees.std() / np.sqrt(runs)
        calibrated = out["KF"].nees[k]
        assert abs(calibrated.mean() - 1.0) < 5 * calibrated.std() / np.sqrt(runs)
    # A filter without a prior in its entry is the same beside one with it.
    _, alone = output(tmp_path, start, "KF: {kind: kf}", runs)
    assert alone["KF"].mean.tobytes() == out["KF"].mean.tobytes()
    assert data.prior.mean.max() == 0.0


def test_a_first_state_beside_a_start_that_draws_it_is_a_mistake(tmp_path: Path) -> None:
    text = CONFIG.replace("START", UNIFORM).replace("FILTERS", "KF: {kind: kf}")
    (tmp_path / "prior.yaml").write_text(text.replace("q: 0.5}}", "q: 0.5}, initial: [1]}"))
    done = trackbench("check", "prior.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "`uniform` draws the first state" in done.stderr


def test_a_sweep_and_the_lower_bound(tmp_path: Path) -> None:
    text = CONFIG.replace("START", UNIFORM).replace("FILTERS", f"W: {{kind: kf, {WRONG}}}")
    (tmp_path / "prior.yaml").write_text(text)
    swept = ("sweep", "prior.yaml", "--grid", "filters.W.assume.start.sigma.x=0.5,1")
    done = trackbench(*swept, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (tmp_path / "prior.yaml").write_text(text + "bound: CRLB\n")
    done = trackbench("check", "prior.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "the bound is of a normal first state" in done.stderr


COMPASS = """
name: compass
seed: 1
runs: 50
scenario:
  kind: tracking
  last: 3
  target:
    kind: driven
    motion: {kind: map, components: [h], angles: [h], next: {h: h}, Q: 0.0001}
  sensor: {kind: function, h: {z: "atan2(sin(h), cos(h))"}, R: 0.25}
  start:
    kind: mixture
    parts:
      - {weight: 1, mean: {h: 3.04}, sigma: {h: 0.05}}
      - {weight: 1, mean: {h: OTHER}, sigma: {h: 0.05}}
filters: {EKF: {kind: ekf}, Grid: {kind: grid}, None: {kind: prior-mean}}
"""


def test_a_mixture_of_angles_across_the_cut_is_that_on_one_turn(tmp_path: Path) -> None:
    """3.04 and -3.04 rad are .2 apart: numbers of all filters, and the prior's own moments."""
    config = tmp_path / "compass.yaml"
    rmse = []
    for other in ("-3.04", repr(2.0 * np.pi - 3.04)):
        config.write_text(COMPASS.replace("OTHER", other))
        prior = load(config).points[0].scenario._start.distribution(1)
        assert np.cos(prior.mean - np.pi) == pytest.approx(1.0, abs=1e-12)
        assert np.sqrt(prior.cov[0, 0]) == pytest.approx(np.hypot(0.05, np.pi - 3.04), rel=1e-9)
        report = api.run(config, out=tmp_path / "out", workers=1, fresh=True, formats=())
        rmse.append(report.summary.query("metric == 'rms(rmse)'")["value"].to_numpy())
    assert rmse[0] == pytest.approx(rmse[1], rel=1e-9)
    assert (rmse[0] < 0.2).all()
