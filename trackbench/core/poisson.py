"""Poisson counts: log-probability, and draws by inversion."""

from math import inf

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import exp, log, log_gamma

_MAX_RATE = 1e6  # of a count, whose inversion takes some 20 sqrt(rate) steps


def log_poisson(z: Array, rate: Array) -> Array:
    """Return the log-probability of counts.

    Parameters
    ----------
    z : array (*batch)
        Counts.
    rate : array (*batch)
        Expected counts, broadcast against z.

    Returns
    -------
    array (*batch)
        Log-probability, -inf unless z is whole and >= 0 and the rate is >= 0. A z of NaN gives NaN.
    """
    counts, index = np.unique(z, return_inverse=True)
    valid = (counts >= 0.0) & (counts == np.floor(counts))
    # `log_gamma` takes one number, so it is called once for each different count.
    log_factorials = np.full(counts.shape, inf)
    for i in np.flatnonzero(valid):
        log_factorials[i] = log_gamma(counts[i] + 1.0)
    log_factorial = log_factorials[index].reshape(z.shape)
    # log p(z) = z log rate - rate - log z!; a rate of zero gives the count zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(z == 0.0, 0.0, z * log(rate)) - rate - log_factorial
    return np.where(rate >= 0.0, value, -np.inf)


def draw_poisson(rate: Array, u: Array) -> Array:
    """Draw a Poisson count for each rate by inversion of uniforms.

    Parameters
    ----------
    rate : array (*batch)
        Expected counts, 0 to 1e6.
    u : array (*batch)
        Uniform numbers in [0, 1).

    Returns
    -------
    array (*batch)
        Counts, as floats.

    Raises
    ------
    ValueError
        For a rate that is negative, NaN, or above 1e6.
    """
    is_rate = (rate >= 0.0) & (rate <= _MAX_RATE)
    if not is_rate.all():
        wrong = rate[~is_rate][0]
        raise ValueError(f"the rate of a count is {wrong:g}; it may be 0 to {_MAX_RATE:g}")
    # Step 1: begin nine standard deviations below the mean, beyond which lies 1e-17.
    reach = 9.0 * np.sqrt(rate)
    count = np.maximum(np.floor(rate - reach), 0.0)
    probability = exp(log_poisson(count, rate))
    below = probability.copy()
    last = rate + reach + 40.0  # of a small rate the upper tail is longer than nine deviations
    # Step 2: add probabilities until their sum exceeds u.
    while True:
        goes_on = (below <= u) & (count < last)
        if not goes_on.any():
            return count
        count = count + goes_on
        # p(n) = p(n - 1) rate / n
        next_probability = probability * rate / np.maximum(count, 1.0)
        probability = np.where(goes_on, next_probability, probability)
        below = np.where(goes_on, below + probability, below)
