"""The fading-memory sum of normalized innovations, and its exact tail.

``rho(k) = gamma rho(k-1) + e(k)`` with independent ``e(k)``, chi-square of two degrees of freedom. In
the long run rho is a sum of independent exponentials of means 2 gamma^j (hypo-exponential), with mean
``2 / (1 - gamma)`` and variance ``4 / (1 - gamma^2)``. It is not chi-square.
"""

from decimal import Decimal, localcontext
from functools import lru_cache

from trackbench.core.elementary import log


@lru_cache(maxsize=256)
def tail(eta: float, gamma: float) -> float:
    """Return P(rho > eta) in the long run, ``sum_j A_j exp(-eta / (2 gamma^j))``.

    ``A_j = prod_{i != j} 1 / (1 - gamma^(i - j))`` alternate in sign and are as large as
    ``exp(2 / (1 - gamma))``, so the sum uses enough decimal digits for an exact cancellation.

    Parameters
    ----------
    eta : float
        Threshold on rho.
    gamma : float
        Fading factor, 0 < gamma < 1.

    Returns
    -------
    float
        Probability.
    """
    if eta <= 0.0:
        return 1.0
    with localcontext() as context:
        context.prec = 50 + int(2.5 / (1.0 - gamma))
        g, half = Decimal(gamma), Decimal(eta) / 2
        smallest = Decimal(10) ** -context.prec
        # Step 1: A_0 = 1 / prod_{i >= 1} (1 - gamma^i).
        product, power = Decimal(1), g
        while power > smallest:
            product *= 1 - power
            power *= g
        A = 1 / product
        # Step 2: add A_j exp(-eta / (2 gamma^j)), with A_j / A_{j-1} = 1 / (1 - gamma^-j).
        total, power = Decimal(0), Decimal(1)
        while True:
            term = A * (-half / power).exp()
            total += term
            if abs(term) < smallest:
                return float(min(max(total, Decimal(0)), Decimal(1)))
            power *= g
            A /= 1 - 1 / power


@lru_cache(maxsize=256)
def threshold(alpha: float, gamma: float) -> float:
    """Return the eta with ``tail(eta, gamma) = alpha``, by bisection."""
    # Step 1: bracket the threshold, starting from the mean of rho.
    low, high = 0.0, 2.0 / (1.0 - gamma)
    while tail(high, gamma) > alpha:
        low, high = high, 2.0 * high
    # Step 2: halve the bracket to nine digits.
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if tail(middle, gamma) > alpha else (low, middle)
    return 0.5 * (low + high)


def significance_threshold(alpha: float) -> float:
    """Return the value that a chi-square variable of two degrees exceeds with probability alpha."""
    return -2.0 * float(log(alpha))
