"""Thresholds of the alarm by a false-alarm probability: laws of the fading sum rho, and of zeta.

The fading-memory sum of normalized innovations is ``rho(k) = gamma rho(k-1) + e(k)`` with independent
``e(k)``, chi-square of two degrees of freedom. In the long run rho is a sum of independent exponentials
of means 2 gamma^j (hypo-exponential), with mean ``2 / (1 - gamma)`` and variance ``4 / (1 - gamma^2)``.
It is not chi-square.
"""

from decimal import Decimal, localcontext
from functools import lru_cache

from trackbench.core.elementary import log


@lru_cache(maxsize=256)
def tail(eta: float, gamma: float) -> float:
    """Return P(rho > eta) in the long run: ``sum_j A_j exp(-eta / (2 gamma^j))``, 0 < gamma < 1.

    rho is the fading sum ``rho(k) = gamma rho(k-1) + e(k)`` of the NIS e of two axes without a maneuver.
    The factors ``A_j = prod_{i != j} 1 / (1 - gamma^(i - j))`` alternate in sign and are as large as
    ``exp(2 / (1 - gamma))``. So the sum is computed with enough decimal digits that they cancel.
    """
    if eta <= 0.0:
        return 1.0
    with localcontext() as context:
        # The largest term has at most 2.5 / (1 - gamma) digits before the point; 50 more are for the
        # sum.
        context.prec = 50 + int(2.5 / (1.0 - gamma))
        g = Decimal(gamma)
        half = Decimal(eta) / 2
        smallest = Decimal(10) ** -context.prec
        # Step 1: A_0 = 1 / prod_{i >= 1} (1 - gamma^i), with factors until they are 1 in these digits.
        product = Decimal(1)
        power = g
        while power > smallest:
            product *= 1 - power
            power *= g
        A = 1 / product
        # Step 2: add A_j exp(-eta / (2 gamma^j)), with A_j / A_{j-1} = 1 / (1 - gamma^-j).
        total = Decimal(0)
        power = Decimal(1)
        while True:
            term = A * (-half / power).exp()
            total += term
            if abs(term) < smallest:
                # Rounding may bring the sum below 0 or above 1.
                return float(min(max(total, Decimal(0)), Decimal(1)))
            power *= g
            A /= 1 - 1 / power


@lru_cache(maxsize=256)
def threshold(alpha: float, gamma: float) -> float:
    """Find the eta that rho exceeds with probability alpha, by bisection of ``tail(eta, gamma)``.

    rho is the fading sum ``rho(k) = gamma rho(k-1) + e(k)`` of the NIS e of two axes without a maneuver.
    """
    # Step 1: bracket the threshold, starting from the mean of rho: e has the mean 2.
    low = 0.0
    high = 2.0 / (1.0 - gamma)
    while tail(high, gamma) > alpha:
        low = high
        high *= 2.0
    # Step 2: halve the bracket to nine digits.
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        if tail(middle, gamma) > alpha:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def significance_threshold(alpha: float) -> float:
    """Return the value that a chi-square variable of two degrees exceeds with probability alpha."""
    return -2.0 * float(log(alpha))
