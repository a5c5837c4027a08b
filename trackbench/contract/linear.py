"""The scenario that filters are examined on first: linear, so that the Kalman filter is exact."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Gaussian
from trackbench.core.streams import Streams
from trackbench.models.base import Model
from trackbench.models.linear import CWNA
from trackbench.scenarios.base import Simulation, simulate_markov


@dataclass(frozen=True)
class PositionSensor:
    """Two positions with independent noise of standard deviation sigma, m."""

    sigma: float
    components: tuple[str, ...] = ("x", "y")

    def measurement(self, x: Array, k: int) -> Gaussian:
        """N((px, py), sigma^2 I)."""
        return Gaussian(x[[0, 2]], self.sigma**2 * np.eye(2))

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """``z - z_pred``."""
        return z - z_pred

    def jacobian(self, x: Array, k: int) -> Array:
        """H (2, 4)."""
        return np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class Linear:
    """Constant velocity in the plane, seen through two noisy positions: the Kalman filter is exact."""

    T: int = 6
    kind = "linear"

    @property
    def model(self) -> Model:
        """CWNA and positions."""
        return Model(CWNA(T=1.0, q=1.0), PositionSensor(2.0))

    @property
    def steps(self) -> Index:
        """0 to T."""
        return np.arange(self.T + 1)

    @property
    def times(self) -> Array:
        """One second per step."""
        return self.steps.astype(float)

    @property
    def windows(self) -> dict[str, Mask]:
        """All but the prior's step."""
        return {"": self.steps > 0}

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Runs of the model from a Gaussian prior."""
        mean = np.repeat(np.array([[10.0], [1.0], [-5.0], [2.0]]), runs, axis=1)
        prior = Gaussian(mean, np.diag([4.0, 1.0, 4.0, 1.0]))
        truth, seen = simulate_markov(self.model, prior.sample(rng), self.steps, rng)
        return Simulation(truth, seen, prior)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Position errors, m."""
        return {"position": (mean - truth)[[0, 2]]}
