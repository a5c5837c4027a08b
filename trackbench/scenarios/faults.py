"""Faults: stretches of a run in which a sensor measures worse than filters assume.

A fault changes measurements that were drawn without it; the scans of a start stay. All other random
numbers stay, so that a run and its twin without faults are paired. A type of fault has its keys, and
the measurements that filters receive. `faults_in_scenario` has the checks, windows and random numbers.
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field, StringConstraints

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.random_streams import RunStreams
from trackbench.durations import time_text
from trackbench.field_types import (
    LEGEND_LABEL,
    ByComponent,
    Count,
    Finite,
    InvalidKeyError,
    Natural,
    Positive,
    Share,
    check_window_name,
    freeze_mappings,
)
from trackbench.models.component_names import by_component

_TICK = 1e-6  # s, by which times may differ from those of steps


class Stretch(NamedTuple):
    """A sensor's measurements of S steps with a fault, M runs."""

    z: Array
    """measurements (n_z, S, M), NaN where missing"""
    elapsed: Array
    """time since the fault's begin (S,), s"""
    components: tuple[str, ...]
    """names of the measurement's components"""
    before: Array = np.empty(0)
    """last measurement of each run before the fault (n_z, M)"""
    noise: Array = np.empty(0)
    """errors of the measurements without the sensor's bias; NaN where the truth is unknown"""
    streams: Callable[[], RunStreams] | None = None
    """returns the random numbers of this fault alone, opened at the first call; None only where
    measurements are corrected, for which nothing is drawn"""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Base of the faults: when they are, and of which sensor."""

    name: Annotated[str, StringConstraints(pattern=LEGEND_LABEL, max_length=70)]
    """window of metrics: rmse_position[burst], rmse_position[after burst]"""
    from_: Finite | None = None
    """time of the first wrong measurement, s; default: from the start"""
    to: Finite | None = None
    """time of the last wrong measurement, s; default: to the end"""
    steps: tuple[Natural, Natural] | None = None
    """first and last step, in place of times"""
    sensor: Count | None = None
    """number of the sensor in a scenario of several, from 1; default: all"""
    recovered: Positive = 0.1
    """excess error after the fault that counts as recovered, as a share of the twin's RMSE"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        check_window_name(self.name)
        has_times = self.from_ is not None or self.to is not None
        if self.steps is not None and has_times:
            raise InvalidKeyError("give `steps`, or `from` and `to`", "steps")
        if self.steps is not None and self.steps[0] > self.steps[1]:
            raise InvalidKeyError(f"{[*self.steps]} ends before it begins", "steps")
        if self.from_ is not None and self.to is not None and self.from_ > self.to:
            message = f"ends at {time_text(self.to)} s, and begins at {time_text(self.from_)} s"
            message += "; take a later end"
            raise InvalidKeyError(message, "to")

    @abstractmethod
    def faulty(self, stretch: Stretch) -> Array:
        """Return the measurements (n_z, S, M) of a stretch with the fault."""

    @property
    def uses_noise(self) -> bool:
        """True if the fault changes the errors of measurements, so that the truth must be known."""
        return False

    @property
    def variance(self) -> float:
        """Factor on the variance of the noise."""
        return 1.0

    def corrected(self, stretch: Stretch) -> Array:
        """Return the measurements (n_z, S, M) that a filter uses if it knows of the fault."""
        return stretch.z

    def check(self, components: tuple[str, ...]) -> None:
        """Raise InvalidKeyError for keys that do not fit the measurement's components."""

    def inside(self, steps: Index, times: Array) -> Mask:
        """Return which steps (K,), at ``times`` (K,), s, have the fault."""
        if self.steps is not None:
            return np.asarray((steps >= self.steps[0]) & (steps <= self.steps[1]))
        # Times in a config may differ slightly from those of the steps.
        first = -np.inf if self.from_ is None else self.from_
        last = np.inf if self.to is None else self.to
        return np.asarray((times >= first - _TICK) & (times <= last + _TICK))


@dataclass(frozen=True, kw_only=True)
class LargerNoise(Fault):
    """Larger or smaller errors of all measurements, or of a share."""

    factor: Positive
    """factor on the errors"""
    share: Share = 1.0
    """share of the measurements that have them"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.share == 0.0:
            raise InvalidKeyError("a share of 0 changes nothing", "share")

    @property
    def uses_noise(self) -> bool:
        """True: the errors change."""
        return True

    @property
    def changed_variance(self) -> float:
        """Factor on the variance of the noise of the measurements that the fault changes."""
        return self.factor * self.factor

    @property
    def known_factor(self) -> float:
        """Factor on the errors of all measurements; NaN if only a random share of them is multiplied."""
        if self.share == 1.0:
            return self.factor
        return np.nan

    @property
    def variance(self) -> float:
        """Factor on the variance of the noise: that of the mixture."""
        return 1.0 + self.share * (self.changed_variance - 1.0)

    def faulty(self, stretch: Stretch) -> Array:
        """Return the measurements (n_z, S, M) of a stretch; the fault changes a share of them.

        A measurement that is missing, or whose error is needed and unknown, stays as it is.
        """
        needed = stretch.noise if self.uses_noise else stretch.z
        changed = ~np.isnan(needed)
        if self.share < 1.0:
            # `FaultContext.with_faults` gives each fault streams.
            assert stretch.streams is not None
            # One draw for each step and run: all components of a measurement change together.
            changed &= stretch.streams().random(stretch.z.shape[1:]) < self.share
        return np.where(changed, self.changed_measurements(stretch), stretch.z)

    def changed_measurements(self, stretch: Stretch) -> Array:
        """Return all measurements of the stretch as the fault changes them: ``h(x) + factor e``."""
        return np.asarray(stretch.z + (self.factor - 1.0) * stretch.noise)


@dataclass(frozen=True, kw_only=True)
class StudentErrors:
    """Errors with Student's t: each measurement's normal error by a random factor."""

    kind: Literal["student-t"] = "student-t"
    """errors with Student's t"""
    df: Positive
    """degrees of freedom"""
    scale: Positive = 1.0
    """factor on the errors beside"""


@dataclass(frozen=True, kw_only=True)
class UniformClutter:
    """False measurements, uniform over a region, whatever the target does."""

    kind: Literal["uniform"] = "uniform"
    """false measurements"""
    region: dict[str, tuple[Finite, Finite]]
    """least and largest value of every component of the measurement, in SI units and radians"""

    def __post_init__(self) -> None:
        freeze_mappings(self)


@dataclass(frozen=True, kw_only=True)
class Outliers(LargerNoise):
    """Larger errors, as a gate is to refuse."""

    kind: Literal["outliers"] = "outliers"
    """larger errors, or others"""
    factor: Positive = 1.0
    """factor on the errors; give this or `density`"""
    density: Annotated[StudentErrors | UniformClutter, Field(discriminator="kind")] | None = None
    """law of the outliers: {kind: student-t, df: 3, scale: 5}, {kind: uniform, region: {x: [0, 9]}}"""

    def __post_init__(self) -> None:
        if (self.density is None) == (self.factor == 1.0):
            raise InvalidKeyError("give a `factor` other than 1, or a `density`")
        super().__post_init__()

    @property
    def uses_noise(self) -> bool:
        """True if the truth must be known."""
        return not isinstance(self.density, UniformClutter)

    @property
    def known_factor(self) -> float:
        """Factor on all errors; NaN if the errors are drawn from a density."""
        if self.density is not None:
            return np.nan
        return super().known_factor

    @property
    def changed_variance(self) -> float:
        """Factor on the variance of the outliers' noise; infinite if no such factor describes them.

        Without a ``density`` it is the square of the key ``factor``.
        """
        law = self.density
        if law is None:
            return super().changed_variance
        # Clutter lies anywhere in its region, whatever the truth and the noise are. Student's t has no
        # finite variance up to two degrees of freedom.
        if isinstance(law, UniformClutter) or law.df <= 2.0:
            return np.inf
        return law.scale * law.scale * law.df / (law.df - 2.0)

    def check(self, components: tuple[str, ...]) -> None:
        """Raise InvalidKeyError unless the region of clutter has an interval for every component."""
        if not isinstance(self.density, UniformClutter):
            return
        region = self.density.region
        if {*region} != {*components}:
            message = f"needs bounds of {', '.join(components)}, and no others"
            raise InvalidKeyError(message, "density", "region")
        for name, (least, largest) in region.items():
            if least >= largest:
                raise InvalidKeyError("ends before it begins", "density", "region", name)

    def changed_measurements(self, stretch: Stretch) -> Array:
        """Return all measurements (n_z, S, M) as outliers, drawn from the density if there is one."""
        if self.density is None:
            return super().changed_measurements(stretch)
        z = stretch.z
        assert stretch.streams is not None  # `FaultContext.with_faults` gives each fault streams
        if isinstance(self.density, UniformClutter):
            ends = np.array([self.density.region[component] for component in stretch.components])
            least, largest = ends.T[..., None, None]
            return np.asarray(least + (largest - least) * stretch.streams().random(z.shape))
        # Student's t is a normal over the root of a gamma variate of mean one.
        half = 0.5 * self.density.df
        gamma = stretch.streams().standard_gamma(half, z.shape[1:]) / half
        # The normal noise is in z already.
        return np.asarray(z + (self.density.scale / np.sqrt(gamma) - 1.0) * stretch.noise)


@dataclass(frozen=True, kw_only=True)
class Noise(LargerNoise):
    """Larger or smaller noise."""

    kind: Literal["noise"] = "noise"
    """larger or smaller noise"""

    def __post_init__(self) -> None:
        if self.factor == 1.0:
            raise InvalidKeyError("a factor of 1 changes nothing", "factor")
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class Blackout(Fault):
    """No measurement."""

    kind: Literal["blackout"] = "blackout"
    """no measurements"""

    def faulty(self, stretch: Stretch) -> Array:
        """Replace the measurements by NaN."""
        return np.full_like(stretch.z, np.nan)


@dataclass(frozen=True, kw_only=True)
class Bias(Fault):
    """An error that is constant, or grows with time."""

    kind: Literal["bias"] = "bias"
    """constant or growing error"""
    value: ByComponent = ()
    """error by component of the measurement, in SI units and radians"""
    ramp: ByComponent = ()
    """growth of the error per s, from zero or `value` at the fault's begin"""

    def check(self, components: tuple[str, ...]) -> None:
        """Raise InvalidKeyError for an unknown component, and for a bias without a value."""
        # `by_component` raises InvalidKeyError for an unknown name.
        by_component(self.value or {}, components, "value")
        by_component(self.ramp or {}, components, "ramp")
        if not (self.value or self.ramp):
            raise InvalidKeyError("give `value`, or `ramp`")

    def bias(self, stretch: Stretch) -> Array:
        """Return the error (n_z, S) of each component at each step: the value, plus the ramp by time."""
        value = by_component(self.value or {}, stretch.components)
        ramp = by_component(self.ramp or {}, stretch.components)
        return np.asarray(value[:, None] + ramp[:, None] * stretch.elapsed)

    def faulty(self, stretch: Stretch) -> Array:
        """Add the error."""
        return np.asarray(stretch.z + self.bias(stretch)[..., None])

    def corrected(self, stretch: Stretch) -> Array:
        """Subtract the error."""
        return np.asarray(stretch.z - self.bias(stretch)[..., None])


@dataclass(frozen=True, kw_only=True)
class Freeze(Fault):
    """The last measurement before the fault again and again."""

    kind: Literal["freeze"] = "freeze"
    """the last measurement again"""

    def faulty(self, stretch: Stretch) -> Array:
        """Repeat the last measurement wherever there is one."""
        return np.where(np.isnan(stretch.z), np.nan, stretch.before[:, None])

    def corrected(self, stretch: Stretch) -> Array:
        """Leave the measurements out: the value has been used before."""
        return np.full_like(stretch.z, np.nan)


AnyFault: TypeAlias = Annotated[
    Outliers | Blackout | Bias | Freeze | Noise, Field(discriminator="kind")
]
"""A fault of any kind."""
