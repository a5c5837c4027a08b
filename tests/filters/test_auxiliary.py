"""The auxiliary particle filter weighs in the log domain what a float64 cannot hold."""

from typing import Any

import numpy as np
import pytest

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.particles import Particles
from trackbench.core.random_streams import block_stream
from trackbench.filters.auxiliary_pf import APF
from trackbench.filters.particle_base import PFState
from trackbench.models.base import Model

R = 1.0 / 6000.0  # the likelihood of a particle one away from the measurement is e^-3000


class Still:
    components = ("x",)

    def transition(self, x: Array, k: int) -> Gaussian:
        return Gaussian(x, np.array([[1e-8]]))


class Direct:
    components = ("z",)

    def measurement(self, x: Array, k: int) -> Gaussian:
        return Gaussian(x, np.array([[R]]))

    def innovation(self, z: Array, z_pred: Array) -> Array:
        return z - z_pred


@pytest.mark.parametrize(("carried", "survivor"), [(-2000.0, 1.0), (-5000.0, 0.0)])
def test_a_weight_that_underflows_still_counts(carried: float, survivor: float) -> None:
    """Of two particles the second has e^carried of the first's weight, and e^3000 of its likelihood."""
    x = np.repeat([[0.0, 1.0]], 3, axis=0)[None]
    log_w = np.repeat([[0.0, carried]], 3, axis=0)
    cloud = Particles(x, np.exp(log_w - np.log1p(np.exp(carried))))
    state = PFState(cloud, cloud, cloud.moments(), np.zeros(3, dtype=bool), 1, log_w=log_w)
    model = Model(Still(), Direct())
    found = APF(N=2).step(model, state, np.ones((1, 3)), 2, block_stream(1, 0))
    np.testing.assert_allclose(found.particles.x, survivor, atol=1e-3)


class Wide(Still):
    def transition(self, x: Array, k: int) -> Gaussian:
        return Gaussian(x, np.array([[1.0]]))


def stepped(**keys: Any) -> PFState:
    """Forty particles after a step by which the likelihoods of most are beyond float64."""
    x = np.zeros((1, 3, 40))
    cloud = Particles(x, np.full((3, 40), 1.0 / 40))
    state = PFState(cloud, cloud, cloud.moments(), np.zeros(3, dtype=bool), 1)
    model = Model(Wide(), Direct())
    return APF(N=40, **keys).step(model, state, np.full((1, 3), 0.2), 2, block_stream(1, 0))


@pytest.mark.parametrize(
    "keys", [{"weights": "naive"}, {"weights": "floor"}, {"weights": "log", "carried": "float64"}]
)
def test_float64_carries_the_weights_it_has(keys: dict[str, Any]) -> None:
    state = stepped(**keys)
    np.testing.assert_allclose(np.exp(state.log_w), state.particles.w, rtol=1e-12)
    if keys["weights"] != "floor":  # whose likelihoods end at 1e-99
        assert np.isneginf(state.log_w).any()


def test_logarithms_carry_all_weights() -> None:
    state = stepped(weights="log")
    assert np.isfinite(state.log_w).all()
    assert np.min(state.log_w) < -2000.0
    np.testing.assert_array_equal(state.log_w, stepped(weights="log", carried="log").log_w)


def test_what_float64_has_lost_has_no_offspring() -> None:
    """The next measurement is far out: the logarithms pick ancestors halfway, which float64 has lost."""
    for carried in ("float64", "log"):
        state = stepped(carried=carried)
        z = np.full((1, 3), 2.2)
        tracker = APF(N=40, carried=carried)
        found = tracker.step(Model(Still(), Direct()), state, z, 3, block_stream(2, 0))
        distance = abs(found.particles.x[0] - 0.2)  # from the last measurement: e^-3000 d^2
        assert (distance > 0.6).all() if carried == "log" else (distance < 0.5).all()


def test_a_product_below_float64_is_zero() -> None:
    """Weight e^-500 times likelihood e^-600 is nothing in float64, and something as a logarithm."""
    x = np.repeat([[1.0, 1.5]], 3, axis=0)[None]
    log_w = np.repeat([[-500.0, 0.0]], 3, axis=0)
    cloud = Particles(x, np.full((3, 2), 0.5))
    state = PFState(cloud, cloud, cloud.moments(), np.zeros(3, dtype=bool), 1, log_w=log_w)
    z = np.full((1, 3), 1.0 - np.sqrt(2.0 * R * 600.0))  # e^-600 of the first, less of the second
    model = Model(Still(), Direct())
    for keys, survivors in (({"weights": "naive"}, 2), ({"weights": "naive", "carried": "log"}, 1)):
        found = APF(N=2, **keys).step(model, state, z, 2, block_stream(1, 0))
        assert len(np.unique(np.round(found.particles.x[0, 0], 1))) == survivors
