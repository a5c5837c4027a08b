"""Proposing each particle from a Kalman filter of its own, and weighing it.

De Freitas et al. 2000; van der Merwe et al. 2000, section 4. Weight: lik * prior / proposal
(hdepf paper, eq. 7).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import linalg, particles
from trackbench.core.arrays import Array, Mask, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.elementary import log, logaddexp
from trackbench.core.particles import (
    Evidence,
    Mass,
    Particles,
    WeightReading,
    read_likelihood,
)
from trackbench.core.posteriors import CloudPosterior, Posterior
from trackbench.core.streams import Streams
from trackbench.core.unscented import Unscented
from trackbench.filters.base import Filter, State
from trackbench.keys import Finite, NonNegative, Positive, Share
from trackbench.models.base import GammaMotion, Model, NormalMotion, Scene, log_likelihood
from trackbench.models.gaussian import (
    Assumed,
    augmented_size,
    augmented_step,
    spread_conflicts,
)

TransitionReading = Literal["model", "increment"]


class ProposedCloud(NamedTuple):
    """Particles x (n, M, N), each one's Kalman covariance P (n, n, M, N), estimate, dead runs.

    ``w`` (M, N) are the weights before resampling, ``mass`` what they summed to before that was one;
    ``source`` is the cloud whose moments the estimate has.
    """

    particles: Particles
    P: Array
    estimate: Gaussian
    dead: Mask
    w: Array
    mass: Mass | None = None
    source: Particles | None = None

    @property
    def posterior(self) -> Posterior:
        """What the estimate is of."""
        return CloudPosterior(self.source or self.particles)

    def noted(self) -> dict[str, Array]:
        """Per run (M,): no weight at all; effective sample size before resampling, as a share of N."""
        return {
            "dead_steps": self.dead.astype(float),
            "ess": particles.effective_share(self.w),
        }


class Proposed(NamedTuple):
    """Draws x (n, M, N), each particle's Gaussian with (n, n, M, N), and the draws' log-density."""

    x: Array
    kalman: Gaussian
    log_q: Callable[[Array], Array]


class Defensive(NamedTuple):
    """Proposals (n, M, N) of which a share is drawn from the transition, so that weights are bounded."""

    kalman: Gaussian
    moved: Distribution
    share: float

    def sample(self, rng: Streams) -> Array:
        """One draw per particle (n, M, N)."""
        x = self.kalman.sample(rng)
        from_prior = rng.random(x.shape[1:]) < self.share
        return np.where(from_prior, self.moved.sample(rng), x)

    def log_prob(self, x: Array) -> Array:
        """Log-density of the mixture (M, N)."""
        kalman = log(1.0 - self.share) + self.kalman.log_prob(x)
        return logaddexp(kalman, log(self.share) + self.moved.log_prob(x))


@dataclass(frozen=True, kw_only=True)
class KalmanProposal(Filter[State]):
    """Keys and parts of a step shared by every filter with a Kalman proposal per particle."""

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""
    weights: WeightReading = "log"
    """arithmetic of the likelihood: log-domain, exp() in float64, or exp() + 1e-99"""
    Q: Positive | None = None
    """process noise variance the proposal assumes; default: the model's"""
    R: Positive | None = None
    """measurement noise variance the proposal assumes; default: the model's"""
    P0: NonNegative | None = None
    """initial variance of each particle's Kalman filter; default: the prior's"""
    noise_mean: bool = True
    """whether the proposal's prediction adds the mean of the process noise"""
    transition_density: TransitionReading = "model"
    """noise in the weight's prior: x_k - f(x_{k-1}), or x_k - x_{k-1} as in the public demo"""
    defensive: Share = 0.0
    """share of draws taken from the transition instead, which bounds the weights"""

    counts: ClassVar[frozenset[str]] = frozenset({"dead_steps"})

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Weights need the density of the process noise."""
        motion = scenario.model.motion
        if isinstance(motion, NormalMotion) and linalg.is_singular(motion.Q):
            return {"": "weighs by the density of the process noise, and this motion's is singular"}
        if self.transition_density == "increment" and not isinstance(motion, GammaMotion):
            return {"transition_density": "increment is defined for a gamma process noise"}
        return {}

    def held(self, model: Model) -> int:
        """Numbers alive at once per run beside the cloud: some ten covariances per particle."""
        n_x = len(model.motion.components)
        return self.N * 10 * n_x * n_x

    def drawn(self, prior: Distribution, rng: Generator) -> ProposedCloud:
        """N draws from the prior, each with its own covariance."""
        x = prior.sample(rng, self.N)
        n, runs, N = x.shape
        cov = prior.cov if self.P0 is None else self.P0 * np.eye(n)
        P = np.broadcast_to(with_trailing(cov, 2, leading=2), (n, n, runs, N))
        cloud = Particles(x, particles.uniform(runs, N))
        return ProposedCloud(cloud, P, cloud.moments(), np.zeros(runs, dtype=np.bool_), cloud.w)

    def propose(
        self, model: Model, state: ProposedCloud, z: Array, k: int, rng: Generator
    ) -> Proposed:
        """One draw from each particle's Kalman posterior, or from the transition (defensive)."""
        kalman = self._kalman(model, Gaussian(state.particles.x, state.P), z, k)
        proposal = self._proposal(model, kalman, state.particles.x, k)
        return Proposed(proposal.sample(rng), kalman, proposal.log_prob)

    def log_target(self, model: Model, origin: Array, z: Array, x: Array, k: int) -> Array:
        """log p(z_k | x) + log p(x | origin): the posterior of x_k given one past particle."""
        lik = read_likelihood(log_likelihood(model.sensor, z, x, k), self.weights)
        moved = model.motion.transition(origin, k)
        if self.transition_density == "model":
            return lik + moved.log_prob(x)
        # Like the demo, without a cut at zero: v^2 exp(-2 v) grows without bound for v < 0.
        noise, v = cast(GammaMotion, model.motion).noise, x[0] - origin[0]
        return lik + (noise.shape - 1.0) * log(np.abs(v)) - noise.rate * v

    def log_evidence(self, cloud: ProposedCloud) -> Array:
        """Logarithm (M,) of the mean unnormalised weight; NaN if the weights are no densities."""
        if cloud.mass is None or self.transition_density == "increment":
            return np.full(cloud.dead.shape, np.nan)
        return Evidence(cloud.mass, 0.0, self.N).log

    def _proposal(
        self, model: Model, kalman: Gaussian, origin: Array, k: int
    ) -> "Gaussian | Defensive":
        if self.defensive == 0.0:
            return kalman
        return Defensive(kalman, model.motion.transition(origin, k), self.defensive)

    def _kalman(self, model: Model, state: Gaussian, z: Array, k: int) -> Gaussian:
        raise NotImplementedError

    @property
    def _assumed(self) -> Assumed:
        return Assumed(self.Q, self.R, self.noise_mean)


@dataclass(frozen=True, kw_only=True)
class UnscentedProposal(KalmanProposal[State]):
    """A UKF per particle as the proposal."""

    alpha: Positive = 1.0
    """spread of the sigma points"""
    beta: Finite = 0.0
    """extra weight of the centre in the covariance"""
    kappa: Finite = 2.0
    """secondary scaling of the sigma points"""

    def held(self, model: Model) -> int:
        """Numbers alive at once per run beside the cloud: sigma points of (x, v, n) per particle.

        Themselves, three arrays each of what motion and sensor make of them, and the covariance.
        """
        n_x, n_z = len(model.motion.components), len(model.sensor.components)
        n = augmented_size(model)
        return self.N * ((n + 3 * (n_x + n_z)) * (2 * n + 1) + n * (n + 1))

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """The same, and sigma points that spread."""
        spread = spread_conflicts(self.alpha, self.kappa, scenario.model)
        return super().conflicts(scenario) | spread

    def _kalman(self, model: Model, state: Gaussian, z: Array, k: int) -> Gaussian:
        unscented = Unscented(self.alpha, self.beta, self.kappa)
        return augmented_step(model, state, z, k, self._assumed, unscented)[0]


MERWE_PROPOSAL: dict[str, object] = {"Q": 1.5, "R": 0.1, "P0": 0.75, "noise_mean": False}
"""The UKF proposal of van der Merwe's public demo."""
