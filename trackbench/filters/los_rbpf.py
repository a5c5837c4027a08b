"""Particle filter in the line-of-sight frame: bearing and cross speed are particles, range is not."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import linalg, particles
from trackbench.core.arrays import Array, Mask
from trackbench.core.counting import note
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.elementary import arctan2, cos_sin, log
from trackbench.core.kernel_smoothing import Kernel, Mode, jitter_modes
from trackbench.core.mixtures import combine
from trackbench.core.particles import Evidence, Particles
from trackbench.core.random_streams import SomeRuns, Streams
from trackbench.core.sums import total
from trackbench.field_types import NonNegative, OpenShare
from trackbench.filters.particle_base import Cloud, ParticleFilter
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import Linear
from trackbench.models.priors import TwoPoint
from trackbench.models.sensors.angular_base import along_line_of_sight
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.registry import register

_LEAST = 0.25  # of the particles for either mode
_SETTLED = 1e-6  # share of the weight of a mode that is given up
_APART = 3.0  # modes of the cross speed: distance of their means in sums of their deviations


class Senses(NamedTuple):
    """A cloud by its sense across the line of sight: shares of the weight (2, M), covs, gains (2, M).

    A range tells the square of the cross speed: until the azimuths tell its sign the cloud has two
    modes, and a kernel as wide as both would undo what the ranges have told. A cloud that is not
    clearly two (M,) is one, half of which stands on either side. ``gain`` is by how much more than its
    share of the particles a sense is given: a few bad azimuths speak for the wrong one, and of the few
    that would be left of the other none need be where the target is.
    """

    share: Array
    cov: list[Array]
    two: Mask
    gain: Array

    @staticmethod
    def of(x: Array, numbers: Array) -> Array:
        """The number (2, M) of each particle's own sense (M, N)."""
        return np.where(x[1] > 0.0, numbers[0][:, None], numbers[1][:, None])

    def modes(self, x: Array) -> list[Mode]:
        """Modes of the particles x (n, M, N)."""
        up = x[1] > 0.0
        shares = np.where(self.two, self.share, 1.0)
        return [Mode(up, shares[0], self.cov[0]), Mode(~up, shares[1], self.cov[1])]


def senses_of(frame: Particles) -> Senses | None:
    """The weighted cloud in either sense; None if all of it is on one side."""
    one_way = frame.x[1] > 0.0
    if (one_way == one_way[:, :1]).all():
        return None
    weights = [np.where(side, frame.w, 0.0) for side in (one_way, ~one_way)]
    share = np.stack([total(w) for w in weights])
    parts = [
        Particles(frame.x, w / np.maximum(part, 1e-300)[:, None]).moments()
        for w, part in zip(weights, share, strict=True)
    ]
    up, down = parts
    apart = up.mean[1] - down.mean[1]
    two = apart > _APART * (np.sqrt(up.cov[1, 1]) + np.sqrt(down.cov[1, 1]))
    two &= (share > 0.0).all(axis=0)
    whole = combine(parts, share).cov
    undecided = two & (share > _SETTLED).all(axis=0)
    wanted = np.clip(share, _LEAST, 1.0 - _LEAST)
    gain = np.where(undecided, wanted / np.maximum(share, _SETTLED), 1.0)
    return Senses(share, [np.where(two, part.cov, whole) for part in parts], two, gain)


@register("filters", "los-rbpf")
@dataclass(frozen=True, kw_only=True)
class LineOfSight(ParticleFilter):
    """Rao-Blackwellised particle filter for a range-azimuth sensor with a sharp range.

    Each particle is a bearing and a cross speed with a Kalman filter for (r, r'): given where it looks,
    the sharp range is linear, and all particles share one 2 x 2 covariance. So the particles need not
    hit the thin banana, as they must where the velocity is marginalised instead (`mpf`). A particle is
    kept as its Cartesian mean, and regularised in (theta, v_c, r, r') so that it stays on its arc, each
    sense of the cross speed by itself; while both are possible neither has less than a quarter of them.
    Few of the first draws survive the third range of a fast target: at 5 km/s it takes some 8000 in the
    first three scans (`boost`).
    """

    ess_threshold: OpenShare = 0.5
    """resample and regularise a run when its effective sample size is below this share of N"""
    kernel: Kernel = "epanechnikov"
    """regularisation kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth"""
    requires: ClassVar[tuple[str, ...]] = ("state.planar", "motion.alike_axes", "prior.azimuths")

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives: the weights are not kept."""
        return super().diagnostic_names - {"ess"}

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Weighs in the log domain only, and looks from where the scans of the start were taken."""
        if self.weights != "log":
            return {"weights": "los-rbpf weighs in the log domain only"}
        if not cast(RangeAzimuth, scenario.model.sensor).at_origin:
            return {"": "los-rbpf looks from the origin; the sensor it assumes stands elsewhere"}
        return {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """Both azimuths drawn, with weights; the triangle of the two measured ranges gives the rest."""
        assert isinstance(prior, TwoPoint)
        T, variance = prior.T, cast(RangeAzimuth, model.sensor).R[0, 0]
        r1, r2 = prior.first[0][:, None], prior.second[0][:, None]
        a1, a2, log_w = prior.azimuths(rng, self._size(0))
        d = a2 - a1
        r = np.broadcast_to(r2, d.shape)
        c, s = cos_sin(d)
        x = _states(*cos_sin(a2), r1 * s / T, r, (r2 - r1 * c) / T)
        walked = prior.q * T / 3.0
        P = np.array([[variance, variance / T], [variance / T, 2.0 * variance / (T * T) + walked]])
        P = np.repeat(P[..., None], len(r1), axis=-1)
        cloud = Particles(x, particles.normalize(log_w).w)
        dead = np.zeros(len(r1), dtype=np.bool_)
        return Cloud(cloud, cloud, _mixture(cloud, P), dead, 0, P, log_w)

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Move across the line of sight, weight by both components, correct along it, resample."""
        motion, sensor = cast("tuple[Linear, RangeAzimuth]", model)
        x, P = _moved(motion, state, rng)
        missing = np.isnan(z[0] + z[1])
        r, across, along = along_line_of_sight(np.where(missing, 0.0, z[1]), x[0], x[2])
        K, S, P = _corrected(P, sensor.R[0, 0], missing)
        nu = z[0][:, None] - r
        half_distance = np.square(nu) * (0.5 / S)[:, None]
        half_distance += np.square(arctan2(across, along)) * (0.5 / sensor.R[1, 1])
        if missing.any():
            nu[missing], half_distance[missing] = 0.0, 0.0
        note("likelihoods", half_distance, components=0)
        log_w = state.log_w - half_distance
        w, dead, mass = particles.normalize(log_w)
        scale = 2.0 * np.pi * np.sqrt(S * sensor.R[1, 1])
        told = Evidence(mass, state.log_w, w.shape[1], np.where(missing, np.nan, scale))
        nu /= r
        weighted = Particles(_stretched(x, K, nu), w)
        log_w, age = np.where(dead[:, None], 0.0, log_w), state.age + 1
        estimate = _mixture(weighted, P)
        cloud = Cloud(weighted, weighted, estimate, dead, age, P, log_w, evidence=(told,))
        return self._renewed(cloud, k, rng, self._size(age))

    def _renewed(self, cloud: Cloud, k: int, rng: Generator, size: int) -> Cloud:
        """The cloud with its poor runs resampled and regularised."""
        x, w = cloud.weighted
        poor = ~(particles.effective_sample_size(w) >= self.ess_threshold * size)
        if size != w.shape[1]:
            poor[:] = True
        if not poor.any():
            return cloud
        old = x[:, poor]
        middle = arctan2(old[2, :, 0], old[0, :, 0])
        frame = Particles(_to_frame(middle, old), w[poor])
        noise = SomeRuns(rng, k, np.flatnonzero(poor))
        senses = senses_of(frame)
        resampled, log_w = self._shared_out(frame, senses, noise, size)
        modes = (
            [Mode(None, None, frame.moments().cov)] if senses is None else senses.modes(resampled.x)
        )
        new = jitter_modes(resampled.x, modes, self.kernel, noise, self.bandwidth_scale)
        new = _from_frame(middle, new)
        if poor.all():
            return cloud._replace(particles=Particles(new, resampled.w), log_w=log_w)
        out, every_log_w = Particles(x.copy(), w.copy()), np.zeros_like(w)
        every_log_w += cloud.log_w
        out.x[:, poor], out.w[poor], every_log_w[poor] = new, resampled.w, log_w
        return cloud._replace(particles=out, log_w=every_log_w)

    def _shared_out(
        self, frame: Particles, senses: Senses | None, rng: Streams, size: int
    ) -> tuple[Particles, Array | float]:
        """The cloud resampled, a sense that may yet be the true one with more than its share."""
        if senses is None or (senses.gain == 1.0).all():
            return self._resampled(frame, rng, size), 0.0
        tilted = Particles(frame.x, frame.w * senses.of(frame.x, senses.gain))
        x = self._resampled(tilted, rng, size).x
        log_w = -log(senses.of(x, senses.gain))
        return Particles(x, particles.normalize(log_w).w), log_w


def _moved(motion: Linear, state: Cloud, rng: Generator) -> tuple[Array, Array]:
    """Particles (px, vx, py, vy) one step on, and the covariance of (r, r') along their sight.

    Noise across the line of sight is drawn; noise along it stays in the covariance.
    """
    x, P = state.particles.x, state.P
    assert P is not None
    T, F, Q = motion.F[0, 1], motion.F[:2, :2], motion.Q[:2, :2]
    w_p, w_v = linalg.matvec(linalg.root(Q), rng.standard_normal((2, *x.shape[1:])))
    px, vx, py, vy = x
    nearness = 1.0 / np.sqrt(px * px + py * py)
    w_p *= nearness
    w_v *= nearness
    out = np.empty_like(x)
    np.multiply(vx, T, out=out[0])
    np.multiply(vy, T, out=out[2])
    out[0] += px
    out[2] += py
    out[0] -= py * w_p
    out[2] += px * w_p
    np.subtract(vx, py * w_v, out=out[1])
    np.add(vy, px * w_v, out=out[3])
    return out, linalg.sandwich(F, P) + Q[..., None]


def _stretched(x: Array, K: Array, nu: Array) -> Array:
    """Each particle corrected along its own sight, in place; nu (M, N) is in parts of its range."""
    for axis in (0, 2):
        u = nu * x[axis]
        x[axis + 1] += K[1][:, None] * u
        u *= K[0][:, None]
        x[axis] += u
    return x


def _corrected(P: Array, variance: float, missing: Mask) -> tuple[Array, Array, Array]:
    """Gain (2, M), innovation variance (M,), covariance (2, 2, M) given a range; no gain without one."""
    note("covariances", P, components=2)
    S = P[0, 0] + variance
    K = np.where(missing, 0.0, P[:, 0] / S)
    return K, S, P - linalg.outer(K, K) * S


def _mixture(cloud: Particles, P: Array) -> Gaussian:
    """Moments of the particles with the covariance P along the mean line of sight.

    That the particles' own lines differ turns P by their spread of angle, which moves the covariance by
    less than sigma_range^2 / r^2 of what the cloud itself has across.
    """
    moments = cloud.moments()
    u = moments.mean[0::2] / np.sqrt(total(np.square(moments.mean[0::2]), axis=0))
    cov = moments.cov.copy()
    for i in range(2):
        for j in range(2):
            cov[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] += u[i] * u[j] * P
    return Gaussian(moments.mean, cov)


def _to_frame(azimuth: Array, x: Array) -> Array:
    """(2 t, v_c, r, r') of states (px, vx, py, vy), t the tangent of half the angle from an azimuth.

    2 t is the angle to third order, has no cut within the cloud, and goes back without a cosine.
    """
    px, vx, py, vy = x
    r, across, along = along_line_of_sight(azimuth, px, py)
    out = np.empty_like(x)
    along += r
    np.divide(across, along, out=out[0])
    out[0] *= 2.0
    np.multiply(px, vy, out=out[1])
    out[1] -= py * vx
    np.multiply(px, vx, out=out[3])
    out[3] += py * vy
    out[1] /= r
    out[3] /= r
    out[2] = r
    return out


def _from_frame(azimuth: Array, frame: Array) -> Array:
    """States (px, vx, py, vy) from line-of-sight coordinates about an azimuth."""
    t, v_c, r, v_r = 0.5 * frame[0], *frame[1:]
    part = 1.0 / (1.0 + t * t)
    c, s = 2.0 * part - 1.0, 2.0 * t * part
    middle_c, middle_s = (wave[:, None] for wave in cos_sin(azimuth))
    return _states(c * middle_c - s * middle_s, s * middle_c + c * middle_s, v_c, r, v_r)


def _states(c: Array, s: Array, v_c: Array, r: Array, v_r: Array) -> Array:
    """(px, vx, py, vy) of range, range rate and cross speed along and across (c, s)."""
    out = np.empty((4, *r.shape))
    np.multiply(r, c, out=out[0])
    np.multiply(r, s, out=out[2])
    np.multiply(v_r, c, out=out[1])
    np.multiply(v_r, s, out=out[3])
    out[1] -= v_c * s
    out[3] += v_c * c
    return out
