"""Particle filters whose proposal is a Kalman filter per particle: EPF and UPF.

De Freitas et al. 2000; van der Merwe et al. 2000, section 4.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from numpy.random import Generator

from trackbench.core import particles
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.metropolis import independence_moves
from trackbench.core.particles import Evidence, Particles
from trackbench.core.resampling import Scheme, ancestors, select
from trackbench.field_types import Natural
from trackbench.filters.kalman_proposal import MERWE_PROPOSAL, ProposingFilter, UnscentedProposal
from trackbench.filters.particle_base import Cloud
from trackbench.models.base import Model
from trackbench.models.gaussian_steps import AssumedNoise, extended_step
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class _Resampling(ProposingFilter):
    resampling: Scheme = "systematic"
    """resampling scheme"""
    moves: Natural = 0
    """Metropolis-Hastings steps of each particle after resampling, drawn from its parent's proposal"""
    estimate_from: Literal["weighted", "resampled"] = "weighted"
    """cloud the estimate is taken from: before resampling, or after it and the moves as in the demo"""

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Propose, weight by lik * prior / proposal (eq. 7), resample, move."""
        origin = state.particles.x
        proposed = self._proposed(model, state, z, k, rng)
        target = self._log_target(model, origin, z, k)(proposed.x)
        w, dead, mass = particles.normalize(target - proposed.log_q(proposed.x))
        weighted = Particles(proposed.x, w)
        index = ancestors(w, rng, self.resampling)
        x, P = select(proposed.x, index), select(proposed.kalman.cov, index)
        if self.moves:
            # By proposals of each particle's parent: no Kalman step is taken again.
            parents, kalman = (
                select(origin, index),
                Gaussian(select(proposed.kalman.mean, index), P),
            )
            proposal = self._proposal(model, kalman, parents, k)
            log_target = self._log_target(model, parents, z, k)

            def log_ratio(x: Array) -> Array:
                return log_target(x) - proposal.log_prob(x)

            x = independence_moves(x, proposal.sample, log_ratio, self.moves, rng)
        resampled = Particles(x, particles.equal_weights(*w.shape))
        source = weighted if self.estimate_from == "weighted" else resampled
        told = (Evidence(mass, 0.0, self.N),)
        return Cloud(resampled, source, source.moments(), dead, P=P, w=w, evidence=told)


@register("filters", "epf")
@dataclass(frozen=True, kw_only=True)
class EPF(_Resampling):
    """Particle filter with an extended Kalman proposal per particle (de Freitas et al. 2000)."""

    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")
    presets: ClassVar[dict[str, dict[str, object]]] = {
        "matched": {},
        "merwe-demo": {
            "Q": 7.5,
            "R": 0.1,
            "P0": 0.75,
            "noise_mean": False,
            "weights": "floor",
            "resampling": "residual",
            "transition_density": "increment",
            "estimate_from": "resampled",
        },
    }

    def _kalman(
        self, model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
    ) -> Gaussian:
        return extended_step(model, state, z, k, assumed)[0]


@register("filters", "upf")
@dataclass(frozen=True, kw_only=True)
class UPF(UnscentedProposal, _Resampling):
    """Unscented particle filter (van der Merwe et al. 2000)."""

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "matched": {},
        "merwe-demo": {
            **MERWE_PROPOSAL,
            "weights": "floor",
            "resampling": "residual",
            "transition_density": "increment",
            "estimate_from": "resampled",
        },
    }
