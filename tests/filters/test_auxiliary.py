"""The auxiliary particle filter weighs in the log domain what a float64 cannot hold."""

import numpy as np
import pytest

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.particles import Particles
from trackbench.core.streams import block_stream
from trackbench.filters.bootstrap import APF, Cloud
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
    state = Cloud(cloud, cloud, cloud.moments(), np.zeros(3, dtype=bool), 1, log_w=log_w)
    model = Model(Still(), Direct())
    found = APF(N=2).step(model, state, np.ones((1, 3)), 2, block_stream(1, 0))
    np.testing.assert_allclose(found.particles.x, survivor, atol=1e-3)
