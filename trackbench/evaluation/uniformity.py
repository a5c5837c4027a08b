"""Are probability integral transforms uniform, as those of a calibrated filter are?

At a step the runs are independent, and the tests are the classical ones. The steps of a run are not:
over them each run has a share in each tenth, and the test takes the covariance of these from the runs,
whatever the correlation in time.
"""

from typing import NamedTuple

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.sums import mean, total
from trackbench.evaluation.calibration import TENTHS, tenth_of


class Histogram(NamedTuple):
    """Shares (TENTHS,) of the truths in each tenth, their standard errors, and how many runs there are.

    ``distance`` is Kolmogorov's, between the transforms' distribution and the uniform one; ``p`` and
    ``p_distance`` are the p-values of a uniform histogram and distribution, NaN if there is no test.
    """

    shares: Array
    stderr: Array
    runs: int
    distance: float = np.nan
    p_distance: float = np.nan
    p: float = np.nan


def at_step(pit: Array) -> Histogram:
    """Of one transform (M,) a run: Pearson's chi-square over the tenths, NaN left out."""
    from scipy.special import chdtrc

    pit = pit[~np.isnan(pit)]
    M = len(pit)
    which = tenth_of(pit)
    counts = np.array([float((which == b).sum()) for b in range(TENTHS)])
    shares = counts / max(M, 1)
    stderr = np.sqrt(shares * (1.0 - shares) / max(M, 1))
    if M < TENTHS:
        return Histogram(shares, stderr, M)
    expected, distance = M / TENTHS, kolmogorov(pit)
    p = float(chdtrc(TENTHS - 1, float(total(np.square(counts - expected))) / expected))
    return Histogram(shares, stderr, M, distance, kolmogorov_p(distance, M), p)


def over_steps(shares: Array) -> Histogram:
    """Of each run's shares (TENTHS, M) of its steps: Hotelling's T^2 of their means (1931).

    NaN, as of lost runs, is left out; the distance is that at the tenths' edges.
    """
    from scipy.special import fdtrc

    shares = shares[:, ~np.isnan(shares).any(axis=0)]
    M = shares.shape[1]
    if M <= TENTHS:
        return Histogram(np.full(TENTHS, np.nan), np.full(TENTHS, np.nan), M)
    centre = mean(shares)
    off = shares - centre[:, None]
    covariance = np.array([[float(total(a * b)) for b in off] for a in off]) / (M - 1.0)
    variance = linalg.diagonal(covariance)
    edges = np.add.accumulate(centre) - np.arange(1, TENTHS + 1) / TENTHS
    distance = float(np.abs(edges).max())
    n, p = TENTHS - 1, 0.0  # the last share is what is left of one
    if (variance > 0.0).all():  # no tenth is without any truth
        T2 = M * float(linalg.mahalanobis(centre[:n] - 1.0 / TENTHS, covariance[:n, :n]))
        p = float(fdtrc(n, M - n, T2 * (M - n) / (n * (M - 1.0))))
    return Histogram(centre, np.sqrt(variance / M), M, distance, p=p)


def kolmogorov(pit: Array) -> float:
    """Largest difference between the distribution function of values (M,) and the uniform one."""
    ordered, M = np.sort(pit), len(pit)
    steps = np.arange(M + 1) / M
    return float(np.maximum(steps[1:] - ordered, ordered - steps[:-1]).max())


def kolmogorov_band(M: int, level: float = 0.95) -> float:
    """What the distance of M uniform values exceeds with probability 1 - level (Stephens 1970)."""
    from scipy.special import kolmogi

    root = np.sqrt(M)
    return float(kolmogi(1.0 - level) / (root + 0.12 + 0.11 / root))


def kolmogorov_p(distance: float, M: int) -> float:
    """Probability that the distance of M uniform values is larger (Stephens 1970, JRSS B 32)."""
    from scipy.special import kolmogorov as beyond

    root = np.sqrt(M)
    return float(beyond(distance * (root + 0.12 + 0.11 / root)))
