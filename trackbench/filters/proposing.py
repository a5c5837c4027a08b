"""Particle filters whose proposal is a Kalman filter per particle: EPF and UPF.

De Freitas et al. 2000; van der Merwe et al. 2000, section 4.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from numpy.random import Generator

from trackbench.core import particles
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.moves import independence_moves
from trackbench.core.particles import Particles
from trackbench.core.posteriors import Posterior
from trackbench.core.resampling import Scheme, ancestors, select
from trackbench.filters.proposal import (
    MERWE_PROPOSAL,
    KalmanProposal,
    ProposedCloud,
    UnscentedProposal,
)
from trackbench.keys import Natural
from trackbench.models.base import Model
from trackbench.models.gaussian import extended_step
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class _Resampling(KalmanProposal[ProposedCloud]):
    resampling: Scheme = "systematic"
    """resampling scheme"""
    moves: Natural = 0
    """Metropolis-Hastings steps of each particle after resampling, drawn from its parent's proposal"""
    estimate_from: Literal["weighted", "resampled"] = "weighted"
    """cloud the estimate is taken from: before resampling, or after it and the moves as in the demo"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> ProposedCloud:
        """N draws from the prior."""
        return self.drawn(prior, rng)

    def step(
        self, model: Model, state: ProposedCloud, z: Array, k: int, rng: Generator
    ) -> ProposedCloud:
        """Propose, weight by lik * prior / proposal (eq. 7), resample, move."""
        origin = state.particles.x
        proposed = self.propose(model, state, z, k, rng)
        target = self.log_target(model, origin, z, proposed.x, k)
        w, dead, mass = particles.normalise(target - proposed.log_q(proposed.x))
        weighted = Particles(proposed.x, w)
        index = ancestors(w, rng, self.resampling)
        x, P = select(proposed.x, index), select(proposed.kalman.cov, index)
        if self.moves:
            kalman = Gaussian(select(proposed.kalman.mean, index), P)
            x = self._moved(model, x, select(origin, index), kalman, z, k, rng)
        resampled = Particles(x, particles.uniform(*w.shape))
        source = weighted if self.estimate_from == "weighted" else resampled
        return ProposedCloud(resampled, P, source.moments(), dead, w, mass, source)

    def _moved(
        self,
        model: Model,
        x: Array,
        parents: Array,
        kalman: Gaussian,
        z: Array,
        k: int,
        rng: Generator,
    ) -> Array:
        """Each particle moved by proposals of its parent: no Kalman step is taken again."""
        proposal = self._proposal(model, kalman, parents, k)

        def log_ratio(x: Array) -> Array:
            return self.log_target(model, parents, z, x, k) - proposal.log_prob(x)

        return independence_moves(x, proposal.sample, log_ratio, self.moves, rng)

    def estimate(self, state: ProposedCloud) -> Gaussian:
        """Weighted mean and covariance."""
        return state.estimate

    def posterior(self, state: ProposedCloud) -> Posterior:
        """The cloud of the estimate."""
        return state.posterior

    def log_likelihood(self, state: ProposedCloud) -> Array:
        """Logarithm (M,) of the mean weight lik * prior / proposal."""
        return self.log_evidence(state)

    def diagnostics(self, state: ProposedCloud) -> dict[str, Array]:
        """``dead_steps``: every weight was zero, and the cloud was kept with equal weights.

        ``ess``: effective sample size before resampling, ``distinct``: particles that are no copies
        after it, both as shares of N.
        """
        return state.noted() | {"distinct": particles.distinct(state.particles.x[0])}


@register("filters", "epf")
@dataclass(frozen=True, kw_only=True)
class EPF(_Resampling):
    """Particle filter with an extended Kalman proposal per particle (de Freitas et al. 2000)."""

    needs: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")
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

    def _kalman(self, model: Model, state: Gaussian, z: Array, k: int) -> Gaussian:
        return extended_step(model, state, z, k, self._assumed)[0]


@register("filters", "upf")
@dataclass(frozen=True, kw_only=True)
class UPF(UnscentedProposal[ProposedCloud], _Resampling):
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
