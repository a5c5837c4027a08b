"""A target that is driven by a motion: another truth in every run."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import Streams
from trackbench.field_types import (
    ByComponent,
    InvalidKeyError,
    Registered,
    freeze_mappings,
)
from trackbench.models.augmented_priors import append_drawn_components
from trackbench.models.base import Motion, extra_std
from trackbench.models.component_names import by_component
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.targets.base import Flight, Target
from trackbench.scenarios.targets.initial_state import Launch, PolarLaunch
from trackbench.scenarios.targets.timeline import Timeline


@register("targets", "driven")
@dataclass(frozen=True, kw_only=True)
class Driven(Target):
    """A target whose path is drawn from a motion, the filters' default model."""

    hints_on_unknown_keys: ClassVar[dict[str, str]] = {
        "launch": "a state with other components has their values in `initial` in place of `launch`"
    }
    """hints beside an unknown key, by the key of the mapping that has it"""

    motion: Annotated[Motion, Registered("motions")]
    """motion that drives it: {kind: cwna, q: 0.1}"""
    launch: Launch | None = None
    """first state; default: at rest at the origin"""
    polar: PolarLaunch | None = None
    """first state in polar coordinates, instead"""
    initial: ByComponent | None = None
    """first state of a motion with other components than positions and velocities: numbers by component,
    0 where none is given, or in order"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        first = {"launch": self.launch, "polar": self.polar, "initial": self.initial}
        keys = [key for key, value in first.items() if value is not None]
        if len(keys) > 1:
            raise ValueError(f"give one of {' and '.join(keys)}")
        # `launch` and `polar` are a position and a velocity; a scalar state takes their first component.
        if (
            keys
            and keys != ["initial"]
            and not (self.has_position_and_velocity or len(self.components) == 1)
        ):
            names = ", ".join(self.components)
            raise InvalidKeyError(f"the state is {names}: give its values in `initial`", *keys)
        if self.initial is not None:
            by_component(self.initial, self.components, "initial")
        if self.motion.input_names:
            message = "a simulation has no recorded inputs: write them as expressions of k and t"
            raise InvalidKeyError(message, "motion", "input")

    @property
    def _first(self) -> Launch | PolarLaunch:
        return self.polar or self.launch or Launch()

    @property
    def axes(self) -> int:
        """Axes of the space it moves in."""
        return self._first.axes

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the truth's components, which are the motion's first ones."""
        # The names are the same for any interval.
        motion = self.motion.sampled(1.0, self.axes)
        # The motion's last components may be further ones, such as accelerations: the truth lacks them.
        number = len(motion.components) - len(extra_std(motion))
        return motion.components[:number]

    @property
    def own_motion(self) -> Motion | None:
        """Motion that drives it."""
        return self.motion

    @property
    def diffusion(self) -> float:
        """Spectral density of its white acceleration, m^2/s^3; 0 for other motions."""
        if isinstance(self.motion, WhiteAcceleration):
            return self.motion.q
        return 0.0

    def start(self, timeline: Timeline) -> Array:
        """Return the configured first state (n_x,)."""
        if self.initial is not None:
            return by_component(self.initial, self.components, "initial")
        # A launch is a position and a velocity along each axis. A state of other components begins at
        # zeros.
        if not self.has_position_and_velocity and len(self.components) > 1:
            return np.zeros(len(self.components))
        # A scalar takes the launch's x, its first component.
        return self._first.state[: len(self.components)]

    def path(self, timeline: Timeline) -> Array:
        """Return states (n_x, K) without process noise."""
        motion = self.motion.sampled(timeline.T, self.axes)
        first = self.start(timeline)
        n = len(first)
        # Components that the motion has beyond the target's, such as an acceleration, begin at zeros.
        path = [np.concatenate([first, np.zeros(len(extra_std(motion)))])]
        for k in timeline.steps[1:].tolist():
            # `loc` is the next state without the noise.
            path.append(motion.transition(path[-1], k).loc)
        return np.stack([x[:n] for x in path], axis=-1)

    def fly(
        self, start: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int
    ) -> Flight:
        """Draw the target's path and its measurements from the true first states ``start`` (n_x, M).

        The first ``scans`` measurements are those that the prior is made of: none of them is missing.
        """
        motion = self.motion.sampled(timeline.T, self.axes)
        n, runs = start.shape
        n_z = len(sensor.components)
        # Components that the motion has beyond the target's, such as an acceleration, begin at normal
        # draws.
        truth = [append_drawn_components(start, extra_std(motion), rng)]
        measurements = []
        # x_k given x_{k-1}, then z_k; the first state is measured only if scans are needed.
        for i, k in enumerate(timeline.steps.tolist()):
            if i > 0:
                truth.append(motion.transition(truth[-1], k).sample(rng))
            if i > 0 or scans:
                noise = rng.standard_normal((n_z, runs))
                measurements.append(sensor.measure(truth[-1], k, noise, rng, certain=i < scans))
        # Without the components that the motion has beyond the target's.
        states = np.stack([x[:n] for x in truth], axis=1)
        return Flight(truth=states, measurements=np.stack(measurements, axis=1))
