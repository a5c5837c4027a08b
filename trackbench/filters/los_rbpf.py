"""Particle filter in the line-of-sight frame: particles of bearing and cross speed, Kalman in range.

docs/pictures/line-of-sight.svg shows the geometry. With u = (cos theta, sin theta) along the line of
sight of a particle and t = (-sin theta, cos theta) across it::

    p = r u,    v = r' u + v_c t,    v_c = (px vy - py vx) / r,    r' = (px vx + py vy) / r
"""

from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import linalg, particle_diagnostics, particle_weights
from trackbench.core.arrays import Array, Mask
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.elementary import arctan2, cos_sin, log
from trackbench.core.line_of_sight import along_line_of_sight
from trackbench.core.particle_weights import Evidence
from trackbench.core.particles import Particles
from trackbench.core.random_streams import SomeRuns, Streams
from trackbench.core.regularization import Kernel, Mode, jitter_modes
from trackbench.core.sums import total
from trackbench.field_types import NonNegative, OpenShare
from trackbench.filters.base import WHOLE_FILTER
from trackbench.filters.cross_speed_modes import CrossSpeedModes, split_by_cross_speed_sign
from trackbench.filters.particle_base import ParticleFilter, PFState
from trackbench.models.base import Model, Scene
from trackbench.models.motions.linear import Linear
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.two_scan_prior import TwoPoint
from trackbench.registry import register


@register("filters", "los-rbpf")
@dataclass(frozen=True, kw_only=True)
class LineOfSight(ParticleFilter):
    """Rao-Blackwellized particle filter for a radar with an accurate range and a coarse azimuth.

    Each particle is a bearing and a cross speed with a Kalman filter of (range, range rate). Given
    the bearing, the range is linear, and all particles share one 2 x 2 covariance. The particles
    therefore need not hit the thin banana of the posterior, as those of `mpf` must. The sign of the
    cross speed can be ambiguous: while both signs are possible, each has at least a quarter of the
    particles. A fast target loses most of the first particles at its third range: at 5 km/s it
    takes some 8000 particles in the first three scans (`boost`). docs/pictures/line-of-sight.svg
    shows the geometry.
    """

    ess_threshold: OpenShare = 0.5
    """resample and regularize a run when its effective sample size is below this share of N"""
    kernel: Kernel = "epanechnikov"
    """regularization kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth"""
    requires: ClassVar[tuple[str, ...]] = ("state.planar", "motion.alike_axes", "prior.azimuths")
    mixes_runs: ClassVar[bool] = True
    diagnostic_names = ParticleFilter.diagnostic_names - {"ess"}  # the weights are not stored

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject weights other than logarithms, and a radar away from the origin."""
        if self.weights != "log":
            return {"weights": "los-rbpf weighs in the log domain only"}
        if not isinstance(scenario.model.sensor, RangeAzimuth):
            return {WHOLE_FILTER: "los-rbpf needs a radar of constant noise"}
        if not scenario.model.sensor.at_origin:
            return {
                WHOLE_FILTER: "los-rbpf needs a radar at the origin; the assumed one is elsewhere"
            }
        return {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw the azimuths of both scans; cross speed and range rate follow from the triangle."""
        assert isinstance(prior, TwoPoint)
        T = prior.T
        variance = cast(RangeAzimuth, model.sensor).R[0, 0]
        r1 = prior.first[0][:, None]
        r2 = prior.second[0][:, None]
        # The log-weights correct for draws with heavier tails than the prior's.
        a1, a2, log_w = prior.azimuths(rng, self._particle_count_after(0))
        # In the frame of the second scan, with d = a2 - a1, the first position is r1 (cos d, -sin d):
        # v_c = r1 sin d / T,  r' = (r2 - r1 cos d) / T.
        d = a2 - a1
        r = np.broadcast_to(r2, d.shape)
        c, s = cos_sin(d)
        x = _to_cartesian(*cos_sin(a2), r1 * s / T, r, (r2 - r1 * c) / T)
        # P of (r, r'): both ranges have the sensor's variance R; the acceleration adds q T / 3 to r'.
        of_acceleration = prior.q * T / 3.0
        rate_variance = 2.0 * variance / (T * T) + of_acceleration
        P = np.array([[variance, variance / T], [variance / T, rate_variance]])
        P = np.repeat(P[..., None], len(r1), axis=-1)
        cloud = Particles(x, particle_weights.normalize(log_w).w)
        state = PFState.first(cloud, log_w)
        return state._replace(estimate=_add_range_covariance(state.estimate, P), P=P)

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Move the particles, weigh by range and azimuth, correct along the line of sight, resample."""
        motion, sensor = cast("tuple[Linear, RangeAzimuth]", model)
        # Step 1: predict the particles and the covariance P of (r, r').
        x, P = _propagate(motion, state, rng)
        missing = np.isnan(z[0] + z[1])  # range or azimuth
        r, across, along = along_line_of_sight(np.where(missing, 0.0, z[1]), x[0], x[2])
        K, S, P = _kalman_gain(P, sensor.R[0, 0], missing)
        # Step 2: log w = log w - nu^2 / (2 S) - (a - theta)^2 / (2 sigma_a^2), nu = z_r - r.
        nu = z[0][:, None] - r
        half_distance = np.square(nu)
        angle = arctan2(across, along)
        half_distance *= (0.5 / S)[:, None]
        of_azimuth = np.square(angle, out=angle)
        of_azimuth *= 0.5 / sensor.R[1, 1]
        half_distance += of_azimuth
        if missing.any():
            # These runs neither move by a gain nor weigh.
            nu[missing] = 0.0
            half_distance[missing] = 0.0
        # For the number of operations in the tables: a likelihood for each particle (M, N).
        count_operations("likelihoods", half_distance, component_axes=0)
        log_w = state.log_w - half_distance
        w, collapsed, sum_of_weights = particle_weights.normalize(log_w)
        # The factor 1 / (2 pi sqrt(S) sigma_a) of the densities is left out of the weights.
        scale = 2.0 * np.pi * np.sqrt(S * sensor.R[1, 1])
        # The likelihood p(z_k | z_1..k-1) is the mean weight times this factor. A step without a
        # measurement has none.
        evidence = Evidence(
            sum_of_weights,
            carried=state.log_w,
            N=w.shape[1],
            scale=np.where(missing, np.nan, scale),
        )
        if collapsed.any():
            # These runs go on with equal weights.
            log_w = np.where(collapsed[:, None], 0.0, log_w)
        # Step 3: correct each particle by K nu along its own line of sight.
        relative_innovation = np.divide(nu, r, out=nu)
        weighted = Particles(_apply_gain(x, K, relative_innovation), w)
        new = PFState(
            particles=weighted,
            averaged_particles=weighted,
            estimate=_add_range_covariance(weighted.moments(), P),
            collapsed=collapsed,
            age=state.age + 1,
            P=P,
            log_w=log_w,
            evidence=(evidence,),
        )
        # Step 4: resample and regularize the runs with few effective particles.
        return self._resample_degenerate(new, k, rng, self._particle_count_after(new.age))

    def _resample_degenerate(self, state: PFState, k: int, rng: Generator, size: int) -> PFState:
        """Resample and regularize the runs whose effective sample size is below the threshold.

        ``size`` is the number of particles from now on, which falls from `boost` times N to N in the
        first steps. If it changes, all runs are resampled, so that the threshold has no effect.

        The next step moves ``state.particles`` and adds to ``state.log_w``. These are the logarithms of
        the particles' weights up to a constant; 0.0 stands for equal weights. `averaged_particles` are
        the weighted particles whose mean is the estimate: they stay as they are before resampling.
        """
        x, w = state.averaged_particles
        # Also runs that have diverged, whose effective sample size is NaN.
        degenerate = ~(particle_diagnostics.effective_sample_size(w) >= self.ess_threshold * size)
        if size != w.shape[1]:
            degenerate[:] = True
        if not degenerate.any():
            return state
        # Resample in line-of-sight coordinates about the azimuth of each run's first particle. The rows
        # of x are px, vx, py, vy.
        old = x[:, degenerate]
        azimuth = arctan2(old[2, :, 0], old[0, :, 0])
        frame = Particles(_to_frame(azimuth, old), w[degenerate])
        # Each run has its own random numbers, which do not depend on the other degenerate runs.
        noise = SomeRuns(rng, k, np.flatnonzero(degenerate))
        modes = split_by_cross_speed_sign(frame)
        resampled, log_w = self._resample_with_mode_floor(frame, modes, noise, size)
        # Each mode of the cross speed has a kernel of its own. Without modes one kernel moves all
        # particles.
        if modes is None:
            kernels = [Mode(members=None, share=None, cov=frame.moments().cov)]
        else:
            kernels = modes.kernels(resampled.x)
        jittered = jitter_modes(resampled.x, kernels, self.kernel, noise, self.bandwidth_scale)
        new = _from_frame(azimuth, jittered)
        if degenerate.all():
            return state._replace(particles=Particles(new, resampled.w), log_w=log_w)
        # The other runs keep their particles and log-weights.
        out = Particles(x.copy(), w.copy())
        every_log_w = np.zeros_like(w)
        every_log_w += state.log_w
        out.x[:, degenerate] = new
        out.w[degenerate] = resampled.w
        every_log_w[degenerate] = log_w
        return state._replace(particles=out, log_w=every_log_w)

    def _resample_with_mode_floor(
        self, frame: Particles, modes: CrossSpeedModes | None, rng: Streams, size: int
    ) -> tuple[Particles, Array | float]:
        """Resample ``size`` particles so that a light mode has more than its share of them.

        ``frame`` are the particles in the coordinates of `_to_frame`, and ``modes`` splits them by the
        sign of the cross speed; None if each run has one sign. Return the particles and their
        log-weights, which make up for the larger share; 0.0 stands for equal weights.
        """
        if modes is None or (modes.gain == 1.0).all():
            resampled = self._resample(frame, rng, size)
            return resampled, 0.0
        tilted = Particles(frame.x, frame.w * modes.of_each(frame.x, modes.gain))
        resampled = self._resample(tilted, rng, size)
        log_w = -log(modes.of_each(resampled.x, modes.gain))
        return Particles(resampled.x, particle_weights.normalize(log_w).w), log_w


def _propagate(motion: Linear, state: PFState, rng: Generator) -> tuple[Array, Array]:
    """Predict the particles (px, vx, py, vy), (4, M, N), and the covariance P of (r, r') by one step.

    P (2, 2, M) is that of range and range rate, one for all particles of a run. The noise across the
    line of sight of a particle is drawn. The noise along it is added to P.
    """
    x = state.particles.x
    P = state.P
    assert P is not None
    # Both axes are alike, and so is every direction: rows 0 and 1 are position and velocity along x.
    T = motion.F[0, 1]
    F = motion.F[:2, :2]
    Q = motion.Q[:2, :2]
    # (w_p, w_v) ~ N(0, Q), divided by r: the noise across is w t = (w / r) (-py, px)
    w_p, w_v = linalg.matvec(linalg.root(Q), rng.standard_normal((2, *x.shape[1:])))
    px, vx, py, vy = x
    inverse_r = 1.0 / np.sqrt(px * px + py * py)
    w_p *= inverse_r
    w_v *= inverse_r
    out = np.empty_like(x)
    # p' = p + T v + w_p t
    np.multiply(vx, T, out=out[0])
    np.multiply(vy, T, out=out[2])
    out[0] += px
    out[2] += py
    out[0] -= py * w_p
    out[2] += px * w_p
    # v' = v + w_v t
    np.subtract(vx, py * w_v, out=out[1])
    np.add(vy, px * w_v, out=out[3])
    # P' = F P F' + Q
    return out, linalg.sandwich(F, P) + Q[..., None]


def _apply_gain(x: Array, K: Array, relative_innovation: Array) -> Array:
    """Correct the particles x (4, M, N) in place along their lines of sight, and return them.

    ``relative_innovation`` (M, N) is nu / r, so that the innovation along the line of sight u is
    ``nu u = (nu / r) p``. K (2, M) is the gain of range and range rate.
    """
    for axis in (0, 2):
        # v += K2 nu u, then p += K1 nu u
        u = relative_innovation * x[axis]
        x[axis + 1] += K[1][:, None] * u
        u *= K[0][:, None]
        x[axis] += u
    return x


def _kalman_gain(P: Array, variance: float, missing: Mask) -> tuple[Array, Array, Array]:
    """Return the gain (2, M) of a measured range, its innovation variance (M,) and the posterior P.

    P (2, 2, M) is that of range and range rate, ``variance`` that of the measurement. Runs whose
    measurement is ``missing`` (M,) have the gain zero.
    """
    # For the number of operations in the tables: an update of a covariance for each run.
    count_operations("covariances", P, component_axes=2)
    # S = P11 + R,  K = P h / S,  P' = P - K S K', with h = [1, 0]'
    S = P[0, 0] + variance
    K = np.where(missing, 0.0, P[:, 0] / S)
    return K, S, P - linalg.outer(K, K) * S


def _add_range_covariance(moments: Gaussian, P: Array) -> Gaussian:
    """Add the covariance P (2, 2, M) of range and range rate to the moments of the particles.

    P is added along one line of sight for all particles, that of their mean. Each particle's own line
    of sight would change the covariance by less than sigma_range^2 / r^2 of the particles' covariance
    across the line of sight.
    """
    u = moments.mean[0::2] / np.sqrt(total(np.square(moments.mean[0::2]), axis=0))
    cov = moments.cov.copy()
    # cov[(p_i, v_i), (p_j, v_j)] += u_i u_j P
    for i in range(2):
        for j in range(2):
            cov[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] += u[i] * u[j] * P
    return Gaussian(moments.mean, cov)


def _to_frame(azimuth: Array, x: Array) -> Array:
    """Transform states x, (px, vx, py, vy), to (2 tan(d / 2), v_c, r, r'), d the angle from an azimuth.

    x is (4, M, N), and ``azimuth`` (M,) is one of each run. v_c is the cross speed, r the range and r'
    the range rate.
    2 tan(d / 2) is nearly the angle d, with an error of third order. It does not jump within the
    particles, and the transform back needs no cosine.
    """
    px, vx, py, vy = x
    r, across, along = along_line_of_sight(azimuth, px, py)
    out = np.empty_like(x)
    # tan(d / 2) = across / (r + along)
    along += r
    np.divide(across, along, out=out[0])
    out[0] *= 2.0
    # v_c = (px vy - py vx) / r
    np.multiply(px, vy, out=out[1])
    out[1] -= py * vx
    # r' = (px vx + py vy) / r
    np.multiply(px, vx, out=out[3])
    out[3] += py * vy
    out[1] /= r
    out[3] /= r
    out[2] = r
    return out


def _from_frame(azimuth: Array, frame: Array) -> Array:
    """Transform line-of-sight coordinates (4, M, N) about an azimuth (M,) to states (px, vx, py, vy).

    The coordinates are those of `_to_frame`: 2 tan(d / 2) with the angle d from ``azimuth`` to the
    target, in rad; the cross speed v_c, positive if the azimuth grows, and the range rate r', both in
    m/s; and the range r in m, which is third.
    """
    t = 0.5 * frame[0]
    v_c, r, v_r = frame[1:]
    # cos d = 2 / (1 + t^2) - 1,  sin d = 2 t / (1 + t^2),  t = tan(d / 2)
    square_of_cos_half = 1.0 / (1.0 + t * t)
    c = 2.0 * square_of_cos_half - 1.0
    s = 2.0 * t * square_of_cos_half
    # theta = azimuth + d
    azimuth_c, azimuth_s = cos_sin(azimuth)
    azimuth_c = azimuth_c[:, None]
    azimuth_s = azimuth_s[:, None]
    cos = c * azimuth_c - s * azimuth_s
    sin = s * azimuth_c + c * azimuth_s
    return _to_cartesian(cos, sin, v_c, r, v_r)


def _to_cartesian(c: Array, s: Array, v_c: Array, r: Array, v_r: Array) -> Array:
    """Transform cross speed v_c, range r and range rate v_r to (px, vx, py, vy), an array (4, M, N).

    u = (c, s) is the line of sight. All arguments are (M, N).
    """
    out = np.empty((4, *r.shape))
    # p = r u
    np.multiply(r, c, out=out[0])
    np.multiply(r, s, out=out[2])
    # v = r' u + v_c t,  t = (-s, c)
    np.multiply(v_r, c, out=out[1])
    np.multiply(v_r, s, out=out[3])
    out[1] -= v_c * s
    out[3] += v_c * c
    return out
