"""Scenario `merwe`: the scalar benchmark of van der Merwe et al. (2000) and of the hdepf paper."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gamma, Gaussian, Point
from trackbench.core.streams import Streams
from trackbench.keys import Finite, Natural, NonNegative, Positive, Steps
from trackbench.models.base import Model
from trackbench.models.merwe import MerweMotion, MerweSensor
from trackbench.registry import register
from trackbench.scenarios.base import Simulation, simulate_markov


@register("scenarios", "merwe")
@dataclass(frozen=True, kw_only=True)
class Merwe:
    """Scalar state driven by a sine and gamma noise, seen through a square and then a line.

    C. Zhang and L. Li, hdepf paper, eqs. 12-13; van der Merwe et al. 2000, section 6.1.
    """

    T: Steps = 50
    """last step; errors are averaged over steps 1 to T"""
    w: Finite = 0.04
    """frequency of the sine drive, in half turns per step"""
    phi1: Finite = 0.5
    """factor of x_{k-1} in the motion"""
    phi2: Positive = 0.2
    """factor of x^2 in the measurement up to the switch"""
    phi3: Positive = 0.5
    """factor of x in the measurement after the switch"""
    gamma_shape: Positive = 3.0
    """shape of the gamma process noise"""
    gamma_rate: Positive = 2.0
    """rate of the gamma process noise (mean shape/rate; as a scale it would triple every RMSE)"""
    R: Positive = 1e-5
    """variance of the measurement noise"""
    x1: Finite = 1.0
    """the first state's mean"""
    P1: NonNegative = 0.0
    """the first state's variance about x1, which every filter starts from; 0: it is known"""
    lost_beyond: Positive | None = 10.0
    """error beyond which a run counts as lost: ten times the error without any data"""
    first: Literal[0, 1] = 1
    """step at which the state is known: 1 (its zero error counts) or 0 (it does not)"""
    switch: Natural = 30
    """last step with the quadratic measurement"""
    sine_index: Literal["new", "old"] = "new"
    """step in the sine: k of x_k (the public demo) or k - 1 (as printed)"""

    def __post_init__(self) -> None:
        if self.first >= self.T:
            raise ValueError(f"T = {self.T} leaves no step to measure after step {self.first}")

    @property
    def model(self) -> Model:
        """Motion and sensor."""
        motion = MerweMotion(
            w=self.w,
            phi1=self.phi1,
            noise=Gamma(self.gamma_shape, self.gamma_rate),
            sine_lag=0 if self.sine_index == "new" else 1,
        )
        return Model(motion, MerweSensor(self.phi2, self.phi3, self.R, self.switch))

    @property
    def steps(self) -> Index:
        """Steps ``first`` to T."""
        return np.arange(self.first, self.T + 1)

    @property
    def times(self) -> Array:
        """One second per step."""
        return self.steps.astype(float)

    @property
    def windows(self) -> dict[str, Mask]:
        """All of 1..T, and both sides of the switch (Table 2 of the hdepf paper)."""
        k = self.steps
        scored = k >= 1
        split = {
            f"k<={self.switch}": scored & (k <= self.switch),
            f"k>{self.switch}": k > self.switch,
        }
        return {"": scored} | {name: mask for name, mask in split.items() if mask.any()}

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Runs of eqs. 12 and 13 from the first state, known or drawn from what is known of it."""
        start = np.full((1, runs), self.x1)
        prior: Distribution = Point(start)
        if self.P1:
            prior = Gaussian(start, np.array([[self.P1]]))
            start = prior.sample(rng)
        truth, seen = simulate_markov(self.model, start, self.steps, rng)
        return Simulation(truth, seen, prior)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """The state's own error, without a name."""
        return {"": mean - truth}
