"""A prior with the components that a motion has beside the target's: zero mean, independent."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.conversions import Conversion
from trackbench.core.distributions import (
    Distribution,
    Gaussian,
    Symmetric,
    draw_covering,
    zero_mean_log_prob,
)
from trackbench.core.random_streams import Streams
from trackbench.models.two_point_prior import TwoPoint


def augment_prior(prior: Distribution, std: tuple[float, ...]) -> Distribution:
    """Return the prior (n, M) with a component N(0, s^2) more for each s of ``std``."""
    if not std:
        return prior
    if isinstance(prior, TwoPoint):
        return AugmentedTwoPoint(prior, std)
    return augment_gaussian(prior, std)


def augment_gaussian(prior: Distribution, std: tuple[float, ...]) -> Gaussian:
    """Return the moments of the extended prior: mean (n + m, M), cov (n + m, n + m[, M])."""
    n, m = len(prior.mean), len(std)
    mean = np.concatenate([prior.mean, np.zeros((m, *prior.mean.shape[1:]))])
    cov = np.zeros((n + m, n + m, *prior.cov.shape[2:]))
    cov[:n, :n] = prior.cov
    for i, s in enumerate(std, n):
        cov[i, i] = s * s
    return Gaussian(mean, cov)


@dataclass(frozen=True, eq=False)
class AugmentedTwoPoint(Symmetric):
    """Two scans' prior, and independent N(0, s^2) components."""

    scans: TwoPoint
    std: tuple[float, ...]

    @property
    def mean(self) -> Array:
        """Return the mean (n + m, M)."""
        return augment_gaussian(self.scans, self.std).mean

    @property
    def cov(self) -> Array:
        """Return the covariance (n + m, n + m, M)."""
        return augment_gaussian(self.scans, self.std).cov

    def gaussian(self, conversion: Conversion) -> Gaussian:
        """Return two-point differencing of converted scans, extended."""
        return augment_gaussian(self.scans.gaussian(conversion), self.std)

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Return states (n + m, M, *trailing)."""
        return append_noise(self.scans.sample(rng, *trailing), self.std, rng)

    def cover(self, rng: Streams, N: int) -> tuple[Array, Array]:
        """Return states (n + m, M, N) that cover the scans' tails, and log-weights (M, N)."""
        x, log_w = draw_covering(self.scans, rng, N)
        return append_noise(x, self.std, rng), log_w

    def log_prob(self, x: Array) -> Array:
        """Return the log-density at x (n + m, M[, N])."""
        n = len(x) - len(self.std)
        rest = zero_mean_log_prob(x[n:], np.diag(np.square(self.std)))
        return self.scans.log_prob(x[:n]) + rest


def append_noise(x: Array, std: tuple[float, ...], rng: Streams) -> Array:
    """Return states (n, *batch) with a draw from N(0, s^2) more for each s of ``std``."""
    if not std:
        return x
    noise = rng.standard_normal((len(std), *x.shape[1:]))
    return np.concatenate([x, with_trailing(np.array(std), noise.ndim - 1) * noise])
