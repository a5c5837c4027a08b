"""Filters that carry equal draws and learn from their moments: ensemble Kalman, particle flow."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sums import dot, mean
from trackbench.models.base import Model
from trackbench.registry import register

_GROWTH = 1.2  # of the steps in the flow's pseudo-time (Li & Coates 2017, section V)


class Ensemble(NamedTuple):
    """Members x (n, M, N) of equal weight, and the last normalised innovation squared (M,)."""

    x: Array
    nis: Array


@dataclass(frozen=True, kw_only=True)
class EnsembleFilter:
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
        C, S = kalman.measured(linalg.transpose(_cross(dx, dz)), _cross(dz, dz) + R, missing)
        K = linalg.matmul(linalg.transpose(C), linalg.inverse(S))
        error = Gaussian(np.zeros_like(nu), R).sample(rng, self.N)
        each = np.where(missing, 0.0, nu)[..., None] - dz + error
        x = x + linalg.matvec(K[..., None], each)
        return Ensemble(x, Innovation(nu, S).nis)


@register("filters", "edh")
@dataclass(frozen=True, kw_only=True)
class ExactFlow(EnsembleFilter):
    """Exact Daum-Huang particle flow: the likelihood moves the particles instead of weighing them.

    Daum, Huang & Noushin 2010, in the form of Ding & Coates 2012: the flow that is exact for a linear
    Gaussian model, linearised at the particles' mean, with the particles' own covariance.
    """

    steps: Annotated[int, Interval(ge=1, le=1000)] = 29
    """steps in pseudo-time, each 1.2 times as long as the one before"""
    needs: ClassVar[tuple[str, ...]] = ("sensor.jacobian",)

    def step(self, model: Any, state: Ensemble, z: Array, k: int, rng: Generator) -> Ensemble:
        """Move the particles, then let them flow from the prediction to the posterior."""
        x = model.motion.transition(state.x, k).sample(rng)
        predicted = self.estimate(Ensemble(x, state.nis))
        start, P = predicted.mean, predicted.cov
        at, nis, done = start, state.nis, 0.0
        for step in _lengths(self.steps):
            time = done + 0.5 * step
            seen = model.sensor.measurement(at, k)
            nu = model.sensor.innovation(z, seen.mean)
            missing = np.isnan(nu)
            H, R = kalman.measured(model.sensor.jacobian(at, k), seen.cov, missing)
            H, R = (with_trailing(matrix, 1, leading=2) for matrix in (H, R))
            PH = linalg.matmul(P, linalg.transpose(H))
            of_prior = linalg.symmetrised(linalg.matmul(H, PH))
            if not done:
                nis = Innovation(nu, of_prior + R).nis
            # Ding & Coates, eqs. 9-10, applied to deviations from the prediction's mean: with
            # y = z - h(at) + H (at - start), dx/dt = A x + (I + 2 t A) (I + t A) P H' R^-1 y.
            A = -0.5 * linalg.matmul(PH, linalg.matmul(linalg.inverse(time * of_prior + R), H))
            y = np.where(missing, 0.0, nu) + linalg.matvec(H, at - start)
            pull = linalg.matvec(PH, linalg.matvec(linalg.inverse(R), y))
            pull = pull + time * linalg.matvec(A, pull)
            pull = pull + 2.0 * time * linalg.matvec(A, pull)
            e = x - start[..., None]
            x = x + step * (linalg.matvec(A[..., None], e) + pull[..., None])
            at, done = mean(x), done + step
        return Ensemble(x, nis)


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
