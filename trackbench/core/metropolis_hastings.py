"""Metropolis-Hastings moves of particles, which separate copies after resampling.

Gilks & Berzuini 2001; van der Merwe et al. 2000, the MCMC step.
"""

from collections.abc import Callable

import numpy as np

from trackbench.core.arrays import Array, Mask, choose
from trackbench.core.random_streams import Streams


def metropolis(gain: Array, temperature: float, rng: Streams) -> Mask:
    """Accept every gain of log-density, and a loss with probability ``exp(gain / temperature)``.

    At temperature 0 no loss is accepted.

    Parameters
    ----------
    gain : array (M, N)
        Log-density of each particle's trial less that of the particle.
    temperature : float
        Temperature, 0 or more, by which the gain is divided.
    rng : Streams
        Random numbers.

    Returns
    -------
    array (M, N)
        True where the trial is accepted. A gain of NaN is rejected. At temperature 0 a gain of 0 is
        rejected, too.
    """
    # u < exp(gain / temperature) for a uniform u is gain > -temperature e, e = -log u exponential.
    threshold: Array = rng.standard_gamma(1, gain.shape)
    threshold *= -temperature
    return np.asarray(gain > threshold)


def independence_moves(
    x: Array,
    draw: Callable[[Streams], Array],
    log_ratio: Callable[[Array], Array],
    steps: int,
    rng: Streams,
) -> Array:
    """Move particles by steps of an independence chain (Tierney 1994).

    A proposal is accepted with the quotient of its ratio and that of x. A particle without density
    under the target moves to the first proposal that has one; a proposal without density is rejected.

    Parameters
    ----------
    x : array (n, M, N)
        Particles.
    draw : callable
        Proposals (n, M, N), drawn independently of x.
    log_ratio : callable
        Log of target over proposal density (M, N) at particles, up to a constant of each particle.
    steps : int
        Number of moves.
    rng : Streams
        Random numbers.

    Returns
    -------
    array (n, M, N)
        Moved particles.
    """
    current = log_ratio(x)
    for _ in range(steps):
        trial = draw(rng)
        proposed = log_ratio(trial)
        # Accept with probability min(1, exp(proposed - current)).
        with np.errstate(invalid="ignore"):
            accept = metropolis(proposed - current, temperature=1.0, rng=rng)
        x = choose(accept, trial, x)
        current = choose(accept, proposed, current)
    return x
