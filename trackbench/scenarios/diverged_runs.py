"""Divergence: the truth lies outside the regions of the last estimates of a run."""

from collections.abc import Mapping

import numpy as np

from trackbench.core.arrays import Array

_IN_A_ROW = 10  # steps at the end of a run


def diverged(values: Mapping[str, Array], recorded: bool) -> Array:
    """Return 1 if the truth is outside the 1 - 1e-6 regions of a run's last ten estimates, else 0.

    A diverged track can be near the target and yet mislead, since its own covariance keeps it from
    coming back. The run stays in the averages, so that an overconfident filter gains nothing.

    Parameters
    ----------
    values : mapping of str to array (K, M)
        Series by name. ``outside_region`` is 1 where the truth is outside the region of the estimate, 0
        where it is inside, and NaN where there is no estimate or truth.
    recorded : bool
        True if the last ten flags other than NaN count, since recorded runs differ in length.

    Returns
    -------
    array (M,)
        1, 0, or NaN for a run with NaN among the flags that count. Without the series it is one NaN
        (1,), for all runs.
    """
    unknown = np.full((1, 1), np.nan)
    outside = values.get("outside_region", unknown)
    if recorded:
        # Move the flags that are not NaN to the end, in their order.
        order = np.argsort(~np.isnan(outside), axis=0, kind="stable")
        outside = np.take_along_axis(outside, order, axis=0)
    # The minimum of the last ten flags is 1 if all of them are 1, and NaN if any of them is NaN.
    return np.asarray(outside[-_IN_A_ROW:].min(axis=0))
