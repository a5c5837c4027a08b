"""Proposing each particle from a Kalman filter of its own, and weighing it.

De Freitas et al. 2000; van der Merwe et al. 2000, section 4. Weight: lik * prior / proposal
(hdepf paper, eq. 7).
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import linalg, particles
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.elementary import log, logaddexp
from trackbench.core.particles import Particles, WeightReading, read_likelihood
from trackbench.core.posteriors import ParticlePosterior, Posterior
from trackbench.core.random_streams import Streams
from trackbench.core.unscented import Unscented
from trackbench.field_types import Finite, NonNegative, Positive, Share
from trackbench.filters.base import Filter
from trackbench.filters.particle_base import Cloud
from trackbench.models.base import (
    GammaMotion,
    Model,
    NormalMotion,
    SampledMotion,
    Scene,
    log_likelihood,
)
from trackbench.models.gaussian_steps import (
    AssumedNoise,
    augmented_size,
    augmented_step,
    idle_noise_mean,
    spread_conflicts,
)

_OF_PROPOSAL = ("Q", "R", "P0", "noise_mean", "alpha", "beta", "kappa")
TransitionReading = Literal["model", "increment"]


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
class ProposingFilter(Filter[Cloud]):
    """Base of the filters with a Kalman filter per particle, which proposes."""

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

    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"dead_steps"})
    _also_noted: ClassVar[frozenset[str]] = frozenset()

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """N draws from the prior, each with its own covariance."""
        x = prior.sample(rng, self.N)
        n, runs, N = x.shape
        cov = prior.cov if self.P0 is None else self.P0 * np.eye(n)
        P = np.broadcast_to(with_trailing(cov, 2, leading=2), (n, n, runs, N))
        cloud, dead = Particles(x, particles.equal_weights(runs, N)), np.zeros(runs, dtype=np.bool_)
        return Cloud(cloud, cloud, cloud.moments(), dead, P=P, w=cloud.w)

    def estimate(self, state: Cloud) -> Gaussian:
        """Weighted mean and covariance."""
        return state.estimate

    def posterior(self, state: Cloud) -> Posterior:
        """The cloud of the estimate."""
        return ParticlePosterior(state.weighted)

    def log_likelihood(self, state: Cloud) -> Array:
        """Logarithm (M,) of the mean weight; NaN if the weights are no densities."""
        densities = self.transition_density == "model"
        return state.log_likelihood if densities else np.full(state.dead.shape, np.nan)

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return frozenset({"dead_steps", "ess", "distinct"}) | self._also_noted

    def diagnostics(self, state: Cloud) -> dict[str, Array]:
        """``dead_steps``: every weight was zero, and the cloud was kept with equal weights.

        ``ess``: effective sample size of what was proposed, ``distinct``: particles that are no copies
        after resampling or evolution, both as shares of N.
        """
        copies = particles.distinct_share(np.sort(state.particles.x[0]))
        return state.noted() | {"distinct": copies}

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Weights need the density of the process noise, and a Kalman filter what it is made of."""
        return self._weight_conflicts(scenario.model.motion) | self._kalman_conflicts(
            scenario.model
        )

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Keys of a proposal from which nothing is drawn."""
        idle = dict.fromkeys(_OF_PROPOSAL, self._unused) if self._unused else {}
        return idle_noise_mean(scenario) | idle

    @property
    def _unused(self) -> str:
        """Reason why no particle is drawn from its Kalman filter, or nothing."""
        return "with `defensive: 1`" if self.defensive == 1.0 else ""

    def extra_memory(self, model: Model) -> int:
        """Numbers alive at once per run beside the cloud."""
        return self.N * self._held_by_each(model)

    def _weight_conflicts(self, motion: SampledMotion) -> dict[str, str]:
        if isinstance(motion, NormalMotion) and linalg.is_singular(motion.Q):
            return {"": "weighs by the density of the process noise, and this motion's is singular"}
        if self.transition_density == "increment" and not isinstance(motion, GammaMotion):
            return {"transition_density": "increment is defined for a gamma process noise"}
        return {}

    def _proposed(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Proposed:
        """One draw from each particle's Kalman posterior, or from the transition (defensive)."""
        assert state.P is not None
        each, assumed = (
            Gaussian(state.particles.x, state.P),
            AssumedNoise(self.Q, self.R, self.noise_mean),
        )
        kalman = self._kalman(model, each, z, k, assumed)
        proposal = self._proposal(model, kalman, state.particles.x, k)
        return Proposed(proposal.sample(rng), kalman, proposal.log_prob)

    def _log_target(
        self, model: Model, origin: Array, z: Array, k: int
    ) -> Callable[[Array], Array]:
        """log p(z_k | x) + log p(x | origin) of x: the posterior of x_k given one past particle."""
        moved = model.motion.transition(origin, k)

        def log_target(x: Array) -> Array:
            lik = read_likelihood(log_likelihood(model.sensor, z, x, k), self.weights)
            if self.transition_density == "model":
                return lik + moved.log_prob(x)
            # Like the demo, without a cut at zero: v^2 exp(-2 v) grows without bound for v < 0.
            noise, v = cast(GammaMotion, model.motion).noise, x[0] - origin[0]
            return lik + (noise.shape - 1.0) * log(np.abs(v)) - noise.rate * v

        return log_target

    def _proposal(
        self, model: Model, kalman: Gaussian, origin: Array, k: int
    ) -> "Gaussian | Defensive":
        if self.defensive == 0.0:
            return kalman
        return Defensive(kalman, model.motion.transition(origin, k), self.defensive)

    @abstractmethod
    def _kalman(
        self, model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
    ) -> Gaussian:
        """The step of every particle's Kalman filter, from (n, M, N) to step k, given z (n_z, M)."""

    def _kalman_conflicts(self, model: Model) -> dict[str, str]:
        return {}

    def _held_by_each(self, model: Model) -> int:
        """Numbers per particle: some ten covariances."""
        return 10 * len(model.motion.components) ** 2


@dataclass(frozen=True, kw_only=True)
class UnscentedProposal:
    """Keys and step of an unscented Kalman filter per particle, to stand before `ProposingFilter`."""

    alpha: Positive = 1.0
    """spread of the sigma points"""
    beta: Finite = 0.0
    """extra weight of the centre in the covariance"""
    kappa: Finite = 2.0
    """secondary scaling of the sigma points"""

    def _kalman(
        self, model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
    ) -> Gaussian:
        unscented = Unscented(self.alpha, self.beta, self.kappa)
        return augmented_step(model, state, z, k, assumed, unscented)[0]

    def _kalman_conflicts(self, model: Model) -> dict[str, str]:
        return spread_conflicts(self.alpha, self.kappa, model)

    def _held_by_each(self, model: Model) -> int:
        """Sigma points of (x, v, n), three arrays each of what becomes of them, and the covariance."""
        n_x, n_z = len(model.motion.components), len(model.sensor.components)
        n = augmented_size(model)
        return (n + 3 * (n_x + n_z)) * (2 * n + 1) + n * (n + 1)


MERWE_PROPOSAL: dict[str, object] = {"Q": 1.5, "R": 0.1, "P0": 0.75, "noise_mean": False}
"""The UKF proposal of van der Merwe's public demo."""
