"""State of the particle filters, and the base of those that move and resample particles."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import particle_diagnostics, particle_weights
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.particle_weights import Evidence, WeightReading, read_likelihood
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import Scheme, ancestors, select
from trackbench.field_types import Count, Natural
from trackbench.filters.base import Filter
from trackbench.models.base import Model, Scene
from trackbench.models.first_particles import draw_covering
from trackbench.models.likelihood import log_likelihood


class PFState(NamedTuple):
    """State of a particle filter: N particles in each of M runs."""

    particles: Particles
    """particles that the next step moves"""
    averaged_particles: Particles
    """weighted particles whose mean is the estimate: before resampling or, if a key says so, after it"""
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
    """names and values (M,) of further diagnostics"""

    @classmethod
    def first(cls, cloud: Particles, log_w: Array | float = 0.0) -> "PFState":
        """Return the state before the first measurement.

        Parameters
        ----------
        cloud : Particles
            Particles x (n, M, N) with normalized weights w (M, N).
        log_w : array (M, N) or float
            Logarithms of the weights up to a constant; 0.0 stands for equal weights.

        Returns
        -------
        PFState
            State of age 0, without a collapsed run. Its estimate is the moments of the particles.
        """
        return cls(
            particles=cloud,
            averaged_particles=cloud,
            estimate=cloud.moments(),
            collapsed=np.zeros(len(cloud.w), dtype=np.bool_),
            log_w=log_w,
        )

    @property
    def log_likelihood(self) -> Array:
        """Logarithm (M,) of the mean unnormalized weight; -inf where every likelihood was zero."""
        return self.evidence[0].log if self.evidence else np.full(self.collapsed.shape, np.nan)

    def diagnostics(self) -> dict[str, Array]:
        """Return ``collapsed_steps``, 1 where every weight was zero, ``ess`` / N, and the extra ones."""
        values = {"collapsed_steps": self.collapsed.astype(float)}
        if self.w is not None:
            values["ess"] = particle_diagnostics.effective_share(self.w)
        return values | dict(self.extra_diagnostics)


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
        """Return posterior means (M,), by name, of the functions g (M, N) of the particles (n, M, N)."""
        return state.averaged_particles.expectation(g)

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
        """Report as idle a key of the boost, more particles in the first steps, without the other."""
        idle = {}
        if self.boost_scans == 0:
            idle["boost"] = "with `boost_scans: 0`"
        if self.boost == 1:
            idle["boost_scans"] = "with `boost: 1`"
        return idle

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw from the prior, with weights if the draws cover its tails."""
        x, log_w = draw_covering(prior, rng, self._particle_count_after(0))
        return PFState.first(Particles(x, particle_weights.normalize(log_w).w), log_w)

    def posterior(self, state: PFState) -> Posterior | None:
        """Return the weighted particles; None if each particle carries a Gaussian."""
        return ParticlePosterior(state.averaged_particles) if state.P is None else None

    # Named steps of `step`.

    def _weigh(
        self, model: Model, state: PFState, z: Array, x: Array, k: int
    ) -> tuple[Array, Mask, tuple[Evidence, ...]]:
        """Weigh moved particles by the likelihood, ``w_k = w_{k-1} p(z_k | x_k)``.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : PFState
            State of the step before, with the log-weights that the particles carry.
        z : array (n_z, M)
            Measurements of step k.
        x : array (n_x, M, N)
            Moved particles.
        k : int
            Number of the step.

        Returns
        -------
        w : array (M, N)
            Normalized weights.
        collapsed : array (M,)
            Runs in which every weight was zero, which get equal weights.
        evidence : tuple of Evidence
            Factors of the estimate of p(z_k | z_1..k-1), here one.
        """
        log_w = self._log_likelihood(model, z, x, k)
        # Resampling leaves the log-weights 0.0, which stands for equal weights.
        is_equal = isinstance(state.log_w, float) and state.log_w == 0.0
        if not is_equal:
            log_w = log_w + state.log_w
        w, collapsed, sum_of_weights = particle_weights.normalize(log_w)
        evidence = Evidence(sum_of_weights, carried=state.log_w, N=w.shape[1])
        return w, collapsed, (evidence,)

    def _log_likelihood(self, model: Model, z: Array, x: Array, k: int) -> Array:
        """Return the log-likelihood of particles, in the arithmetic that the key ``weights`` names.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        z : array (n_z, M)
            Measurements of step k; NaN where one is missing.
        x : array (n_x, M, N)
            Particles.
        k : int
            Number of the step.

        Returns
        -------
        array (M, N)
            log p(z_k | x_k = x); -inf where the arithmetic of ``weights: naive`` underflows.
        """
        return read_likelihood(log_likelihood(model.sensor, z, x, k), self.weights)

    def _resample(self, cloud: Particles, rng: Streams, size: int) -> Particles:
        """Resample the particles by the key `resampling`.

        Parameters
        ----------
        cloud : Particles
            Particles x (n, M, N) with normalized weights w (M, N).
        rng : Streams
            Random numbers of the block of runs, or of the runs that are resampled.
        size : int
            Number of new particles in each run.

        Returns
        -------
        Particles
            Copies x (n, M, size) with equal weights w (M, size).
        """
        index = ancestors(cloud.w, rng, self.resampling, size)
        return Particles(select(cloud.x, index), particle_weights.equal_weights(*index.shape))

    def _particle_count_after(self, age: int) -> int:
        """Return the number of particles after some steps, which the keys of the boost may raise.

        Parameters
        ----------
        age : int
            Number of steps done, `PFState.age`; 0 for the first particles.

        Returns
        -------
        int
            ``boost`` times N during the first ``boost_scans`` steps, N from then on.
        """
        return self.N * (self.boost if age < self.boost_scans else 1)
