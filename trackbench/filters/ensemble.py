"""Filters that carry equal draws and learn from their moments: ensemble Kalman, particle flow."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple, cast

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import kalman, linalg, particles
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.counting import note
from trackbench.core.distributions import Distribution, Gaussian, draw_covering
from trackbench.core.kalman import Innovation
from trackbench.core.particles import Evidence, Particles, equal_weights
from trackbench.core.posteriors import ParticlePosterior, Posterior
from trackbench.core.sums import dot, mean
from trackbench.filters.base import Filter
from trackbench.filters.particle_base import Cloud, CloudFilter
from trackbench.models.base import DifferentiableSensor, Model, log_likelihood
from trackbench.registry import register


@register("filters", "gpf")
@dataclass(frozen=True, kw_only=True)
class GaussianPF(CloudFilter):
    """Gaussian particle filter: draws anew from a Gaussian at each step, so that nothing is resampled.

    Kotecha & Djuric 2003a. The moments are as right as N draws make them; that the posterior has no
    other shape is assumed.
    """

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """The moments of draws from the prior."""
        x, log_w = draw_covering(prior, rng, self.N)
        return _fitted(x, log_w)

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Draw, move, weigh, and keep the moments."""
        x = model.motion.transition(state.estimate.sample(rng, self.N), k).sample(rng)
        return _fitted(x, log_likelihood(model.sensor, z, x, k))


def _fitted(x: Array, log_w: Array) -> Cloud:
    """Draws (n, M, N) and log-weights (M, N)."""
    w, dead, mass = particles.normalize(np.broadcast_to(log_w, x.shape[1:]))
    cloud = Particles(x, w)
    told = (Evidence(mass, 0.0, w.shape[1]),)
    return Cloud(cloud, cloud, cloud.moments(), dead, w=w, evidence=told)


_GROWTH = 1.2  # of the steps in the flow's pseudo-time (Li & Coates 2017, section V)


class Ensemble(NamedTuple):
    """Members x (n, M, N) of equal weight, and the last normalised innovation squared (M,).

    ``seen`` is the innovation itself, once there is one.
    """

    x: Array
    nis: Array
    seen: Innovation | None = None


@dataclass(frozen=True, kw_only=True)
class EnsembleFilter(Filter[Ensemble]):
    """Base of the filters whose state is equal draws."""

    N: Annotated[int, Ge(2)] = 100
    """number of members"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Ensemble:
        """Draws from the prior."""
        x = prior.sample(rng, self.N)
        return Ensemble(x, np.full(x.shape[1], np.nan))

    def estimate(self, state: Ensemble) -> Gaussian:
        """Mean and sample covariance of the members."""
        m = mean(state.x)
        e = state.x - m[..., None]
        return Gaussian(m, _cross(e, e))

    def posterior(self, state: Ensemble) -> Posterior:
        """The members."""
        return ParticlePosterior(Particles(state.x, equal_weights(*state.x.shape[1:])))

    def log_likelihood(self, state: Ensemble) -> Array:
        """log N(innovation; 0, S) (M,), S by the members' covariances."""
        if state.seen is None:
            return np.full(state.nis.shape, np.nan)
        return state.seen.log_likelihood

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return frozenset({"nis"})

    def diagnostics(self, state: Ensemble) -> dict[str, Array]:
        """``nis``: normalised innovation squared, expected n_z."""
        return {"nis": state.nis}


@register("filters", "enkf")
@dataclass(frozen=True, kw_only=True)
class EnKF(EnsembleFilter):
    """Ensemble Kalman filter with perturbed measurements.

    Evensen 1994; Burgers, van Leeuwen & Evensen 1998. The gain is that of the members' covariances, so
    neither motion nor sensor is linearised.
    """

    def step(self, model: Model, state: Ensemble, z: Array, k: int, rng: Generator) -> Ensemble:
        """Move every member, and correct it by a measurement with an error drawn for it."""
        x = model.motion.transition(state.x, k).sample(rng)
        centre = model.sensor.measurement(mean(x), k)
        seen = model.sensor.innovation(
            model.sensor.measurement(x, k).mean, centre.mean[..., None]
        )  # about one point, so that angles are averaged away from the cut
        z_mean, R = mean(seen), with_trailing(centre.cov, 1, leading=2)
        dx, dz = x - mean(x)[..., None], seen - z_mean[..., None]
        nu = model.sensor.innovation(z, centre.mean + z_mean)
        missing = np.isnan(nu)
        C, S = kalman.drop_missing(linalg.transpose(_cross(dx, dz)), _cross(dz, dz) + R, missing)
        note("covariances", S, components=2)
        K = linalg.matmul(linalg.transpose(C), linalg.inverse(S))
        error = Gaussian(np.zeros_like(nu), R).sample(rng, self.N)
        each = np.where(missing, 0.0, nu)[..., None] - dz + error
        x = x + linalg.matvec(K[..., None], each)
        innovation = Innovation(nu, S)
        return Ensemble(x, innovation.nis, innovation)


@register("filters", "edh")
@dataclass(frozen=True, kw_only=True)
class ExactFlow(EnsembleFilter):
    """Exact Daum-Huang particle flow: the likelihood moves the particles instead of weighing them.

    Daum, Huang & Noushin 2010, in the form of Ding & Coates 2012: the flow that is exact for a linear
    Gaussian model, linearised at the particles' mean, with the particles' own covariance.
    """

    steps: Annotated[int, Interval(ge=1, le=1000)] = 29
    """steps in pseudo-time, each 1.2 times as long as the one before"""
    requires: ClassVar[tuple[str, ...]] = ("sensor.jacobian",)

    def step(self, model: Model, state: Ensemble, z: Array, k: int, rng: Generator) -> Ensemble:
        """Move the particles, then let them flow from the prediction to the posterior."""
        x = model.motion.transition(state.x, k).sample(rng)
        predicted = self.estimate(Ensemble(x, state.nis))
        start, P = predicted.mean, predicted.cov
        # The flow of all particles of a run is one affine map of their deviations from the mean.
        turn = np.broadcast_to(with_trailing(np.eye(len(P)), 1, leading=2), P.shape)
        shift, done = np.zeros_like(start), 0.0
        nis, first, sensor = state.nis, state.seen, cast(DifferentiableSensor, model.sensor)
        for length in _lengths(self.steps):
            A, pull, seen = _flow(sensor, Gaussian(start, P), shift, z, k, done + 0.5 * length)
            nis, first = (nis, first) if done else (seen.nis, seen)
            turn = turn + length * linalg.matmul(A, turn)
            shift = shift + length * (linalg.matvec(A, shift) + pull)
            done += length
        flown = linalg.matvec(turn[..., None], x - start[..., None])
        return Ensemble(flown + (start + shift)[..., None], nis, first)


def _flow(
    sensor: DifferentiableSensor, prior: Gaussian, shift: Array, z: Array, k: int, time: float
) -> tuple[Array, Array, Innovation]:
    """A (n, n, M) and b (n, M) of the flow dx = (A x + b) dt about the mean; what z is to that mean.

    Ding & Coates 2012, eqs. 9 and 10, of deviations from the prior's mean m: ``y = z - h(m + shift) +
    H shift``, ``A = -P H' (t H P H' + R)^-1 H / 2``, ``b = (I + 2 t A) (I + t A) P H' R^-1 y``.
    """
    at = prior.mean + shift
    seen = sensor.measurement(at, k)
    nu = sensor.innovation(z, seen.mean)
    missing = np.isnan(nu)
    H, R = kalman.drop_missing(sensor.jacobian(at, k), seen.cov, missing)
    H, R = (with_trailing(matrix, 1, leading=2) for matrix in (H, R))
    PH = linalg.matmul(prior.cov, linalg.transpose(H))
    HPH = linalg.symmetrize(linalg.matmul(H, PH))
    A = -0.5 * linalg.matmul(PH, linalg.matmul(linalg.inverse(time * HPH + R), H))
    y = np.where(missing, 0.0, nu) + linalg.matvec(H, shift)
    b = linalg.matvec(PH, linalg.matvec(linalg.inverse(R), y))
    for factor in (1.0, 2.0):
        b = b + factor * time * linalg.matvec(A, b)
    return A, b, Innovation(nu, HPH + R)


def _lengths(steps: int) -> list[float]:
    """Lengths of the steps, which sum to one."""
    lengths = [_GROWTH**i for i in range(steps)]
    whole = 0.0
    for length in lengths:
        whole += length
    return [length / whole for length in lengths]


def _cross(a: Array, b: Array) -> Array:
    """Sample covariance (n, m, M) of deviations a (n, M, N) and b (m, M, N)."""
    return np.stack([dot(row, b) for row in a]) / (a.shape[-1] - 1.0)
