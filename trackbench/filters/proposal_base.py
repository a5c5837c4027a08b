"""Bases of the filters that weigh particles by likelihood * prior / proposal (hdepf paper, eq. 7).

The proposal may be a Kalman filter of each particle (de Freitas et al. 2000; van der Merwe et al. 2000,
section 4).
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal, NamedTuple, TypeAlias, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import particle_diagnostics, particle_weights
from trackbench.core.arrays import Array, choose, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.elementary import log, logaddexp
from trackbench.core.particle_weights import WeightReading, read_likelihood
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.random_streams import Streams
from trackbench.core.sigma_points import Unscented
from trackbench.field_types import Finite, NonNegative, Positive, Share
from trackbench.filters.assumed_noise import AssumedNoise, idle_noise_mean
from trackbench.filters.base import Filter
from trackbench.filters.particle_base import PFState
from trackbench.filters.sigma_point_steps import augmented_step
from trackbench.filters.singular_process_noise import proposal_conflicts
from trackbench.filters.ukf import spread_conflicts
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
        """Draw one new state for each particle.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : PFState
            State of step k - 1, whose `particles` x (n_x, M, N) are moved.
        z : array (n_z, M)
            Measurements of step k; NaN where one is missing.
        k : int
            Number of the step.
        rng : numpy.random.Generator
            Random numbers of the block of runs, the only ones allowed.

        Returns
        -------
        Proposals
            Draws (n_x, M, N) and the density that they are drawn from.
        """

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

        It is the log-density of each particle's posterior, up to a constant. The key ``weights`` names
        the arithmetic of the likelihood: logarithms, or exp() in float64. By the key
        ``transition_density`` the noise of p(x | origin) is x - f(origin) ("model"), or the increment x
        - origin ("increment"), as in van der Merwe's public demo of the unscented particle filter.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        origin : array (n_x, M, N)
            Particles at step k - 1, each the parent of the particle at the same place in x.
        z : array (n_z, M)
            Measurements of step k; NaN where one is missing.
        k : int
            Number of the step.

        Returns
        -------
        callable
            Takes particles x (n_x, M, N) of step k and returns the log-densities (M, N).
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


@dataclass(frozen=True, kw_only=True)
class KalmanProposalFilter(ProposalFilter):
    """Base of the filters that draw each particle from a Kalman filter of its own."""

    Q: Positive | None = None
    """process noise variance the proposal assumes; default: the model's"""
    R: Positive | None = None
    """measurement noise variance the proposal assumes; default: the model's"""
    P0: NonNegative | None = None
    """initial variance of each particle's Kalman filter; default: the prior's"""
    noise_mean: bool = True
    """whether the proposal's prediction adds the mean of the process noise"""
    defensive: Share = 0.0
    """share of draws taken from the transition instead, which bounds the weights"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw N particles from the prior, each with the covariance of its Kalman filter."""
        state = super().init(model, prior, rng)
        shape = state.particles.x.shape
        # The particles of a run start with one covariance: P is (n, n, M, N).
        cov = prior.cov
        if self.P0 is not None:
            cov = self.P0 * np.eye(len(prior.mean))
        P = np.broadcast_to(with_trailing(cov, 2, leading=2), (shape[0], *shape))
        return state._replace(P=P)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject also models that the particles' Kalman filter cannot use."""
        return super().conflicts(scenario) | self._kalman_conflicts(scenario.model)

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report as idle the keys of the Kalman proposal if all draws come from the transition."""
        idle = super().idle_keys(scenario) | idle_noise_mean(scenario)
        if self.defensive == 1.0:
            keys = ("Q", "R", "P0", "noise_mean", "alpha", "beta", "kappa")
            idle |= dict.fromkeys(keys, "with `defensive: 1`")
        return idle

    def _draw_proposals(
        self, model: Model, state: PFState, z: Array, k: int, rng: Generator
    ) -> Proposals:
        """Draw each particle from its Kalman posterior, or from the transition (defensive)."""
        assert state.P is not None
        # Step 1: update the Kalman filter of each particle by z_k.
        each = Gaussian(state.particles.x, state.P)
        kalman = self._kalman(model, each, z, k, AssumedNoise(self.Q, self.R, self.noise_mean))
        # Step 2: draw from its posterior, or from a mixture with the transition.
        q = self._density(model, kalman, state.particles.x, k)
        return Proposals(x=q.sample(rng), q=q, kalman=kalman)

    def _density(self, model: Model, kalman: Gaussian, origin: Array, k: int) -> Density:
        """Return the density of the draws: the Kalman posteriors, or their mixture with the transition.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        kalman : Gaussian
            Kalman posterior of each particle: mean (n_x, M, N), covariance (n_x, n_x, M, N).
        origin : array (n_x, M, N)
            Particles of step k - 1, from which the transition leads to step k.
        k : int
            Number of the step.

        Returns
        -------
        Gaussian or DefensiveMixture
            ``kalman``, or with the key ``defensive`` its mixture with p(x_k | origin).
        """
        if self.defensive == 0.0:
            return kalman
        return DefensiveMixture(kalman, model.motion.transition(origin, k), self.defensive)

    @abstractmethod
    def _kalman(
        self, model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
    ) -> Gaussian:
        """Return the Kalman posterior of every particle.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : Gaussian
            Particles of step k - 1 as means (n_x, M, N), and their covariances (n_x, n_x, M, N).
        z : array (n_z, M)
            Measurements of step k, one for all particles of a run; NaN where one is missing.
        k : int
            Number of the step.
        assumed : AssumedNoise
            Noise that the Kalman filter assumes, by the keys Q, R and ``noise_mean``.

        Returns
        -------
        Gaussian
            Mean (n_x, M, N) and covariance (n_x, n_x, M, N) at step k, given z.
        """

    def _kalman_conflicts(self, model: Model) -> dict[str, str]:
        """Return reasons why the particles' Kalman filter cannot use the model.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.

        Returns
        -------
        dict
            Reason by key of the filter; empty, as by default, if it can use every model.
        """
        return {}


@dataclass(frozen=True, kw_only=True)
class UnscentedProposal:
    """Keys and step of an unscented Kalman filter per particle, a mixin of `KalmanProposalFilter`."""

    alpha: Positive = 1.0
    """spread of the sigma points"""
    beta: Finite = 0.0
    """extra weight of the center in the covariance"""
    kappa: Finite = 2.0
    """secondary scaling of the sigma points"""

    def _kalman(
        self, model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
    ) -> Gaussian:
        """Return the UKF's posterior of every particle (n, M, N) at step k, given z (n_z, M)."""
        posterior, _ = augmented_step(model, state, z, k, assumed, self._rule)
        return posterior

    @cached_property
    def _rule(self) -> Unscented:
        return Unscented(self.alpha, self.beta, self.kappa)

    def _kalman_conflicts(self, model: Model) -> dict[str, str]:
        return spread_conflicts(self.alpha, self.kappa, model)
