"""The fading-memory sum of normalised innovations, and its exact tail.

``rho(k) = gamma rho(k-1) + e(k)`` with independent ``e(k)`` chi-square of two degrees of freedom is, in
the long run, a sum of independent exponentials of means 2 gamma^j: hypo-exponential, with mean
``2 / (1 - gamma)`` and variance ``4 / (1 - gamma^2)``. It is not chi-square.
"""

from decimal import Decimal, localcontext
from functools import lru_cache

from trackbench.core.elementary import log


@lru_cache(maxsize=256)
def tail(eta: float, gamma: float) -> float:
    """Return P(rho > eta) in the long run, ``sum_j A_j exp(-eta / (2 gamma^j))``.

    ``A_j = prod_{i != j} 1 / (1 - gamma^(i - j))`` alternate and are as large as
    ``exp(2 / (1 - gamma))``, so the sum is done in so many decimal digits that nothing cancels.
    """
    if eta <= 0.0:
        return 1.0
    with localcontext() as context:
        context.prec = 50 + int(2.5 / (1.0 - gamma))
        g, half = Decimal(gamma), Decimal(eta) / 2
        smallest = Decimal(10) ** -context.prec
        A = 1 / _euler_product(g, smallest)
        total, power = Decimal(0), Decimal(1)
        while True:
            term = A * (-half / power).exp()
            total += term
            if abs(term) < smallest:
                return float(min(max(total, Decimal(0)), Decimal(1)))
            power *= g
            A /= 1 - 1 / power  # A_j / A_{j-1} = 1 / (1 - gamma^-j)


@lru_cache(maxsize=256)
def threshold(alpha: float, gamma: float) -> float:
    """Return the eta with ``tail(eta, gamma) = alpha``, by bisection on the logarithm."""
    low, high = 0.0, 2.0 / (1.0 - gamma)
    while tail(high, gamma) > alpha:
        low, high = high, 2.0 * high
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if tail(middle, gamma) > alpha else (low, middle)
    return 0.5 * (low + high)


def significance_threshold(alpha: float) -> float:
    """Return the value that a chi-square variable of two degrees exceeds with probability alpha."""
    return -2.0 * float(log(alpha))


def _euler_product(g: Decimal, smallest: Decimal) -> Decimal:
    """Return ``prod_{i >= 1} (1 - g^i)``."""
    product, power = Decimal(1), g
    while power > smallest:
        product *= 1 - power
        power *= g
    return product
