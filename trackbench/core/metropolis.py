"""Metropolis-Hastings moves of a resampled cloud, so that copies part.

Gilks & Berzuini 2001; van der Merwe et al. 2000, the MCMC step.
"""

from collections.abc import Callable

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.differential_evolution import metropolis
from trackbench.core.random_streams import Streams


def independence_moves(
    x: Array,
    draw: Callable[[Streams], Array],
    log_ratio: Callable[[Array], Array],
    steps: int,
    rng: Streams,
) -> Array:
    """Return ``x`` (n, M, N) after so many steps with proposals that do not depend on it.

    ``log_ratio`` (M, N) is the logarithm of target over proposal density, up to a constant of each
    particle: a draw is accepted with the quotient of its ratio and that of x (Tierney 1994, independence
    chains). What has no density under the target is left by the first draw that has one, never entered.
    """
    found = log_ratio(x)
    for _ in range(steps):
        trial = draw(rng)
        drawn = log_ratio(trial)
        with np.errstate(invalid="ignore"):
            take = metropolis(drawn - found, 1.0, rng)
        x, found = np.where(take, trial, x), np.where(take, drawn, found)
    return x
