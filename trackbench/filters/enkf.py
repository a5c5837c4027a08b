"""Filters that use only moments of draws: Gaussian particle, ensemble Kalman, particle flow."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import linalg, missing_components, particle_weights
from trackbench.core.angles import bring_together, mean_direction, near
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.operation_counts import count_operations
from trackbench.core.particle_weights import Evidence, equal_weights
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.smoothing import Transition, backwards
from trackbench.core.sums import dot, mean
from trackbench.filters.base import FixedLag, InnovationFilter, SmoothingFilter
from trackbench.filters.particle_base import PFState, WeightedParticlesFilter
from trackbench.models.base import DifferentiableSensor, Model, Scene, angle_rows
from trackbench.models.derivatives import jacobian_at
from trackbench.models.first_particles import draw_covering
from trackbench.models.likelihood import log_likelihood
from trackbench.registry import register


@register("filters", "gpf")
@dataclass(frozen=True, kw_only=True)
class GaussianPF(WeightedParticlesFilter):
    """Gaussian particle filter: draws from a Gaussian at each step, and resamples nothing.

    Kotecha & Djuric 2003a. The posterior is assumed Gaussian, with the moments of N weighted draws.
    """

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw from the prior and take the moments."""
        x, log_w = draw_covering(prior, rng, self.N)
        return _state_of_draws(x, log_w)

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Draw from the Gaussian, move, weigh, take the moments."""
        before = state.estimate.sample(rng, self.N)
        x = model.motion.transition(before, k).sample(rng)
        log_w = log_likelihood(model.sensor, z, x, k)
        return _state_of_draws(x, log_w, angle_rows(model.motion))


def _state_of_draws(x: Array, log_w: Array, angles: tuple[int, ...] = ()) -> PFState:
    """Return the state whose particles are the draws x (n, M, N) with log-weights (M, N).

    ``angles`` are the components that are angles: whole turns between them are removed before they are
    averaged.
    """
    # A log-weight that all particles share is broadcast to (M, N) first.
    w, collapsed, sum_of_weights = particle_weights.normalize(np.broadcast_to(log_w, x.shape[1:]))
    cloud = bring_together(Particles(x, w), angles)
    return PFState(
        particles=cloud,
        averaged_particles=cloud,
        estimate=cloud.moments(),
        collapsed=collapsed,
        w=w,
        # For p(z_k | z_1..k-1): the mean of N weights that were equal before the update.
        evidence=(Evidence(sum_of_weights, carried=0.0, N=w.shape[1]),),
    )


_GROWTH = 1.2  # of the steps in the flow's pseudo-time (Li & Coates 2017, section V)


class Ensemble(NamedTuple):
    """State of an ensemble filter: members of equal weight."""

    x: Array
    """members (n, M, N)"""
    nis: Array
    """NIS (M,) of the last measurement"""
    innovation: Innovation | None = None
    """innovation of the last measurement"""
    predicted: Array | None = None
    """members (n, M, N) before the last measurement"""


@dataclass(frozen=True, kw_only=True)
class EnsembleFilter(InnovationFilter[Ensemble]):
    """Base of the filters whose state is equally weighted draws."""

    N: Annotated[int, Ge(2)] = 100
    """number of members"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Ensemble:
        """Draw the members from the prior."""
        x = prior.sample(rng, self.N)
        return Ensemble(x, np.full(x.shape[1], np.nan))

    def estimate(self, state: Ensemble) -> Gaussian:
        """Return the mean and the sample covariance of the members."""
        m = mean(state.x)
        e = state.x - m[..., None]
        return Gaussian(m, _cross_cov(e, e))

    def posterior(self, state: Ensemble) -> Posterior:
        """Return the members."""
        return ParticlePosterior(Particles(state.x, equal_weights(*state.x.shape[1:])))


@register("filters", "enkf")
@dataclass(frozen=True, kw_only=True)
class EnKF(SmoothingFilter[Ensemble], EnsembleFilter):
    """Ensemble Kalman filter with perturbed measurements, or the ensemble transform filter.

    Evensen 1994; Burgers, van Leeuwen & Evensen 1998. The gain comes from the members' covariances,
    without a linearization of motion or sensor. The transform (Bishop, Etherton & Majumdar 2001; Hunt,
    Kostelich & Szunyogh 2007) gives the members the exact covariance of the update. The smoother is the
    ensemble RTS smoother.
    """

    form: Literal["perturbed", "etkf"] = "perturbed"
    """measurement errors drawn for each member, or the ensemble transform by a symmetric root"""
    rotation: bool = False
    """rotate the transformed deviations at random about their mean (Sakov & Oke 2008)"""
    centered: bool = False
    """draw measurement errors whose mean over the members is zero, which helps small ensembles"""
    inflation: Annotated[float, Ge(1), Interval(lt=float("inf"))] = 1.0
    """factor on the members' deviations from their mean after each update"""
    smooth: bool | FixedLag = False
    """estimate each step from all measurements of the run, or from so many later ones: {lag: 5}"""

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report the key of the other form as idle."""
        other = "rotation" if self.form == "perturbed" else "centered"
        return {other: f"with `form: {self.form}`"}

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a smoother with rotations: it follows each member, which a rotation mixes."""
        conflicts = super().conflicts(scenario)
        if self.smooths and self.rotation:
            conflicts["smooth"] = (
                "follows each member backwards, and `rotation: true` mixes the members"
            )
        return conflicts

    def step(self, model: Model, state: Ensemble, z: Array, k: int, rng: Generator) -> Ensemble:
        """Move every member, and correct it by the gain of the members' covariances."""
        # Step 1: move the members. Angles that differ by whole turns are brought together.
        moved = model.motion.transition(state.x, k).sample(rng)
        x, middle = _together(moved, angle_rows(model.motion))
        # Step 2: predicted measurements, as innovations about one point: angles are averaged away from
        # their cut.
        center = model.sensor.measurement(middle, k)
        z_of_members = model.sensor.measurement(x, k).mean
        predicted = model.sensor.innovation(z_of_members, center.mean[..., None])
        z_mean = mean(predicted)
        dx = x - mean(x)[..., None]
        dz = predicted - z_mean[..., None]
        R = with_trailing(center.cov, 1, leading=2)
        nu = model.sensor.innovation(z, center.mean + z_mean)
        missing = np.isnan(nu)
        known = np.where(missing, 0.0, nu)
        # Step 3: K = C S^-1, C = cov(x, z), S = cov(z, z) + R.
        C_transposed = linalg.transpose(_cross_cov(dx, dz))
        C_transposed, S = missing_components.drop_missing(
            C_transposed, _cross_cov(dz, dz) + R, missing
        )
        count_operations("covariances", S, component_axes=2)
        K = linalg.matmul(linalg.transpose(C_transposed), linalg.inverse(S))
        # Step 4: correct the members.
        if self.form == "etkf":
            dx = _transformed(
                dx,
                np.where(missing[..., None], 0.0, dz),
                S,
                missing_components.drop_missing_cov(R, missing),
            )
            if self.rotation:
                dx = _rotated(dx, rng)
            corrected = (mean(x) + linalg.matvec(K, known))[..., None] + dx
        else:
            corrected = self._perturbed(x, dz, known, K, R, rng)
        # Step 5: widen the ensemble about its mean.
        if self.inflation != 1.0:
            m = mean(corrected)[..., None]
            corrected = m + self.inflation * (corrected - m)
        innovation = Innovation(nu, S)
        return Ensemble(x=corrected, nis=innovation.nis, innovation=innovation, predicted=moved)

    def smoothed(
        self, model: Model, states: list[Ensemble], k: int, rng: Generator
    ) -> list[Ensemble]:
        """Smooth the members of every step by the ensemble RTS smoother (Raanes 2016)."""

        def smooth_one_back(i: int, later: Array) -> Array:
            """Smooth the members (n, M, N) of ``states[i]`` by those of the next state, smoothed."""
            x = states[i].x
            predicted = states[i + 1].predicted  # x moved, before the update
            assert predicted is not None
            later = near(later, predicted, angle_rows(model.motion))
            dx = x - mean(x)[..., None]
            dp = predicted - mean(predicted)[..., None]
            # G = C P_pred^-1 of the members; x_i + G (x_later_i - x_pred_i)
            moments = Gaussian(mean(predicted), _cross_cov(dp, dp))
            G = Transition(moments, _cross_cov(dx, dp)).gain
            return x + linalg.matvec(G[..., None], later - predicted)

        smoothed = backwards([state.x for state in states], smooth_one_back, self.lag)
        return [state._replace(x=x) for state, x in zip(states, smoothed, strict=True)]

    def _perturbed(
        self, x: Array, dz: Array, nu: Array, K: Array, R: Array, rng: Generator
    ) -> Array:
        """Move the members x (n, M, N) to x_i + K (z + e_i - z_i), e_i ~ N(0, R).

        ``dz`` (n_z, M, N) are the deviations of their predicted measurements z_i from the mean of these,
        and ``nu`` (n_z, M) is the innovation of that mean.
        """
        error = Gaussian(np.zeros_like(nu), R).sample(rng, self.N)
        if self.centered:
            # Without their mean the errors have (N - 1) / N of the variance.
            error = np.sqrt(self.N / (self.N - 1)) * (error - mean(error)[..., None])
        nu_of_members = nu[..., None] - dz + error
        return x + linalg.matvec(K[..., None], nu_of_members)


def _together(x: Array, angles: tuple[int, ...]) -> tuple[Array, Array]:
    """Shift angles of the members x (n, M, N) by whole turns so that they are near each other.

    Return the members, and their middle (n, M): the mean, or of an angle the mean direction. The
    members' angles are within half a turn of it.
    """
    if not angles:
        return x, mean(x)
    w = equal_weights(*x.shape[1:])
    middle = mean_direction(x, w, mean(x), angles)
    together = near(x, middle[..., None], angles)
    rows = list(angles)
    middle_of_all = mean(together)
    middle_of_all[rows] = middle[rows]
    return together, middle_of_all


def _transformed(dx: Array, dz: Array, S: Array, R: Array) -> Array:
    """Return the deviations of the updated members, ``dx T`` (ensemble transform).

    T is the symmetric root ``(I + dz' R^-1 dz / (N - 1))^-1/2``. ``dx`` (n, M, N) and ``dz`` (n_z, M, N)
    are the deviations of the members and of their predicted measurements. S is the covariance of the
    innovation, and R that of the measurement.
    """
    # E = I - W W' = L^-1 R L'^-1 = V diag(w) V',  W = L^-1 dz / sqrt(N - 1),  L L' = S
    L = linalg.cholesky(S)
    whitened = linalg.solve_lower(L[..., None], dz)
    if dz.shape[-1] <= len(dz):
        # As many measurements as members or more: the root itself, T = (I - W' W)^1/2 (N, N, runs).
        rows = np.ascontiguousarray(np.moveaxis(whitened, 2, 0))
        square = linalg.matmul(rows, linalg.transpose(rows)) / (dz.shape[-1] - 1.0)
        w, V = linalg.eigen(linalg.identity_minus(square))
        T = linalg.matmul(V * np.sqrt(np.maximum(w, 0.0)), linalg.transpose(V))
        transformed = linalg.matmul(np.ascontiguousarray(np.moveaxis(dx, 2, 1)), T)
        return np.ascontiguousarray(np.moveaxis(transformed, 1, 2))
    # Otherwise T = I - W' G W,  G = (I + E^1/2)^-1: matrices (n_z, n_z) are smaller.
    E = linalg.solve_lower(L[:, :, None], R)
    E = linalg.symmetrize(linalg.solve_lower(L[:, :, None], linalg.transpose(E)))
    w, V = linalg.eigen(E)
    G = linalg.matmul(V / (1.0 + np.sqrt(np.maximum(w, 0.0))), linalg.transpose(V))
    gain = linalg.matmul(_cross_cov(dx, whitened), G)
    return dx - linalg.matvec(gain[..., None], whitened)


def _rotated(dx: Array, rng: Generator) -> Array:
    """Rotate deviations dx (n, M, N) by a random orthogonal matrix that keeps their mean zero.

    The matrix is uniformly distributed: a product of reflections (Stewart 1980) in the space of
    deviations with mean zero.
    """
    runs, N = dx.shape[1:]
    # Step 1: y = dx B, B the reflection with B e_1 = (1, ..., 1) / sqrt(N): y_1 is the mean.
    to_mean = np.full(N, 1.0 / np.sqrt(N))
    to_mean[0] -= 1.0
    y = _reflected(dx, to_mean)
    # Step 2: from each axis on, the reflection that maps it to a normal vector's direction.
    for i in range(1, N):
        v = rng.standard_normal((runs, N - i))
        sign = np.where(v[:, 0] < 0.0, -1.0, 1.0)
        v[:, 0] += sign * np.sqrt(dot(v, v))
        y[..., i:] = _reflected(y[..., i:], v)
        y[..., i] *= -sign
    # Step 3: back to the members.
    return _reflected(y, to_mean)


def _reflected(y: Array, v: Array) -> Array:
    """Reflect rows y (n, M, m) in v (m,) or (M, m): ``y (I - 2 v v' / v'v)``."""
    return y - (2.0 * dot(y, v) / dot(v, v))[..., None] * v


@register("filters", "edh")
@dataclass(frozen=True, kw_only=True)
class ExactFlow(EnsembleFilter):
    """Exact Daum-Huang particle flow: particles move from the prediction to the posterior.

    Daum, Huang & Noushin 2010, in the form of Ding & Coates 2012: the flow that is exact for a linear
    Gaussian model, linearized at the particles' mean, with the particles' covariance.
    """

    steps: Annotated[int, Interval(ge=1, le=1000)] = 29
    """steps in pseudo-time, each 1.2 times as long as the one before"""
    requires: ClassVar[tuple[str, ...]] = ("sensor.jacobian",)

    def step(self, model: Model, state: Ensemble, z: Array, k: int, rng: Generator) -> Ensemble:
        """Move the particles, then integrate the flow."""
        moved = model.motion.transition(state.x, k).sample(rng)
        x, _ = _together(moved, angle_rows(model.motion))
        predicted = self.estimate(Ensemble(x, state.nis))  # of x: the NIS is not read
        start = predicted.mean
        P = predicted.cov
        # All particles of a run flow by one affine map of their deviations from the mean, x -> B x + c:
        # dB = A B dt, dc = (A c + b) dt (Euler steps, with A and b of the middle of each step).
        B = np.broadcast_to(with_trailing(np.eye(len(P)), 1, leading=2), P.shape)
        c = np.zeros_like(start)
        time = 0.0
        first_innovation = None
        sensor = cast(DifferentiableSensor, model.sensor)
        for length in _step_lengths(self.steps):
            A, b, innovation = _flow(sensor, Gaussian(start, P), c, z, k, time + 0.5 * length)
            if first_innovation is None:
                first_innovation = innovation
            B = B + length * linalg.matmul(A, B)
            c = c + length * (linalg.matvec(A, c) + b)
            time += length
        deviations = linalg.matvec(B[..., None], x - start[..., None])
        assert first_innovation is not None
        return Ensemble(
            x=deviations + (start + c)[..., None],
            nis=first_innovation.nis,
            innovation=first_innovation,
        )


def _flow(
    sensor: DifferentiableSensor, prior: Gaussian, shift: Array, z: Array, k: int, time: float
) -> tuple[Array, Array, Innovation]:
    """Return A (n, n, M) and b (n, M) of the flow dx = (A x + b) dt, and the innovation at its start.

    The states x are deviations from the mean m of the prior N(m, P). The measurement is linearized at
    m + shift, with ``y = z - h(m + shift) + H shift``. At the pseudo-time t, ``time``, of 0 to 1,
    ``A = -P H' (t H P H' + R)^-1 H / 2`` and ``b = (I + 2 t A) (I + t A) P H' R^-1 y`` (Ding & Coates
    2012, eqs. 9, 10).
    """
    shifted_mean = prior.mean + shift
    expected = sensor.measurement(shifted_mean, k)
    nu = sensor.innovation(z, expected.mean)
    missing = np.isnan(nu)
    H = jacobian_at(sensor, Gaussian(shifted_mean, prior.cov), k)
    H, R = missing_components.drop_missing(H, expected.cov, missing)
    H = with_trailing(H, 1, leading=2)
    R = with_trailing(R, 1, leading=2)
    PH = linalg.matmul(prior.cov, linalg.transpose(H))
    HPH = linalg.symmetrize(linalg.matmul(H, PH))
    # A = -P H' (t H P H' + R)^-1 H / 2 (eq. 9)
    A = -0.5 * linalg.matmul(PH, linalg.matmul(linalg.inverse(time * HPH + R), H))
    # b = (I + 2 t A) (I + t A) P H' R^-1 y (eq. 10)
    y = np.where(missing, 0.0, nu) + linalg.matvec(H, shift)
    b = linalg.matvec(PH, linalg.matvec(linalg.inverse(R), y))
    for factor in (1.0, 2.0):
        b = b + factor * time * linalg.matvec(A, b)
    return A, b, Innovation(nu, HPH + R)


def _step_lengths(steps: int) -> list[float]:
    """Return the lengths of the steps in pseudo-time, which grow by a factor and sum to one."""
    lengths = [_GROWTH**i for i in range(steps)]
    # In order: `sum` differs from Python 3.12 on.
    whole = 0.0
    for length in lengths:
        whole += length
    return [length / whole for length in lengths]


def _cross_cov(a: Array, b: Array) -> Array:
    """Return the sample covariance (n, m, M) of deviations a (n, M, N) and b (m, M, N)."""
    return np.stack([dot(row, b) for row in a]) / (a.shape[-1] - 1.0)
