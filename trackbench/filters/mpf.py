"""Marginalised particle filter: positions are particles, velocities Kalman filters."""

from dataclasses import dataclass
from typing import ClassVar, Literal, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import particles
from trackbench.core.arrays import Array
from trackbench.core.counting import note
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kernel_smoothing import Kernel, jitter
from trackbench.core.particles import Particles
from trackbench.field_types import NonNegative
from trackbench.filters.particle_base import Cloud, ParticleFilter
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import Linear
from trackbench.models.priors import TwoPoint
from trackbench.registry import register


@register("filters", "mpf")
@dataclass(frozen=True, kw_only=True)
class MPF(ParticleFilter):
    """Marginalised (Rao-Blackwellised) particle filter for a position sensor and a linear motion.

    Schon, Gustafsson & Nordlund 2005; banana paper, section VI. As printed there, eqs. 14 and 15 are
    exchanged, and eqs. 16-17 leave out that one acceleration drives position and velocity.
    """

    regularise: Literal["joint", "position", "none"] = "joint"
    """what is jittered after resampling: positions with their velocities, positions alone, nothing"""
    kernel: Kernel = "epanechnikov"
    """regularisation kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth"""
    requires: ClassVar[tuple[str, ...]] = ("state.planar", "motion.alike_axes", "prior.positions")

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives: the weights are not kept."""
        return super().diagnostic_names - {"ess"}

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Without process noise nothing but its particle moves a position."""
        if cast(Linear, scenario.model.motion).Q[0, 0] == 0.0:
            return {"": "mpf needs process noise: q must be greater than 0"}
        return {}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Return the kernel's keys where nothing is jittered."""
        idle = ("kernel", "bandwidth_scale") if self.regularise == "none" else ()
        return super().idle_keys(scenario) | dict.fromkeys(idle, "with `regularise: none`")

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """Both first positions drawn, with weights; their difference over T is the velocity's mean."""
        assert isinstance(prior, TwoPoint)
        p1, p2, log_w = prior.positions(rng, self._size(0))
        vx, vy = (p2 - p1) / prior.T
        cloud = Particles(np.stack([p2[0], vx, p2[1], vy]), particles.normalize(log_w).w)
        C = np.array(prior.q * prior.T / 3.0)
        dead = np.zeros(len(vx), dtype=np.bool_)
        return Cloud(cloud, cloud, _with_velocity(cloud.moments(), C), dead, 0, C, log_w)

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Move positions, learn the velocities from the moves, weight, resample, regularise."""
        x, C = _moved(cast(Linear, model.motion), state, rng)
        w, dead, told = self._weighed(model, state, z, x, k)
        weighted, age = Particles(x, w), state.age + 1
        moments = weighted.moments()
        resampled = self._resampled(weighted, rng, self._size(age))
        cloud = Particles(self._jittered(resampled.x, moments.cov, rng), resampled.w)
        estimate = _with_velocity(moments, C)
        return Cloud(cloud, weighted, estimate, dead, age, C, evidence=told)

    def _jittered(self, x: Array, cov: Array, rng: Generator) -> Array:
        if self.regularise == "none":
            return x
        if self.regularise == "position":
            moved = jitter(x[0::2], cov[0::2, 0::2], self.kernel, rng, self.bandwidth_scale)
            return np.stack([moved[0], x[1], moved[1], x[3]])
        return jitter(x, cov, self.kernel, rng, self.bandwidth_scale)


def _moved(motion: Linear, state: Cloud, rng: Generator) -> tuple[Array, Array]:
    """Positions drawn with their velocities marginalised, and the velocities given the moves dz.

    The state is (px, E vx, py, E vy) with variance C of each velocity given its particle.
    ``dz ~ N(T v, T^2 C + Q11)`` and ``cov(dz, v') = T C + Q12``, so that
    ``v' = v + K (dz - T v)``, ``K = (T C + Q12) / (T^2 C + Q11)``: the decorrelated second measurement
    update of Schon et al. in one line.
    """
    x, C = state.particles.x, state.P
    assert C is not None
    T, Q = motion.F[0, 1], motion.Q
    N = T * T * C + Q[0, 0]
    K = (T * C + Q[0, 1]) / N
    note("covariances", C, components=0)
    surprise = np.sqrt(N) * rng.standard_normal((2, *x.shape[1:]))
    out = np.empty_like(x)
    out[0::2] = x[0::2] + T * x[1::2] + surprise
    out[1::2] = x[1::2] + K * surprise
    return out, C + Q[1, 1] - K * K * N


def _with_velocity(moments: Gaussian, C: Array) -> Gaussian:
    """The mixture's moments: the velocities' own variance added to that of their means."""
    cov = moments.cov.copy()
    cov[1, 1] += C
    cov[3, 3] += C
    return Gaussian(moments.mean, cov)
