"""Smoothing of a sequence of Gaussian posteriors backwards in time.

The recursion is that of Rauch, Tung & Striebel 1965, in the form for any Gaussian filter (Sarkka &
Svensson 2023, chapters 12 and 13): it needs the posterior of each step, the prediction from it, and the
covariance between the two.
"""

from collections.abc import Sequence
from typing import NamedTuple

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian


class Transition(NamedTuple):
    """Prediction from a posterior N(m, P): the moments of x_{k+1}, and C = cov(x_k, x_{k+1})."""

    predicted: Gaussian
    cross: Array


def smooth(
    posteriors: Sequence[Gaussian], transitions: Sequence[Transition], lag: int | None = None
) -> list[Gaussian]:
    """Return the distribution of the state at each step given also later measurements.

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
    # G = C P_pred^-1
    gains = [
        linalg.transpose(linalg.solve_singular(t.predicted.cov, linalg.transpose(t.cross)))
        for t in transitions
    ]

    def one_back(k: int, later: Gaussian) -> Gaussian:
        """Return x_k given what ``later``, the distribution of x_{k+1}, is given."""
        predicted, G = transitions[k].predicted, gains[k]
        # m + G (m_later - m_pred), P + G (P_later - P_pred) G'
        mean = posteriors[k].mean + linalg.matvec(G, later.mean - predicted.mean)
        cov = posteriors[k].cov + linalg.sandwich(G, later.cov - predicted.cov)
        return Gaussian(mean, cov)

    last = len(posteriors) - 1
    if lag is None:
        # All measurements: one pass from the last step back to the first.
        backwards = [posteriors[last]]
        for k in reversed(range(last)):
            backwards.append(one_back(k, backwards[-1]))
        return backwards[::-1]
    out = []
    # Fixed lag: go back from step k + lag for each step k.
    for k in range(last + 1):
        end = min(k + lag, last)
        smoothed = posteriors[end]
        for j in reversed(range(k, end)):
            smoothed = one_back(j, smoothed)
        out.append(smoothed)
    return out
