"""Priors of the state with the further components of a motion."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import (
    Distribution,
    Gaussian,
    PointMass,
    Symmetric,
    zero_mean_log_prob,
)
from trackbench.core.polar_conversions import Conversion
from trackbench.core.random_streams import Streams
from trackbench.models.first_particles import draw_covering
from trackbench.models.two_scan_prior import TwoPoint


@dataclass(frozen=True, eq=False)
class Augmented(Symmetric):
    """A prior with further independent N(0, s^2) components."""

    prior: Distribution
    std: tuple[float, ...]

    @property
    def mean(self) -> Array:
        """Mean (n + m, M)."""
        return augment_gaussian(self.prior, self.std).mean

    @property
    def cov(self) -> Array:
        """Covariance (n + m, n + m[, M])."""
        return augment_gaussian(self.prior, self.std).cov

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw states (n + m, M, *trailing)."""
        return append_drawn_components(self.prior.sample(rng, *trailing), self.std, rng)

    def cover(self, rng: Streams, N: int) -> tuple[Array, Array]:
        """Draw states (n + m, M, N) that cover the prior's tails, with log-weights (M, N)."""
        x, log_w = draw_covering(self.prior, rng, N)
        return append_drawn_components(x, self.std, rng), log_w

    def log_prob(self, x: Array) -> Array:
        """Evaluate the log-density at x (n + m, M[, N])."""
        # The further components are independent of the others.
        n = len(x) - len(self.std)
        further = zero_mean_log_prob(x[n:], np.diag(np.square(self.std)))
        return self.prior.log_prob(x[:n]) + further


@dataclass(frozen=True, eq=False)
class AugmentedTwoPoint(Augmented):
    """Prior of two scans, and independent N(0, s^2) components."""

    prior: TwoPoint

    def gaussian(self, conversion: Conversion) -> Gaussian:
        """Difference two converted scans, and add the further components."""
        return augment_gaussian(self.prior.gaussian(conversion), self.std)


def augment_prior(prior: Distribution, std: tuple[float, ...]) -> Distribution:
    """Extend the prior by a component N(0, s^2) for each s of ``std``.

    Parameters
    ----------
    prior : Distribution
        Prior of states (n, M).
    std : tuple of float
        Initial standard deviations of the m components that a motion has beyond the prior's, such as
        accelerations, each in its unit. They are those of `extra_std`.

    Returns
    -------
    Distribution
        Prior of states (n + m, M). It is the prior itself if ``std`` is empty. A prior of two scans
        stays one.
    """
    if not std:
        return prior
    # A prior of two scans stays one, as filters may choose how the scans are converted to positions. A
    # Gaussian or a known point becomes a Gaussian. Any other prior is wrapped, to keep its own draws and
    # density.
    if isinstance(prior, TwoPoint):
        return AugmentedTwoPoint(prior, std)
    if isinstance(prior, Gaussian | PointMass):
        return augment_gaussian(prior, std)
    return Augmented(prior, std)


def augment_gaussian(prior: Distribution, std: tuple[float, ...]) -> Gaussian:
    """Extend the moments of the prior by independent components of mean 0 and deviations ``std``.

    Parameters
    ----------
    prior : Distribution
        Prior with mean (n, M) and covariance (n, n[, M]).
    std : tuple of float
        Standard deviations of the m components, each in its unit.

    Returns
    -------
    Gaussian
        Mean (n + m, M) and covariance (n + m, n + m[, M]).
    """
    n = len(prior.mean)
    m = len(std)
    mean = np.concatenate([prior.mean, np.zeros((m, *prior.mean.shape[1:]))])
    # P = [P 0; 0 diag(s^2)]
    cov = np.zeros((n + m, n + m, *prior.cov.shape[2:]))
    cov[:n, :n] = prior.cov
    for i, s in enumerate(std, n):
        cov[i, i] = s * s
    return Gaussian(mean, cov)


def append_drawn_components(x: Array, std: tuple[float, ...], rng: Streams) -> Array:
    """Append a motion's further components to states, drawn from N(0, s^2) for each s of ``std``.

    Parameters
    ----------
    x : array (n, *batch)
        States.
    std : tuple of float
        Standard deviations of the m components, each in its unit, as `extra_std` has them.
    rng : Streams
        Random numbers.

    Returns
    -------
    array (n + m, *batch)
        States with the further components in the last rows. It is x itself if ``std`` is empty.
    """
    if not std:
        return x
    noise = rng.standard_normal((len(std), *x.shape[1:]))
    return np.concatenate([x, with_trailing(np.array(std), noise.ndim - 1) * noise])
