"""Covariances that are not positive definite: the runs with one, and the note below tables."""

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.errors import counted

NOT_DEFINITE = "not positive definite"
INDEFINITE_NOTE = (
    f"A covariance that is {NOT_DEFINITE} has a direction of negative variance, and no ANEES. Usual "
    "causes are float32 and the update P - K H P: make P symmetric after each step, use the Joseph form "
    "(I - K H) P (I - K H)' + K R K' or a square root of P, or compute in double precision. Against "
    "large coordinates, where float32 has a spacing of 0.25 m at 2700 km, only double precision or a "
    "nearer origin helps."
)
"""Note below a table that counts such runs."""


def indefinite_runs(anees: Array, first_indefinite: Array | None) -> Mask:
    """Mark the runs (M,) whose covariance is not positive definite at some step.

    ``anees`` (M,) is each run's ANEES, which is infinite in such a run, and ``first_indefinite`` (M,)
    the step from which on it is so, NaN in other runs; None if there is no such run.
    """
    if first_indefinite is None:
        return np.zeros(len(anees), dtype=np.bool_)
    return np.isinf(anees) & np.isfinite(first_indefinite)


def indefinite_in_words(number: int, *, runs: int, lost: int, first_step: float) -> str:
    """Return ``in 4 of 8 runs, first at step 63``, where a covariance is not positive definite.

    ``number`` is that of these runs, and ``first_step`` the earliest such step of any of them.
    Covariances of the ``lost`` ones of all ``runs`` are not judged.
    """
    judged = counted(runs - lost, "run")
    if lost:
        judged += " that it did not lose"
    return f"in {number} of {judged}, first at step {first_step:.0f}"
