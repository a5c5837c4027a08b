"""Interacting multiple models: mixing, and the moments of a mixture (Blom & Bar-Shalom 1988)."""

from collections.abc import Sequence
from functools import cache
from typing import TypeAlias

import numpy as np

from trackbench.core import elementary, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.sums import total

Common: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]
"""Indices of the components that two states share, in the one and in the other."""


def predict_weights(weights: Array, transition: Array) -> tuple[Array, Array]:
    """Return model weights (r, M) one step on, and the mixing weights (r, r, M): [i, j] of i given j."""
    joint = transition[:, :, None] * weights[:, None]
    after = total(joint, axis=0)
    # A model that cannot be reached mixes nothing; its own estimate goes on.
    reachable = after > 0.0
    mixing = joint / np.where(reachable, after, 1.0)
    stay = np.eye(len(weights))[:, :, None]
    return after, np.where(reachable, mixing, stay)


def update_weights(predicted: Array, nis: Array, scale: Array) -> Array:
    """Return weights (r, M) after Gaussian likelihoods ``exp(-nis / 2) / scale`` (r, M).

    The prediction where all are zero.
    """
    least = np.where(predicted > 0.0, nis, np.inf).min(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        w = predicted / scale * elementary.exp(-0.5 * (nis - least))
        return np.where(least == np.inf, predicted, w / total(w, axis=0))


def log_mixture(weights: Array, log_densities: Array) -> Array:
    """Return the log (M,) of a mixture of densities with weights (r, M), from their logs (r, M)."""
    with np.errstate(divide="ignore"):
        terms = elementary.log(weights) + log_densities
    value = terms[0]
    for term in terms[1:]:
        value = elementary.logaddexp(value, term)
    return value


def combine(states: Sequence[Gaussian], weights: Array) -> Gaussian:
    """Return the mean (n, M) and covariance (n, n, M) of the mixture with weights (r, M)."""
    terms = list(zip(weights, states, strict=True))
    mean = np.asarray(sum(w * s.mean for w, s in terms))
    cov = np.zeros((len(mean), *mean.shape))
    for w, s in terms:
        e = s.mean - mean
        cov += w * (with_trailing(s.cov, 1, leading=2) + linalg.outer(e, e))
    return Gaussian(mean, cov)


def pad(state: Gaussian, like: Gaussian, shared: Common, unbiased: bool) -> Gaussian:
    """Return a state (n, M) as one of another model's components, to mix with it.

    What it does not have comes from the other's own mean and covariance (unbiased: Yuan, Bar-Shalom et
    al. 2012), or is zero, which draws it to zero; what the other does not have is left out.
    """
    here, there = shared
    m, runs = len(like.mean), state.mean.shape[1]
    if here == there == tuple(range(m)):
        return state if len(state.mean) == m else Gaussian(state.mean[:m], state.cov[:m, :m])
    mean, cov = np.zeros((m, runs)), np.zeros((m, m, runs))
    own = with_trailing(state.cov, 1, leading=2)
    mean[list(there)] = state.mean[list(here)]
    cov[np.ix_(there, there)] = own[np.ix_(here, here)]
    if unbiased:
        rest = [i for i in range(m) if i not in there]
        mean[rest] = like.mean[rest]
        cov[np.ix_(rest, rest)] = with_trailing(like.cov, 1, leading=2)[np.ix_(rest, rest)]
    return Gaussian(mean, cov)


@cache
def common_components(of: tuple[str, ...], like: tuple[str, ...]) -> Common:
    """Return the positions of the components that two models share."""
    names = [name for name in like if name in of]
    return tuple(of.index(name) for name in names), tuple(like.index(name) for name in names)
