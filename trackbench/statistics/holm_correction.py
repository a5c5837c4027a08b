"""Holm's correction of the p-values of a family of tests, and the significant differences by it."""

from collections.abc import Hashable, Mapping, Sequence
from math import copysign
from typing import TypeVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.statistics.comparison import Comparison
from trackbench.statistics.significance_rules import LEVEL, is_tested

Key = TypeVar("Key", bound=Hashable)


def holm(p: Array, tests: int = 0) -> Array:
    """Return p-values adjusted for a family of tests (Holm 1979).

    Parameters
    ----------
    p
        p-values (n,) of single tests; a NaN is no test
    tests
        number of tests of a family that has more tests than these; 0 means these

    Returns
    -------
    array (n,)
        adjusted p-values, at most 1; a NaN stays NaN
    """
    adjusted = np.full(len(p), np.nan)
    # The smallest p counts n times, the next n - 1 times, ...; none is less than the one before.
    order = np.argsort(p)[: int((~np.isnan(p)).sum())]
    stepped = p[order] * (max(tests, len(order)) - np.arange(len(order)))
    adjusted[order] = np.minimum(np.maximum.accumulate(stepped), 1.0)
    return adjusted


def two_sided_p_values(zs: Sequence[float], tests: int = 0) -> Array:
    """Return two-sided p-values (n,) by Holm from the z of a family; a NaN is no test and stays NaN.

    ``tests`` is the size of a family that has more tests than these.
    """
    from scipy.special import ndtr

    p = 2.0 * ndtr(-np.abs(np.array(zs, dtype=float)))
    return holm(p, tests)


def significant_signs(zs: Sequence[float]) -> list[int]:
    """Return the sign of each significant difference of a family by Holm at `LEVEL`.

    Parameters
    ----------
    zs
        z of the family; a NaN is no test

    Returns
    -------
    list of int
        1 or -1, and 0 for a difference that is not significant
    """
    signs_of_family = []
    for z, p in zip(zs, two_sided_p_values(zs), strict=True):
        signs_of_family.append(int(copysign(1.0, z)) if p < LEVEL else 0)
    return signs_of_family


def signs_beyond(zs: Sequence[float], sigmas: float) -> tuple[Array, list[int]]:
    """Return one-sided p-values by Holm on the side of each z, and the signs of significant ones.

    A positive z has the p-value of the test that the number is larger, a negative one that of the test
    that it is smaller. A number is larger or smaller if its p-value is at most the normal tail beyond
    ``sigmas``. This tail is about the probability that any of the numbers without a difference is called
    larger, for any dependence of the numbers (docs/statistics.md).

    Parameters
    ----------
    zs
        z (n,) of the numbers; a NaN is no test
    sigmas
        limit of `trackbench gate`, in standard errors

    Returns
    -------
    p : array (n,)
        adjusted p-values
    signs : list of int
        1 for a number that is larger, -1 for one that is smaller, else 0
    """
    from scipy.special import ndtr

    z = np.array(zs, dtype=float)
    tail = ndtr(-sigmas)
    p_larger = holm(ndtr(-z))
    p_smaller = holm(ndtr(z))
    significant = (p_larger <= tail).astype(int) - (p_smaller <= tail).astype(int)
    return np.where(z < 0.0, p_smaller, p_larger), significant.tolist()


def as_family(comparisons: Mapping[Key, Comparison], tests: int = 0) -> dict[Key, Comparison]:
    """Return the comparisons with p-values by Holm as one family.

    Parameters
    ----------
    comparisons
        comparisons by any key
    tests
        number of tests of the family; 0 for those of the comparisons that can be tested

    Returns
    -------
    dict
        comparisons with ``p`` and ``tests`` set, by the same keys. p is NaN for those that cannot be
        tested
    """
    zs = []
    for comparison in comparisons.values():
        z = np.nan  # no test
        if is_tested(comparison.difference):
            z = comparison.z
        zs.append(z)
    p_values = two_sided_p_values(zs, tests)
    tests = tests or int(np.sum(~np.isnan(p_values)))
    return {
        key: comparison._replace(p=float(p), tests=tests)
        for (key, comparison), p in zip(comparisons.items(), p_values, strict=True)
    }
