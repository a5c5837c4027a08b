"""Noncredibility: log NEES less its mean for a consistent filter, dB (Li, Zhao & Jilkov 2002)."""

from trackbench.core.arrays import Array
from trackbench.core.elementary import log
from trackbench.core.singular_nees import by_rank

_EULER = 0.5772156649015329


def noncredibility(nees: Array, n: int, rank: Array | None = None) -> Array:
    """Return ``10 log10 NEES`` minus its mean for a Gaussian posterior; positive means overconfident.

    Parameters
    ----------
    nees
        normalized errors squared (T + 1, M) of states of n components
    n
        number of components
    rank
        ranks (T + 1, M) of the covariances; None if they are n everywhere

    Returns
    -------
    array (T + 1, M)
        noncredibility in dB
    """

    def noncredibility_of_rank(squared: Array, r: int) -> Array:
        """Return the noncredibility, dB, of each NEES of rank r."""
        # A NEES of rank r is stored times n / r: squared * (r / n) is chi-square of r degrees.
        # psi(r / 2) by psi(1) = -gamma, psi(1 / 2) = -gamma - 2 log 2, psi(x + 1) = psi(x) + 1 / x
        digamma = -_EULER
        first = 2
        if r % 2 == 1:
            digamma = -_EULER - 2.0 * float(log(2.0))
            first = 1
        for i in range(first, r, 2):
            digamma += 2.0 / i
        # E log NEES = log 2 + psi(r / 2) for chi-square of r degrees of freedom
        return decibels(log(squared * (r / n)) - float(log(2.0)) - digamma)

    return by_rank(noncredibility_of_rank, nees, n, rank)


def decibels(log_ratio: Array) -> Array:
    """Convert natural logarithms to decibels."""
    return 10.0 / float(log(10.0)) * log_ratio
