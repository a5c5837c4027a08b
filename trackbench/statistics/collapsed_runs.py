"""Collapsed runs: their limit, their number, and the note below a table that counts them."""

import numpy as np

from trackbench.core.arrays import Array

_COLLAPSED_ANEES = 1e4
COLLAPSED_NOTE = (
    f"A collapsed run has a mean squared error of more than {_COLLAPSED_ANEES:g} times what its "
    "covariance says. One alone decides the mean, so their number is shown."
)


def collapsed_runs(anees: Array) -> int:
    """Count the collapsed runs by each run's ANEES or ANIS (M,)."""
    return int(np.sum(anees[~np.isnan(anees)] > _COLLAPSED_ANEES))


def collapsed_in_words(anees: Array) -> str:
    """Return ``collapsed in 3 of 40 runs`` from each run's ANEES or ANIS (M,).

    Empty if no run collapsed, or if there is only one run, whose ANEES itself shows the collapse.
    """
    runs = anees[~np.isnan(anees)]
    collapsed = collapsed_runs(runs)
    if not collapsed or len(runs) == 1:
        return ""
    return f"collapsed in {collapsed} of {len(runs)} runs"
