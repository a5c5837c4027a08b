"""Motions over intervals that differ from step to step, as in recorded data.

`Irregular` moves the states of one step, `SideBySide` those of several steps at once.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.models.base import Motion, SampledMotion, angle_rows, extra_std
from trackbench.models.inputs import KnownInputs, inputs_in_equations
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.nonlinear import SteppedMotion


@dataclass(frozen=True, eq=False)
class Irregular:
    """Motion whose step k covers the interval ``intervals[k - first]``, s.

    It has a Jacobian if the motion has one. There is no T and no F, since they differ by step.
    """

    motion: Motion
    axes: int
    """number of axes of the space"""
    first: int
    """number of the step that the first interval ends with"""
    intervals: Array
    """lengths (K,) of the intervals, s"""
    named_angles: tuple[int, ...] = ()
    """rows of all angles, where the motion itself does not name each of them"""
    recorded_inputs: KnownInputs | None = None
    """inputs of the recording, if it has any"""

    def motion_at(self, k: int) -> SampledMotion:
        """Return the motion from step k - 1 to step k."""
        sampled = self.motion.sampled(float(self.intervals[k - self.first]), self.axes)
        return motion_with_inputs(sampled, self.known_inputs)

    @cached_property
    def known_inputs(self) -> KnownInputs | None:
        """Inputs in the motion's equations, as `inputs.inputs_of`; raises InvalidKeyError."""
        return inputs_in_equations(self.motion, self.recorded_inputs)

    def transition(self, x: Array, k: int) -> Distribution:
        """Return the distribution of x_k given x_{k-1} = x (n_x, *batch)."""
        return self.motion_at(k).transition(x, k)

    @property
    def jacobian(self) -> Callable[[Array, int], Array]:
        """Return d E[x_k] / d x_{k-1} as a function of x and k.

        It raises AttributeError if the motion has no Jacobian, so that `hasattr` gives False.
        """
        self._first_motion.jacobian  # type: ignore[attr-defined]  # noqa: B018
        return self._jacobian_at

    @property
    def linear(self) -> bool:
        """Return True for a linear motion.

        It raises AttributeError for any other motion, so that `hasattr` gives False.
        """
        # A motion without F may still be linear, with matrices that depend on the step.
        if not hasattr(self._first_motion, "F"):
            self._first_motion.linear  # type: ignore[attr-defined]  # noqa: B018
        return True

    @property
    def Q(self) -> Array:
        """Noise covariance (n, n) of the first interval, which is singular if all are."""
        return self._first_motion.Q  # type: ignore[attr-defined]

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the state's components, in order."""
        return self._first_motion.components

    @property
    def extra_std(self) -> tuple[float, ...]:
        """Initial standard deviations of further components, as `base.extra_std`."""
        return extra_std(self._first_motion)

    @property
    def rows_of_angles(self) -> tuple[int, ...]:
        """Rows of the state that are angles, as `base.angle_rows`."""
        return self.named_angles or angle_rows(self._first_motion)

    @cached_property
    def _first_motion(self) -> SampledMotion:
        """Motion over the first interval."""
        return self.motion_at(self.first)

    def _jacobian_at(self, x: Array, k: int) -> Array:
        """Return d E[x_k] / d x_{k-1} (n, n[, *batch]) at x (n, *batch)."""
        return self.motion_at(k).jacobian(x, k)  # type: ignore[attr-defined]


def motion_with_inputs(sampled: SampledMotion, known: KnownInputs | None) -> SampledMotion:
    """Return a sampled motion with the values of the inputs in its equations, if it has any.

    Parameters
    ----------
    sampled : SampledMotion
        Motion over one interval.
    known : KnownInputs or None
        Values of its inputs, in the order of its key ``input``. None if it has no inputs.

    Returns
    -------
    SampledMotion
        Motion with the values. It is ``sampled`` itself if ``known`` is None.
    """
    if known is None:
        return sampled
    # Only motions of equations in the config have inputs, and they are sampled to this class.
    assert isinstance(sampled, SteppedMotion)
    return sampled.with_inputs(known)


@dataclass(frozen=True, eq=False)
class SideBySide(Irregular):
    """A linear motion of several steps at once: the batch (K M,) is the M runs of each step in turn."""

    steps: tuple[int, ...] = ()
    """numbers of the K steps"""
    runs: int = 1
    """number M of runs"""

    def motion_at(self, k: int) -> Linear:
        """Return the motion of all steps and runs, F and Q (n, n, K M); ``k`` has no effect."""
        return self._motion

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return the distribution one step after the states x (n, *points, K M).

        The last axis of x has the M runs of the first of K steps, then those of the second, and so on.
        ``points`` are axes such as that of sigma points; ``k`` has no effect.
        """
        n = len(self._motion.F)
        axes_of_points = (1,) * (x.ndim - 2)
        F = self._motion.F.reshape(n, n, *axes_of_points, -1)
        return Gaussian(linalg.matvec(F, x), self._motion.Q)

    @cached_property
    def _motion(self) -> Linear:
        """Motion with F and Q (n, n, K M): the matrices of each of K steps, repeated for M runs.

        Index k M + m is that of run m at the step with index k. The motion's T, of the first step, has
        no meaning.
        """
        motions = []
        for step in self.steps:
            motion = super().motion_at(step)
            assert isinstance(motion, Linear)
            motions.append(motion)
        F = np.stack([motion.F for motion in motions], axis=-1)
        Q = np.stack([motion.Q for motion in motions], axis=-1)
        return replace(
            motions[0],
            F=np.repeat(F, self.runs, axis=-1),
            Q=np.repeat(Q, self.runs, axis=-1),
        )


def put_side_by_side(motion: SampledMotion, steps: Collection[int], runs: int) -> SampledMotion:
    """Return a linear motion that moves the states of several steps at once, each over its own interval.

    Parameters
    ----------
    motion : SampledMotion
        Linear motion.
    steps : collection of int
        Numbers of the K steps.
    runs : int
        Number M of runs.

    Returns
    -------
    SampledMotion
        Motion of states (n, ..., K M): the M runs of each step in turn. A motion of equal intervals is
        the same at each step, and returned as it is.
    """
    if not isinstance(motion, Irregular):
        return motion
    return SideBySide(
        motion=motion.motion,
        axes=motion.axes,
        first=motion.first,
        intervals=motion.intervals,
        named_angles=motion.named_angles,
        recorded_inputs=motion.recorded_inputs,
        steps=tuple(steps),
        runs=runs,
    )
