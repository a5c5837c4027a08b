"""State of the particle filters, the base of those that move and resample particles, their smoother."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import linalg, particles
from trackbench.core.angles import bring_together, near
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian, draw_covering
from trackbench.core.particles import Evidence, Particles, WeightReading, read_likelihood
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import Scheme, ancestors, select
from trackbench.core.smoothing import backwards, draw_predecessors
from trackbench.field_types import Count, Natural
from trackbench.filters.base import Filter, SmoothingFilter, Trajectories
from trackbench.models.base import Model, Scene, angle_rows, log_likelihood


class PFState(NamedTuple):
    """State of a particle filter: N particles in each of M runs."""

    particles: Particles
    """particles that the next step moves"""
    weighted: Particles
    """particles that the estimate is the mean of"""
    estimate: Gaussian
    collapsed: Mask
    """runs (M,) in which every weight was zero: their particles got equal weights"""
    age: int = 0
    """steps done"""
    P: Array | None = None
    """covariance of the particles' Kalman filters: one of all, or each its own (n, n, M, N)"""
    log_w: Array | float = 0.0
    """logarithms of the weights (M, N) up to a constant, or 0.0 if they are equal"""
    w: Array | None = None
    """weights (M, N) before resampling, for the effective sample size"""
    mode: Index | None = None
    """number (M, N) of the motion that each particle follows"""
    evidence: tuple[Evidence, ...] = ()
    """factors of the likelihood of the last measurement"""
    extra_diagnostics: tuple[tuple[str, Array], ...] = ()
    origin: Index | None = None
    """flat indices (M, N) of those of ``weighted`` that ``particles`` are copies of, for figures"""

    @classmethod
    def first(cls, cloud: Particles, log_w: Array | float = 0.0) -> "PFState":
        """Return the state before the first measurement."""
        collapsed = np.zeros(len(cloud.w), dtype=np.bool_)
        return cls(cloud, cloud, cloud.moments(), collapsed, log_w=log_w)

    @property
    def log_likelihood(self) -> Array:
        """Logarithm (M,) of the mean unnormalized weight; -inf where every likelihood was zero."""
        return self.evidence[0].log if self.evidence else np.full(self.collapsed.shape, np.nan)

    def diagnostics(self) -> dict[str, Array]:
        """Return collapsed runs, the effective sample size as a share of N, and the extra ones."""
        ess = (
            {}
            if self.w is None
            else {"ess": particles.effective_sample_size(self.w) / self.w.shape[-1]}
        )
        return (
            {"collapsed_steps": self.collapsed.astype(float)} | ess | dict(self.extra_diagnostics)
        )


class WeightedParticlesFilter(Filter[PFState]):
    """Base of the filters whose estimate is the mean of weighted particles."""

    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"collapsed_steps"})
    diagnostic_names = frozenset({"collapsed_steps", "ess"})
    density_only: ClassVar[bool] = True

    def estimate(self, state: PFState) -> Gaussian:
        """Return the weighted mean and covariance."""
        return state.estimate

    def expectation(
        self, state: PFState, g: Callable[[Array], dict[str, Array]]
    ) -> dict[str, Array]:
        """Return posterior means (M,) of functions of the state."""
        return state.weighted.expectation(g)

    def log_likelihood(self, state: PFState) -> Array:
        """Return the logarithm (M,) of the mean unnormalized weight; -inf where all were zero."""
        return state.log_likelihood

    def diagnostics(self, state: PFState) -> dict[str, Array]:
        """Report ``collapsed_steps`` and ``ess``.

        ``collapsed_steps``: 1 where every weight was zero and the particles got equal weights. ``ess``:
        effective sample size before resampling, as a share of N.
        """
        return state.diagnostics()


@dataclass(frozen=True, kw_only=True)
class ParticleFilter(WeightedParticlesFilter):
    """Base of the filters that move particles by the motion, weigh and resample them."""

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""
    resampling: Scheme = "systematic"
    """resampling scheme"""
    weights: WeightReading = "log"
    """arithmetic of the likelihood: log-domain, exp() in float64, or exp() + 1e-99"""
    boost: Count = 1
    """factor on N during the first steps"""
    boost_scans: Natural = 0
    """number of steps with the boosted N"""

    @property
    def max_particle_count(self) -> int:
        """Number of particles during the boost."""
        return self.N * (self.boost if self.boost_scans else 1)

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report as idle a key of the boost that is set without the other one."""
        out = {} if self.boost_scans else {"boost": "with `boost_scans: 0`"}
        return out | ({"boost_scans": "with `boost: 1`"} if self.boost == 1 else {})

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw from the prior, with weights if the draws cover its tails."""
        x, log_w = draw_covering(prior, rng, self._size(0))
        return PFState.first(Particles(x, particles.normalize(log_w).w), log_w)

    def posterior(self, state: PFState) -> Posterior | None:
        """Return the weighted particles; None if each particle carries a Gaussian."""
        return ParticlePosterior(state.weighted) if state.P is None else None

    def _log_likelihood(self, model: Model, z: Array, x: Array, k: int) -> Array:
        return read_likelihood(log_likelihood(model.sensor, z, x, k), self.weights)

    def _weigh(
        self, model: Model, state: PFState, z: Array, x: Array, k: int
    ) -> tuple[Array, Mask, tuple[Evidence, ...]]:
        """Weigh the moved particles x: weights (M, N), collapsed runs, and the evidence."""
        log_w = self._log_likelihood(model, z, x, k)
        # w_k = w_{k-1} p(z | x); equal weights w_{k-1} drop out.
        equal = isinstance(state.log_w, float) and state.log_w == 0.0  # as resampling leaves them
        w, collapsed, mass = particles.normalize(log_w if equal else log_w + state.log_w)
        return w, collapsed, (Evidence(mass, state.log_w, w.shape[1]),)

    def _size(self, age: int) -> int:
        """Return the number of particles after so many steps."""
        return self.N * (self.boost if age < self.boost_scans else 1)

    def _resample(self, cloud: Particles, rng: Streams, size: int) -> tuple[Particles, Index]:
        """Copy each particle as often as the scheme draws it, with equal weights; return its index."""
        index = ancestors(cloud.w, rng, self.resampling, size)
        return Particles(select(cloud.x, index), particles.equal_weights(*index.shape)), index


@dataclass(frozen=True, kw_only=True)
class SimulatingSmoother(SmoothingFilter[PFState], ParticleFilter):
    """Base of the particle filters that smooth by backward simulation (Godsill et al. 2004)."""

    smooth: bool | Trajectories = False
    """estimate each step from all measurements of the run, or otherwise: {trajectories: 50, lag: 5}"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a smoother if the motion has no density, judged at one state if Q depends on it."""
        out, motion = super().conflicts(scenario), scenario.model.motion
        n = len(motion.components)
        x = np.linspace(0.3, 1.7, n)[:, None]
        transition = motion.transition(x, int(scenario.steps[0]) + 1) if self.smooths else None
        if isinstance(transition, Gaussian) and linalg.is_singular(transition.cov.reshape(n, n)):
            what = "weighs by the density of the process noise, and this motion's Q is singular"
            out["smooth"] = f"{what}; give every component noise, or smooth an ekf or ukf"
        return out

    def smoothed(
        self, model: Model, states: list[PFState], k: int, rng: Generator
    ) -> list[PFState]:
        """Replace the particles of every step by equally weighted trajectories."""

        def one_back(i: int, later: Array) -> Array:
            cloud = states[i].weighted
            transition = model.motion.transition(cloud.x, k + 1 + i)
            angles = angle_rows(model.motion)

            def log_density(x: Array) -> Array:
                # An angle of a later state is the same after whole turns.
                return transition.log_prob(near(x, transition.mean, angles))

            return draw_predecessors(cloud, log_density, later, rng)

        # Step 1: draw the last states from each posterior; a run that diverged stays NaN.
        count = self._keys.trajectories
        ends = []
        for x, w in (state.weighted for state in states):
            last = np.where(np.isnan(w), np.nan, x)
            ends.append(select(last, ancestors(w, rng, size=count)))
        # Step 2: draw the states before them, step by step.
        paths = backwards(ends, one_back, self.lag)
        angles = angle_rows(model.motion)
        clouds = []
        for x in paths:
            cloud = Particles(x, particles.equal_weights(*x.shape[1:]))
            clouds.append(bring_together(cloud, angles))
        # A trajectory goes on from step to step; with a lag each step has trajectories of its own.
        origin = None
        if self.lag is None:
            origin = np.arange(clouds[0].w.size).reshape(clouds[0].w.shape)
        return [
            state._replace(particles=cloud, weighted=cloud, estimate=cloud.moments(), origin=origin)
            for state, cloud in zip(states, clouds, strict=True)
        ]

    @property
    def _keys(self) -> Trajectories:
        return Trajectories() if isinstance(self.smooth, bool) else self.smooth
