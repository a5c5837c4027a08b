"""The alpha-beta filter."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.field_types import InvalidKeyError, OpenShare, Positive
from trackbench.filters.base import OWN_MOTION, PLANAR_POSITION, Filter
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantVelocity, Linear
from trackbench.models.sensors.position import PositionSensor
from trackbench.registry import register


class Smoothed(NamedTuple):
    """N(mean, cov), the last NIS (M,), and the number n of measurements so far, in each run or all.

    ``seen`` is the innovation, once there is one.
    """

    posterior: Gaussian
    nis: Array
    n: Array
    seen: Innovation | None = None


@register("filters", "alpha-beta")
@dataclass(frozen=True, kw_only=True)
class AlphaBeta(Filter[Smoothed]):
    """Alpha-beta filter: fixed gains, those of a constant-velocity Kalman filter in its steady state.

    Kalata 1984: gains from the tracking index. While the least-squares gains of the first n
    measurements are larger they are used instead, so that the start is forgotten. The reported
    covariance is the one these gains give under a random acceleration of variance q.
    """

    q: Positive
    """variance of the random acceleration held for T, per axis, (m/s^2)^2"""
    alpha: OpenShare | None = None
    """gain of the position; default: from q"""
    beta: Positive | None = None
    """gain of the velocity times T; default: from q"""
    growing: bool = True
    """whether the start uses least-squares gains"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "its gains are fixed"}

    def __post_init__(self) -> None:
        if (self.alpha is None) != (self.beta is None):
            raise ValueError("alpha and beta are given together or not at all")
        if self.alpha is not None and self.beta is not None and self.beta >= 4 - 2 * self.alpha:
            raise InvalidKeyError(f"unstable: beta must be below {4 - 2 * self.alpha:g}", "beta")

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Its motion is that of `q`."""
        return OWN_MOTION

    def gains(self, T: float, sigma: float) -> tuple[float, float]:
        """alpha and beta, from the tracking index ``sqrt(q) T^2 / sigma`` unless given."""
        if self.alpha is not None and self.beta is not None:
            return self.alpha, self.beta
        index = np.sqrt(self.q) * T * T / sigma
        r = (4.0 + index - np.sqrt(8.0 * index + index * index)) / 4.0
        alpha = 1.0 - r * r
        return float(alpha), float(2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha))

    def gain(self, n: Array, T: float, sigma: float) -> Array:
        """K (4, 2[, M]) at the n-th measurement, n () or (M,)."""
        alpha, beta = self.gains(T, sigma)
        K = np.zeros((4, 2, *n.shape))
        K[0, 0], K[1, 0] = alpha, beta / T
        if self.growing:
            K[0, 0] = np.maximum(alpha, 2.0 * (2 * n - 1) / (n * (n + 1)))
            K[1, 0] = np.maximum(beta, 6.0 / (n * (n + 1))) / T
        K[2:, 1] = K[:2, 0]
        return K

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Smoothed:
        """The prior, which stands for two measurements."""
        unknown = np.full(prior.mean.shape[1], np.nan)
        first = Gaussian(prior.mean[:4], prior.cov[:4, :4])  # the motion is its own
        return Smoothed(first, unknown, np.array(2))

    def step(self, model: Model, state: Smoothed, z: Array, k: int, rng: Generator) -> Smoothed:
        """``x = F x``, ``x = x + K (z - H x)``; a missing measurement is predicted over."""
        own, sensor = cast("tuple[Linear, PositionSensor]", model)
        motion, H = ConstantVelocity(q=self.q).sampled(own.T), sensor.H()
        predicted = kalman.predict(state.posterior, motion.F, motion.Q)
        nu = z - linalg.matvec(H, predicted.mean)
        missing = np.isnan(nu).any(axis=0)
        nu = np.where(missing, np.nan, nu)  # half a measurement is none to fixed gains
        n = np.asarray(state.n + (~missing if missing.any() else 1))
        posterior = kalman.update_with_gain(
            predicted, nu, self.gain(n, own.T, sensor.sigma), H, sensor.R
        )
        S, _ = kalman.gain(predicted.cov, H, sensor.R)
        seen = Innovation(nu, S)
        return Smoothed(posterior, seen.nis, n, seen)

    def estimate(self, state: Smoothed) -> Gaussian:
        """The track and its covariance."""
        return state.posterior

    def log_likelihood(self, state: Smoothed) -> Array:
        """log N(innovation; 0, S) (M,), S by the covariance that its gains give."""
        if state.seen is None:
            return np.full(state.nis.shape, np.nan)
        return state.seen.log_likelihood

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return frozenset({"nis"})

    def diagnostics(self, state: Smoothed) -> dict[str, Array]:
        """``nis``: normalised innovation squared, expected n_z."""
        return {"nis": state.nis}
