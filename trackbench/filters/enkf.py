"""Ensemble Kalman filter: perturbed measurements, or the ensemble transform."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import linalg, missing_components
from trackbench.core.angles import near
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Gaussian
from trackbench.core.fixed_lag_smoothing import backwards
from trackbench.core.kalman import Innovation
from trackbench.core.rts_smoother import Transition
from trackbench.core.sums import dot, mean
from trackbench.filters.ensemble_base import Ensemble, EnsembleFilter, members_cov, members_together
from trackbench.filters.smoother_keys import FixedLag, SmoothingFilter
from trackbench.models.base import Model, Scene, angle_rows
from trackbench.registry import register


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
        """Move every member, and correct it by the gain of the members' covariances.

        The members are x (n, M, N).
        """
        # Step 1: move the members. Angles that differ by whole turns are brought together.
        moved = model.motion.transition(state.x, k).sample(rng)
        x, middle = members_together(moved, angle_rows(model.motion))
        # Step 2: predicted measurements, as innovations about one point: angles are averaged away from
        # their cut.
        center = model.sensor.measurement(middle, k)
        z_of_members = model.sensor.measurement(x, k).mean
        relative_z = model.sensor.innovation(z_of_members, center.mean[..., None])
        z_mean = mean(relative_z)
        dx = x - mean(x)[..., None]
        dz = relative_z - z_mean[..., None]
        R = with_trailing(center.cov, 1, leading=2)
        nu = model.sensor.innovation(z, center.mean + z_mean)
        missing = np.isnan(nu)
        known = np.where(missing, 0.0, nu)
        # Step 3: K = C S^-1, C = cov(x, z), S = cov(z, z) + R.
        C_transposed = linalg.transpose(members_cov(dx, dz))
        C_transposed, S = missing_components.drop_missing(
            C_transposed, members_cov(dz, dz) + R, missing
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
        # The smoother regresses the members before on `moved`, in which each member's angles continue
        # its own, without whole turns in between.
        return Ensemble(x=corrected, nis=innovation.nis, innovation=innovation, predicted=moved)

    def smoothed(
        self, model: Model, states: list[Ensemble], k: int, rng: Generator
    ) -> list[Ensemble]:
        """Smooth the members of every step by the ensemble RTS smoother (Raanes 2016).

        It uses all later measurements, or those of `lag` steps. The motion is not needed again, hence
        neither the step ``k`` of the first state, nor random numbers.
        """

        def smooth_one_back(i: int, later: Array) -> Array:
            """Smooth the members (n, M, N) of ``states[i]`` by those of the next state, smoothed."""
            x = states[i].x
            predicted = states[i + 1].predicted  # x moved, before the update
            assert predicted is not None
            later = near(later, predicted, angle_rows(model.motion))
            dx = x - mean(x)[..., None]
            dp = predicted - mean(predicted)[..., None]
            # G = C P_pred^-1, the regression of the members on the moved ones, as of a motion with the
            # covariance C = cov(x, x_pred); x_i + G (x_later_i - x_pred_i)
            moments = Gaussian(mean(predicted), members_cov(dp, dp))
            G = Transition(predicted=moments, cross=members_cov(dx, dp)).gain
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
        rows = np.ascontiguousarray(np.moveaxis(whitened, 2, 0))  # W' sqrt(N - 1), (N, n_z, runs)
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
    gain = linalg.matmul(members_cov(dx, whitened), G)
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
    # Step 2: from each axis i on, the reflection that maps the axis to -sign times the direction of a
    # normal vector; with the factor -sign it is that direction, which is uniformly distributed.
    for i in range(1, N):
        v = rng.standard_normal((runs, N - i))
        sign = np.where(v[:, 0] < 0.0, -1.0, 1.0)
        v[:, 0] += sign * np.sqrt(dot(v, v))  # with this sign no digits cancel
        y[..., i:] = _reflected(y[..., i:], v)
        y[..., i] *= -sign
    # Step 3: back to the members.
    return _reflected(y, to_mean)


def _reflected(y: Array, v: Array) -> Array:
    """Reflect rows y (n, M, m) in v (m,) or (M, m): ``y (I - 2 v v' / v'v)``."""
    return y - (2.0 * dot(y, v) / dot(v, v))[..., None] * v
