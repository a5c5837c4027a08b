"""Sampling interval: motions over intervals of a given length, and the seconds of a step."""

from dataclasses import replace

from trackbench.models.base import Model, Motion, SampledMotion, extra_std
from trackbench.models.inputs import KnownInputs, inputs_in_equations
from trackbench.models.motions.coordinated_turn import Turning
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.nonlinear import SteppedMotion
from trackbench.models.motions.unequal_intervals import Irregular, motion_with_inputs


def sample_equally(
    motion: Motion, T: float, axes: int, recorded: KnownInputs | None
) -> SampledMotion:
    """Sample a motion over equal intervals.

    Parameters
    ----------
    motion : Motion
        Motion as the config names it.
    T : float
        Length of the intervals, s.
    axes : int
        Number of axes of the space.
    recorded : KnownInputs or None
        Inputs of a recording. None if it has none.

    Returns
    -------
    SampledMotion
        Motion over T seconds, with the values of its inputs.

    Raises
    ------
    InvalidKeyError
        For an input in the motion's equations that is not recorded.
    """
    known = inputs_in_equations(motion, recorded)
    sampled = motion_with_inputs(motion.sampled(T, axes), known)
    # These types keep all recorded inputs, also those that are not in their equations. A filter that has
    # a motion of its own, with other inputs, takes these from the scenario's (`sample_alike`).
    if recorded is not None and isinstance(sampled, Linear | SteppedMotion | Turning):
        return replace(sampled, recorded_inputs=recorded)
    return sampled


def sample_alike(motion: Motion, other: SampledMotion) -> SampledMotion:
    """Sample ``motion`` over the intervals, along the axes and with the inputs of ``other``.

    Parameters
    ----------
    motion : Motion
        Motion as the config names it.
    other : SampledMotion
        Sampled motion of the same scenario.

    Returns
    -------
    SampledMotion
        The first motion, sampled as the second one is.

    Raises
    ------
    InvalidKeyError
        For an input in the motion's equations that is not recorded.
    """
    if isinstance(other, Irregular):
        # Raise the error here that the new motion would raise at its first step.
        inputs_in_equations(motion, other.recorded_inputs)
        # Rows of angles that were named for the other motion need not be those of the new one.
        return replace(other, motion=motion, named_angles=())
    # `other` has equal intervals. Along each axis it has a position and a velocity, then come further
    # components, such as accelerations. A motion of any other state ignores the number of axes.
    axes = (len(other.components) - len(extra_std(other))) // 2
    recorded = getattr(other, "recorded_inputs", None)
    return sample_equally(motion, other.T, axes, recorded)  # type: ignore[attr-defined]


def step_length(model: Model, k: int | None = None) -> float:
    """Return the time from step k - 1 to step k.

    Parameters
    ----------
    model : Model
        Model, whose motion has the intervals.
    k : int, optional
        Step. None stands for the first interval.

    Returns
    -------
    float
        Time, s. It is 1 for a motion without a sampling time.
    """
    motion = model.motion
    if not isinstance(motion, Irregular):
        return float(getattr(motion, "T", 1.0))
    if k is None:
        return float(motion.intervals[0])
    return float(motion.intervals[k - motion.first])
