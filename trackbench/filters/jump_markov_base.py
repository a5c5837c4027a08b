"""Base of the filters with several motions, and the probabilities of switches between them."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import InvalidKeyError, Registered, Share
from trackbench.filters.base import Filter, State
from trackbench.models.angle_components import angle_names, with_angle_names
from trackbench.models.assume import OWN_MOTION
from trackbench.models.base import Model, Motion, SampledMotion, Scene, extra_std
from trackbench.models.motions.nonlinear import AngledMotion
from trackbench.models.motions.sampling_interval import sample_alike

_ROUNDING = 1e-9  # of a row's sum


@dataclass(frozen=True, kw_only=True)
class JumpMarkov(Filter[State]):
    """Base of the filters with several motions."""

    motions: Annotated[tuple[Motion, ...], Registered("motions")]
    """motions of the models, such as [{kind: cv, q: 0.01}, {kind: ca, q: 0.001}]"""
    transition: tuple[tuple[Share, ...], ...]
    """probability of a switch from model i (row) to model j in one step; rows sum to 1"""
    initial: tuple[Share, ...] | None = None
    """probability of each model at the start; default: equal"""
    requires: ClassVar[tuple[str, ...]] = ("motion.T|intervals",)
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "has motions of its own"}

    def __post_init__(self) -> None:
        r = len(self.motions)
        if r < 2:
            raise InvalidKeyError("give at least two motions", "motions")
        # The transition matrix is r x r, and each of its rows sums to one.
        if len(self.transition) != r:
            message = f"{len(self.transition)} rows for {r} motions"
            raise InvalidKeyError(message, "transition")
        for i, row in enumerate(self.transition):
            if len(row) != r:
                raise InvalidKeyError(f"{len(row)} entries for {r} motions", "transition", i)
            if abs(sum(row) - 1.0) > _ROUNDING:
                raise InvalidKeyError(f"the row sums to {sum(row):g}, not to 1", "transition", i)
        # The initial probabilities are r numbers that sum to one.
        if self.initial is not None and len(self.initial) != r:
            raise InvalidKeyError(f"{len(self.initial)} entries for {r} motions", "initial")
        if self.initial is not None and abs(sum(self.initial) - 1.0) > _ROUNDING:
            raise InvalidKeyError(f"sums to {sum(self.initial):g}, not to 1", "initial")

    @property
    def initial_weights(self) -> Array:
        """Probabilities (r,) of the models at the start."""
        if self.initial is not None:
            return np.array(self.initial)
        r = len(self.motions)
        return np.full(r, 1.0 / r)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject motions with other positions and velocities than the target, or inputs not recorded."""
        target = position_velocity_components(scenario.model.motion)
        conflicts = super().conflicts(scenario)
        unknown_inputs = {}
        for i, motion in enumerate(self.motions):
            # This raises if the motion has an input that the target's recording lacks.
            try:
                sample_alike(motion, scenario.model.motion)
            except InvalidKeyError as error:
                unknown_inputs[f"motions.{i}.input"] = str(error)
        if unknown_inputs:
            return conflicts | unknown_inputs
        # `sampled` is the motion along the axes and over the steps of the target's.
        for i, (sampled, _) in enumerate(self.models(scenario.model)):
            if position_velocity_components(sampled) != target:
                # Along the axes of a target without positions, a motion has no components.
                names = ", ".join(sampled.components) or "positions and velocities"
                conflicts[f"motions.{i}"] = f"a motion of {names} for {', '.join(target)}"
        return conflicts

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report an assumed motion as idle: the filter's motions are `motions`."""
        return super().idle_keys(scenario) | OWN_MOTION

    def models(self, model: Model) -> list[Model]:
        """Return a model for each motion of the key ``motions``.

        A component that is an angle in one of the motions, or in that of ``model``, is an angle in all.

        Parameters
        ----------
        model : Model
            Motion and sensor that the scenario lets a filter assume. Its motion gives the axes and the
            steps.

        Returns
        -------
        list of Model
            One model for each of the r motions, in their order: the sampled motion, and the sensor of
            ``model``.

        Raises
        ------
        InvalidKeyError
            If a motion has an input that the target's recording lacks. `conflicts` reports it before a
            run.
        """
        sampled = [sample_alike(motion, model.motion) for motion in self.motions]
        # Names of the components that are angles in any of the motions.
        angles = angle_names(model.motion).union(*map(angle_names, sampled))
        if angles:
            sampled = []
            for motion in self.motions:
                # First the key `angles`, by which a motion of equations keeps its own step within half a
                # turn. Then the rows of the sampled motion, as not every motion has the key.
                with_key = _with_angles(motion, tuple(sorted(angles)))
                sampled.append(with_angle_names(sample_alike(with_key, model.motion), angles))
        return [Model(motion, model.sensor) for motion in sampled]


def _with_angles(motion: Motion, names: tuple[str, ...]) -> Motion:
    """Return the motion with these components as angles, unless it names angles or can have none."""
    return motion.with_angles(names, 1) if isinstance(motion, AngledMotion) else motion


def position_velocity_components(motion: SampledMotion) -> tuple[str, ...]:
    """Return the positions and velocities, which all motions of a target share."""
    return motion.components[: len(motion.components) - len(extra_std(motion))]
