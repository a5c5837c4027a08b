"""Is it rounding? What another processor or library does to a number, told from a change.

A filter that draws nothing passes the last bit on, made larger by the condition of its matrices: between
two kinds of processor 1e-5 was measured at most. A filter that draws may amplify it until a run has
nothing of the other any more. Then each run's stored value and the one computed again are as good as
exchanged at random, so their difference is symmetric about zero, which is tested on the common runs.
"""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.intervals import p_value
from trackbench.evaluation.statistics import mean, z_score

ROUNDING = 1e-4
"""Share of a value, or of what is usual in its column, that rounding may move it by."""
FALSE_ALARM = 1e-3
"""Probability that any of a folder's filters and metrics is taken for changed by chance."""


@np.errstate(all="ignore")
def relative(a: Array, b: Array, scale: Array | float = 0.0) -> Array:
    """Differences as shares of the larger value (n,) or of the scale; infinite beside no number."""
    share = np.abs(a - b) / np.maximum(np.maximum(np.abs(a), np.abs(b)), scale)
    return np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.nan_to_num(share, nan=np.inf))


def usual(x: Array) -> float:
    """The median size of the numbers in a column; zero if there are none."""
    there = np.abs(x[np.isfinite(x)])
    return float(np.median(there)) if len(there) else 0.0


@np.errstate(all="ignore")
def differences(a: Array, b: Array) -> Array:
    """``a - b`` of the runs (M,) that have both; what is rounding is no difference."""
    both = np.isfinite(a) & np.isfinite(b)
    real = relative(a, b, usual(a)) > ROUNDING
    return np.where(real, a - b, 0.0)[both]


def p_of_chance(difference: Array) -> float:
    """How likely differences (M,) are, if each might as well have had the other sign.

    The smaller p of two tests, doubled: Student's t, which heavy tails make careful and blind, and the
    sign test, which they leave alone.
    """
    from scipy.special import bdtr

    up, down = int((difference > 0).sum()), int((difference < 0).sum())
    if up + down == 0:
        return 1.0
    p_t = p_value(z_score(mean(difference)), len(difference))
    p_sign = 2.0 * float(bdtr(min(up, down), up + down, 0.5))
    return min(1.0, 2.0 * float(np.nanmin([p_t, p_sign])))
