"""The posterior Cramer-Rao bound of a filtering problem (Tichavsky, Muravchik & Nehorai 1998)."""

from collections.abc import Iterable

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array


def posterior_cramer_rao(initial: Array, F: Array, Q: Array, information: Iterable[Array]) -> Array:
    """Lower bounds (n, n, T + 1) on the mean squared error matrix at the start and at each step.

    ``J_{k+1} = (Q + F J_k^-1 F')^-1 + E[H' R^-1 H]`` for a linear motion with Gaussian noise (their
    eq. 21 with D11 = F' Q^-1 F; this form stands a singular Q). ``initial`` (n, n) is the bound before
    the first step, ``information`` yields E[H' R^-1 H] (n, n) of each step.
    """
    bounds = [initial]
    for gained in information:
        predicted = linalg.sandwich(F, bounds[-1]) + Q
        bounds.append(_inverse(_inverse(predicted) + gained))
    return np.stack(bounds, axis=-1)


def largest_deviation(cov: Array) -> float:
    """Return the largest standard deviation in any direction of a covariance (n, n); in 3D a bound."""
    if len(cov) != 2:
        return float(np.sqrt(np.diagonal(cov).sum()))
    half = 0.5 * (cov[0, 0] - cov[1, 1])
    spread = np.sqrt(half * half + cov[0, 1] * cov[0, 1])
    return float(np.sqrt(0.5 * (cov[0, 0] + cov[1, 1]) + spread))


def _inverse(P: Array) -> Array:
    """Invert through a unit diagonal, because meters and meters per second differ by many decades."""
    scale = 1.0 / np.sqrt(np.diagonal(P))
    both = np.outer(scale, scale)
    return both * linalg.inverse(both * P)
