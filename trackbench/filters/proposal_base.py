"""Base of the filters that weigh particles by likelihood * prior / proposal (hdepf paper, eq. 7)."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, TypeAlias, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import particle_diagnostics, particle_weights
from trackbench.core.arrays import Array, choose
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.elementary import log, logaddexp
from trackbench.core.particle_weights import WeightReading, read_likelihood
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.random_streams import Streams
from trackbench.filters.base import Filter
from trackbench.filters.particle_base import PFState
from trackbench.filters.singular_process_noise import proposal_conflicts
from trackbench.models.base import GammaMotion, Model, Scene
from trackbench.models.likelihood import log_likelihood

TransitionReading = Literal["model", "increment"]


class Proposals(NamedTuple):
    """One draw for each particle."""

    x: Array
    """draws (n, M, N)"""
    q: "Density"
    """density that they are drawn from"""
    kalman: Gaussian | None = None
    """Kalman posterior of each particle, if there is one"""


class DefensiveMixture(NamedTuple):
    """Proposal of which a share is drawn from the transition, so that the weights are bounded."""

    kalman: Gaussian
    transition: Distribution
    share: float

    def sample(self, rng: Streams) -> Array:
        """Return one draw per particle (n, M, N)."""
        x = self.kalman.sample(rng)
        from_prior = rng.random(x.shape[1:]) < self.share
        return choose(from_prior, self.transition.sample(rng), x)

    def log_prob(self, x: Array) -> Array:
        """Evaluate the log-density (M, N) of the mixture."""
        kalman = log(1.0 - self.share) + self.kalman.log_prob(x)
        return logaddexp(kalman, log(self.share) + self.transition.log_prob(x))


Density: TypeAlias = Distribution | DefensiveMixture
"""Density that proposes one draw per particle."""


@dataclass(frozen=True, kw_only=True)
class ProposalFilter(Filter[PFState]):
    """Base of the filters that weigh each draw by likelihood * prior / proposal (hdepf paper, eq. 7)."""

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"collapsed_steps"})
    # Names of diagnostics that a subclass adds.
    _extra_diagnostics: ClassVar[frozenset[str]] = frozenset()
    # Path to the key `transition_density`, such as "reading."; empty if it is a key of the filter
    # itself.
    _reading_path: ClassVar[str] = ""

    @property
    @abstractmethod
    def _weight_reading(self) -> tuple[WeightReading, TransitionReading]:
        """Arithmetic of the likelihood, and interpretation of the transition density."""

    @abstractmethod
    def _draw_proposals(
        self, model: Model, state: PFState, z: Array, k: int, rng: Generator
    ) -> Proposals:
        """Draw one new state for each particle, and return the draws with their density."""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw N particles from the prior."""
        x = prior.sample(rng, self.N)
        cloud = Particles(x, particle_weights.equal_weights(*x.shape[1:]))
        # w is stored for the effective sample size.
        return PFState.first(cloud)._replace(w=cloud.w)

    def estimate(self, state: PFState) -> Gaussian:
        """Return the weighted mean and covariance."""
        return state.estimate

    def posterior(self, state: PFState) -> Posterior:
        """Return the weighted particles."""
        return ParticlePosterior(state.averaged_particles)

    def log_likelihood(self, state: PFState) -> Array:
        """Return the logarithm (M,) of the mean weight; NaN without the model's transition density."""
        _, transition = self._weight_reading
        if transition != "model":
            return np.full(state.collapsed.shape, np.nan)
        return state.log_likelihood

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of `diagnostics`."""
        return frozenset({"collapsed_steps", "ess", "distinct_particles"}) | self._extra_diagnostics

    def diagnostics(self, state: PFState) -> dict[str, Array]:
        """Report ``collapsed_steps``, ``ess`` and ``distinct_particles``.

        ``collapsed_steps``: 1 where every weight was zero and the particles got equal weights. ``ess``:
        effective sample size of the draws. ``distinct_particles``: particles that are no copies after
        resampling or evolution. Both are shares of N.
        """
        # Copies have equal first components, which sorting puts side by side.
        distinct = particle_diagnostics.distinct_share(np.sort(state.particles.x[0]))
        return state.diagnostics() | {"distinct_particles": distinct}

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject process noise without a density, and a ``transition_density`` not defined for it."""
        conflicts = proposal_conflicts(scenario)
        if conflicts:
            return conflicts
        _, transition = self._weight_reading
        if transition == "increment" and not isinstance(scenario.model.motion, GammaMotion):
            # `pfde` and `hdepf` have the key below `reading`.
            key = f"{self._reading_path}transition_density"
            return {key: "increment is defined for a gamma process noise"}
        return {}

    def _log_target(
        self, model: Model, origin: Array, z: Array, k: int
    ) -> Callable[[Array], Array]:
        """Return the function ``log p(z_k | x) + log p(x | origin)`` of particles x (n, M, N).

        It is the log-density of each particle's posterior, up to a constant. ``origin`` (n, M, N) are
        the particles at step k - 1. The key ``weights`` names the arithmetic of the likelihood:
        logarithms, or exp() in float64. By the key ``transition_density`` the noise of p(x | origin) is
        x - f(origin) ("model"), or the increment x - origin ("increment"), as in van der Merwe's public
        demo of the unscented particle filter.
        """
        arithmetic, transition = self._weight_reading
        prior = model.motion.transition(origin, k)

        def log_target(x: Array) -> Array:
            """Return ``log p(z_k | x) + log p(x | origin)`` (M, N) of particles x (n, M, N)."""
            # log p(z_k | x), in the arithmetic of the key `weights`
            log_p_z = read_likelihood(log_likelihood(model.sensor, z, x, k), arithmetic)
            if transition == "model":
                return log_p_z + prior.log_prob(x)
            # The increment v has the density of the gamma noise. To reproduce van der Merwe's demo it is
            # not cut at v = 0, although v^2 exp(-2 v) grows without bound for v < 0.
            noise = cast(GammaMotion, model.motion).noise
            v = x[0] - origin[0]
            return log_p_z + (noise.shape - 1.0) * log(np.abs(v)) - noise.rate * v

        return log_target
