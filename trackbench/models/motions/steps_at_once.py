"""Linear motions of many steps at once: F and Q of each step."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.models.base import SampledMotion
from trackbench.models.motions.kinematic import PerAxis
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.unequal_intervals import Irregular


class MotionMatrices(NamedTuple):
    """Matrices of a linear motion over T steps; those of steps of equal length are stored once."""

    F: Array
    """the K different transition matrices (K, n, n)"""
    Q: Array
    """the K covariances (K, n, n) of the process noise"""
    numbers: Index
    """which of the K each step has (T,)"""

    @property
    def size(self) -> int:
        """Number n of components of a state."""
        return self.F.shape[-1]

    def arguments(self) -> tuple[Array, Array, Index]:
        """Return F and Q (K, n, n) and which of the K each step has (T,), as the C kernels take them."""
        F = np.ascontiguousarray(self.F, dtype=np.float64)
        Q = np.ascontiguousarray(self.Q, dtype=np.float64)
        return F, Q, np.ascontiguousarray(self.numbers, dtype=np.int64)

    def of_each_step(self) -> tuple[Array, Array]:
        """Return F and Q (n, n, T, 1) of each step, or (n, n) if all steps have the same.

        The last axis of length one is that of the runs, which share the matrices.
        """
        if len(self.F) == 1:
            return self.F[0], self.Q[0]
        F = np.ascontiguousarray(np.moveaxis(self.F[self.numbers], 0, -1))
        Q = np.ascontiguousarray(np.moveaxis(self.Q[self.numbers], 0, -1))
        return F[..., None], Q[..., None]


def matrices_of_steps(motion: SampledMotion, k: int, steps: int) -> MotionMatrices | None:
    """Return the matrices F and Q of several steps of a linear motion.

    Intervals of equal length share their matrices: `numbers` has the index of each step's F and Q.

    Parameters
    ----------
    motion : SampledMotion
        Motion of n components.
    k : int
        Number of the first step.
    steps : int
        Number T of steps.

    Returns
    -------
    MotionMatrices or None
        K different matrices F and Q (K, n, n), and which of them each step has (T,). None if the motion
        is not linear. None also for a `SideBySide`, which already moves several steps in one call.
    """
    if isinstance(motion, Linear):
        # Equal intervals: all steps have the only F and Q.
        numbers = np.zeros(steps, dtype=np.int64)
        return MotionMatrices(F=motion.F[None], Q=motion.Q[None], numbers=numbers)
    # `type` leaves out the subclass `SideBySide`.
    if type(motion) is not Irregular or not isinstance(motion.motion_at(k), Linear):
        return None
    # Sample the motion once for each different length of an interval.
    first = k - motion.first
    intervals = motion.intervals[first : first + steps]
    lengths, first_of_each, numbers = np.unique(intervals, return_index=True, return_inverse=True)
    if isinstance(motion.motion, PerAxis):
        F, Q = motion.motion.matrices(lengths, motion.axes)
        return MotionMatrices(F=F, Q=Q, numbers=numbers)
    sampled = [motion.motion_at(k + i) for i in first_of_each.tolist()]
    return MotionMatrices(
        F=np.stack([at_step.F for at_step in sampled]),  # type: ignore[attr-defined]
        Q=np.stack([at_step.Q for at_step in sampled]),  # type: ignore[attr-defined]
        numbers=numbers,
    )
