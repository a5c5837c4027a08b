"""Two-point differencing: state at the second of two scans, as moments or as a prior of its own."""

from dataclasses import dataclass
from math import sqrt
from typing import Protocol, runtime_checkable

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian, Symmetric, zero_mean_log_prob
from trackbench.core.elementary import log
from trackbench.core.polar_conversions import Conversion, convert, position
from trackbench.core.random_streams import Streams
from trackbench.models.first_particles import heavy_tailed_normal
from trackbench.models.sensors.range_azimuth import RangeAzimuth


@runtime_checkable
class Convertible(Protocol):
    """A prior from two scans of range and azimuth, for filters that choose the conversion."""

    def gaussian(self, conversion: Conversion) -> Gaussian:
        """Difference two converted scans.

        Parameters
        ----------
        conversion : Conversion
            Method that converts a scan to a position, such as ``mucm``.

        Returns
        -------
        Gaussian
            State at the second scan: mean (n, M), covariance (n, n, M).
        """


def two_point_difference(first: Gaussian, second: Gaussian, T: float | Array, q: float) -> Gaussian:
    """Difference two positions to the state at the second (Bar-Shalom, Li & Kirubarajan 2001, 5.5.3).

    Parameters
    ----------
    first, second : Gaussian
        Positions (axes, M), m, and their covariances (axes, axes[, M]).
    T : float or array (M,)
        Time between the positions, s, of all runs or of each.
    q : float
        Density of a white acceleration, m^2/s^3, which adds q T / 3 per axis to the velocity's variance.

    Returns
    -------
    Gaussian
        State (px, vx, py, vy, ...): mean (2 axes, M), covariance (2 axes, 2 axes[, M]).
    """
    n = 2 * len(second.mean)
    runs = second.mean.shape[1]
    first_cov = first.cov
    second_cov = second.cov
    if not isinstance(T, float | int):
        # If T differs by run, so do the covariances.
        ones = np.ones(runs)
        first_cov = with_trailing(first_cov, 1, leading=2) * ones
        second_cov = with_trailing(second_cov, 1, leading=2) * ones
    noise = (q * T / 3.0) * with_trailing(np.eye(n // 2), second_cov.ndim - 2, leading=2)
    mean = np.empty((n, runs))
    cov = np.empty((n, n, *second_cov.shape[2:]))
    p = slice(0, n, 2)
    v = slice(1, n, 2)
    # v = (p2 - p1) / T, so cov(p, v) = P2 / T and cov(v, v) = (P1 + P2) / T^2 + q T / 3 I.
    mean[p] = second.mean
    mean[v] = (second.mean - first.mean) / T
    cov[p, p] = second_cov
    cov[p, v] = second_cov / T
    cov[v, p] = cov[p, v]
    cov[v, v] = (first_cov + second_cov) / (T * T) + noise
    return Gaussian(mean, cov)


@dataclass(frozen=True, eq=False)
class TwoPoint(Symmetric):
    """State at the second of two scans (2, M) each, without other knowledge of the target.

    The velocity is the difference of the two positions over T plus the noise that white acceleration of
    density q adds within T (variance q T / 3 per axis). Samples are drawn in polar coordinates, where
    the posterior without prior knowledge is the measurement's own banana (to 1 in r). Particle
    filters start from a `cover` of it.
    """

    sensor: RangeAzimuth
    first: Array
    """range and azimuth (2, M) of the first scan, m and rad"""
    second: Array
    """range and azimuth (2, M) of the second scan"""
    T: float
    """time between the scans, s"""
    q: float
    """density of the white acceleration, m^2/s^3"""

    @property
    def mean(self) -> Array:
        """Mean of `gaussian` with the modified unbiased conversion (4, M)."""
        return self.gaussian("mucm").mean

    @property
    def cov(self) -> Array:
        """Covariance of `gaussian` with the modified unbiased conversion (4, 4, M)."""
        return self.gaussian("mucm").cov

    def gaussian(self, conversion: Conversion) -> Gaussian:
        """Convert range and azimuth of each scan to a position, and difference the two positions.

        Parameters
        ----------
        conversion : Conversion
            Method, such as ``mucm``, the modified unbiased conversion.

        Returns
        -------
        Gaussian
            State (px, vx, py, vy) at the second scan: mean (4, M), covariance (4, 4, M).
        """
        first = convert(conversion, self.sensor.reading(self.first))
        second = convert(conversion, self.sensor.reading(self.second))
        return two_point_difference(first, second, self.T, self.q)

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw both scans in polar coordinates, and difference them to states (4, M, *trailing)."""
        r1, a1 = self.polar(self.first, rng, *trailing)
        r2, a2 = self.polar(self.second, rng, *trailing)
        return self._make_states(position(r1, a1), position(r2, a2), rng)

    def cover(self, rng: Streams, N: int) -> tuple[Array, Array]:
        """Draw states (4, M, N) from `positions`, with log-weights (M, N)."""
        p1, p2, log_w = self.positions(rng, N)
        return self._make_states(p1, p2, rng), log_w

    def positions(self, rng: Streams, N: int) -> tuple[Array, Array, Array]:
        """Draw the positions at both scans.

        The weights correct for azimuths that are drawn with heavier tails than their errors have.

        Parameters
        ----------
        rng : Streams
            Random numbers.
        N : int
            Number of particles in each run.

        Returns
        -------
        first, second : array (2, M, N)
            Positions (px, py) at each scan, m.
        log_w : array (M, N)
            Log-weights of the particles.
        """
        a1, a2, log_w = self.azimuths(rng, N)
        # r_i = z_i + sigma_r e_i at each scan.
        noise = self.sensor.sigma_range * rng.standard_normal((2, *log_w.shape))
        r1 = self.first[0][:, None] + noise[0]
        r2 = self.second[0][:, None] + noise[1]
        return position(r1, a1), position(r2, a2), log_w

    def azimuths(self, rng: Streams, N: int) -> tuple[Array, Array, Array]:
        """Draw the azimuths at both scans.

        The next scan is the third one. A precise range in it determines the difference of the two
        azimuths up to its sign, but not their sum. So draws of the difference cover its tails: even if
        the measured difference is off by several standard deviations, as many particles as usual keep
        weight after that scan.

        Parameters
        ----------
        rng : Streams
            Random numbers.
        N : int
            Number of particles in each run.

        Returns
        -------
        first, second : array (M, N)
            Azimuths at each scan, rad, not wrapped.
        log_w : array (M, N)
            Log-weights of the particles.
        """
        # a1 = z1 + sigma (s - d) / sqrt 2, a2 = z2 + sigma (s + d) / sqrt 2, d with heavy tails.
        d, log_w = heavy_tailed_normal(self.first.shape[1], N, rng)
        s = rng.standard_normal(d.shape)
        half = sqrt(0.5) * self.sensor.sigma_azimuth
        a1 = self.first[1][:, None] + half * (s - d)
        a2 = self.second[1][:, None] + half * (s + d)
        return a1, a2, log_w

    def polar(self, scan: Array, rng: Streams, *trailing: int) -> Array:
        """Draw true ranges and azimuths given a scan of them.

        Parameters
        ----------
        scan : array (2, M)
            Measured range, m, and azimuth, rad.
        rng : Streams
            Random numbers.
        *trailing : int
            Lengths of further axes, such as the number N of particles.

        Returns
        -------
        array (2, M, *trailing)
            Range, m, and azimuth, rad, not wrapped.
        """
        sigma = np.array([self.sensor.sigma_range, self.sensor.sigma_azimuth])
        noise = rng.standard_normal((*scan.shape, *trailing))
        return with_trailing(scan, noise.ndim - 1) + with_trailing(sigma, noise.ndim - 1) * noise

    def _make_states(self, p1: Array, p2: Array, rng: Streams) -> Array:
        """Difference positions p1, p2 (2, ...) to states (4, ...) at p2, with noise on the velocity."""
        # v = (p2 - p1) / T + N(0, q T / 3)
        noise = np.sqrt(self.q * self.T / 3.0) * rng.standard_normal(p1.shape)
        vx, vy = (p2 - p1) / self.T + noise
        return np.stack([p2[0], vx, p2[1], vy])

    def log_prob(self, x: Array) -> Array:
        """Evaluate the log-density at x (4, M[, N]): both scans' polar densities in Cartesian terms.

        The noise of the velocity enters the first scan's variances to first order.
        """
        # Step 1: range and azimuth at both scans.
        px, vx, py, vy = x
        earlier = np.stack([px - self.T * vx, vx, py - self.T * vy, vy])
        first = self.sensor.polar(earlier)
        second = self.sensor.polar(x)
        # Step 2: add the velocity's noise, q T^3 / 3 of position, to the first scan's covariance.
        variance = self.q * self.T * self.T * self.T / 3.0
        R = np.zeros((2, 2, *first.shape[1:]))
        R[0, 0] = self.sensor.R[0, 0] + variance
        R[1, 1] = self.sensor.R[1, 1] + variance / np.square(first[0])
        # Step 3: d(r1, a1, r2, a2) / dx has the determinant T^2 / (r1 r2).
        jacobian = log(self.T * self.T / (second[0] * first[0]))
        return (
            jacobian
            + zero_mean_log_prob(self._innovation(self.second, second), self.sensor.R)
            + zero_mean_log_prob(self._innovation(self.first, first), R)
        )

    def _innovation(self, scan: Array, predicted: Array) -> Array:
        """Return a scan (2, M) less predicted measurements (2, M[, N]), the azimuth wrapped."""
        return self.sensor.innovation(with_trailing(scan, predicted.ndim - 1), predicted)
