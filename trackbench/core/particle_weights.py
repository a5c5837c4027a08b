"""Weights of particles: arithmetic of the likelihood, normalization of log-weights, sum before it.

Log-weights are (M, N): N particles in each of M runs.
"""

from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core import compiled, elementary, elementary_tables
from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import total

WeightReading = Literal["log", "naive", "floor"]
_LOG_SMALLEST = -744.4400719213812  # log of 5e-324: below it exp() is zero in float64
_LOG_FLOOR = -227.95592420641054  # log of 1e-99
CLIP = -700.0  # exp() of less underflows, at six times the cost
_SHORT = 64  # particles in a row; below it a transposed copy is worth its cost


class Mass(NamedTuple):
    """Sum of unnormalized weights, ``exp(top) * scale`` (M,), with its logarithm."""

    top: Array
    scale: Array

    @property
    def log(self) -> Array:
        """Logarithm of the sum (M,), -inf of a run with weight collapse."""
        return self.top + elementary.log(self.scale)


class Weights(NamedTuple):
    """Normalized weights w (M, N), the runs (M,) whose weights were all zero, and the sum before."""

    w: Array
    collapsed: Mask
    mass: Mass


class Evidence(NamedTuple):
    """Estimate of a measurement's likelihood from a particle set's unnormalized weights.

    ``carried`` (M, N) are the N particles' log-weights before the update, up to a constant; 0.0 stands
    for equal ones. ``scale`` (M,) is a divisor that the new weights omit.
    """

    mass: Mass
    carried: Array | float
    N: int
    scale: Array | float = 1.0

    @property
    def log(self) -> Array:
        """Log of the estimated likelihood (M,) (Doucet & Johansen 2009, section 4.1).

        The likelihood is the sum of the weights after the update over that before, divided by ``scale``.
        ``mass`` is the sum after the update. ``scale`` is 1, unless a filter leaves a factor 1 / scale
        of the likelihoods, which all particles have in common, out of its weights.
        """
        if isinstance(self.carried, float):
            # 0.0 stands for N equal log-weights of zero, whose weights have the sum N.
            log_sum_before = elementary.log(float(self.N))
        else:
            # Log of the sum of the carried weights.
            log_sum_before = normalize(self.carried).mass.log
        return np.asarray(self.mass.log - log_sum_before - elementary.log(self.scale))


@cache
def equal_weights(runs: int, N: int) -> Array:
    """Return equal weights, as a read-only view of one number.

    Parameters
    ----------
    runs : int
        Number M of runs.
    N : int
        Number of particles in each run.

    Returns
    -------
    array (M, N)
        Weights 1 / N.
    """
    return np.broadcast_to(np.float64(1.0 / N), (runs, N))


def read_likelihood(log_likelihood: Array, reading: WeightReading) -> Array:
    """Read a log-likelihood as a program with another arithmetic computes it, by the ``reading``.

    Parameters
    ----------
    log_likelihood : array (M, N)
        Log-likelihood of each particle.
    reading : {"log", "naive", "floor"}
        Arithmetic. ``log``: unchanged. ``naive``: exp() in float64, zero below 5e-324. ``floor``:
        likelihood + 1e-99, the guard of van der Merwe's public demo. The last two exist to reproduce
        published numbers.

    Returns
    -------
    array (M, N)
        Log of the likelihood that such a program computes.
    """
    if reading == "naive":
        return np.where(log_likelihood < _LOG_SMALLEST, -np.inf, log_likelihood)
    if reading == "floor":
        return elementary.logaddexp(log_likelihood, _LOG_FLOOR)
    return log_likelihood


def normalize(log_w: Array) -> Weights:
    """Normalize log-weights to weights.

    A run whose log-weights are all -inf gets equal weights and is marked as collapsed. A run with a NaN
    or +inf among them becomes NaN as a whole, which marks it as diverged.

    Parameters
    ----------
    log_w : array (M, N)
        Log-weights, up to a constant of each run.

    Returns
    -------
    Weights
        Weights w (M, N), runs (M,) with weight collapse, and sum (M,) of exp(log_w), as a `Mass`.
    """
    if compiled.kernels:
        log_w = np.ascontiguousarray(log_w, dtype=np.float64)
        w = np.empty(log_w.shape)
        runs, N = log_w.shape
        top = np.empty(runs)
        scale = np.empty(runs)
        collapsed = np.empty(runs, dtype=np.bool_)
        powers = elementary_tables.powers_of_two()
        compiled.kernels.normalize(powers, _constants(), log_w, w, top, scale, collapsed, N)
        return Weights(w, collapsed, Mass(top, scale))
    log_w = np.asarray(log_w, dtype=np.float64)
    # Step 1: find each run's largest log-weight, and the runs without any weight.
    top = shift = _row_maxima(log_w)
    collapsed = top == -np.inf
    if collapsed.any():
        log_w = np.where(collapsed[:, None], 0.0, log_w)
        shift = np.where(collapsed, 0.0, top)
    # Step 2: exp(log w - max), clipped where exp underflows.
    shifted = log_w - shift[:, None]
    np.maximum(shifted, CLIP, out=shifted)
    w = elementary.exp_of_moderate(shifted)
    w -= _clipped()  # zero where the exponent was clipped; lost in rounding everywhere else
    # Step 3: divide by the sum.
    scale = total(w)
    w *= 1.0 / scale[:, None]
    return Weights(w, collapsed, Mass(top, scale))


@cache
def _clipped() -> float:
    """Return the weight of a clipped exponent, computed at the first call."""
    return float(elementary.exp(CLIP))


@cache
def _constants() -> Array:
    """Return the constants of exp, the clip and its weight for the C kernel."""
    return np.array([*elementary_tables.exp_constants(), CLIP, _clipped()])


def _row_maxima(a: Array) -> Array:
    """Find the largest entry of each row (M,), six times as fast as numpy for short rows."""
    if a.shape[-1] < _SHORT:
        return np.asarray(np.ascontiguousarray(a.T).max(axis=0))
    return np.asarray(a.max(axis=-1))
