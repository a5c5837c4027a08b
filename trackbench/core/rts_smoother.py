"""Rauch-Tung-Striebel smoother of Gaussians (1965), in the form for any Gaussian filter.

It needs the posterior of each step, the prediction from it, and the covariance between the two (Sarkka &
Svensson 2023, chapters 12 and 13).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.fixed_lag_smoothing import backwards


@dataclass(frozen=True)
class Transition:
    """Prediction from a posterior N(m, P): the moments of x_{k+1}, and C = cov(x_k, x_{k+1}).

    ``predicted`` has mean (n, M) and covariance (n, n, M), and ``cross`` is C (n, n, M).
    """

    predicted: Gaussian
    cross: Array

    @cached_property
    def gain(self) -> Array:
        """Regression of x_k on x_{k+1}, ``G = C P_pred^-1`` (n, n, M)."""
        C = linalg.transpose(self.cross)
        return linalg.transpose(linalg.solve_singular(self.predicted.cov, C))


def smooth_step(posterior: Gaussian, transition: Transition, later: Gaussian) -> Gaussian:
    """Smooth x_k (Rauch-Tung-Striebel) from the smoothed x_{k+1}.

    Parameters
    ----------
    posterior : Gaussian
        Distribution of x_k by the measurements up to step k: mean (n, M), covariance (n, n, M).
    transition : Transition
        Prediction from it.
    later : Gaussian
        Smoothed distribution of x_{k+1}.

    Returns
    -------
    Gaussian
        Smoothed distribution of x_k: mean (n, M), covariance (n, n, M).
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
        Posterior of every step given the measurements up to it: mean (n, M), covariance (n, n, M). The
        covariances may be (n, n) if those of all posteriors and transitions are.
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
