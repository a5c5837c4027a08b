"""Clouds of particles that filters carry, and what the filters share that move and resample them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import particles
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian, draw_covering
from trackbench.core.particles import Evidence, Particles, WeightReading, read_likelihood
from trackbench.core.posteriors import ParticlePosterior, Posterior
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import Scheme, ancestors, select
from trackbench.field_types import Count, Natural
from trackbench.filters.base import Filter
from trackbench.models.base import Model, Scene, log_likelihood


class Cloud(NamedTuple):
    """Particles to go on from; those of the estimate, with it; runs without weight; steps done.

    ``P`` is the covariance of what each particle carries in a Kalman filter, if it does, one of all or
    each its own (n, n, M, N); ``log_w`` (M, N) the weights' logarithms up to a constant, where the next
    step weighs what underflows; ``w`` (M, N) the weights before resampling, where they are noted;
    ``mode`` (M, N) the number of the motion that each particle follows, if there are several;
    ``evidence`` what the likelihood of the last measurement is the product of; ``notes`` further
    diagnostics (M,).
    """

    particles: Particles
    weighted: Particles
    estimate: Gaussian
    dead: Mask
    age: int = 0
    P: Array | None = None
    log_w: Array | float = 0.0
    w: Array | None = None
    mode: Index | None = None
    evidence: tuple[Evidence, ...] = ()
    notes: tuple[tuple[str, Array], ...] = ()

    @property
    def log_likelihood(self) -> Array:
        """Logarithm (M,) of the mean unnormalised weight; -inf where every likelihood was zero."""
        return self.evidence[0].log if self.evidence else np.full(self.dead.shape, np.nan)

    def noted(self) -> dict[str, Array]:
        """``dead_steps``: every likelihood was zero, and the cloud was kept with equal weights.

        ``ess``: effective sample size before resampling, as a share of N.
        """
        ess = {}
        if self.w is not None:
            ess["ess"] = particles.effective_sample_size(self.w) / self.w.shape[-1]
        return {"dead_steps": self.dead.astype(float)} | ess | dict(self.notes)


class CloudFilter(Filter[Cloud]):
    """Base of the filters whose estimate is that of a weighted cloud."""

    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"dead_steps"})

    def estimate(self, state: Cloud) -> Gaussian:
        """Weighted mean and covariance."""
        return state.estimate

    def expectation(self, state: Cloud, g: Callable[[Array], dict[str, Array]]) -> dict[str, Array]:
        """Posterior means (M,) of functions of the state."""
        return state.weighted.expectation(g)

    def log_likelihood(self, state: Cloud) -> Array:
        """Logarithm (M,) of the mean unnormalised weight; -inf where every likelihood was zero."""
        return state.log_likelihood

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return frozenset({"dead_steps", "ess"})

    def diagnostics(self, state: Cloud) -> dict[str, Array]:
        """``dead_steps``: every likelihood was zero, and the cloud was kept with equal weights.

        ``ess``: effective sample size before resampling, as a share of N.
        """
        return state.noted()


@dataclass(frozen=True, kw_only=True)
class ParticleFilter(CloudFilter):
    """Keys and hooks shared by the filters that carry a cloud."""

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""
    resampling: Scheme = "systematic"
    """resampling scheme"""
    weights: WeightReading = "log"
    """arithmetic of the likelihood: log-domain, exp() in float64, or exp() + 1e-99"""
    boost: Count = 1
    """factor on N during the first steps"""
    boost_scans: Natural = 0
    """how many steps the cloud is boosted for"""

    @property
    def max_particle_count(self) -> int:
        """Those of the boost."""
        return self.N * (self.boost if self.boost_scans else 1)

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Return the key of a boost that is set without the other one."""
        out = {} if self.boost_scans else {"boost": "with `boost_scans: 0`"}
        return out | ({"boost_scans": "with `boost: 1`"} if self.boost == 1 else {})

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """Draws from the prior in each run, with weights where it covers its tails."""
        x, log_w = draw_covering(prior, rng, self._size(0))
        cloud = Particles(x, particles.normalize(log_w).w)
        dead = np.zeros(x.shape[1], dtype=np.bool_)
        return Cloud(cloud, cloud, cloud.moments(), dead, 0, log_w=log_w)

    def posterior(self, state: Cloud) -> Posterior | None:
        """The cloud of the estimate; nothing of particles that carry a Gaussian each."""
        return ParticlePosterior(state.weighted) if state.P is None else None

    def _log_likelihood(self, model: Model, z: Array, x: Array, k: int) -> Array:
        return read_likelihood(log_likelihood(model.sensor, z, x, k), self.weights)

    def _weighed(
        self, model: Model, state: Cloud, z: Array, x: Array, k: int
    ) -> tuple[Array, Mask, tuple[Evidence, ...]]:
        """Weights (M, N) of moved particles x from those that the state carries; dead runs; evidence."""
        log_w = self._log_likelihood(model, z, x, k)
        equal = isinstance(state.log_w, float) and state.log_w == 0.0  # as resampling leaves them
        w, dead, mass = particles.normalize(log_w if equal else log_w + state.log_w)
        return w, dead, (Evidence(mass, state.log_w, w.shape[1]),)

    def _size(self, age: int) -> int:
        """Number of particles after so many steps."""
        return self.N * (self.boost if age < self.boost_scans else 1)

    def _resampled(self, cloud: Particles, rng: Streams, size: int) -> Particles:
        index = ancestors(cloud.w, rng, self.resampling, size)
        return Particles(select(cloud.x, index), particles.equal_weights(*index.shape))
