"""Tests of whether probability integral transforms are uniform, as those of a calibrated filter are.

At a step the runs are independent, and the tests are the classical ones. The steps of a run are
correlated. Over them each run has a share in each tenth, and the test takes the covariance of the shares
from the runs, whatever the correlation in time.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.sums import mean, total
from trackbench.evaluation.calibration_series import TENTHS, in_tenths
from trackbench.statistics.kolmogorov_distance import cell_of, kolmogorov, kolmogorov_p

_MOST_PLACES = 4096
_OFF_A_PLACE = 1e-3  # files have seven digits
_FEWEST_TRANSFORMS = 10  # from which the number of places is found


class Histogram(NamedTuple):
    """Rank histogram of transforms, and the tests of whether they are uniform."""

    shares: Array
    """shares (TENTHS,) of the truths in each tenth"""
    stderr: Array
    """standard errors (TENTHS,) of the shares"""
    runs: int
    """number of runs"""
    distance: float = np.nan
    """Kolmogorov's distance between the distribution of the transforms and the uniform one"""
    p_distance: float = np.nan
    """p-value of a uniform distribution; NaN if there is no test"""
    p: float = np.nan
    """p-value of a uniform histogram; NaN if there is no test"""


def at_step(pit: Array) -> Histogram:
    """Test one transform per run: Pearson's chi-square over the tenths, and Kolmogorov's test.

    A transform by particles is the rank of the truth among N of them, which has N + 1 places. It is the
    middle of its place, one of N + 1 equal parts of (0, 1). So the values alone show the number of
    places. Ranks are counted by whole places, in at most ten groups, each with its own expectation.

    Parameters
    ----------
    pit
        transforms (M,), NaN left out

    Returns
    -------
    Histogram
        shares and p-values; there is no test of fewer than ten transforms
    """
    from scipy.special import chdtrc

    # Step 1: shares of the tenths, with binomial standard errors sqrt(p (1 - p) / M).
    pit = pit[~np.isnan(pit)]
    M = len(pit)
    places = number_of_places(pit)
    shares = total(in_tenths(pit, places)) / max(M, 1)
    stderr = np.sqrt(shares * (1.0 - shares) / max(M, 1))
    if M < TENTHS:
        return Histogram(shares=shares, stderr=stderr, runs=M)
    # Step 2: Pearson's test; a group of ranks expects runs in proportion to its places. Transforms by a
    # density have no places, and are counted in tenths.
    cells = places or TENTHS
    groups = min(cells, TENTHS)
    group_of = np.arange(cells) * groups // cells
    counts = np.bincount(group_of[cell_of(pit, cells)], minlength=groups)
    expected = np.bincount(group_of) * (M / cells)
    p = float(chdtrc(groups - 1, float(total(np.square(counts - expected) / expected))))
    # Step 3: Kolmogorov's test of the whole distribution.
    distance = kolmogorov(pit, places)
    return Histogram(
        shares=shares,
        stderr=stderr,
        runs=M,
        distance=distance,
        p_distance=kolmogorov_p(distance, M),
        p=p,
    )


def over_steps(shares: Array) -> Histogram:
    """Test the transforms of many steps: Hotelling's T^2 (1931).

    The distance is that at the tenths' edges. Ranks among fewer than nine particles have fewer than ten
    places, equal parts of (0, 1), and get no test. A place is shared out among the tenths that it covers
    (`in_tenths`), so that no tenth is empty in all runs.

    Parameters
    ----------
    shares
        share (TENTHS, M) of each run's steps whose transform is in a tenth of (0, 1). Runs with NaN,
        such as lost ones, are left out

    Returns
    -------
    Histogram
        shares and p-value ``p``; NaN for ten runs or fewer
    """
    from scipy.special import fdtrc

    # Step 1: mean share of each tenth and the runs' covariance of the shares.
    shares = shares[:, ~np.isnan(shares).any(axis=0)]
    M = shares.shape[1]
    if M <= TENTHS:
        # Too few runs for the covariance of the shares.
        unknown = np.full(TENTHS, np.nan)
        return Histogram(shares=unknown, stderr=unknown, runs=M)
    center = mean(shares)
    deviations = shares - center[:, None]
    products = [float(total(a * b)) for a, b in product(deviations, repeat=2)]
    covariance = np.array(products).reshape(TENTHS, TENTHS) / (M - 1.0)
    variance = linalg.diagonal(covariance)
    # Step 2: Kolmogorov's distance, at the edges of the tenths.
    edges = np.add.accumulate(center) - np.arange(1, TENTHS + 1) / TENTHS
    distance = float(np.abs(edges).max())
    # Step 3: Hotelling's test of all tenths but the last, whose share is what is left of one.
    n = TENTHS - 1
    S = covariance[:n, :n]
    if not (variance > 0.0).all():
        p = 0.0  # a tenth without any truth
    elif linalg.is_singular(S):
        p = np.nan  # fewer than ten places: their shares in tenths depend on each other
    else:
        # T^2 = M (c - 1/10)' S^-1 (c - 1/10); (M - n) T^2 / (n (M - 1)) is F(n, M - n).
        T2 = M * float(linalg.mahalanobis(center[:n] - 1.0 / TENTHS, S))
        p = float(fdtrc(n, M - n, T2 * (M - n) / (n * (M - 1.0))))
    return Histogram(shares=center, stderr=np.sqrt(variance / M), runs=M, distance=distance, p=p)


def number_of_places(pit: Array) -> int:
    """Find how many ranks are possible, if transforms are computed from ranks.

    The rank i of a truth among N particles has N + 1 places, from 0 to N. Its transform is the middle of
    the place: (i + 0.5) / (N + 1).

    Parameters
    ----------
    pit
        transforms (M,) without NaN

    Returns
    -------
    int
        least number of places that fits all transforms; 0 for transforms by a density, and for fewer
        than ten transforms
    """
    if len(pit) < _FEWEST_TRANSFORMS:
        return 0
    sizes = np.arange(3, _MOST_PLACES)  # 3 places are those of two particles
    # Try all sizes on ten values, and the few that remain on all values.
    remaining = sizes[_are_middles(pit[:_FEWEST_TRANSFORMS, None], sizes).all(axis=0)]
    for size in remaining:
        if _are_middles(pit, size).all():
            return int(size)
    return 0


def _are_middles(pit: Array, sizes: Index) -> Mask:
    """Test which transforms ``pit`` are the middle of a place, if (0, 1) has ``sizes`` equal places.

    A place is one of the equal parts of (0, 1), one for each possible rank of a truth among particles.
    A transform that is computed from a rank is the middle of its place; one by a density is so by chance
    only. ``pit`` (..., 1) and ``sizes`` (n,) give a result (..., n). ``pit`` (M,) and a single number in
    place of ``sizes`` give a result (M,).
    """
    # u = (i + 0.5) / size is the middle of place i, so that u size - 0.5 is a whole number.
    i = pit * sizes - 0.5
    return np.abs(i - np.rint(i)) < _OFF_A_PLACE
