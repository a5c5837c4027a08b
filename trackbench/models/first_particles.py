"""Draws of the first particles from a prior, with weights if they cover its tails."""

from math import pi, sqrt
from typing import Protocol, runtime_checkable

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import LOG_2PI, Distribution
from trackbench.core.elementary import log
from trackbench.core.random_streams import Streams


@runtime_checkable
class Covering(Protocol):
    """A distribution with draws that cover its tails."""

    def cover(self, rng: Streams, N: int) -> tuple[Array, Array]:
        """Draw states that cover the distribution's tails.

        Parameters
        ----------
        rng : Streams
            Random numbers.
        N : int
            Number of draws in each of M runs.

        Returns
        -------
        x : array (n, M, N)
            Draws.
        log_w : array (M, N)
            Log-weights that make them draws from the distribution.
        """


def draw_covering(prior: Distribution, rng: Streams, N: int) -> tuple[Array, Array]:
    """Draw first particles, by ``prior.cover`` if the prior has it.

    Parameters
    ----------
    prior : Distribution
        Prior of states (n, M).
    rng : Streams
        Random numbers.
    N : int
        Number of particles in each run.

    Returns
    -------
    x : array (n, M, N)
        Particles.
    log_w : array (M, N)
        Log-weights that make them draws from the prior. They are 0 for a prior without ``cover``.
    """
    if isinstance(prior, Covering):
        return prior.cover(rng, N)
    x = prior.sample(rng, N)
    return x, np.zeros(x.shape[1:])


_SCALE = 2.0 * sqrt(3.0) / pi  # of a logistic with twice the normal's standard deviation
_EDGE = 2.0**-52


def heavy_tailed_normal(runs: int, N: int, rng: Streams) -> tuple[Array, Array]:
    """Draw numbers with heavy tails, and log-weights that make them N(0, 1).

    The draws come from a logistic of twice the normal's standard deviation, which has 800 times as many
    draws beyond four deviations and .6 times as many within one. Weights are at most 1.76, 1 on average.

    Parameters
    ----------
    runs : int
        Number M of runs.
    N : int
        Number of draws in each run.
    rng : Streams
        Random numbers.

    Returns
    -------
    x : array (M, N)
        Draws, ascending in each run.
    log_w : array (M, N)
        Log-weights.
    """
    # Step 1: one uniform in each of N strata of equal probability.
    u = (np.arange(N) + rng.random((runs, N))) * (1.0 / N)
    np.clip(u, _EDGE, 1.0 - _EDGE, out=u)  # the quantiles of 0 and 1 are infinite
    # Step 2: x is the logistic quantile of u; the weight is the ratio of the densities at x.
    log_u = log(u)
    log_rest = log(1.0 - u)
    x = _SCALE * (log_u - log_rest)
    log_w = float(log(_SCALE)) - 0.5 * LOG_2PI - 0.5 * np.square(x) - log_u - log_rest
    return x, log_w
