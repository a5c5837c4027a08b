"""trackbench's filters against the second implementation: run by run, step by step, same noise.

A difference counts in standard deviations of the posterior plus 1e-4 of the state, since a cloud may
collapse. The tolerances are rounding, as the matrices' condition and the evolution magnify it: at
2711 km float64 leaves the conventional conversion four digits, by either implementation.
"""

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.papers import banana, maneuver, merwe
from tests.reference import Draws
from tests.reference.maneuver import T as T_M
from tests.reference.maneuver import adaptive
from tests.reference.particles import apf, hdepf, upf
from tests.reference.radar import T, cmkf, mcaekf, mpf
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import (
    Detector,
    Exit,
    SecondDecision,
)
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.scenarios.targets.legs import Leg

RUNS, SEED = 3, 20261122
LONG, MERWE = maneuver(T=T_M), merwe()
TURNS = (Leg(start=60, end=110, ax=1.0, ay=-2.0), Leg(start=170, end=200, ax=-3.0, ay=1.0))
SHORT = maneuver(duration=400.0, legs=TURNS, T=T_M)
FAR, CURVED = banana(velocity_cross=1000.0, scans=40, T=T), banana(range_km=250.0, scans=15, T=T)
NEAR = banana(velocity_cross=0.1, scans=20, range_km=0.1, azimuth_deg=179.6, T=T)  # turns past 180


def switching(q, q_m, n, hold_s, **detector):
    return make_filter(
        "adaptive-kf",
        nmf=ConstantVelocity(q=q),
        mf=ConstantAcceleration(q=q_m),
        detector=Detector(**detector),
        dlw=SecondDecision(n=n),
        exit=Exit(hold_s=hold_s),
    )


PAPER = switching(0.01, 1e-4, 0, 0.0, kind="fading-ie", eta=20.0)
WINDOWS = {"window_s": 12 * T_M, "min_window_s": 4 * T_M}
SECONDS = switching(0.0, 1e-4, 0, 9 * T_M, kind="ie", eta=20.0, **WINDOWS)
CAREFUL = switching(0.01, 1e-3, 8, 0.0, kind="fading", eta=15.0)
BOOSTED = {"N": 300, "boost": 4, "boost_scans": 3}
PRINTED = make_filter("hdepf", "published-level", N=10)
CASES = {
    "paper": (1e-9, LONG, PAPER, adaptive, (0.01, 1e-4, 20.0, "rho")),
    "seconds": (1e-9, SHORT, SECONDS, adaptive, (0.0, 1e-4, 20.0, "zeta", "argmax", 12, 4, 0, 9)),
    "careful": (1e-9, SHORT, CAREFUL, adaptive, (0.01, 1e-3, 15.0, "rho", "oldest", 5, 0, 8)),
    "mpf": (1e-9, NEAR, make_filter("mpf", **BOOSTED), mpf, (300, 4, 3)),
    "mpf, curved": (1e-6, CURVED, make_filter("mpf", **BOOSTED), mpf, (300, 4, 3)),
    "apf": (1e-9, MERWE, make_filter("apf", N=20), apf, (20, 1e-5)),
    "apf, noisy": (1e-9, merwe(R=1.0), make_filter("apf", N=20), apf, (20, 1.0)),
    "apf, two stages": (1e-9, MERWE, make_filter("apf", N=20, stages=2), apf, (20, 1e-5, 2)),
    "upf": (1e-9, MERWE, make_filter("upf", N=20), upf, (20, False)),
    "upf, demo": (1e-9, MERWE, make_filter("upf", "merwe-demo", N=20), upf, (20, True)),
    "hdepf": (1e-7, MERWE, make_filter("hdepf", N=10), hdepf, (10, False)),
    "hdepf, eq. 9": (
        1e-7,
        MERWE,
        make_filter("hdepf", N=10, reading={"population": "uniform"}),
        hdepf,
        (10, False, True),
    ),
    "hdepf, printed": (1e-7, MERWE, PRINTED, hdepf, (10, True)),
}
for where, scenario, tolerance in (("near", NEAR, 1e-9), ("far", FAR, 1e-6)):
    CASES[f"mcaekf, {where}"] = tolerance, scenario, make_filter("mcaekf"), mcaekf, ()
    for kind in ("ccm", "ucm", "mucm", "ducm"):
        digits = 1e-2 if (where, kind) == ("far", "ccm") else tolerance
        tracker = make_filter("cmkf", conversion=kind)
        CASES[f"{kind}, {where}"] = digits, scenario, tracker, cmkf, (kind,)


class Recorder:
    """A block's noise, with a copy of all that is drawn; the last two axes are runs and particles."""

    def __init__(self):
        self._rng, self.drawn = block_stream(SEED, 0), []

    def __getattr__(self, kind):
        def draw(*args):
            values = getattr(self._rng, kind)(*args)
            self.drawn.append((kind, values.copy()))
            return values

        return draw


def start(prior, m):
    """What run m of a scenario starts from."""
    if hasattr(prior, "first"):
        return prior.first[:, m], prior.second[:, m]
    return (prior.mean[:, m], prior.cov) if prior.cov.any() else ()


@pytest.mark.parametrize("case", CASES)
def test_a_filter_is_its_second_implementation(case):
    tolerance, scenario, tracker, algorithm, options = CASES[case]
    data, rng, found = scenario.simulate(RunStreams(SEED, range(RUNS)), RUNS), Recorder(), []
    state = tracker.init(scenario.model, data.prior, rng)
    for z, k in zip(data.measurements.swapaxes(0, 1), scenario.steps[1:], strict=True):
        state = tracker.step(scenario.model, state, z, int(k), rng)
        found.append((tracker.estimate(state), tracker.diagnostics(state)))
    for m in range(RUNS):
        draws, modes = Draws([(kind, drawn[..., m, :]) for kind, drawn in rng.drawn]), []
        inputs = (data.measurements[..., m].T.squeeze().tolist(), draws)[: 2 if rng.drawn else 1]
        expected = algorithm(*start(data.prior, m), *inputs, *options)
        for (theirs, noted), (mean, cov, *mode) in zip(found, expected, strict=True):
            scale = np.sqrt(np.diag(cov)) + 1e-4 * np.abs(mean)
            off = (theirs.mean[:, m] - mean) / scale
            assert np.abs(off).max() < tolerance
            off = (theirs.cov[:, :, m] - cov) / np.outer(scale, scale)
            assert np.abs(off).max() < tolerance
            assert not mode or mode == noted["mode"][m]
            modes += mode
        assert draws.used_up()
        assert not modes or {-1.0, 1.0} <= set(np.diff(modes))  # it switched on, and off
