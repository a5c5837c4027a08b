"""Model probabilities of interacting multiple models: prediction, mixing probabilities, update.

Blom & Bar-Shalom 1988.
"""

import numpy as np

from trackbench.core import elementary
from trackbench.core.arrays import Array
from trackbench.core.sums import total


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
