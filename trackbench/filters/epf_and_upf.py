"""Particle filters whose proposal is a Kalman filter per particle: EPF and UPF.

De Freitas et al. 2000; van der Merwe et al. 2000, section 4.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from numpy.random import Generator

from trackbench.core import particle_weights
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.metropolis_hastings import independence_moves
from trackbench.core.particle_weights import Evidence, WeightReading
from trackbench.core.particles import Particles
from trackbench.core.resampling import Scheme, ancestors, select
from trackbench.field_types import Natural
from trackbench.filters.assumed_noise import AssumedNoise
from trackbench.filters.ekf import extended_step
from trackbench.filters.merwe_demo import MERWE_EKF_PROPOSAL, MERWE_PROPOSAL, MERWE_WEIGHTS
from trackbench.filters.particle_base import PFState
from trackbench.filters.proposal_base import (
    KalmanProposalFilter,
    TransitionReading,
    UnscentedProposal,
)
from trackbench.models.base import Model, angle_rows
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class _ResamplingFilter(KalmanProposalFilter):
    weights: WeightReading = "log"
    """arithmetic of the likelihood: log-domain, exp() in float64, or exp() + 1e-99"""
    transition_density: TransitionReading = "model"
    """noise in the weight's prior: x_k - f(x_{k-1}), or x_k - x_{k-1} as in the public demo"""
    resampling: Scheme = "systematic"
    """resampling scheme"""
    moves: Natural = 0
    """Metropolis-Hastings steps of each particle after resampling, drawn from its parent's proposal"""
    estimate_from: Literal["weighted", "resampled"] = "weighted"
    """particles the estimate is taken from: before resampling, or after it and the moves (demo)"""
    contract_exemptions: ClassVar[dict[str, str]] = {
        "consistency": "its weights degenerate where the motion's noise is small"
    }

    @property
    def _weight_reading(self) -> tuple[WeightReading, TransitionReading]:
        return self.weights, self.transition_density

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Draw from each particle's Kalman posterior, weigh, resample, move."""
        # Step 1: draw each particle from its own Kalman posterior q.
        origin = state.particles.x
        proposals = self._draw_proposals(model, state, z, k, rng)
        kalman = proposals.kalman
        assert kalman is not None  # the draws of a `KalmanProposalFilter` have it
        # Step 2: weigh by p(z|x) p(x|x_{k-1}) / q(x).
        target = self._log_target(model, origin, z, k)(proposals.x)
        w, collapsed, sum_of_weights = particle_weights.normalize(
            target - proposals.q.log_prob(proposals.x)
        )
        angles = angle_rows(model.motion)
        weighted = bring_together(Particles(proposals.x, w), angles)
        # Step 3: resample, each particle with its covariance.
        index = ancestors(w, rng, self.resampling)
        x = select(weighted.x, index)
        P = select(kalman.cov, index)
        # Step 4: move the particles by their parents' proposals: no Kalman step is taken again.
        if self.moves:
            parents = select(origin, index)
            q = self._density(model, Gaussian(select(kalman.mean, index), P), parents, k)
            log_target = self._log_target(model, parents, z, k)

            def log_ratio(x: Array) -> Array:
                return log_target(x) - q.log_prob(x)

            x = independence_moves(x, q.sample, log_ratio, self.moves, rng)
        resampled = bring_together(Particles(x, particle_weights.equal_weights(*w.shape)), angles)
        averaged = weighted if self.estimate_from == "weighted" else resampled
        return PFState(
            particles=resampled,
            averaged_particles=averaged,
            estimate=averaged.moments(),
            collapsed=collapsed,
            P=P,
            w=w,
            # For p(z_k | z_1..k-1): the mean of N weights. `carried` are the log-weights before the
            # update; 0.0 stands for equal ones.
            evidence=(Evidence(sum_of_weights, carried=0.0, N=self.N),),
        )


@register("filters", "epf")
@dataclass(frozen=True, kw_only=True)
class EPF(_ResamplingFilter):
    """Particle filter with an extended Kalman proposal per particle (de Freitas et al. 2000)."""

    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")
    presets: ClassVar[dict[str, dict[str, object]]] = {
        "matched": {},
        "merwe-demo": {**MERWE_EKF_PROPOSAL, **MERWE_WEIGHTS},
    }

    def _kalman(
        self, model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
    ) -> Gaussian:
        """Return the EKF's posterior of every particle (n, M, N) at step k, given z (n_z, M)."""
        posterior, _ = extended_step(model, state, z, k, assumed)
        return posterior


@register("filters", "upf")
@dataclass(frozen=True, kw_only=True)
class UPF(UnscentedProposal, _ResamplingFilter):
    """Unscented particle filter: a UKF proposes each particle (van der Merwe et al. 2000)."""

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "matched": {},
        "merwe-demo": {**MERWE_PROPOSAL, **MERWE_WEIGHTS},
    }
