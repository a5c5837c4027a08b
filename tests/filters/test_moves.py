"""`moves` of pf, epf and upf: ratio, parents, and the posterior that they leave alone."""

from dataclasses import replace
from math import exp, gamma, log, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter, track
from tests.papers import merwe
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters import bootstrap_pf, epf_and_upf

R, Q, P0 = 0.1, 0.75, 0.5


def log_normal(x: float, mean: float, variance: float) -> float:
    return -0.5 * ((x - mean) ** 2 / variance + log(2.0 * pi * variance))


def motion(x: float, k: int) -> float:
    """x_k without its noise."""
    return 1.0 + sin(0.04 * pi * k) + 0.5 * x


def ekf(x: float, z: float, k: int) -> tuple[float, float]:
    """Mean and variance of x_k given z, linearized at the parent x."""
    mean, variance = motion(x, k) + 1.5, 0.25 * P0 + Q
    slope = 0.4 * mean
    gain = variance * slope / (slope * variance * slope + R)
    return mean + gain * (z - 0.2 * mean**2), variance - gain * slope * variance


def ukf(x: float, z: float, k: int) -> tuple[float, float]:
    """The same by seven sigma points of (state, process noise, measurement noise): kappa 2."""
    spread = sqrt(5.0)
    points = [(0.0, 0.0, 0.0)]
    for i, sd in enumerate((sqrt(P0), sqrt(Q), sqrt(R))):
        for sign in (1.0, -1.0):
            points.append(tuple(sign * spread * sd if j == i else 0.0 for j in range(3)))
    weights = [0.4] + [0.1] * 6
    states = [motion(x + dx, k) + 1.5 + v for dx, v, _ in points]
    seen = [0.2 * s * s + n for s, (_, _, n) in zip(states, points, strict=True)]
    mean = sum(w * s for w, s in zip(weights, states, strict=True))
    z_mean = sum(w * s for w, s in zip(weights, seen, strict=True))
    parts = list(zip(weights, states, seen, strict=True))
    S = sum(w * (b - z_mean) ** 2 for w, _, b in parts)
    C = sum(w * (a - mean) * (b - z_mean) for w, a, b in parts)
    P = sum(w * (a - mean) ** 2 for w, a, _ in parts)
    return mean + C / S * (z - z_mean), P - C * C / S


def log_ratio(kind: str, x: float, parent: float, z: float, k: int) -> float:
    """log of likelihood (pf), or of likelihood * prior / proposal (epf, upf)."""
    likelihood = log_normal(z, 0.2 * x * x, R)
    if kind == "pf":
        return likelihood
    noise = x - motion(parent, k)
    prior = log(2.0**3 / gamma(3.0) * noise**2 * exp(-2.0 * noise)) if noise > 0 else -np.inf
    return likelihood + prior - log_normal(x, *(ekf if kind == "epf" else ukf)(parent, z, k))


@pytest.mark.parametrize("kind", ["pf", "epf", "upf"])
def test_ratio_and_proposal_are_those_of_each_particles_parent(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parents all different, most particles resampled: a scalar program finds the same ratios."""
    keys: dict[str, Any] = {} if kind == "pf" else {"P0": P0}
    runs, N, k = 3, 6, 2
    scenario = merwe(R=R, P1=0.5)
    tracker = make_filter(kind, N=N, moves=2, resampling="multinomial", **keys)
    calls: list[Any] = []
    module = bootstrap_pf if kind == "pf" else epf_and_upf
    real = module.independence_moves

    def spied(x: Any, draw: Any, ratio: Any, steps: int, rng: Any) -> Any:
        calls.append((x, draw, ratio, steps))
        return real(x, draw, ratio, steps, rng)

    monkeypatch.setattr(module, "independence_moves", spied)
    data = scenario.simulate(RunStreams(1, range(runs)), runs)
    state = tracker.init(scenario.model, data.prior, block_stream(1, 0))
    parents, z = state.particles.x[0], data.measurements[:, 0]
    tracker.step(scenario.model, state, z, k, block_stream(2, 0))
    [(x, draw, ratio, steps)] = calls
    assert steps == 2
    # From the particles alone: a copy has its original's ratio, so it must have its parent, too.
    own = make_filter(kind, N=N, **keys)
    before = block_stream(2, 0)
    children = (
        scenario.model.motion.transition(state.particles.x, k).sample(before)
        if kind == "pf"
        else own._draw_proposals(scenario.model, state, z, k, before).x
    )
    index = np.array([[list(children[0, m]).index(v) for v in x[0, m]] for m in range(runs)])
    assert len({tuple(row) for row in index}) > 1
    points = np.stack([draw(block_stream(s, 0)) for s in range(400)])
    found = ratio(points[0])
    for m, i in np.ndindex(runs, N):
        parent = parents[m, index[m, i]]
        expected = log_ratio(kind, points[0, 0, m, i], parent, z[0, m], k)
        assert found[m, i] == pytest.approx(expected, rel=1e-9, abs=1e-9)
        mean, variance = (
            (motion(parent, k) + 1.5, 0.75)
            if kind == "pf"
            else (ekf if kind == "epf" else ukf)(parent, z[0, m], k)
        )
        drawn = points[:, 0, m, i]
        assert abs(drawn.mean() - mean) < 5.0 * sqrt(variance / len(drawn))
        assert drawn.var() == pytest.approx(variance, rel=0.6)


def distances(tracker: Any, runs: int = 40) -> tuple[np.ndarray, float]:
    """Distances (T, M) to the exact posterior mean; the square expected of a cloud that is moved.

    That is the square without moves, and the posterior variance over N for the particles drawn anew.
    """
    scenario = merwe(T=14, switch=7, R=0.1)
    exact = track(scenario, make_filter("grid"), runs).mean[0, 1:]
    still = track(scenario, replace(tracker, moves=0), runs).mean[0, 1:]
    truth = simulate(scenario, 1, 0, runs).truth[0, 1:]
    moved = track(scenario, tracker, runs).mean[0, 1:]
    expected = np.square(still - exact).mean() + np.square(truth - exact).mean() / tracker.N
    return moved - exact, expected


@pytest.mark.parametrize("kind", ["pf", "epf", "upf"])
def test_the_posterior_stays_what_it_is(kind: str) -> None:
    off, expected = distances(make_filter(kind, N=800, moves=3, estimate_from="resampled"))
    assert np.square(off).mean() < 1.3 * expected
    per_run = off.mean(axis=0)
    assert abs(per_run.mean()) < 4.0 * per_run.std() / np.sqrt(len(per_run))


def test_moves_part_copies() -> None:
    scenario = merwe(R=0.1)
    data = scenario.simulate(RunStreams(1, range(20)), 20)
    number = {}
    for moves in (0, 1):
        tracker = make_filter("pf", N=50, moves=moves)
        state = tracker.init(scenario.model, data.prior, block_stream(1, 0))
        state = tracker.step(scenario.model, state, data.measurements[:, 0], 2, block_stream(2, 0))
        number[moves] = len(np.unique(state.particles.x))
    assert number[1] > 1.2 * number[0]


def test_moves_need_no_resampling() -> None:
    """Where a run is not resampled its particles keep weights and parents, and move all the same."""
    off, expected = distances(
        make_filter("pf", N=800, moves=2, ess_threshold=0.3, estimate_from="resampled")
    )
    assert np.square(off).mean() < 1.3 * expected
