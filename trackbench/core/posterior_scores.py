"""Posterior distributions of the state, evaluated at the truth: calibration and CRPS.

A posterior of one step and M runs is a Gaussian, a set of weighted particles, or a density on a line.
The truth x is (n, M) and may have only the first components of the posterior's state.

If the truth is a draw from the posterior, `below` and `within` are uniform on (0, 1) (Rosenblatt 1952;
Talts et al. 2018, theorem 1). For N equal particles they are ranks r / N, uniform on N + 1 places, and
`uniform` returns the middle of a place. Ranks by weight are uniform only as the effective sample size
grows.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trackbench.core import grid_quadrature, linalg
from trackbench.core.arrays import Array
from trackbench.core.cumulative_probabilities import chi_square_cdf, normal_cdf, normal_density
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import log
from trackbench.core.grid_quadrature import Panel, Panels, gauss_legendre, weights_up_to
from trackbench.core.linalg import product, whiten_in_range
from trackbench.core.particles import Particles
from trackbench.core.singular_nees import (
    by_rank,
    component_size,
    distance_in_range,
    root_without_rounding,
)
from trackbench.core.sums import dot, total

_ROOT_PI = 1.7724538509055159
_LEAST = 1e-15  # lower bound on a squared distance and on a remaining variance: below is rounding


class Posterior(Protocol):
    """A distribution of the state, evaluated at the truth.

    The truth x is (n, M), of the first n components of the state.
    """

    def below(self, x: Array) -> Array:
        """Return the probability below each component of x (probability integral transform).

        Parameters
        ----------
        x : array (n, M)
            True states.

        Returns
        -------
        array (n, M)
            Probabilities.
        """

    def within(self, x: Array) -> Array:
        """Return the probability of states nearer to the mean than x in Mahalanobis distance.

        Parameters
        ----------
        x : array (n, M)
            True states.

        Returns
        -------
        array (M,)
            Probabilities.
        """

    def crps(self, x: Array) -> Array:
        """Return the continuous ranked probability score.

        Parameters
        ----------
        x : array (n, M)
            True states.

        Returns
        -------
        array (n, M)
            Scores, in the components' units.
        """

    def log_excess(self, x: Array) -> Array | None:
        """Return log NEES at x less the mean that it has if x is a draw from the posterior.

        Parameters
        ----------
        x : array (n, M)
            True states.

        Returns
        -------
        array (M,) or None
            Excess; None if the caller is to take the mean for Gaussian errors, by the chi-square law.
        """
        return None

    @property
    def places(self) -> int:
        """Number N + 1 of places that a rank among N particles has; 0 for a density."""
        return 0

    def uniform(self, probability: Array) -> Array:
        """Return the PIT of a ``probability`` from `below` or `within`, which is uniform on (0, 1).

        The probability is that of a density, or else a rank r / N among N particles: one of N + 1
        places, whose middle (r + 1/2) / (N + 1) is the PIT.

        Parameters
        ----------
        probability : array (...)
            Probabilities: (n, M) from `below`, (M,) from `within`.

        Returns
        -------
        array (...)
            PIT of each probability.
        """
        if not self.places:  # a density
            return probability
        N = self.places - 1
        return (N * probability + 0.5) / float(self.places)


@dataclass(frozen=True)
class NormalPosterior(Posterior):
    """N(mean, cov): mean (n, M), cov (n, n) or (n, n, M), which may be singular."""

    state: Gaussian

    def below(self, x: Array) -> Array:
        """Return the normal distribution function at each component of x (n, M)."""
        error, sd = self._error(x)
        return normal_cdf(_ratio(error, sd))

    def within(self, x: Array) -> Array:
        """Return the chi-square distribution function of the normalized error squared, (M,).

        x (n, M) has the first n components of the state, which may have more.
        """
        n = len(x)
        mean = self.state.mean[:n]
        P = self.state.cov[:n, :n]
        # The sizes decide which standard deviations count as rounding: these lower the rank.
        squared, rank = distance_in_range(x - mean, P, component_size(x, mean))
        return by_rank(chi_square_cdf, squared, n, rank)

    def crps(self, x: Array) -> Array:
        """Return the CRPS in closed form (Gneiting & Raftery 2007, section 4.2)."""
        error, sd = self._error(x)
        z = _ratio(error, sd)
        spread = sd * (2.0 * normal_density(z) - 1.0 / _ROOT_PI)
        return np.asarray(error * (2.0 * normal_cdf(z) - 1.0) + spread)

    def _error(self, x: Array) -> tuple[Array, Array]:
        """Return the error (n, M) at x and its standard deviation (n, 1 or M)."""
        n = len(x)  # of the state's components, which may be more
        sd = np.sqrt(linalg.diagonal(self.state.cov[:n, :n]))
        return x - self.state.mean[:n], sd.reshape(n, -1)


@dataclass(frozen=True)
class ParticlePosterior(Posterior):
    """Weighted particles x (n, M, N), w (M, N)."""

    particles: Particles

    def below(self, x: Array) -> Array:
        """Sum the weight (n, M) of the particles below x (n, M), and half of that at x.

        The particles may have further components, which x lacks.
        """
        particles = self.particles.x[: len(x)]
        point = x[..., None]
        share_below = (particles < point) + 0.5 * (particles == point)
        return _probability(dot(self.particles.w, share_below), x)

    def within(self, x: Array) -> Array:
        """Sum the weight (M,) of the particles with a smaller Mahalanobis distance than x (n, M).

        The distance of x is by the moments of the particles. The distance of a particle is by the
        moments of x and the other particles. So x and the particles are treated alike: if x is a draw
        like them, its rank among them is uniform.
        """
        of_x, of_each = self._distances(x)
        weight = dot(self.particles.w, (of_each < of_x[:, None]).astype(float))
        # An infinite distance is that of an x outside particles without spread.
        return _probability(np.where(of_x == np.inf, 1.0, weight), of_x)

    def log_excess(self, x: Array) -> Array:
        """Return log NEES of x less the weighted mean of the particles' log NEES (M,).

        The NEES of x is by the moments of the particles. The NEES of a particle is by the moments of x
        and the other particles. So log NEES of x has the same expected value as that of a particle if x
        is a draw like them, and the difference has the mean zero. (For equal draws from a Gaussian that
        value is ``digamma(n/2) + log(N + 1) - digamma((N - n)/2)``, since the NEES is (N + 1) times a
        ratio of chi-squares of n and N - n, Hotelling 1931. The computation does not need it.)
        """
        nees_of_x, nees_of_each = self._distances(x)
        excess = log(nees_of_x) - dot(self.particles.w, log(nees_of_each))
        # An x outside the range of particles without spread in some direction has an infinite NEES.
        return np.where(nees_of_x == np.inf, nees_of_x, excess)

    def _distances(self, x: Array) -> tuple[Array, Array]:
        """Return squared Mahalanobis distances of x and of each particle from all others.

        x is (n, M), and the distances are (M,) and (M, N). The moments of all others are those of x and
        the particles without the one that is measured. If x and N equal particles are draws from one
        distribution, the N + 1 distances are exchangeable.
        """
        # Particles may have further components, after those of the truth x.
        x_i = self.particles.x[: len(x)]
        w = self.particles.w
        N = w.shape[-1]
        state = Particles(x_i, w).moments()
        m = state.mean
        P = state.cov
        error = x - m
        # The rank (M,) of P is None if all covariances are positive definite.
        size = component_size(x, m)
        of_x, rank = distance_in_range(error, P, size)
        with np.errstate(all="ignore"):  # of_x is infinite outside the particles' range
            # Step 1: q = e' P^-1 e and c = e' P^-1 d of each particle by the particles' moments.
            if rank is None:
                L = linalg.cholesky(P)
                whiten = linalg.solve_lower
            else:
                L = root_without_rounding(P, size)
                whiten = whiten_in_range
                of_x = np.where(rank == 0, np.nan, of_x)  # all particles are where x is
            e = whiten(L[..., None], x_i - m[..., None])
            d = whiten(L, error)[..., None]
            q = total(e * e, axis=0)
            c = total(e * d, axis=0)
            # Step 2: add x with weight 1 / (N + 1) to mean and covariance (Sherman-Morrison).
            pooled = q + 1.0 / (N + 1.0) - np.square(1.0 + c) / (N + 1.0 + of_x[:, None])
            # Step 3: remove each particle with its weight from them.
            share = N / (N + 1.0)
            rest = share * (1.0 - share * w) - share * w * pooled
            return of_x, np.maximum(pooled, _LEAST) / np.maximum(rest, _LEAST)

    def crps(self, x: Array) -> Array:
        """Compute ``E|X - x| - E|X - X'| / 2``, X and X' particles (Gneiting & Raftery 2007, eq. 21).

        x (n, M) is the truth, and the result is (n, M). The particles may have further components, which
        x lacks. X' may be X: for N equal draws from the truth's law the mean is 1 + 1 / N times that
        law's score (Ferro 2014).
        """
        particles = self.particles.x[: len(x)]
        at = x[..., None]
        # Step 1: sort the particles of each component, with their weights.
        order = np.argsort(particles, axis=-1, kind="stable")
        ordered = np.take_along_axis(particles, order, axis=-1)
        w = np.broadcast_to(self.particles.w, particles.shape)
        weights = np.take_along_axis(w, order, axis=-1)
        # Step 2: E|X - X'| / 2 is the integral of F (1 - F), F the weight up to each particle.
        F = np.add.accumulate(weights, axis=-1)[..., :-1]
        gaps = ordered[..., 1:] - ordered[..., :-1]
        half_spread = dot(F * (1.0 - F), gaps)
        return np.asarray(dot(self.particles.w, np.abs(particles - at)) - half_spread)

    @property
    def places(self) -> int:
        """One more than there are particles."""
        return self.particles.w.shape[-1] + 1


@dataclass(frozen=True)
class LinePosterior(Posterior):
    """A density of a scalar state on panels of Gauss-Legendre nodes."""

    panels: grid_quadrature.Panels

    def below(self, x: Array) -> Array:
        """Integrate the density up to x (1, M), by its interpolating polynomials: (1, M)."""
        return np.clip(grid_quadrature.mass_below(self.panels, x[0]), 0.0, 1.0)[None]

    def within(self, x: Array) -> Array:
        """Integrate the density over the interval about the mean that ends at x (1, M): (M,)."""
        mean = grid_quadrature.moments(self.panels).mean[0]
        reach = np.abs(x[0] - mean)
        inside = grid_quadrature.mass_below(self.panels, mean + reach)
        return np.clip(inside - grid_quadrature.mass_below(self.panels, mean - reach), 0.0, 1.0)

    def crps(self, x: Array) -> Array:
        """Compute ``E|X - x| - E|X - X'| / 2`` (1, M), by the interpolating polynomials."""
        to_x = grid_quadrature.distance_from(self.panels, x[0])
        return (to_x - _half_distance_of_draws(self.panels))[None]


def _probability(weight: Array, point: Array) -> Array:
    """Limit a sum of weights to one despite rounding; NaN where ``point`` is NaN."""
    return np.where(np.isnan(point), np.nan, np.minimum(weight, 1.0))


def _ratio(error: Array, sd: Array) -> Array:
    """Divide error by standard deviation; infinite without a deviation, 0 without an error."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(error == 0.0, 0.0, error / sd)


def _half_distance_of_draws(posterior: Panels) -> Array:
    """Compute ``E|X - X'| / 2`` (M,) for two independent draws, by panels that do not overlap."""
    # Of two draws from different panels, which do not overlap, E|X - X'| is the distance of the panels'
    # means: sums over masses.
    masses = [total(panel.mass, axis=0) for panel in posterior]
    sums = [total(panel.mass * panel.x, axis=0) for panel in posterior]
    across = []
    for i in range(len(masses)):
        for j in range(i):
            across.append(abs(masses[i] * sums[j] - masses[j] * sums[i]))
    return np.asarray(sum(_half_distance_in(panel) for panel in posterior) + sum(across))


def _half_distance_in(panel: Panel) -> Array:
    """Return the part of ``E|X - X'| / 2`` (M,) of two draws that are both from this panel.

    It is the integral of ``F (m - F)`` over the panel of mass m, F being the panel's mass below x.
    """
    if panel.is_point:
        return np.zeros_like(panel.low)
    n = len(panel.x)
    # F at each node: the integral of the density from the left end to there. A run is a row of the
    # product, so that its rounding does not depend on the other runs of the block (`refined`).
    F = panel.half * product(panel.density.T, weights_up_to(gauss_legendre(n).nodes, n).T).T
    integrand = F * (total(panel.mass, axis=0) - F)
    return np.asarray(panel.half * total(gauss_legendre(n).weights[:, None] * integrand, axis=0))
