"""Smoother of interacting multiple models: predictions given later measurements."""

from collections.abc import Sequence

import numpy as np

from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.mixtures import combine

_ROUNDING = 1e-9  # of a covariance


def given_later(
    predicted: Sequence[Gaussian], mixing: Array, later: Gaussian, angles: Sequence[int] = ()
) -> tuple[list[Gaussian], Array]:
    """Condition each of r predictions on later measurements (Heskes & Zoeter 2002).

    Their likelihood is ``later(x) / mixed(x)``, by the smoothed and the predicted mixture of all r. It
    is taken as 1 in a run where it would widen a prediction.

    Parameters
    ----------
    predicted : sequence of Gaussian
        r predictions, means (n, M), covariances (n, n, M).
    mixing : array (r, M)
        Their weights in the predicted mixture.
    later : Gaussian
        Moments of the same step given all measurements, also later ones.
    angles : sequence of int
        Components that are angles.

    Returns
    -------
    conditioned : list of Gaussian
        The r predictions given the later measurements.
    log_c : array (r, M)
        Logarithm of the likelihood of the later measurements under each prediction.
    """
    mixed = combine(predicted, mixing, angles=angles)
    # A component without any variance would make the inverses below infinite. It gets unit variance in
    # every term, which cancels in the results.
    added = np.eye(len(mixed.mean))[..., None] * (linalg.diagonal(mixed.cov) == 0.0)
    mixed_cov = mixed.cov + added
    later_cov = later.cov + added
    mixed_precision = linalg.inverse(mixed_cov)
    later_precision = linalg.inverse(later_cov)
    mixed_mean = mixed.mean
    later_mean = later.mean
    conditioned = []
    log_ratios = []
    is_proper = np.ones(later.mean.shape[1], dtype=np.bool_)
    for prediction in predicted:
        p = Gaussian(prediction.mean, prediction.cov + added)
        # Step 1: P = (P_i^-1 + P_later^-1 - P_mixed^-1)^-1,
        # m = m_i + P (P_later^-1 (m_later - m_i) - P_mixed^-1 (m_mixed - m_i)).
        P = linalg.inverse(linalg.inverse(p.cov) + later_precision - mixed_precision)
        later_mean = near(later_mean, p.mean, angles)
        mixed_mean = near(mixed_mean, p.mean, angles)
        by_later = linalg.matvec(later_precision, later_mean - p.mean)
        by_mixed = linalg.matvec(mixed_precision, mixed_mean - p.mean)
        given = Gaussian(p.mean + linalg.matvec(P, by_later - by_mixed), P)
        # Step 2: c_i = N_i(x) later(x) / (mixed(x) given_i(x)) at any x.
        x = p.mean
        above = p.log_prob(x) + Gaussian(later_mean, later_cov).log_prob(x)
        below = Gaussian(mixed_mean, mixed_cov).log_prob(x) + given.log_prob(x)
        # A likelihood narrows: a wider P is none of a proper likelihood.
        is_narrower = linalg.diagonal(P) <= (1.0 + _ROUNDING) * linalg.diagonal(p.cov)
        is_proper &= is_narrower.all(axis=0) & np.isfinite(above - below)
        conditioned.append(given)
        log_ratios.append(above - below)
    # Step 3: keep the predictions of the runs in which one of them would become wider.
    results = []
    for given, prediction in zip(conditioned, predicted, strict=True):
        mean = np.where(is_proper, given.mean, prediction.mean)
        cov = np.where(is_proper, given.cov - added, prediction.cov)
        results.append(Gaussian(mean, cov))
    return results, np.where(is_proper, np.stack(log_ratios), 0.0)
