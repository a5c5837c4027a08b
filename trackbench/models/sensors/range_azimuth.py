"""Radars of range and azimuth in the plane: also with range rate, or reporting positions."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core import linalg
from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import arctan2
from trackbench.core.line_of_sight import (
    along_line_of_sight,
    errors_along_line_of_sight,
    squares_along_line_of_sight,
)
from trackbench.core.polar_conversions import Conversion, Polar, ccm, convert, distance, position
from trackbench.core.read_only import fixed
from trackbench.field_types import Positive, Unit
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.position import selection_matrix
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class Radar(AngularSensor):
    """Base of the radars in the plane."""

    sigma_range: Annotated[Positive, Unit("m")]
    """standard deviation of the range, m"""
    sigma_azimuth_mrad: Annotated[Positive, Unit("mrad")]
    """standard deviation of the azimuth, mrad"""

    angles: ClassVar[tuple[int, ...]] = (1,)

    @property
    def sigma_azimuth(self) -> float:
        """Standard deviation of the azimuth, rad."""
        return 1e-3 * self.sigma_azimuth_mrad

    def polar(self, x: Array, k: int = 0) -> Array:
        """Return the range and azimuth of states.

        Parameters
        ----------
        x : array (n_x, *batch)
            States (px, vx, py, vy, ...), m and m/s.
        k : int
            Step, on which the place of a moving radar depends.

        Returns
        -------
        array (2, *batch)
            Range, m, and azimuth in (-pi, pi], rad.
        """
        px, py = self.relative_position(x, k)
        return np.stack([distance(px, py), arctan2(py, px)])

    def range(self, x: Array, k: int = 0) -> Array:
        """Return the range (*batch) of states x (n, *batch)."""
        return distance(*self.relative_position(x, k))

    def polar_jacobian(self, x: Array, k: int = 0) -> Array:
        """Return the derivatives of range and azimuth.

        Parameters
        ----------
        x : array (n_x, *batch)
            States (px, vx, py, vy, ...), m and m/s.
        k : int
            Step, on which the place of a moving radar depends.

        Returns
        -------
        array (2, n_x, *batch)
            d(range, azimuth) / dx.
        """
        # dr/dp = p / r, da/dpx = -py / r^2, da/dpy = px / r^2
        px, py = self.relative_position(x, k)
        square = px * px + py * py
        r = np.sqrt(square)
        H = np.zeros((2, *x.shape))
        H[0, 0] = px / r
        H[0, 2] = py / r
        H[1, 0] = -py / square
        H[1, 2] = px / square
        return H

    def _reading(self, z: Array) -> Polar:
        """Return the range and azimuth of a measurement z (2, M) together with their variances."""
        sigma = np.array([self.sigma_range, self.sigma_azimuth])
        range_variance, azimuth_variance = np.square(sigma).tolist()
        return Polar(z[0], z[1], range_variance, azimuth_variance)

    def located(self, z: Array, k: int, conversion: Conversion = "mucm") -> Gaussian:
        """Return the measured Cartesian position.

        Parameters
        ----------
        z : array (n_z, M)
            Measurements, whose first two rows are range, m, and azimuth, rad.
        k : int
            Step, on which the place of a moving radar depends.
        conversion : Conversion
            Method, such as ``mucm``, the modified unbiased conversion.

        Returns
        -------
        Gaussian
            Position (2, M), m, and its covariance (2, 2, M), m^2.
        """
        relative = convert(conversion, self._reading(z))
        return Gaussian(self.absolute_position(relative.mean, k), relative.cov)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return signed errors (1, *batch) in polar coordinates and along and across the line of sight.

        They are those of the mean (n, *batch) against the truth (n, *batch). A moving sensor has none,
        as its position depends on the step, which is not given.
        """
        if self.platform is not None:
            return {}
        e = mean - truth
        r, a = self.polar(mean)
        r_true, a_true = self.polar(truth)
        return {
            "range": (r - r_true)[None],
            "azimuth_deg": np.rad2deg(wrap_angle(a - a_true))[None],
        } | errors_along_line_of_sight(e, a_true)

    def squares(self, P: Array, x: Array) -> dict[str, Array]:
        """Return mean squared errors (K,) of the quantities of `errors`, and of the mean range.

        The mean range is the posterior mean of the range (`observables`), in place of the range of the
        mean. To first order both have the same error. P (n, n, K) are the covariances of states x (n,
        K). A moving sensor has none, as in `errors`.
        """
        if self.platform is not None:
            return {}
        # P in polar coordinates, H P H'.
        polar = linalg.sandwich(self.polar_jacobian(x), P)
        return {
            "range": polar[0, 0],
            "mean_range": polar[0, 0],
            # A variance in degrees squared: converted twice.
            "azimuth_deg": np.rad2deg(np.rad2deg(polar[1, 1])),
        } | squares_along_line_of_sight(P, self.polar(x)[1])

    def observables(self, x: Array) -> dict[str, Array]:
        """Return the range, whose posterior mean differs from the range of the mean.

        A moving sensor has no observables: its position depends on the step, which is not given.
        """
        if self.platform is not None:
            return {}
        return {"mean_range": self.range(x)}


@register("sensors", "range-azimuth")
@dataclass(frozen=True, kw_only=True)
class RangeAzimuth(Radar):
    """Radar of range and azimuth, each with an independent error (banana paper, eqs. 7-8).

    ``r = sqrt(px^2 + py^2) + w_r``, ``a = atan2(py, px) + w_a``.
    """

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth")
    jacobian = Radar.polar_jacobian
    reading = Radar._reading

    @cached_property
    def R(self) -> Array:
        """Noise covariance (2, 2), in m^2 and rad^2."""
        return fixed(np.diag(np.square([self.sigma_range, self.sigma_azimuth])))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N((range, azimuth), R) for x (n, *batch)."""
        return Gaussian(self.polar(x, k), self.R)

    def residual(self, z: Array, x: Array, k: int) -> Gaussian:
        """Compute ``innovation(z, polar(x))`` (2, M, N) of particles x (n, M, N), and R."""
        nu = np.empty((2, *x.shape[1:]))
        # In coordinates along the measured azimuth, a - z_a is atan2(across, along) without wrapping.
        # If the azimuth is missing, any direction gives the range. The residual of the azimuth is then a
        # number without meaning, and the caller leaves the missing component out.
        azimuth = np.where(np.isnan(z[1]), 0.0, z[1])
        r, across, along = along_line_of_sight(azimuth, *self.relative_position(x, k))
        np.subtract(z[0][:, None], r, out=nu[0])
        np.negative(arctan2(across, along), out=nu[1])
        return Gaussian(nu, self.R)


@register("sensors", "polar-position")
@dataclass(frozen=True, kw_only=True)
class PolarPosition(Radar):
    """Position of a planar target with the errors of a range and an azimuth.

    The measurement is ``(r + w_r) (cos, sin)(a + w_a)``, the conventional conversion. Filters assume a
    normal error of the first-order covariance, which rotates and grows with the target. A filter with a
    constant covariance assumes `{kind: position, sigma: ...}`.
    """

    components: ClassVar[tuple[str, ...]] = ("x", "y")
    angles: ClassVar[tuple[int, ...]] = ()

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(position, R(x)) for x (n, *batch)."""
        return Gaussian(x[0:4:2], ccm(self._reading(self.polar(x, k))).cov)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(x, y)/dx (2, n)."""
        return selection_matrix(0, 4, 2, len(x))

    def draw(self, x: Array, k: int, noise: Array) -> Array:
        """Draw range and azimuth (2, M) with their errors, and convert them to a position."""
        r, a = self.polar(x, k)
        # z = (r + w_r) (cos, sin)(a + w_a)
        relative = position(r + self.sigma_range * noise[0], a + self.sigma_azimuth * noise[1])
        return self.absolute_position(relative, k)

    def located(self, z: Array, k: int, conversion: Conversion = "ccm") -> Gaussian:
        """Return the measured position z (2, M), with the covariance (2, 2, M) of a target at z.

        There is nothing to convert, so ``conversion`` has no effect.
        """
        # The covariance depends on positions alone: any velocity will do.
        state = np.zeros((4, *z.shape[1:]))
        state[0::2] = z
        return Gaussian(z, self.measurement(state, k).cov)


@register("sensors", "range-azimuth-doppler")
@dataclass(frozen=True, kw_only=True)
class RangeAzimuthDoppler(Radar):
    """Range, azimuth and ``r' = (px vx + py vy) / r``, each with an independent error.

    Bar-Shalom, Li & Kirubarajan 2001, section 10.4. The radar stands still.
    """

    sigma_range_rate: Annotated[Positive, Unit("m/s")]
    """standard deviation of the range rate, m/s"""

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "range_rate")
    standing: ClassVar[str] = "a radar with Doppler"

    @cached_property
    def R(self) -> Array:
        """Noise covariance (3, 3), in m^2, rad^2 and (m/s)^2."""
        sigma = [self.sigma_range, self.sigma_azimuth, self.sigma_range_rate]
        return fixed(np.diag(np.square(sigma)))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N((range, azimuth, range rate), R) for x (n, *batch)."""
        # z = (r, a, (px vx + py vy) / r)
        r, a = self.polar(x, k)
        return Gaussian(np.stack([r, a, self._range_times_rate(x, k) / r]), self.R)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(range, azimuth, range rate)/dx (3, n, *batch); the radar stands still."""
        px, py = self.relative_position(x, k)
        r = self.range(x, k)
        rate = self._range_times_rate(x, k) / r
        H = np.zeros((3, *x.shape))
        H[:2] = self.polar_jacobian(x, k)
        # r' = (px vx + py vy) / r, so dr'/dpx = (vx - r' px / r) / r and dr'/dvx = px / r.
        H[2, 0] = (x[1] - rate * px / r) / r
        H[2, 2] = (x[3] - rate * py / r) / r
        H[2, 1] = px / r
        H[2, 3] = py / r
        return H

    def _range_times_rate(self, x: Array, k: int) -> Array:
        """Return ``px vx + py vy`` (*batch), the range times the range rate."""
        px, py = self.relative_position(x, k)
        return px * x[1] + py * x[3]
