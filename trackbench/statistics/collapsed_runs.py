"""Runs whose covariance has collapsed or is none: their limit, their number, and notes below tables.

A covariance is too small, or has no spread (all particles at one point), or is not positive definite.
"""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.statistics.indefinite_covariances import NOT_DEFINITE, indefinite_runs

_COLLAPSED_ANEES = 1e4
COLLAPSED_NOTE = (
    f"A collapsed run has a mean squared error of more than {_COLLAPSED_ANEES:g} times what its "
    "covariance says. One alone decides the mean, so their number is shown."
)


def collapsed_runs(anees: Array) -> int:
    """Count the collapsed runs by each run's ANEES or ANIS (M,)."""
    return int(np.sum(anees[~np.isnan(anees)] > _COLLAPSED_ANEES))


def collapsed_runs_decide(metric: str, statistic: str) -> bool:
    """Test whether a few collapsed runs decide a ``statistic`` over the runs of a ``metric``.

    They decide a NEES or NIS over the runs: its mean, and likewise its rms and variance. They do not
    decide its median.
    """
    return metric in ("nees", "anees", "nis", "anis") and statistic != "median"


def collapsed_in_words(anees: Array, first_indefinite: Array | None = None) -> str:
    """Return ``collapsed in 3 of 40 runs``, or ``not positive definite in 2 of 40 runs``.

    Parameters
    ----------
    anees
        ANEES or ANIS (M,) of each run, NaN where it has none
    first_indefinite
        step (M,) from which on a run's covariance is not positive definite, NaN in other runs; None if
        there is no such run

    Returns
    -------
    str
        words on indefinite covariances, or without any on collapsed runs. Empty if no run collapsed, or
        if there is only one run, whose ANEES itself shows the collapse
    """
    indefinite = indefinite_runs(anees, first_indefinite)
    if indefinite.any():
        number = int(np.sum(~np.isnan(anees)))
        return f"{NOT_DEFINITE} in {int(indefinite.sum())} of {counted(number, 'run')}"
    runs = anees[~np.isnan(anees)]
    collapsed = collapsed_runs(runs)
    if not collapsed or len(runs) == 1:
        return ""
    return f"collapsed in {collapsed} of {len(runs)} runs"
