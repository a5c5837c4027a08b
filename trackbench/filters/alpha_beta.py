"""Alpha-beta filter."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.field_types import InvalidKeyError, OpenShare, Positive, Unit
from trackbench.filters.base import PLANAR_POSITION, InnovationFilter
from trackbench.models.assume import OWN_MOTION
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.models.motions.linear import Linear
from trackbench.models.sensors.position import PositionSensor
from trackbench.registry import register


class Smoothed(NamedTuple):
    """State of the alpha-beta filter."""

    posterior: Gaussian
    """mean (4, M), covariance (4, 4[, M])"""
    n: Array
    """number of measurements so far, () or (M,)"""
    nis: Array
    """NIS (M,) of the last measurement"""
    innovation: Innovation | None = None
    """innovation of the last measurement"""


@register("filters", "alpha-beta")
@dataclass(frozen=True, kw_only=True)
class AlphaBeta(InnovationFilter[Smoothed]):
    """Alpha-beta filter: the steady-state gains of a constant-velocity Kalman filter.

    Kalata 1984: gains from the tracking index. While the least-squares gains of the first n
    measurements are larger, they are used instead. The reported covariance is that of these gains
    under a random acceleration of variance q.
    """

    q: Annotated[Positive, Unit("(m/s^2)^2")]
    """variance of the random acceleration, constant over T, per axis, (m/s^2)^2"""
    alpha: OpenShare | None = None
    """gain of the position; default: from q"""
    beta: Positive | None = None
    """gain of the velocity times T; default: from q"""
    growing: bool = True
    """whether the first steps use least-squares gains"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    is_linear: ClassVar[bool] = True
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "its gains are fixed"}

    def __post_init__(self) -> None:
        if (self.alpha is None) != (self.beta is None):
            raise ValueError("give both alpha and beta, or neither")
        if self.alpha is not None and self.beta is not None and self.beta >= 4 - 2 * self.alpha:
            raise InvalidKeyError(f"unstable: beta must be below {4 - 2 * self.alpha:g}", "beta")

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report an assumed motion as idle: the filter's own has the key `q`."""
        return OWN_MOTION

    def gains(self, T: float, sigma: float) -> tuple[float, float]:
        """Return the steady-state gains: the keys, or from the tracking index ``sqrt(q) T^2 / sigma``.

        Parameters
        ----------
        T : float
            Interval of the steps, s.
        sigma : float
            Standard deviation of a measured position, m.

        Returns
        -------
        alpha : float
            Gain of the position.
        beta : float
            Gain of the velocity times T.
        """
        if self.alpha is not None and self.beta is not None:
            return self.alpha, self.beta
        # r = (4 + i - sqrt(8 i + i^2)) / 4,  alpha = 1 - r^2,  beta = 2 (2 - alpha) - 4 sqrt(1 - alpha)
        index = np.sqrt(self.q) * T * T / sigma
        r = (4.0 + index - np.sqrt(8.0 * index + index * index)) / 4.0
        alpha = 1.0 - r * r
        return float(alpha), float(2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha))

    def gain(self, n: Array, T: float, sigma: float) -> Array:
        """Return the gain K at a measurement.

        With ``growing`` it is that of least squares over the measurements so far, while that is larger.

        Parameters
        ----------
        n : array () or (M,)
            Number of measurements so far with this one, one for all runs or one for each; the prior
            counts as two.
        T : float
            Interval of the steps, s.
        sigma : float
            Standard deviation of a measured position, m.

        Returns
        -------
        array (4, 2) or (4, 2, M)
            Gain of the state (px, vx, py, vy) by the measured position. The gain of a velocity is in
            1/s.
        """
        alpha, beta = self.gains(T, sigma)
        K = np.zeros((4, 2, *n.shape))
        K[0, 0] = alpha
        K[1, 0] = beta / T
        if self.growing:
            # While they are larger, the gains of least squares over n measurements are used:
            # alpha_n = 2 (2 n - 1) / (n (n + 1)),  beta_n = 6 / (n (n + 1))
            K[0, 0] = np.maximum(alpha, 2.0 * (2 * n - 1) / (n * (n + 1)))
            K[1, 0] = np.maximum(beta, 6.0 / (n * (n + 1))) / T
        K[2:, 1] = K[:2, 0]
        return K

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Smoothed:
        """Start from the prior of position and velocity, which counts as two measured positions.

        Further components of the prior, such as an acceleration, are left out.
        """
        first = Gaussian(prior.mean[:4], prior.cov[:4, :4])
        unknown = np.full(prior.mean.shape[1], np.nan)
        return Smoothed(posterior=first, n=np.array(2), nis=unknown)

    def step(self, model: Model, state: Smoothed, z: Array, k: int, rng: Generator) -> Smoothed:
        """Predict ``x = F x``, update ``x = x + K (z - H x)``; predict only if z is missing."""
        # The assumed motion gives only the interval T: this filter has its own q.
        assumed, sensor = cast("tuple[Linear, PositionSensor]", model)
        motion = ConstantVelocity(q=self.q).sampled(assumed.T)
        H = sensor.H()
        # x = F x
        predicted = kalman.predict(state.posterior, motion.F, motion.Q)
        nu = z - linalg.matvec(H, predicted.mean)
        # Fixed gains cannot use half a measurement.
        missing = np.isnan(nu).any(axis=0)
        nu = np.where(missing, np.nan, nu)
        # The count is one number for all runs until a measurement is missing in one of them.
        number_of_new = ~missing if missing.any() else 1
        n = np.asarray(state.n + number_of_new)
        # x = x + K nu: the gain depends on the number of measurements n so far.
        K = self.gain(n, assumed.T, sensor.sigma)
        posterior = kalman.update_with_gain(predicted, nu, K, H, sensor.R)
        # S = H P H' + R, for the NIS only.
        S, _ = kalman.gain(predicted.cov, H, sensor.R)
        innovation = Innovation(nu, S)
        return Smoothed(posterior=posterior, n=n, nis=innovation.nis, innovation=innovation)

    def estimate(self, state: Smoothed) -> Gaussian:
        """Return the posterior."""
        return state.posterior
