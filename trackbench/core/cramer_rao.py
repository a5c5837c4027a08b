"""The posterior Cramer-Rao bound (Tichavsky, Muravchik & Nehorai 1998)."""

from collections.abc import Iterable

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, with_axes_of


def posterior_cramer_rao(initial: Array, F: Array, Q: Array, information: Iterable[Array]) -> Array:
    """Bound the mean squared error matrix of a linear motion with Gaussian noise from below.

    ``J_{k+1} = (Q + F J_k^-1 F')^-1 + E[H' R^-1 H]``, eq. 21 of Tichavsky et al. 1998 with
    D11 = F' Q^-1 F in a form that also accepts a singular Q.

    Parameters
    ----------
    initial : (n, n[, B])
        Bound before the first step, J_0^-1; of B problems side by side.
    F, Q : (n, n)
        Transition matrix and noise covariance.
    information : iterable of (n, n[, B])
        E[H' R^-1 H] of each of the T steps, over the states of that step.

    Returns
    -------
    (n, n[, B], T + 1)
        Bounds J_k^-1, the initial one first.
    """
    bounds = [initial]
    for gained in information:
        predicted = linalg.sandwich(F, bounds[-1])
        predicted = predicted + with_axes_of(predicted, Q)
        bounds.append(_inverse(_inverse(predicted) + gained))
    return np.stack(bounds, axis=-1)


def _inverse(P: Array) -> Array:
    """Invert through a unit diagonal, because meters and meters per second differ by many decades."""
    scale = 1.0 / np.sqrt(linalg.diagonal(P))
    both = linalg.outer(scale, scale)
    return both * linalg.inverse(both * P)
