"""Bases of the filters that draw each particle from a Kalman filter of its own.

De Freitas et al. 2000; van der Merwe et al. 2000, section 4.
"""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.sigma_points import Unscented
from trackbench.field_types import Finite, NonNegative, Positive, Share
from trackbench.filters.assumed_noise import AssumedNoise, idle_noise_mean
from trackbench.filters.particle_base import PFState
from trackbench.filters.proposal_base import DefensiveMixture, Density, ProposalFilter, Proposals
from trackbench.filters.sigma_point_step import augmented_step
from trackbench.filters.ukf import spread_conflicts
from trackbench.models.base import Model, Scene


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

        The transition is that from the particles ``origin`` of step k - 1.
        """
        if self.defensive == 0.0:
            return kalman
        return DefensiveMixture(kalman, model.motion.transition(origin, k), self.defensive)

    @abstractmethod
    def _kalman(
        self, model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
    ) -> Gaussian:
        """Return the Kalman posterior of every particle (n, M, N) at step k, given z (n_z, M)."""

    def _kalman_conflicts(self, model: Model) -> dict[str, str]:
        """Return reasons why the particles' Kalman filter cannot use the model, by key."""
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
