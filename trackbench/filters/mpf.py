"""Marginalized particle filter: positions are particles, velocities have a Kalman filter.

Derivation (Schon, Gustafsson & Nordlund 2005, for constant velocity along each axis). Given the
positions of its particle, each velocity is Gaussian with mean v and variance C, the same C in all
particles. With ``p' = p + T v + w1``, ``v' = v + w2`` and ``cov(w1, w2) = [[Q11, Q12], [Q12,
Q22]]``, the displacement ``dp = p' - p`` and v' are jointly Gaussian::

    dp ~ N(T v, N),  N = T^2 C + Q11
    v' ~ N(v, C + Q22),  cov(dp, v') = T C + Q12

The filter draws dp (velocities marginalized), and conditions v' on it: ``K = (T C + Q12) / N``,
``v' = v + K (dp - T v)``, ``C' = C + Q22 - K^2 N``. This is the second measurement update of Schon
et al. with the noises decorrelated.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import particle_weights
from trackbench.core.arrays import Array
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.particles import Particles, displaced
from trackbench.core.regularization import Kernel, jitter, jitter_if_measured
from trackbench.field_types import NonNegative
from trackbench.filters.base import WHOLE_FILTER
from trackbench.filters.particle_base import ParticleFilter, PFState
from trackbench.models.base import Model, Scene
from trackbench.models.motions.linear import Linear
from trackbench.models.two_scan_prior import TwoPoint
from trackbench.registry import register


@register("filters", "mpf")
@dataclass(frozen=True, kw_only=True)
class MPF(ParticleFilter):
    """Marginalized (Rao-Blackwellized) particle filter for a position sensor and constant velocity.

    Schon, Gustafsson & Nordlund 2005; banana paper, section VI. In print eqs. 14 and 15 are
    exchanged, and eqs. 16-17 leave out that one acceleration drives position and velocity.
    """

    regularize: Literal["joint", "position", "none"] = "joint"
    """components jittered after resampling: positions with their velocities, positions alone, none"""
    kernel: Kernel = "epanechnikov"
    """regularization kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth"""
    requires: ClassVar[tuple[str, ...]] = ("state.planar", "motion.alike_axes", "prior.positions")
    diagnostic_names = ParticleFilter.diagnostic_names - {"ess"}  # the weights are not stored

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a motion without process noise.

        With q = 0 the velocity variance C would be zero after one step, and the gain K would be 0 / 0.
        """
        if cast(Linear, scenario.model.motion).Q[0, 0] == 0.0:
            return {WHOLE_FILTER: "mpf needs process noise: q must be greater than 0"}
        return {}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report the kernel's keys as idle if nothing is jittered."""
        idle = super().idle_keys(scenario)
        if self.regularize == "none":
            idle |= dict.fromkeys(("kernel", "bandwidth_scale"), "with `regularize: none`")
        return idle

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw the positions of both scans; their difference over T is the velocity's mean."""
        assert isinstance(prior, TwoPoint)
        first, second, log_w = prior.positions(rng, self._particle_count_after(0))
        vx, vy = (second - first) / prior.T
        x = np.stack([second[0], vx, second[1], vy])
        cloud = Particles(x, particle_weights.normalize(log_w).w)
        # Velocity variance given both positions, of a white acceleration over T: C = q T / 3.
        C = np.array(prior.q * prior.T / 3.0)
        state = PFState.first(cloud, log_w)
        return state._replace(estimate=_add_velocity_variance(state.estimate, C), P=C)

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Draw positions, condition the velocities on them, weigh, resample, regularize.

        The particles are (px, E vx, py, E vy). C, the state's ``P``, is the variance of each velocity
        given the positions, which all particles share.
        """
        # Steps 1 and 2: draw the positions, condition the velocities on the displacements.
        x, C = _propagate(cast(Linear, model.motion), state, rng)
        # Step 3: weigh by the likelihood of the positions.
        w, collapsed, evidence = self._weigh(model, state, z, x, k)
        weighted = Particles(x, w)
        age = state.age + 1
        moments = weighted.moments()
        # Step 4: resample and regularize; C is the same in all particles. The first `boost_scans` steps
        # have more particles, so their number depends on the age, the number of steps done.
        resampled = self._resample(weighted, rng, self._particle_count_after(age))
        jittered = self._jitter(resampled.x, moments.cov, rng)
        regularized = jitter_if_measured(z, resampled.x, jittered)
        return PFState(
            particles=Particles(regularized, resampled.w),
            averaged_particles=weighted,  # those whose mean is the estimate, before resampling
            estimate=_add_velocity_variance(moments, C),
            collapsed=collapsed,
            age=age,
            P=C,
            evidence=evidence,
        )

    def _jitter(self, x: Array, cov: Array, rng: Generator) -> Array:
        """Jitter the resampled particles x (4, M, N), as the key `regularize` says.

        ``cov`` (4, 4, M) is the covariance of the particles before resampling.
        """
        if self.regularize == "none":
            return x
        if self.regularize == "position":
            px, py = jitter(x[0::2], cov[0::2, 0::2], self.kernel, rng, self.bandwidth_scale)
            return np.stack([px, x[1], py, x[3]])
        return jitter(x, cov, self.kernel, rng, self.bandwidth_scale)


def _propagate(motion: Linear, state: PFState, rng: Generator) -> tuple[Array, Array]:
    """Predict the particles (px, E vx, py, E vy) by one step; return also the velocity variance C'.

    C and C' are one number, (), for both axes of all particles and runs.
    """
    x = state.particles.x
    C = state.P
    assert C is not None
    # Both axes are alike: rows 0 and 1 are position and velocity along x.
    T = motion.F[0, 1]
    Q = motion.Q
    # N = T^2 C + Q11, K = (T C + Q12) / N
    N = T * T * C + Q[0, 0]
    K = (T * C + Q[0, 1]) / N
    count_operations("covariances", C, component_axes=0)  # one, for the operations in the tables
    # dp - T v ~ N(0, N), of both axes
    position_innovation = rng.standard_normal((2, *x.shape[1:]))
    position_innovation *= np.sqrt(N)
    # p' = p + T v + (dp - T v),  v' = v + K (dp - T v)
    out = displaced(x, T, position_innovation, K)
    # C' = C + Q22 - K^2 N
    return out, C + Q[1, 1] - K * K * N


def _add_velocity_variance(moments: Gaussian, C: Array) -> Gaussian:
    """Add the variance C, which every velocity has in all particles, to the particles' covariance."""
    cov = moments.cov.copy()
    cov[1, 1] += C
    cov[3, 3] += C
    return Gaussian(moments.mean, cov)
