"""Filters of a heading whose first value is hardly known, against programs of a few lines."""

from functools import cache
from math import atan2, cos, exp, pi, sin, sqrt

import numpy as np
import pytest

from tests.conftest import make_filter, track
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.mixtures import combine
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.base import AnyFilter, WrongReturnError
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

TURN, Q, R = 0.2, 0.01, 0.04
SIGMA, LAST, RUNS = 1.8, 8, 150
STAY = 0.95


def _motion(turn: float, angles: tuple[str, ...] = ("h",)) -> MapMotion:
    return MapMotion(components=("h",), next={"h": f"h + {turn}"}, Q=Q, angles=angles)


def _scenario(compass: FunctionSensor | None = None, angles: tuple[str, ...] = ("h",)) -> Tracking:
    return Tracking(
        target=Driven(motion=_motion(TURN, angles), initial={"h": 0.0}),
        sensor=compass or FunctionSensor(h={"z": "atan2(sin(h), cos(h))"}, R=R),
        start=GaussianStart(sigma=(SIGMA,)),
        last=LAST,
    )


def _both_motions(angles: tuple[str, ...] = ("h",)) -> dict[str, object]:
    motions = (_motion(TURN, angles), _motion(-TURN, angles))
    return {"motions": motions, "transition": ((STAY, 1.0 - STAY), (1.0 - STAY, STAY))}


def _wrapped(angle: float) -> float:
    return atan2(sin(angle), cos(angle))


def _rms(errors: Array) -> float:
    """Root mean square of errors that are equal after whole turns."""
    return float(np.sqrt(np.mean(np.square(np.arctan2(np.sin(errors), np.cos(errors))))))


@cache
def _exact_directions() -> Array:
    """Return the mean directions (LAST, RUNS) of the exact posteriors, by a grid of the circle."""
    data = simulate(_scenario(), 1, 0, RUNS)
    prior, z = data.prior.mean[0], data.measurements[0]
    n = 256
    x = 2.0 * pi * np.arange(n) / n
    turns = 2.0 * pi * np.arange(-4, 5)
    p = np.zeros((n, RUNS))
    step = np.zeros((n, n))
    for turn in turns:
        p += np.exp(-0.5 * (x[:, None] - prior + turn) ** 2 / SIGMA**2)
        step += np.exp(-0.5 * (x[:, None] - x - TURN + turn) ** 2 / Q)
    out = []
    for k in range(LAST):
        p = step @ p
        p *= sum(np.exp(-0.5 * (z[k] - x[:, None] + turn) ** 2 / R) for turn in turns)
        p /= p.sum(axis=0)
        out.append(np.arctan2(np.sin(x) @ p, np.cos(x) @ p))
    return np.array(out)


def _own_imm(prior: float, z: Array) -> list[float]:
    """Return the mean directions of an IMM of two motions of a heading, means mixed on the circle."""
    m, P, mu = [prior, prior], [SIGMA**2] * 2, [0.5, 0.5]
    chain = ((STAY, 1.0 - STAY), (1.0 - STAY, STAY))

    def mix(w: list[float], m: list[float], P: list[float]) -> tuple[float, float]:
        center = atan2(
            sum(a * sin(b) for a, b in zip(w, m, strict=True)),
            sum(a * cos(b) for a, b in zip(w, m, strict=True)),
        )
        near = [center + _wrapped(b - center) for b in m]
        mean = sum(a * b for a, b in zip(w, near, strict=True))
        each = zip(w, near, P, strict=True)
        return mean, sum(a * (p + (b - mean) ** 2) for a, b, p in each)

    out = []
    for value in z:
        c = [sum(chain[i][j] * mu[i] for i in range(2)) for j in range(2)]
        new_m, new_P, likelihood = [], [], []
        for j, turn in enumerate((TURN, -TURN)):
            a, p = mix([chain[i][j] * mu[i] / c[j] for i in range(2)], m, P)
            a, p = a + turn, p + Q
            nu, S = _wrapped(value - a), p + R
            new_m.append(a + p / S * nu)
            new_P.append(p - p * p / S)
            likelihood.append(c[j] * exp(-0.5 * nu * nu / S) / sqrt(S))
        m, P = new_m, new_P
        mu = [weight / sum(likelihood) for weight in likelihood]
        out.append(mix(mu, m, P)[0])
    return out


FILTERS = {
    "ukf": make_filter("ukf"),
    "ckf": make_filter("ckf"),
    "wide ukf": make_filter("ukf", kappa=6.0, noise="additive"),
    "iplf": make_filter("iplf"),
    "gpf": make_filter("gpf", N=500),
    "rpf": make_filter("rpf", N=500),
    "jitter-pf": make_filter("jitter-pf", N=500),
    "pf": make_filter("pf", N=500, moves=1, estimate_from="resampled"),
    "enkf": make_filter("enkf", N=200),
    "etkf": make_filter("enkf", form="etkf", N=200),
    "edh": make_filter("edh", N=200),
}


@pytest.mark.parametrize("label", FILTERS)
@pytest.mark.parametrize("named", ["by the motion", "by the sensor"])
def test_a_wide_first_heading_is_averaged_on_the_circle(label: str, named: str) -> None:
    scenario = _scenario()
    if named == "by the sensor":
        compass = FunctionSensor(h={"z": "h"}, angles=("z",), R=R)
        scenario = _scenario(compass, angles=())
    data = simulate(scenario, 1, 0, RUNS)
    found = track(scenario, FILTERS[label], RUNS)
    exact = _rms(_exact_directions() - data.truth[0, 1:])
    assert _rms((found.mean - data.truth)[0, 1:]) == pytest.approx(exact, rel=0.05)
    assert 0.75 < np.mean(found.nees[1:]) < 1.3


def test_the_grid_of_a_line_is_that_of_the_circle() -> None:
    """The mean direction and the mean on the direction's turn differ in skewed posteriors only."""
    found = track(_scenario(), make_filter("grid"), 30)
    assert _rms(found.mean[0, 1:] - _exact_directions()[:, :30]) < 2e-3


def test_an_imm_is_that_of_a_program_on_the_circle() -> None:
    scenario = _scenario()
    data = simulate(scenario, 1, 0, RUNS)
    pairs = zip(data.prior.mean[0], data.measurements[0].T, strict=True)
    own = [_own_imm(*each) for each in pairs]
    # The filter's motions name no angle: that of the target is theirs.
    for angles in (("h",), ()):
        found = track(scenario, make_filter("imm", **_both_motions(angles)), RUNS)
        assert _rms(found.mean[0, 1:] - np.array(own).T) < 1e-9


def test_motions_of_a_wide_heading_and_smoothers() -> None:
    scenario = _scenario()
    data = simulate(scenario, 1, 0, RUNS)
    errors = {}
    for label, tracker in {
        "imm": make_filter("imm", **_both_motions()),
        "mmpf": make_filter("mmpf", N=500, **_both_motions()),
        "smoothed imm": make_filter("imm", smooth=True, **_both_motions()),
        "smoothed ekf": make_filter("ekf", smooth=True),
        "smoothed enkf": make_filter("enkf", N=200, smooth=True),
        "smoothed rpf": make_filter("rpf", N=300, smooth=True),
    }.items():
        found = track(scenario, tracker, RUNS)
        errors[label] = _rms((found.mean - data.truth)[0, 1:])
    assert errors["mmpf"] == pytest.approx(errors["imm"], rel=0.05)
    assert errors["smoothed imm"] < errors["imm"]
    for label in ("smoothed enkf", "smoothed rpf", "smoothed imm"):
        assert errors[label] == pytest.approx(errors["smoothed ekf"], rel=0.1)


def _turning(sensors: tuple[FunctionSensor, ...], sigma: float) -> Tracking:
    names = ("x", "y", "v", "h")
    moves = {"x": "x + v*T*cos(h)", "y": "y + v*T*sin(h)", "v": "v", "h": "h + 0.1"}
    motion = MapMotion(components=names, next=moves, Q=(0.01, 0.01, 0.01, 1e-3), angles=("h",))
    return Tracking(
        target=Driven(motion=motion, initial={"v": 10.0, "h": 3.0}),
        sensor=sensors,
        start=GaussianStart(sigma=(5.0, 5.0, 1.0, sigma)),
        T=0.5,
        last=40,
    )


@pytest.mark.parametrize(
    "tracker", [make_filter("ukf"), make_filter("ckf"), make_filter("enkf", N=300)]
)
def test_a_heading_beside_a_position(tracker: AnyFilter) -> None:
    """A wide heading with a compass is soon known as well as a narrow one."""
    position = FunctionSensor(h={"px": "x", "py": "y"}, R=25.0)
    compass = FunctionSensor(h={"c": "h"}, angles=("c",), R=0.01)
    errors = []
    for sigma in (0.1, 2.5):
        scenario = _turning((position, compass), sigma)
        error = (track(scenario, tracker, 50).mean - simulate(scenario, 1, 0, 50).truth)[3, 5:]
        errors.append(_rms(error))
    assert errors[1] == pytest.approx(errors[0], rel=0.15)


def test_states_of_a_mixture_meet_at_the_cut() -> None:
    cov = np.full((1, 1, 1), 0.01)
    states = [Gaussian(np.array([[3.1]]), cov), Gaussian(np.array([[-3.1]]), cov)]
    weights = np.array([[0.5], [0.5]])
    mixed = combine(states, weights, angles=(0,))
    assert mixed.mean[0, 0] == pytest.approx(pi)
    assert mixed.cov[0, 0, 0] == pytest.approx(0.01 + (pi - 3.1) ** 2)
    assert combine(states, weights).mean[0, 0] == 0.0


def test_grid_2d_stops_at_an_angle_of_several_turns() -> None:
    motion = MapMotion(
        components=("h", "w"), next={"h": "h + w", "w": "w"}, Q=(0.05, 0.01), angles=("h",)
    )
    scenario = Tracking(
        target=Driven(motion=motion, initial={"h": 3.0, "w": 0.0}),
        sensor=FunctionSensor(h={"s": "sin(h)"}, R=1.0),
        start=GaussianStart(sigma=(1.0, 0.1)),
        last=1,
    )
    with pytest.raises(WrongReturnError, match="the angle 'h' may differ by more than half a turn"):
        track(scenario, make_filter("grid-2d", nodes=128), 1)
