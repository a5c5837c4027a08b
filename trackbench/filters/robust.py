"""Robust updates of the filters with one Gaussian, by weights on the measurement noise.

A sensor's weight w replaces its R by R / w in an update that is otherwise the filter's. Weight and
posterior determine each other: both are iterated, from weights of one. Each sensor has a weight of its
own, so that an outlier of one does not cost the other's measurement.
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import factorial
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, cast

import numpy as np
from pydantic import Field

from trackbench.core import linalg
from trackbench.core.arrays import Array, Index, with_trailing
from trackbench.core.cumulative_probabilities import chi_square_cdf
from trackbench.core.distributions import Factored, Gaussian, per_run_moments
from trackbench.core.elementary import exp, log, log_gamma
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.read_only import fixed
from trackbench.core.sigma_points import Unscented
from trackbench.core.sums import total
from trackbench.field_types import Count, Positive
from trackbench.models.base import Model, Sensor
from trackbench.models.sensors.noise import ScaledNoise
from trackbench.models.sensors.stacked import Sensors, rows_of

_CUBATURE = Unscented(1.0, 0.0, 0.0)
_LEAST = 1e-30  # weight, of an outlier by 1e15 standard deviations or more


@dataclass(frozen=True, kw_only=True)
class RobustUpdate:
    """Base of the robust updates: a law of the residuals with a heavier tail than the normal one."""

    iterations: Count = 5
    """updates with new weights, after one with weights of 1"""

    uses_spread: ClassVar[bool] = False
    """whether weights depend on the posterior's covariance, too"""

    @abstractmethod
    def weight(self, squared: Array, n: Index) -> Array:
        """Return the weight of one sensor in each of M runs, by which its R is divided.

        Parameters
        ----------
        squared : array (M,)
            Squared normalized residual ``r' R^-1 r`` of the sensor's measurement.
        n : array (M,)
            Number of its measured components; 0 has the weight 1.

        Returns
        -------
        array (M,)
            Weight, at most 1 for Huber.
        """

    @abstractmethod
    def log_ratio(self, nis: Array, n: Index) -> Array:
        """Evaluate log p(nu) - log N(nu; 0, S) of n measured components, by their NIS.

        p is the density of the innovation nu by this law, with S as its scale.

        Parameters
        ----------
        nis : array (M,)
            Normalized innovation squared.
        n : array (M,)
            Number of measured components.

        Returns
        -------
        array (M,)
            Difference of the log-densities.
        """

    def weights(self, sensor: Sensor, posterior: Gaussian, z: Array, k: int) -> Array:
        """Weigh the sensors by the residuals of their measurements.

        Parameters
        ----------
        sensor : Sensor
            Sensor of the filter model, which may stand for several.
        posterior : Gaussian
            Posterior by the weights before: mean (n_x, M), covariance (n_x, n_x[, M]).
        z : array (n_z, M)
            Measurements of step k.
        k : int
            Number of the step.

        Returns
        -------
        array (sensors, M)
            Weights; 1 without a measurement or with a singular R.
        """
        posterior = per_run_moments(posterior)
        R = with_trailing(sensor.measurement(posterior.mean, k).cov, 1, leading=2)
        # Step 1: residuals z - h(x) at the mean, or at cubature points of the posterior.
        points = None
        x = posterior.mean[:, None]
        if self.uses_spread:
            points = _CUBATURE.points(posterior)
            x = points.x
        expected = sensor.measurement(x, k).mean
        z_of_points = np.broadcast_to(z[:, None], expected.shape)
        missing = np.isnan(z_of_points)
        residual = np.where(missing, 0.0, sensor.innovation(z_of_points, expected))
        weights = []
        for rows in sensor_rows(sensor):
            # Step 2: r' R^-1 r of the sensor's measured components, averaged over the points.
            absent = missing[rows, 0]  # the same at all points
            # Missing components, and a singular R, get the unit matrix as a stand-in.
            eye = np.eye(len(absent))[..., None]
            noise = np.where(absent[:, None] | absent[None], eye, R[rows, rows])
            is_regular = (linalg.diagonal(linalg.cholesky(noise)) > 0.0).all(axis=0)
            noise = np.where(is_regular, noise, eye)
            of_points = linalg.mahalanobis(residual[rows], noise[:, :, None])
            squared = of_points[0]
            if points is not None:
                squared = points.mean(of_points[None])[0]
            # Step 3: the weight, which is 1 if all components are missing, as `squared` then is 0. R is
            # divided by it, so that it must not underflow to zero.
            weight = np.maximum(self.weight(squared, (~absent).sum(axis=0)), _LEAST)
            weights.append(np.where(is_regular, weight, 1.0))
        return np.stack(weights)


def robust_update(
    law: RobustUpdate,
    update: Callable[[Model, Gaussian, Array, int], Updated],
    model: Model,
    state: Gaussian,
    z: Array,
    k: int,
) -> tuple[Gaussian, Innovation, Array]:
    """Update with weights of 1, then ``law.iterations`` times with new weights of the sensors.

    Parameters
    ----------
    law : RobustUpdate
        Law of the residuals.
    update : callable
        `GaussianFilter.update` of the filter.
    model : Model
        Motion and sensor that the filter assumes.
    state : Gaussian
        Posterior of step k - 1: mean (n_x, M), covariance (n_x, n_x[, M]).
    z : array (n_z, M)
        Measurements of step k; NaN where one is missing.
    k : int
        Number of the step.

    Returns
    -------
    posterior : Gaussian
        Posterior by the last weights.
    innovation : Innovation
        Innovation by weights of 1.
    weight : array (M,)
        Mean weight of the measured components; NaN without any.
    """
    # R / w differs by run. A covariance that all runs share is repeated for each; the update of a
    # triangular factor does so by itself.
    if not isinstance(state, Factored):
        state = per_run_moments(state)
    posterior, innovation = update(model, state, z, k)
    weighted = None
    for _ in range(law.iterations):
        weighted = Reweighted(model.sensor, law.weights(model.sensor, posterior, z, k))
        posterior, _ = update(model._replace(sensor=weighted), state, z, k)
    assert weighted is not None
    return posterior, innovation, weighted.mean_weight(z)


@dataclass(frozen=True, kw_only=True)
class Huber(RobustUpdate):
    """Huber's M-estimate: the weighted update's fixed point minimizes a convex cost.

    ``(x - m)' P^-1 (x - m) / 2 + sum rho(|R_s^-1/2 (z_s - h_s(x))|)`` over the sensors s, with
    ``rho(r) = r^2 / 2`` up to k and ``k r - k^2 / 2`` beyond. Karlgaard & Schaub 2007 weigh each
    component, and the prediction too; Chang, Hu, Chang & Li 2013 weigh the measurement alone.
    """

    kind: Literal["huber"] = "huber"
    """weights min(1, k / r) of a residual of r standard deviations"""
    k: Positive = 1.5
    """residual beyond which the cost is linear: norm of a sensor's components, each over its sigma"""

    def weight(self, squared: Array, n: Index) -> Array:
        """Return ``psi(r) / r = min(1, k / r)``, r the root of ``squared``."""
        return self.k / np.maximum(np.sqrt(squared), self.k)

    def log_ratio(self, nis: Array, n: Index) -> Array:
        """Return the log-ratio (M,) of Huber's density of scale S to the normal one, by NIS (M,).

        Huber's density is ``exp(-rho(r))`` over its integral. n (M,) counts the measured components.
        """
        r = np.sqrt(nis)
        rho = np.where(r > self.k, self.k * r - 0.5 * self.k * self.k, 0.5 * nis)
        return np.asarray(0.5 * nis - rho - _log_integrals(self.k, int(n.max(initial=0)))[n])


@cache
def _log_integrals(k: float, n_z: int) -> Array:
    """Return log(I_n / J_n) (n_z + 1,) for n = 0, ..., n_z components; k is Huber's constant.

    I_n is the integral of ``exp(-rho(|u|))`` over n components u, and J_n that of ``exp(-|u|^2 / 2)``.
    """
    # For a large k the tail is zero, and the terms below may overflow.
    tail = float(exp(-0.5 * k * k))
    values = [0.0]
    for n in range(1, n_z + 1):
        # I_n / J_n = P(chi^2_n < k^2) + 2 e^(-k^2/2) (n-1)! / (2^(n/2) Gamma(n/2) k^n) sum_j<n k^2j / j!
        value = float(chi_square_cdf(k * k, n))
        if tail > 0.0:
            terms = 0.0
            for j in range(n):  # in order: `sum` differs from Python 3.12 on
                terms += k ** (2 * j - n) / factorial(j)
            scale = log(2.0 * factorial(n - 1)) - 0.5 * n * log(2.0) - log_gamma(0.5 * n)
            value += tail * float(exp(scale)) * terms
        values.append(float(log(value)))
    return fixed(np.array(values))


@dataclass(frozen=True, kw_only=True)
class StudentT(RobustUpdate):
    """Variational update for noise with Student's t of scale R (Piche, Sarkka & Hartikainen 2012).

    The noise is N(0, R / w) with w of a gamma law of shape and rate df / 2. The posterior is a product
    of a Gaussian and a gamma law, whose mean is the weight. Agamennoni, Nieto & Nebot 2012 have a
    Wishart law of a whole matrix in its place.
    """

    kind: Literal["student-t"] = "student-t"
    """weights by a variational posterior for Student's t of scale R"""
    df: Positive = 4.0
    """degrees of freedom"""

    uses_spread: ClassVar[bool] = True

    def weight(self, squared: Array, n: Index) -> Array:
        """Return ``(df + n) / (df + E r' R^-1 r)``, the mean of the gamma law."""
        return np.asarray((self.df + n) / (self.df + squared))

    def log_ratio(self, nis: Array, n: Index) -> Array:
        """Return the log-ratio (M,) of the t density of scale S to the normal one, by NIS (M,).

        n (M,) counts the measured components.
        """
        constants = [
            log_gamma(0.5 * (self.df + i)) - log_gamma(0.5 * self.df) - 0.5 * i * log(0.5 * self.df)
            for i in range(int(n.max(initial=0)) + 1)
        ]
        # log(1 + x) without the loss of digits for a small x. numpy's log1p is not used, as its last
        # digits differ between machines.
        x = nis / self.df
        u = 1.0 + x
        logs = np.where(u == 1.0, x, log(u) * x / np.where(u == 1.0, 1.0, u - 1.0))
        kernel = 0.5 * (self.df + n) * logs
        return np.asarray(np.array(constants)[n] + 0.5 * nis - kernel)


AnyRobust: TypeAlias = Annotated[Huber | StudentT, Field(discriminator="kind")]
"""A robust update of any kind."""


def sensor_rows(sensor: Sensor) -> list[slice]:
    """Return the rows of each sensor in a measurement z (n_z, M)."""
    # Faults may multiply the noise of the sensors: the sensor inside has the rows.
    while isinstance(sensor, ScaledNoise):
        sensor = sensor.sensor
    return rows_of(cast(Sensors, sensor))


class Reweighted:
    """A sensor whose noise is N(0, R / w), with weights w (sensors, M)."""

    def __init__(self, sensor: Sensor, weights: Array) -> None:
        """Store the weights (n_z, M) of the components, from those of the sensors (sensors, M)."""
        self._sensor = sensor
        self._weights = np.empty((len(sensor.components), weights.shape[1]))
        for weight, rows in zip(weights, sensor_rows(sensor), strict=True):
            self._weights[rows] = weight

    def mean_weight(self, z: Array) -> Array:
        """Average the weights (M,) of the components that are measured, NaN without any."""
        measured = ~np.isnan(z)
        total_weight = total(np.where(measured, self._weights, 0.0), 0)
        with np.errstate(invalid="ignore"):
            return np.asarray(total_weight / measured.sum(axis=0))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(h(x), R / w) for states x (n_x[, points], M)."""
        exact = self._sensor.measurement(x, k)
        R = with_trailing(exact.cov, x.ndim - 1, leading=2)
        # R has a block per sensor, whose components have one weight: dividing the rows is enough.
        weights = self._weights[:, None]
        if x.ndim > 2:  # points of each run
            weights = weights[:, :, None]
        return Gaussian(exact.mean, R / weights)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred``, angles wrapped."""
        return self._sensor.innovation(z, z_pred)

    # All else, such as `components`, is that of the sensor.
    def __getattr__(self, name: str) -> Any:
        return getattr(self._sensor, name)
