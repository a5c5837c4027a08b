"""Likelihood ratio: likelihood of the measurements so far by a filter over that by the reference."""

from collections.abc import Mapping

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import exp

_SCORE = "log_likelihood"


def likelihood_ratio(scores: Mapping[str, Array], exact: Mapping[str, Array]) -> dict[str, Array]:
    """Return the ratio of the likelihoods of all measurements so far: filter to reference.

    A particle filter's estimate of the likelihood is unbiased, so that the mean of the ratio is one (Del
    Moral 2004, section 7.4.2). Filters that weigh or move particles in another way than by importance
    sampling and resampling are biased.

    Parameters
    ----------
    scores, exact
        predictive series (T + 1, M) of the filter and of the reference, by name

    Returns
    -------
    dict
        ``likelihood_ratio`` (T + 1, M), NaN at the first state, and from a step on at which only one of
        both has a likelihood. Empty unless both have the series ``log_likelihood``
    """
    if _SCORE not in scores or _SCORE not in exact:
        return {}
    log_p = scores[_SCORE]
    log_p_exact = exact[_SCORE]
    # prod p(z_k) / p_exact(z_k); a step at which neither has a likelihood counts as 1.
    neither = np.isnan(log_p) & np.isnan(log_p_exact)
    log_ratio = np.add.accumulate(np.where(neither, 0.0, log_p - log_p_exact), axis=0)
    ratio = exp(log_ratio)
    ratio[0] = np.nan  # the first state has no measurement
    return {"likelihood_ratio": ratio}
