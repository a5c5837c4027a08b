"""Divergence: the truth lies outside the regions of the last estimates of a run."""

from collections.abc import Mapping

import numpy as np

from trackbench.core.arrays import Array

_IN_A_ROW = 10  # steps at the end of a run


def diverged(values: Mapping[str, Array], recorded: bool) -> Array:
    """Return 1 if the truth is outside the 1 - 1e-6 regions of a run's last ten estimates, else 0 (M,).

    It is NaN if ``values`` have no series ``outside_region``. A diverged track can be near the target
    and yet mislead, since its own covariance keeps it from coming back. The run stays in the averages,
    so that an overconfident filter gains nothing. With ``recorded`` each run's last existing estimates
    count, since recorded runs differ in length.
    """
    unknown = np.full((1, 1), np.nan)
    outside = values.get("outside_region", unknown)
    if recorded:
        # Move the estimates that exist to the end, in their order.
        order = np.argsort(~np.isnan(outside), axis=0, kind="stable")
        outside = np.take_along_axis(outside, order, axis=0)
    # The minimum of the last ten flags is 1 if all of them are outside.
    return np.asarray(outside[-_IN_A_ROW:].min(axis=0))
