"""What a filter holds a state for, asked at the truth: where in it the truth lies, and its CRPS.

A posterior of one step and M runs is a Gaussian, a weighted cloud, or a density on a line. Each tells of
the truth x (n, M), or of the first components of what it is about,

``below(x)``   the probability below each component (n, M), its probability integral transform;
``within(x)``  the probability (M,) of what is nearer to the mean than x in Mahalanobis distance;
``crps(x)``    the continuous ranked probability score (n, M), in the components' units.

If the truth is a draw from the posterior, the first two are uniform on (0, 1), whatever the posterior
(Rosenblatt 1952; Talts et al. 2018, theorem 1). Of a cloud of N they are weights, and `uniform` makes of
a rank's r / N the middle of its place among N + 1, so that nothing random is needed.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trackbench.core import grid, linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.particles import Particles
from trackbench.core.probabilities import chi_square_cdf, normal_cdf, normal_density
from trackbench.core.sums import dot

_ROOT_PI = 1.7724538509055159


class Posterior(Protocol):
    """A distribution of the state that is asked at the truth x (n, M)."""

    def below(self, x: Array) -> Array:
        """Probability (n, M) below each component of x."""

    def within(self, x: Array) -> Array:
        """Probability (M,) of states nearer to the mean than x."""

    def crps(self, x: Array) -> Array:
        """Continuous ranked probability score (n, M) of each component."""

    def uniform(self, probability: Array) -> Array:
        """What a probability of these is uniform by: itself, or the rank's of a cloud."""
        return probability


@dataclass(frozen=True)
class NormalPosterior(Posterior):
    """N(mean, cov): mean (n, M), cov (n, n) or (n, n, M). A singular one is sure of its mean."""

    found: Gaussian

    def below(self, x: Array) -> Array:
        """By the normal distribution function."""
        error, sd = self._error(x)
        return normal_cdf(_ratio(error, sd))

    def within(self, x: Array) -> Array:
        """By the chi-square distribution function of the normalised error squared."""
        n = len(x)
        return chi_square_cdf(distance(x - self.found.mean[:n], self.found.cov[:n, :n]), n)

    def crps(self, x: Array) -> Array:
        """In closed form (Gneiting & Raftery 2007, section 4.2)."""
        error, sd = self._error(x)
        z = _ratio(error, sd)
        spread = sd * (2.0 * normal_density(z) - 1.0 / _ROOT_PI)
        return np.asarray(error * (2.0 * normal_cdf(z) - 1.0) + spread)

    def _error(self, x: Array) -> tuple[Array, Array]:
        n = len(x)
        sd = np.sqrt(linalg.diagonal(self.found.cov[:n, :n]))
        return x - self.found.mean[:n], sd.reshape(n, -1)


@dataclass(frozen=True)
class CloudPosterior(Posterior):
    """A weighted cloud x (n, M, N), w (M, N)."""

    cloud: Particles

    def below(self, x: Array) -> Array:
        """Weight of the particles below, and half of that at x."""
        cloud, at = self._beside(x)
        return _known(dot(self.cloud.w, (cloud < at) + 0.5 * (cloud == at)), x)

    def within(self, x: Array) -> Array:
        """Weight of the particles at a smaller distance by the cloud's own mean and covariance."""
        cloud, _ = self._beside(x)
        found = Particles(cloud, self.cloud.w).moments()
        own = distance(x - found.mean, found.cov)
        each = distance(cloud - found.mean[..., None], found.cov[..., None])
        weight = dot(self.cloud.w, (each < own[:, None]).astype(float))
        return _known(np.where(own == np.inf, 1.0, weight), own)  # beyond a cloud without spread

    def crps(self, x: Array) -> Array:
        """``E|X - x| - E|X - X'| / 2`` of the cloud itself, X' another draw (the same, eq. 21).

        The second term is the integral of ``F (1 - F)``, F the weight up to each particle in order.
        """
        cloud, at = self._beside(x)
        order = np.argsort(cloud, axis=-1, kind="stable")
        ordered = np.take_along_axis(cloud, order, axis=-1)
        weights = np.take_along_axis(np.broadcast_to(self.cloud.w, cloud.shape), order, axis=-1)
        up_to = np.add.accumulate(weights, axis=-1)[..., :-1]
        gaps = ordered[..., 1:] - ordered[..., :-1]
        return np.asarray(dot(self.cloud.w, np.abs(cloud - at)) - dot(up_to * (1.0 - up_to), gaps))

    def _beside(self, x: Array) -> tuple[Array, Array]:
        return self.cloud.x[: len(x)], x[..., None]

    def uniform(self, probability: Array) -> Array:
        """``(r + 1/2) / (N + 1)`` of ``r / N``."""
        N = self.cloud.w.shape[-1]
        return (N * probability + 0.5) / (N + 1.0)


@dataclass(frozen=True)
class LinePosterior(Posterior):
    """A density of a scalar state on panels of Gauss-Legendre nodes."""

    panels: grid.Posterior

    def below(self, x: Array) -> Array:
        """The density's integral up to x, by its interpolating polynomials."""
        return np.clip(grid.mass_below(self.panels, x[0]), 0.0, 1.0)[None]

    def within(self, x: Array) -> Array:
        """Its integral over the interval about the mean that ends at x."""
        mean = grid.moments(self.panels).mean[0]
        reach = np.abs(x[0] - mean)
        inside = grid.mass_below(self.panels, mean + reach)
        return np.clip(inside - grid.mass_below(self.panels, mean - reach), 0.0, 1.0)

    def crps(self, x: Array) -> Array:
        """``E|X - x| - E|X - X'| / 2``, by the interpolating polynomials."""
        far = grid.distance_from(self.panels, x[0])
        return (far - grid.half_distance_within(self.panels))[None]


def distance(e: Array, P: Array) -> Array:
    """``e' P^-1 e`` (*batch); infinite where P leaves no room for an error that is known."""
    found = linalg.mahalanobis(e, P)
    known = np.isfinite(e).all(axis=0) & np.isfinite(P).all(axis=(0, 1))
    return np.where(np.isnan(found) & known, np.inf, found)


def _known(weight: Array, of: Array) -> Array:
    """A weight up to one, which all sum to but for rounding; NaN where that which it is of is."""
    return np.where(np.isnan(of), np.nan, np.minimum(weight, 1.0))


def _ratio(error: Array, sd: Array) -> Array:
    """Error over standard deviation; infinite for one without a standard deviation, 0 for none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(error == 0.0, 0.0, error / sd)
