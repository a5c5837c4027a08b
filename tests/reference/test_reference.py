"""trackbench's filters against the second implementation: run by run, step by step, same random numbers.

Differences count in standard deviations of the reference's posterior.
"""

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.reference import Draws
from tests.reference.maneuver import adaptive
from tests.reference.particles import apf, hdepf, upf
from tests.reference.radar import cmkf, mcaekf, mpf
from trackbench.core.streams import RunStreams, block_stream
from trackbench.filters.switching import Detector, Exit, SecondDecision
from trackbench.models.motions import ConstantAcceleration, ConstantVelocity
from trackbench.scenarios.banana import Banana
from trackbench.scenarios.maneuver import Leg, Maneuver
from trackbench.scenarios.merwe import Merwe

RUNS, SEED = 3, 20261122


class Recorder:
    """A block's noise, with a copy of all that is drawn; the last two axes are runs and particles."""

    def __init__(self):
        self._rng, self._drawn = block_stream(SEED, 0), []

    def standard_normal(self, size):
        return self._kept("normal", self._rng.standard_normal(size))

    def standard_gamma(self, shape, size):
        return self._kept("gamma", self._rng.standard_gamma(shape, size))

    def random(self, size):
        return self._kept("uniform", self._rng.random(size))

    def _kept(self, kind, values):
        self._drawn.append((kind, values.copy()))
        return values

    def of_run(self, m):
        return Draws([(kind, values[..., m, :]) for kind, values in self._drawn])


def compare(scenario, tracker, reference, tolerance):
    """``reference(prior, m, z, draws)`` yields run m's estimates; returns what else it yields."""
    data, rng, found = scenario.simulate(RunStreams(SEED, range(RUNS)), RUNS), Recorder(), []
    state = tracker.init(scenario.model, data.prior, rng)
    for z, k in zip(data.measurements.swapaxes(0, 1), scenario.steps[1:], strict=True):
        state = tracker.step(scenario.model, state, z, int(k), rng)
        found.append((tracker.estimate(state), tracker.diagnostics(state)))
    for m in range(RUNS):
        draws = rng.of_run(m)
        estimates = reference(data.prior, m, data.measurements[..., m].T, draws)
        for (theirs, noted), (mean, cov, *mode) in zip(found, estimates, strict=True):
            std = np.sqrt(np.diag(cov))
            error = (theirs.mean[:, m] - mean) / std
            np.testing.assert_allclose(error, 0.0, atol=tolerance)
            error = (theirs.cov[:, :, m] - cov) / np.outer(std, std)
            np.testing.assert_allclose(error, 0.0, atol=tolerance)
            assert [noted["mode"][m]] == mode if mode else True
        assert draws.used_up()
    return found



SHORT = Maneuver(
    duration=260.0,
    legs=(Leg(start=60, end=110, ax=1.0, ay=-2.0), Leg(start=170, end=200, ax=-3.0, ay=1.0)),
)


@pytest.mark.parametrize(
    ("scenario", "detector", "leave", "n", "keys"),
    [
        (Maneuver(), {"kind": "fading-ie", "eta": 20.0}, {}, 0, {"statistic": "rho"}),
        (SHORT, {"kind": "ie", "eta": 20.0, "window_s": 20.0, "min_window_s": 6.0}, {"hold_s": 9.0}, 0,
         {"statistic": "zeta", "window": 20, "xi_min": 6, "hold": 9}),
        (SHORT, {"kind": "fading", "eta": 25.0}, {}, 0, {"statistic": "rho", "onset": "oldest"}),
        (SHORT, {"kind": "fading-ie", "eta": 15.0, "onset": "paper"}, {}, 8,
         {"statistic": "rho", "onset": "newest", "n": 8}),
    ],
    ids=["paper", "seconds", "fading", "second decision"],
)  # fmt: skip
def test_adaptive_filter(scenario, detector, leave, n, keys):
    tracker = make_filter(
        "adaptive-kf", nmf=ConstantVelocity(q=0.01), mf=ConstantAcceleration(q=1e-4),
        detector=Detector(**detector), exit=Exit(**leave), dlw=SecondDecision(n=n),
    )  # fmt: skip

    def reference(prior, m, z, draws):
        return adaptive(prior.mean[:, m], prior.cov, z, 0.01, 1e-4, detector["eta"], **keys)

    found = compare(scenario, tracker, reference, 1e-9)
    mode = np.array([noted["mode"] for _, noted in found])
    switches = np.diff(mode, axis=0)
    assert (switches == 1).any(axis=0).all()
    assert (switches == -1).any(axis=0).all()


FAR = Banana(velocity_cross=1000.0, scans=60)


@pytest.mark.parametrize("kind", ["ccm", "ucm", "mucm", "ducm"])
def test_converted_measurement_filters(kind):
    def reference(prior, m, z, draws):
        return cmkf(prior.first[:, m], prior.second[:, m], z, kind)

    compare(FAR, make_filter("cmkf", conversion=kind), reference, 1e-9)


def test_measurement_covariance_adaptive_filter():
    def reference(prior, m, z, draws):
        return mcaekf(prior.first[:, m], prior.second[:, m], z)

    compare(FAR, make_filter("mcaekf"), reference, 1e-9)


def test_marginalised_particle_filter():
    def reference(prior, m, z, draws):
        return mpf(prior.first[:, m], prior.second[:, m], z, draws, 200, 5, 4)

    tracker = make_filter("mpf", N=200, boost=5, boost_scans=4)
    compare(Banana(range_km=200.0, scans=30), tracker, reference, 1e-9)


@pytest.mark.parametrize(
    ("algorithm", "preset", "options"),
    [
        (apf, None, ()),
        (upf, "matched", (False,)),
        (upf, "merwe-demo", (True,)),
        (hdepf, "matched", (False,)),
        (hdepf, "published-level", (True,)),
    ],
)
def test_particle_filters(algorithm, preset, options):
    def reference(prior, m, z, draws):
        return algorithm(z[:, 0].tolist(), draws, 20, *options)

    compare(Merwe(), make_filter(algorithm.__name__, preset, N=20), reference, 1e-9)
