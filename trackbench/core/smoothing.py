"""Smoothing of a sequence of posteriors backwards in time.

The recursion of Gaussians is that of Rauch, Tung & Striebel 1965, in the form for any Gaussian filter
(Sarkka & Svensson 2023, chapters 12 and 13): it needs the posterior of each step, the prediction from
it, and the covariance between the two.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian

S = TypeVar("S")


@dataclass(frozen=True)
class Transition:
    """Prediction from a posterior N(m, P): the moments of x_{k+1}, and C = cov(x_k, x_{k+1})."""

    predicted: Gaussian
    cross: Array

    @cached_property
    def gain(self) -> Array:
        """Regression of x_k on x_{k+1}, ``G = C P_pred^-1`` (n, n, M)."""
        C = linalg.transpose(self.cross)
        return linalg.transpose(linalg.solve_singular(self.predicted.cov, C))


def backwards(
    filtered: Sequence[S], one_back: Callable[[int, S], S], lag: int | None = None
) -> list[S]:
    """Smooth the ``filtered`` state of every step, from all measurements or from ``lag`` later ones.

    ``one_back(k, later)`` returns state k given the measurements that ``later``, of step k + 1, uses.
    """
    last = len(filtered) - 1
    if lag is None:
        # All measurements: one pass from the last step back to the first.
        smoothed_states = [filtered[last]]
        for k in reversed(range(last)):
            smoothed_states.append(one_back(k, smoothed_states[-1]))
        return smoothed_states[::-1]
    smoothed_states = []
    # Fixed lag: go back from step k + lag for each step k.
    for k in range(last + 1):
        end = min(k + lag, last)
        smoothed = filtered[end]
        for j in reversed(range(k, end)):
            smoothed = one_back(j, smoothed)
        smoothed_states.append(smoothed)
    return smoothed_states


def smooth_step(posterior: Gaussian, transition: Transition, later: Gaussian) -> Gaussian:
    """Smooth x_k (Rauch-Tung-Striebel) from ``later``, the smoothed x_{k+1}.

    ``posterior`` is that of x_k by the measurements up to step k, ``transition`` the prediction from it.
    """
    predicted = transition.predicted
    G = transition.gain
    # m + G (m_later - m_pred), P + G (P_later - P_pred) G'
    mean = posterior.mean + linalg.matvec(G, later.mean - predicted.mean)
    cov = posterior.cov + linalg.sandwich(G, later.cov - predicted.cov)
    return Gaussian(mean, cov)


def smooth(
    posteriors: Sequence[Gaussian], transitions: Sequence[Transition], lag: int | None = None
) -> list[Gaussian]:
    """Smooth the distribution of the state at each step by later measurements.

    Parameters
    ----------
    posteriors : sequence of Gaussian
        Posterior of every step given the measurements up to it: mean (n, M), covariance (n, n[, M]).
    transitions : sequence of Transition
        Prediction from each posterior but the last.
    lag : int, optional
        Number of later measurements that an estimate may use; default: all.

    Returns
    -------
    list of Gaussian
        Smoothed distribution of every step.
    """
    return backwards(posteriors, lambda k, x: smooth_step(posteriors[k], transitions[k], x), lag)
