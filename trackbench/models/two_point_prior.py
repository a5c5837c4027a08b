"""The first state that two scans give, and of a range-azimuth sensor in every form a filter may ask."""

from dataclasses import dataclass
from math import sqrt
from typing import Protocol, runtime_checkable

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.conversions import Conversion, convert, position
from trackbench.core.distributions import (
    Gaussian,
    Symmetric,
    heavy_tailed_normal,
    zero_mean_log_prob,
)
from trackbench.core.elementary import log
from trackbench.core.random_streams import Streams
from trackbench.models.sensors.range_azimuth import RangeAzimuth


@runtime_checkable
class Convertible(Protocol):
    """A prior that two scans of range and azimuth gave."""

    def gaussian(self, conversion: Conversion) -> Gaussian:
        """Return two-point differencing of converted scans."""


def two_point_difference(one: Gaussian, two: Gaussian, T: float | Array, q: float) -> Gaussian:
    """Return the state at the second of two positions (axes, M), with their difference as velocity.

    T may be each run's own (M,).

    White acceleration of density q adds q T / 3 per axis to the velocity's variance (Bar-Shalom, Li &
    Kirubarajan 2001, 5.5.3). Covariances are (axes, axes[, M]).
    """
    n, runs = 2 * len(two.mean), two.mean.shape[1]
    if not isinstance(T, float | int):
        every = np.ones(runs)
        one, two = (
            Gaussian(p.mean, with_trailing(p.cov, 1, leading=2) * every) for p in (one, two)
        )
    noise = (q * T / 3.0) * with_trailing(np.eye(n // 2), two.cov.ndim - 2, leading=2)
    mean, cov = np.empty((n, runs)), np.empty((n, n, *two.cov.shape[2:]))
    p, v = slice(0, n, 2), slice(1, n, 2)
    mean[p], mean[v] = two.mean, (two.mean - one.mean) / T
    cov[p, p] = two.cov
    cov[p, v] = cov[v, p] = two.cov / T
    cov[v, v] = (one.cov + two.cov) / (T * T) + noise
    return Gaussian(mean, cov)


@dataclass(frozen=True, eq=False)
class TwoPoint(Symmetric):
    """State at the second of two scans (2, M) each, under no other knowledge of the target.

    Velocity is the difference of the two positions over T plus the noise that white acceleration of
    density q adds to it within T (variance q T / 3 per axis). Samples are drawn in polar coordinates:
    with no knowledge of position the posterior is the measurement's own banana (to 1 in r). Particle
    filters start from a `cover` of it.
    """

    sensor: RangeAzimuth
    first: Array
    second: Array
    T: float
    q: float

    @property
    def mean(self) -> Array:
        """Return the mean of `gaussian` with the modified unbiased conversion (4, M)."""
        return self.gaussian("mucm").mean

    @property
    def cov(self) -> Array:
        """Return the covariance of `gaussian` with the modified unbiased conversion (4, 4, M)."""
        return self.gaussian("mucm").cov

    def gaussian(self, conversion: Conversion) -> Gaussian:
        """Return two-point differencing of converted scans."""
        one, two = (
            convert(conversion, self.sensor.reading(scan)) for scan in (self.first, self.second)
        )
        return two_point_difference(one, two, self.T, self.q)

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Return states (4, M, *trailing): both scans drawn in polar coordinates and differenced."""
        one, two = (self.polar(scan, rng, *trailing) for scan in (self.first, self.second))
        return self._moving(position(*one), position(*two), rng)

    def cover(self, rng: Streams, N: int) -> tuple[Array, Array]:
        """Return states (4, M, N) from `positions`, and their log-weights (M, N)."""
        p1, p2, log_w = self.positions(rng, N)
        return self._moving(p1, p2, rng), log_w

    def positions(self, rng: Streams, N: int) -> tuple[Array, Array, Array]:
        """Return draws (2, M, N) of the positions at both scans, and log-weights (M, N)."""
        a1, a2, log_w = self.azimuths(rng, N)
        noise = self.sensor.sigma_range * rng.standard_normal((2, *log_w.shape))
        r1, r2 = self.first[0][:, None] + noise[0], self.second[0][:, None] + noise[1]
        return position(r1, a1), position(r2, a2), log_w

    def azimuths(self, rng: Streams, N: int) -> tuple[Array, Array, Array]:
        """Return draws (M, N) of the azimuths at both scans, and log-weights (M, N).

        A third sharp range tells their difference up to its sign, to a small part of sigma_azimuth, and
        nothing of their sum. So the difference covers its tails: measured azimuths that are off by
        some standard deviations against each other leave as many particles as others do.
        """
        apart, log_w = heavy_tailed_normal(self.first.shape[1], N, rng)
        both = rng.standard_normal(apart.shape)
        half = sqrt(0.5) * self.sensor.sigma_azimuth
        a1, a2 = self.first[1][:, None], self.second[1][:, None]
        return a1 + half * (both - apart), a2 + half * (both + apart), log_w

    def polar(self, scan: Array, rng: Streams, *trailing: int) -> Array:
        """Return draws of (range, azimuth) given a scan (2, M)."""
        sigma = np.array([self.sensor.sigma_range, self.sensor.sigma_azimuth])
        noise = rng.standard_normal((*scan.shape, *trailing))
        return with_trailing(scan, noise.ndim - 1) + with_trailing(sigma, noise.ndim - 1) * noise

    def _moving(self, p1: Array, p2: Array, rng: Streams) -> Array:
        """Return states at the second of two positions, with the noise of the velocity."""
        excess = np.sqrt(self.q * self.T / 3.0) * rng.standard_normal(p1.shape)
        vx, vy = (p2 - p1) / self.T + excess
        return np.stack([p2[0], vx, p2[1], vy])

    def log_prob(self, x: Array) -> Array:
        """Return the log-density at x (4, M[, N]): both scans' polar densities in Cartesian terms.

        The noise of the velocity enters the first scan's variances to first order.
        """
        px, vx, py, vy = x
        earlier = np.stack([px - self.T * vx, vx, py - self.T * vy, vy])
        now, then = self.sensor.polar(x), self.sensor.polar(earlier)
        walked = self.q * self.T * self.T * self.T / 3.0
        R = np.zeros((2, 2, *then.shape[1:]))
        R[0, 0] = self.sensor.R[0, 0] + walked
        R[1, 1] = self.sensor.R[1, 1] + walked / np.square(then[0])
        jacobian = log(self.T * self.T / (now[0] * then[0]))
        return (
            jacobian
            + zero_mean_log_prob(self._innovation(self.second, now), self.sensor.R)
            + zero_mean_log_prob(self._innovation(self.first, then), R)
        )

    def _innovation(self, scan: Array, predicted: Array) -> Array:
        return self.sensor.innovation(with_trailing(scan, predicted.ndim - 1), predicted)
