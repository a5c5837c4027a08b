"""Interacting multiple models: mixing, and the moments of a mixture (Blom & Bar-Shalom 1988)."""

from collections.abc import Sequence

import numpy as np

from trackbench.core import elementary, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.sums import total


def predicted_weights(weights: Array, transition: Array) -> tuple[Array, Array]:
    """Model weights (r, M) one step on, and the mixing weights (r, r, M): [i, j] of i given j."""
    joint = transition[:, :, None] * weights[:, None]
    after = total(joint, axis=0)
    # A model that cannot be reached mixes nothing; its own estimate goes on.
    reachable = after > 0.0
    mixing = joint / np.where(reachable, after, 1.0)
    stay = np.eye(len(weights))[:, :, None]
    return after, np.where(reachable, mixing, stay)


def updated_weights(predicted: Array, nis: Array, scale: Array) -> Array:
    """Weights (r, M) after Gaussian likelihoods ``exp(-nis / 2) / scale`` of the models, (r, M) each.

    The prediction where all are zero.
    """
    least = np.where(predicted > 0.0, nis, np.inf).min(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        w = predicted / scale * elementary.exp(-0.5 * (nis - least))
        return np.where(least == np.inf, predicted, w / total(w, axis=0))


def combined(states: Sequence[Gaussian], weights: Array) -> Gaussian:
    """Mean (n, M) and covariance (n, n, M) of the mixture with weights (r, M)."""
    terms = list(zip(weights, states, strict=True))
    mean = np.asarray(sum(w * s.mean for w, s in terms))
    cov = np.zeros((len(mean), *mean.shape))
    for w, s in terms:
        e = s.mean - mean
        cov += w * (with_trailing(s.cov, 1, leading=2) + linalg.outer(e, e))
    return Gaussian(mean, cov)


def padded(state: Gaussian, like: Gaussian, unbiased: bool) -> Gaussian:
    """A state (n, M) with the further components of a longer one, to mix with it.

    Unbiased: with the longer state's own mean and covariance (Yuan, Bar-Shalom et al. 2012); else with
    zeros, which draws them to zero. The result is no longer than ``like``, whose tail is cut.
    """
    n, m = len(state.mean), len(like.mean)
    if n >= m:
        return Gaussian(state.mean[:m], state.cov[:m, :m])
    runs = state.mean.shape[1]
    mean, cov = np.zeros((m, runs)), np.zeros((m, m, runs))
    mean[:n], cov[:n, :n] = state.mean, with_trailing(state.cov, 1, leading=2)
    if unbiased:
        mean[n:], cov[n:, n:] = like.mean[n:], with_trailing(like.cov, 1, leading=2)[n:, n:]
    return Gaussian(mean, cov)
