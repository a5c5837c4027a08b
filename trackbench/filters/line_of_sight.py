"""Particle filter in the line-of-sight frame: bearing and cross speed are particles, range is not."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator

from trackbench.core import linalg, particles
from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.particles import Particles
from trackbench.core.regularisation import Kernel, jitter
from trackbench.core.streams import SomeRuns
from trackbench.filters.bootstrap import Cloud, ParticleFilter
from trackbench.keys import NonNegative, OpenShare
from trackbench.models.radar import wrapped
from trackbench.models.twopoint import TwoPoint
from trackbench.registry import register


@register("filters", "los-rbpf")
@dataclass(frozen=True, kw_only=True)
class LineOfSight(ParticleFilter):
    """Rao-Blackwellised particle filter for a range-azimuth sensor with a sharp range.

    Each particle is a bearing and a cross speed with a Kalman filter for (r, r'): given where it looks,
    the sharp range is linear, and all particles share one 2 x 2 covariance. So the particles need not
    hit the thin banana, as they must where the velocity is marginalised instead (`mpf`). A particle is
    kept as its Cartesian mean, and regularised in (theta, v_c, r, r') so that it stays on its arc.
    """

    ess_threshold: OpenShare = 0.5
    """resample and regularise a run when its effective sample size is below this share of N"""
    kernel: Kernel = "epanechnikov"
    """regularisation kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth"""
    needs: ClassVar[tuple[str, ...]] = ("motion.F", "motion.Q", "sensor.reading")

    def init(self, model: Any, prior: Distribution, rng: Generator) -> Cloud:
        """Both azimuths drawn; the triangle of the two measured ranges gives the rest."""
        assert isinstance(prior, TwoPoint)
        T, variance = prior.T, model.sensor.sigma_range**2
        r1, r2 = prior.first[0][:, None], prior.second[0][:, None]
        a1, a2 = (prior.azimuths(scan, rng, self._size(0)) for scan in (prior.first, prior.second))
        d = a2 - a1
        x = _from_frame(a2, r1 * np.sin(d) / T, r2, (r2 - r1 * np.cos(d)) / T)
        walked = prior.q * T / 3.0
        P = np.array([[variance, variance / T], [variance / T, 2.0 * variance / T**2 + walked]])
        P = np.repeat(P[..., None], len(r1), axis=-1)
        cloud = Particles(x, particles.uniform(*x.shape[1:]))
        dead = np.zeros(len(r1), dtype=np.bool_)
        return Cloud(cloud, cloud, _mixture(cloud, P), dead, 0, P)

    def step(self, model: Any, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Move across the line of sight, weight by both components, correct along it, resample."""
        sensor, age = model.sensor, state.age + 1
        x, P = _moved(model.motion, state, rng)
        missing = np.isnan(z[0] + z[1])
        r, a = sensor.polar(x)
        K, S, P = _corrected(P, sensor.sigma_range**2, missing)
        nu_r = z[0][:, None] - r
        log_w = np.log(state.particles.w)
        log_w -= np.square(nu_r) * (0.5 / S)[:, None]
        log_w -= np.square(wrapped(z[1][:, None] - a)) * (0.5 / sensor.sigma_azimuth**2)
        if missing.any():
            nu_r[missing], log_w[missing] = 0.0, np.log(state.particles.w[missing])
        w, dead = particles.normalise(log_w)
        along = nu_r / r
        for axis in (0, 2):
            u = along * x[axis]
            x[axis] += K[0][:, None] * u
            x[axis + 1] += K[1][:, None] * u
        weighted = Particles(x, w)
        cloud = self._renewed(sensor, weighted, k, rng, self._size(age))
        return Cloud(cloud, weighted, _mixture(weighted, P), dead, age, P)

    def _renewed(
        self, sensor: Any, cloud: Particles, k: int, rng: Generator, size: int
    ) -> Particles:
        """The cloud with its poor runs resampled and regularised."""
        poor = ~(particles.effective_sample_size(cloud.w) >= self.ess_threshold * size)
        if size != cloud.w.shape[1]:
            poor[:] = True
        if not poor.any():
            return cloud
        x = cloud.x[:, poor]
        frame = Particles(_to_frame(sensor, x), cloud.w[poor])
        noise = SomeRuns(rng, k, np.flatnonzero(poor))
        resampled = self._resampled(frame, noise, size)
        x = jitter(resampled.x, frame.moments().cov, self.kernel, noise, self.bandwidth_scale)
        x = _from_frame(*x)
        if poor.all():
            return Particles(x, resampled.w)
        out = Particles(cloud.x.copy(), cloud.w.copy())
        out.x[:, poor], out.w[poor] = x, resampled.w
        return out


def _moved(motion: Any, state: Cloud, rng: Generator) -> tuple[Array, Array]:
    """Particles (px, vx, py, vy) one step on, and the covariance of (r, r') along their sight.

    Noise across the line of sight is drawn; noise along it stays in the covariance.
    """
    x, P = state.particles.x, state.P
    assert P is not None
    T, F, Q = motion.F[0, 1], motion.F[:2, :2], motion.Q[:2, :2]
    w_p, w_v = linalg.matvec(linalg.cholesky(Q), rng.standard_normal((2, *x.shape[1:])))
    px, vx, py, vy = x
    r = np.sqrt(px * px + py * py)
    c, s = px / r, py / r
    out = np.empty_like(x)
    out[0] = px + T * vx - s * w_p
    out[1] = vx - s * w_v
    out[2] = py + T * vy + c * w_p
    out[3] = vy + c * w_v
    return out, linalg.sandwich(F, P) + Q[..., None]


def _corrected(P: Array, variance: float, missing: Mask) -> tuple[Array, Array, Array]:
    """Gain (2, M), innovation variance (M,), covariance (2, 2, M) given a range; no gain without one."""
    S = P[0, 0] + variance
    K = np.where(missing, 0.0, P[:, 0] / S)
    return K, S, P - linalg.outer(K, K) * S


def _mixture(cloud: Particles, P: Array) -> Gaussian:
    """Moments of the particles with the covariance P along the mean line of sight.

    That the particles' own lines differ turns P by their spread of angle, which moves the covariance by
    less than sigma_range^2 / r^2 of what the cloud itself has across.
    """
    moments = cloud.moments()
    u = moments.mean[0::2] / np.sqrt(np.square(moments.mean[0::2]).sum(axis=0))
    cov = moments.cov.copy()
    for i in range(2):
        for j in range(2):
            cov[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] += u[i] * u[j] * P
    return Gaussian(moments.mean, cov)


def _to_frame(sensor: Any, x: Array) -> Array:
    """(theta, v_c, r, r') of states (px, vx, py, vy); theta continuous within each cloud."""
    px, vx, py, vy = x
    r, a = sensor.polar(x)
    theta = a[:, :1] + wrapped(a - a[:, :1])
    return np.stack([theta, (px * vy - py * vx) / r, r, (px * vx + py * vy) / r])


def _from_frame(theta: Array, v_c: Array, r: Array, v_r: Array) -> Array:
    """States (px, vx, py, vy) from line-of-sight coordinates."""
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([r * c, v_r * c - v_c * s, r * s, v_r * s + v_c * c])
