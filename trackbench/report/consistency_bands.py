"""Bands of averages over runs for a consistent filter with missing measurements."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import total
from trackbench.evaluation.intervals import anees_band


def components(numbers: Array) -> float:
    """Return the number of components of one average with the variance of the mean of runs' averages.

    Of run i with n_i components (``numbers``, (M,)) that is chi2(n_i) / n_i, of variance 2 / n_i. Their
    unweighted mean has sum(2 / n_i) / M^2, which a chi-square over its M^2 / sum(1 / n_i) degrees of
    freedom has, too (Satterthwaite 1946, Biometrics Bull. 2, 110). Of equal n_i exactly M n; 0 of none.
    """
    there = numbers[numbers > 0]
    if not len(there):
        return 0.0
    least = there.min()  # so that of equal numbers nothing is rounded
    return float(len(there) * least * (len(there) / total(least / there)))


def anis_band(numbers: Array) -> tuple[float, float]:
    """Return the 95 % band of the mean ANIS over runs; wide for few measurements."""
    return anees_band(1, components(numbers))  # any degrees of freedom


def autocorrelation_band(numbers: Array) -> float:
    """Return the 95 % half-width of the mean autocorrelation over runs."""
    number = components(numbers)
    return 1.96 / float(np.sqrt(number)) if number else np.inf
