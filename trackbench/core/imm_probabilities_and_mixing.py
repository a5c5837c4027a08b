"""Interacting multiple models: model and mixing probabilities, and the mixing of their states.

Blom & Bar-Shalom 1988. The components of the states may differ.
"""

from collections.abc import Sequence
from functools import cache
from typing import Literal, TypeAlias

import numpy as np

from trackbench.core import elementary
from trackbench.core.arrays import Array, Index, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.mixtures import combine
from trackbench.core.sums import total

Common: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]
"""Indices of the components that two states share, in the one and in the other."""


def predict_weights(weights: Array, transition: Array) -> tuple[Array, Array]:
    """Predict the model probabilities and compute the mixing probabilities.

    Parameters
    ----------
    weights : (r, M)
        Probabilities mu_i of the r models.
    transition : (r, r)
        Probabilities p_ij of a switch from model i to model j.

    Returns
    -------
    after : (r, M)
        Predicted probabilities, ``c_j = sum_i p_ij mu_i``.
    mixing : (r, r, M)
        ``mu_{i|j} = p_ij mu_i / c_j`` at [i, j]; the identity where c_j is zero.
    """
    joint = transition[:, :, None] * weights[:, None]
    after = total(joint, axis=0)
    # A model that cannot be reached continues from its own estimate.
    reachable = after > 0.0
    mixing = joint / np.where(reachable, after, 1.0)
    stay = np.eye(len(weights))[:, :, None]
    return after, np.where(reachable, mixing, stay)


def update_weights(
    predicted: Array, nis: Array, mantissa: Array | float = 1.0, exponent: Array | int = 0
) -> Array:
    """Update model probabilities by Gaussian likelihoods ``exp(-nis / 2) / sqrt(det S)``.

    Parameters
    ----------
    predicted, nis : (r, M)
        Predicted probabilities, and NIS, of each model.
    mantissa, exponent : (r, M)
        ``sqrt(det S) = mantissa 2^exponent`` of each model; default: 1 of all.

    Returns
    -------
    (r, M)
        Probabilities; the prediction for a run without any positive probability.
    """
    # Subtract the least NIS of the possible models, so that one likelihood does not underflow.
    is_possible = predicted > 0.0
    least = np.where(is_possible, nis, np.inf).min(axis=0)
    # Likewise divide by the least power of two, which changes no ratio.
    scale = np.ldexp(mantissa, exponent - np.min(exponent, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        # An impossible model may have a smaller NIS, and its density may be infinite: 0 times it is NaN.
        excess = np.where(is_possible, nis - least, 0.0)
        w = predicted / scale * elementary.exp(-0.5 * excess)
        return np.where(least == np.inf, predicted, w / total(w, axis=0))


def mix_states(
    states: Sequence[Gaussian],
    mixing_weights: Array,
    names: Sequence[tuple[str, ...]],
    angles: Sequence[tuple[int, ...]],
    mixing: Literal["unbiased", "zero", "zero-mean"],
) -> list[Gaussian]:
    """Return the mixed state that each model's filter starts from.

    It is ``m_0j = sum_i mu_i|j m_i``, ``P_0j = sum_i mu_i|j (P_i + (m_i - m_0j)(m_i - m_0j)')``.

    Parameters
    ----------
    states : sequence of Gaussian
        Posterior of each of the r models.
    mixing_weights : array (r, r, M)
        At [i, j] the weight mu_i|j of the state of model i for model j.
    names : sequence of tuples of str
        Components of each model's state.
    angles : sequence of tuples of int
        Components of each model's state that are angles: means are first shifted by whole turns to near
        each other.
    mixing : str
        Components of model j that model i lacks come from the state of model j if it is "unbiased", and
        are zero otherwise. If it is "zero-mean" they add no spread of the means either.
    """
    mixed = []
    for j, own_state in enumerate(states):
        # Fill each state up to the components of model j.
        filled = []
        for i, other_state in enumerate(states):
            common = common_components(names[i], names[j])
            filled.append(pad(other_state, own_state, common, mixing == "unbiased"))
        # Filled-in components of `without_spread` add no spread of the means.
        without_spread = _lacking_components(names, j) if mixing == "zero-mean" else []
        mixed.append(combine(filled, mixing_weights[:, j], without_spread, angles[j]))
    return mixed


def _lacking_components(names: Sequence[tuple[str, ...]], j: int) -> list[list[int]]:
    """List, for the state of each model, the indices of the components of model j that it lacks.

    ``names`` are the components of each model.
    """
    missing = []
    for state_names in names:
        missing.append([i for i, name in enumerate(names[j]) if name not in state_names])
    return missing


def pad(state: Gaussian, other: Gaussian, shared: Common, unbiased: bool) -> Gaussian:
    """Fill a state up to the components of another model's state, to mix with it.

    Components that only this state has are dropped.

    Parameters
    ----------
    state, other : Gaussian
        State of a model (n, M), and that of the other model (m, M).
    shared : tuple of tuples of int
        Indices of the shared components in ``state`` and in ``other``, from `common_components`.
    unbiased : bool
        Components that only the other model has come from its mean and covariance (Yuan, Bar-Shalom et
        al. 2012); else they are zero.

    Returns
    -------
    Gaussian
        Mean (m, M), covariance (m, m, M).
    """
    source, target = shared
    m = len(other.mean)
    runs = state.mean.shape[1]
    # The other model's components are the first ones of this state: nothing is filled up.
    if source == target == tuple(range(m)):
        if len(state.mean) == m:
            return state
        return Gaussian(state.mean[:m], state.cov[:m, :m])
    # Step 1: copy the shared components.
    mean = np.zeros((m, runs))
    cov = np.zeros((m, m, runs))
    mean[list(target)] = state.mean[list(source)]
    state_cov = with_trailing(state.cov, 1, leading=2)
    cov[_block(target)] = state_cov[_block(source)]
    # Step 2: fill the others from the other model.
    if unbiased:
        rest = tuple(i for i in range(m) if i not in target)
        mean[list(rest)] = other.mean[list(rest)]
        cov[_block(rest)] = with_trailing(other.cov, 1, leading=2)[_block(rest)]
    return Gaussian(mean, cov)


@cache
def _block(components: tuple[int, ...]) -> tuple[Index, ...]:
    """Return the index of these rows and columns of a covariance."""
    return np.ix_(components, components)


@cache
def common_components(names: tuple[str, ...], other_names: tuple[str, ...]) -> Common:
    """Find the components that two models share.

    Parameters
    ----------
    names, other_names : tuple of str
        Components of each model's state.

    Returns
    -------
    source, target : tuple of int
        Indices of the shared components in ``names``, and those in ``other_names``, in the order of
        the other model.
    """
    shared = [name for name in other_names if name in names]
    source = tuple(names.index(name) for name in shared)
    target = tuple(other_names.index(name) for name in shared)
    return source, target
