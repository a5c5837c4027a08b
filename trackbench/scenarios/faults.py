"""Faults: stretches of a run in which a sensor measures worse than filters assume.

A fault changes measurements that were drawn without it; the scans of a start stay. All other random
numbers stay, so that a run and its twin without faults are paired. A type of fault has its keys, and
the measurements that filters receive. `FaultContext` has the checks, windows and random numbers of the
faults of a scenario, and what a filter that knows of them has.
"""

import zlib
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Annotated, Literal, NamedTuple, TypeAlias, cast

import numpy as np
from pydantic import Field, StringConstraints

from trackbench.core.arrays import Array, Index, Mask, with_trailing
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.core.read_only import fixed
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
from trackbench.models.base import Sensor
from trackbench.models.component_names import by_component
from trackbench.models.likelihood import has_own_density
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.noise import ScaledNoise
from trackbench.models.sensors.stacked import Sensors, rows_of, sensors_of
from trackbench.scenarios.delays import stream_number

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
        """Return the measurements (n_z, S, M) of a stretch with the fault.

        Parameters
        ----------
        stretch : Stretch
            Measurements of the fault's sensors in its S steps. `noise` is set only if `uses_noise` is
            True.

        Returns
        -------
        array (n_z, S, M)
            Measurements that filters get, NaN where one is missing.
        """

    @property
    def uses_noise(self) -> bool:
        """True if the fault changes the errors of measurements, so that the truth must be known."""
        return False

    @property
    def variance(self) -> float:
        """Factor on the variance of the noise."""
        return 1.0

    def corrected(self, stretch: Stretch) -> Array:
        """Return the measurements (n_z, S, M) that a filter uses if it knows of the fault.

        Parameters
        ----------
        stretch : Stretch
            Measurements with the fault. `before`, `noise` and `streams` are unset.

        Returns
        -------
        array (n_z, S, M)
            Measurements without the error that is known, NaN where a filter leaves one out.
        """
        return stretch.z

    def check(self, components: tuple[str, ...]) -> None:
        """Raise InvalidKeyError for keys that do not fit the measurement's components.

        Parameters
        ----------
        components : tuple of str
            Names of the components that the fault changes, in order.

        Raises
        ------
        InvalidKeyError
            For an unknown component, for example. By default all keys fit.
        """

    def inside(self, steps: Index, times: Array) -> Mask:
        """Return which steps have the fault.

        Parameters
        ----------
        steps : array of int (K,)
            Numbers of the steps.
        times : array (K,)
            Their times, s.

        Returns
        -------
        array of bool (K,)
            True within the fault, both ends included.
        """
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
        """Return all measurements of the stretch as the fault changes them: ``h(x) + factor e``.

        Parameters
        ----------
        stretch : Stretch
            Measurements of the fault's sensors in its S steps.

        Returns
        -------
        array (n_z, S, M)
            Measurements. `faulty` takes a share of them.
        """
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
        """Return the error of each component at each step: the value, plus the ramp by time.

        Parameters
        ----------
        stretch : Stretch
            Measurements of the fault's sensors in its S steps.

        Returns
        -------
        array (n_z, S)
            Error, in SI units and radians.
        """
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


class FaultContext(NamedTuple):
    """Sensors and steps of a scenario with faults."""

    sensor: Sensors
    """true sensor, or all sensors as one"""
    steps: Index
    """numbers (T + 1,) of the steps from the first state on"""
    times: Array
    """times (T + 1,) of these steps, s"""
    starts_with_scans: bool = False
    """measurements of the start precede the steps"""

    def rows(self, fault: Fault) -> slice:
        """Return the rows of the measurement that a fault changes."""
        if fault.sensor is None:
            return slice(None)
        return rows_of(self.sensor)[fault.sensor - 1]

    def sensors(self, fault: Fault) -> tuple[SensorBase, ...]:
        """Return the sensors that a fault changes."""
        sensors = sensors_of(self.sensor)
        if fault.sensor is None:
            return sensors
        return (sensors[fault.sensor - 1],)

    def components(self, fault: Fault) -> tuple[str, ...]:
        """Return the names of the components that a fault changes."""
        if fault.sensor is None:
            return self.sensor.components
        return self.sensors(fault)[0].components

    def faulty_steps(self, fault: Fault) -> Mask:
        """Return which measured steps (T,) have a fault."""
        return fault.inside(self.steps[1:], self.times[1:])

    def check(self, faults: Sequence[Fault], taken: Mapping[str, object], has_truth: bool) -> None:
        """Raise InvalidKeyError for a fault outside the run, of no sensor, or whose name is taken.

        Parameters
        ----------
        faults : sequence of Fault
            Faults in the order of the config.
        taken : mapping
            Names of other windows, its keys.
        has_truth : bool
            False without a truth. No fault can then change errors.

        Raises
        ------
        InvalidKeyError
            With the fault's key. Also for a key that its own `check` rejects.
        """
        names = [*taken]
        for i, fault in enumerate(faults):
            try:
                self._check_fault(fault, names, has_truth)
            except InvalidKeyError as error:
                raise InvalidKeyError(str(error), "faults", i, *error.path) from None
            names += [fault.name, f"after {fault.name}"]

    def _check_fault(self, fault: Fault, names: Sequence[str], has_truth: bool) -> None:
        """Raise InvalidKeyError, with a key of the fault, if it does not fit the scenario.

        ``names`` are those of other windows. Without a truth, ``has_truth`` is False.
        """
        number = len(sensors_of(self.sensor))
        if fault.sensor is not None and fault.sensor > number:
            message = f"{fault.sensor} is no sensor: this scenario has {number}"
            raise InvalidKeyError(message, "sensor")
        if not self.faulty_steps(fault).any():
            # The first step has no measurement.
            first, last = self.times[[1, -1]]
            message = (
                f"no measurement is in it: they are at {time_text(first)} to {time_text(last)} s, "
            )
            message += f"steps {self.steps[1]} to {self.steps[-1]}"
            raise InvalidKeyError(message, self._key_of_time(fault))
        idle = self._sensors_without_measurement(fault)
        if idle:
            message = f"{idle} measures at no step of it, by its `period` and `offset`; "
            message += "take other steps, or a longer fault"
            raise InvalidKeyError(message, self._key_of_time(fault))
        for name in (fault.name, f"after {fault.name}"):
            if name in names:
                message = f"there is a window {name!r} already: choose another name"
                raise InvalidKeyError(message, "name")
        if fault.uses_noise and not has_truth:
            message = "multiplies errors, which are known with a truth only; take bias or blackout"
            raise InvalidKeyError(message, "kind")
        changes_errors = fault.uses_noise or isinstance(fault, Bias)
        if changes_errors and any(
            getattr(sensor, "is_count", False) for sensor in self.sensors(fault)
        ):
            message = "a count (`noise: poisson`) has no such error; take blackout or freeze"
            raise InvalidKeyError(message, "kind")
        if isinstance(fault, Freeze) and not self._measures_before(fault):
            message = "no measurement is before this fault that a frozen sensor could repeat; "
            message += "begin later, or take blackout"
            key = "from"
            if fault.steps:
                key = "steps"
            elif fault.from_ is None:
                key = "kind"
            raise InvalidKeyError(message, key)
        fault.check(self.components(fault))

    def _key_of_time(self, fault: Fault) -> str:
        """Return the key of the config that says when the fault is.

        It is ``to`` for a fault with an end alone, and also for one without any of these keys.
        """
        if fault.steps:
            return "steps"
        return "to" if fault.from_ is None else "from"

    def _sensors_without_measurement(self, fault: Fault) -> str:
        """Describe the fault's sensors if none of them measures during the fault; empty otherwise."""
        steps = self.steps[1:][self.faulty_steps(fault)]
        sensors = self.sensors(fault)
        for sensor in sensors:
            if sensor.measures_at(steps).any():
                return ""
        return "the sensor" if len(sensors) == 1 else "every sensor"

    def _measures_before(self, fault: Fault) -> bool:
        """Test whether each of the fault's sensors measures before it, by its period."""
        # The scans of the start are measured before all steps, and so before any fault.
        if self.starts_with_scans:
            return True
        # Measurement i, counted from 0, is that of step ``steps[1 + i]``: the first step has none.
        earlier = self.steps[1 : 1 + self._first_measured(fault)]
        return all(sensor.measures_at(earlier).any() for sensor in self.sensors(fault))

    def _first_measured(self, fault: Fault) -> int:
        """Return the index of the first measurement with a fault; 0 is the one after the first state."""
        return int(np.argmax(self.faulty_steps(fault)))

    def windows(self, faults: Sequence[Fault], scored: Mask) -> dict[str, Mask]:
        """Return the scored steps of each fault, and those after it up to the next one.

        Parameters
        ----------
        faults : sequence of Fault
            Faults, each with at least one measured step.
        scored : array of bool (T + 1,)
            True for the steps that are scored.

        Returns
        -------
        dict of array of bool (T + 1,)
            Windows by name: ``burst`` and ``after burst`` for a fault of the name burst.
        """
        step_indices = np.arange(len(self.steps))
        # The first step has no measurement, and no fault.
        inside = {fault: np.insert(self.faulty_steps(fault), 0, False) for fault in faults}
        with_any_fault = np.zeros(len(self.steps), dtype=np.bool_)
        for during in inside.values():
            with_any_fault |= during
        first_steps = [np.flatnonzero(during)[0] for during in inside.values()]
        windows = {}
        for fault, during in inside.items():
            last = np.flatnonzero(during)[-1]
            later = [first for first in first_steps if first > last]
            end = min(later, default=len(self.steps))
            after = (step_indices > last) & (step_indices < end)
            windows[fault.name] = scored & during
            windows[f"after {fault.name}"] = scored & after & ~with_any_fault
        return windows

    def with_faults(
        self, faults: Sequence[Fault], truth: Array, z: Array, scans: Array, rng: Streams
    ) -> Array:
        """Return measurements with the faults, which are added in order of time.

        Each fault draws from streams of its own, beside ``rng``. Their number depends on the fault's
        name alone, so that another fault does not change its draws.

        Parameters
        ----------
        faults : sequence of Fault
            Faults, each with at least one measured step.
        truth : array (n_x, T + 1, M)
            True states, from the first state's step on.
        z : array (n_z, T, M)
            Measurements without the faults, NaN where one is missing.
        scans : array (n_z, scans, M)
            Scans of the start, before z.
        rng : Streams
            Random numbers, a stream per run.

        Returns
        -------
        array (n_z, T, M)
            Measurements that filters get.

        Raises
        ------
        ValueError
            For a recorded sensor that freezes before its first measurement.
        """
        z = z.copy()
        numbers = self._stream_numbers(faults)
        for fault in self._in_order(faults):
            rows = self.rows(fault)  # slice of components
            inside = self.faulty_steps(fault)  # mask (T,) of steps
            earlier = np.concatenate([scans, z[:, : self._first_measured(fault)]], axis=1)[rows]
            stretch = self._stretch(fault, z)._replace(before=_last_measurements(earlier))
            if isinstance(fault, Freeze):
                self._check_frozen(fault, stretch)
            # The fault's streams are opened at its first draw.
            open_streams = partial(cast(RunStreams, rng).beside, numbers[fault.name])
            stretch = stretch._replace(streams=cache(open_streams))
            if fault.uses_noise:
                # These are the present errors, which earlier faults may have changed already.
                stretch = stretch._replace(noise=self._errors_without_bias(truth, z, inside)[rows])
            z[rows, inside] = fault.faulty(stretch)
        return z

    def _stream_numbers(self, faults: Sequence[Fault]) -> dict[str, int]:
        """Return the number of each fault's random streams, which is the CRC-32 of its name.

        If two names have the same CRC-32, the fault that is listed first gets it, and the other one the
        next free number.
        """
        numbers: dict[str, int] = {}
        # The delays of the sensors have streams of these numbers.
        taken = {stream_number(n) for n in range(len(sensors_of(self.sensor)))}
        for fault in faults:
            number = zlib.crc32(fault.name.encode())
            while number in taken:
                number += 1
            taken.add(number)
            numbers[fault.name] = number
        return numbers

    def _in_order(self, faults: Sequence[Fault]) -> list[Fault]:
        """Return the faults sorted by their first steps; those that begin at one step stay in order."""
        return sorted(faults, key=self._first_measured)

    def _check_frozen(self, fault: Fault, stretch: Stretch) -> None:
        """Raise ValueError for a recorded sensor that freezes before its first measurement.

        If a simulated sensor misses detections, its runs may lack a measurement by chance: no mistake.
        """
        detects_always = all(sensor.detection == 1 for sensor in self.sensors(fault))
        # Components that have a value during the fault in any run, and those that no run has before it.
        measured = ~np.isnan(stretch.z).all(axis=(1, 2))
        unknown = np.isnan(stretch.before).all(axis=1)
        if detects_always and (measured & unknown).any():
            name = stretch.components[int(np.argmax(measured & unknown))]
            message = f"the fault {fault.name!r} freezes `{name}` before its first measurement"
            raise ValueError(f"{message}; begin later, or take blackout")

    def corrected(self, faults: Sequence[Fault], z: Array) -> Array:
        """Return measurements as a filter that knows of the faults corrects them.

        A filter subtracts a known bias, for example, and leaves out the values of a frozen sensor.

        Parameters
        ----------
        faults : sequence of Fault
            Faults, each with at least one measured step.
        z : array (n_z, T, M)
            Measurements with the faults.

        Returns
        -------
        array (n_z, T, M)
            Corrected measurements, NaN where one is left out.
        """
        z = z.copy()
        ordered = self._in_order(faults)
        for i, fault in enumerate(ordered):
            changed = (self.rows(fault), self.faulty_steps(fault))
            corrected = fault.corrected(self._stretch(fault, z))
            # Faults that began later have multiplied the error of this one by this factor (n_z, S). It
            # is NaN where it is random. This is of no use for a fault other than a bias, and
            # `known_sensor` rejects it for a bias.
            later_factor = self._factor_on_errors(ordered[i + 1 :])[changed]
            if isinstance(fault, Bias) and (later_factor != 1.0).any():
                corrected = z[changed] - later_factor[..., None] * (z[changed] - corrected)
            z[changed] = corrected
        return z

    def _factor_on_errors(self, faults: Sequence[Fault]) -> Array:
        """Return the factor (n_z, T) of these faults on errors of earlier ones; NaN if it is random."""
        factor = np.ones((len(self.sensor.components), len(self.steps) - 1))
        for fault in faults:
            if isinstance(fault, LargerNoise):
                factor[self.rows(fault), self.faulty_steps(fault)] *= fault.known_factor
        return factor

    def known_sensor(self, faults: Sequence[Fault], assumed: Sensors) -> Sensor:
        """Return the sensor that a filter assumes if it knows of the faults and their noise.

        Only its noise changes: `corrected` subtracts a known bias from the measurements.

        Parameters
        ----------
        faults : sequence of Fault
            Faults of the scenario.
        assumed : Sensors
            Sensor that the filter assumes without faults.

        Returns
        -------
        Sensor
            Sensor with the noise of the faults. It is ``assumed`` if no fault changes the noise.

        Raises
        ------
        InvalidKeyError
            Without faults, and if no sensor has such noise.
        """
        if not faults:
            raise InvalidKeyError("has no effect: the scenario has no `faults`", "assume", "faults")
        # Step 1: reject a bias that a later fault multiplies by a random factor, which is NaN here.
        ordered = self._in_order(faults)
        for i, fault in enumerate(ordered):
            changed = (self.rows(fault), self.faulty_steps(fault))
            later_factor = self._factor_on_errors(ordered[i + 1 :])[changed]
            if isinstance(fault, Bias) and np.isnan(later_factor).any():
                message = (
                    f"a later fault multiplies the bias of {fault.name!r} by a random factor, "
                )
                message += (
                    "and no filter knows its law; give the later one a `factor` without a `share`"
                )
                raise InvalidKeyError(message, "assume", "faults")
        # Step 2: factor on the standard deviation of the noise. A fault's `variance` is a factor, too:
        # it is relative to the variance without this fault.
        scales = np.ones((len(self.sensor.components), len(self.steps) - 1))
        for fault in faults:
            if fault.variance == np.inf:
                message = (
                    f"the density of {fault.name!r} has no variance about the truth: it is uniform, "
                    "or Student's t with df <= 2"
                )
                raise InvalidKeyError(message, "assume", "faults")
            scales[self.rows(fault), self.faulty_steps(fault)] *= np.sqrt(fault.variance)
        if (scales == 1.0).all():
            return assumed
        if has_own_density(assumed):
            message = "noise that is not normal has no known law in a fault that multiplies it"
            raise InvalidKeyError(message, "assume", "faults")
        first_measured_step = int(self.steps[1])  # the step of the first state is not measured
        return ScaledNoise(assumed, first_measured_step, fixed(scales))

    def _stretch(self, fault: Fault, z: Array) -> Stretch:
        """Return the measurements of a fault's sensor in the steps of the fault.

        ``z`` (n_z, T, M) are the measurements of all sensors at all T measured steps.
        """
        inside = self.faulty_steps(fault)
        times = self.times[1:][inside]
        # Without the key `from` the fault begins at its first step.
        begin = fault.from_
        if begin is None:
            begin = times[0]
        return Stretch(
            z=z[self.rows(fault), inside],
            elapsed=times - begin,
            components=self.components(fault),
        )

    def _errors_without_bias(self, truth: Array, z: Array, inside: Mask) -> Array:
        """Return the errors (n_z, S, M) of measurements without the sensors' biases.

        ``inside`` (T,) marks the S steps of the measurements z (n_z, T, M). The ``truth`` begins one
        step before z: (n_x, T + 1, M).
        """
        bias = np.zeros(len(z))
        for sensor, rows in zip(sensors_of(self.sensor), rows_of(self.sensor), strict=True):
            bias[rows] = sensor.bias or 0.0
        errors = []
        for i in np.flatnonzero(inside).tolist():
            expected = self.sensor.measurement(truth[:, i + 1], int(self.steps[i + 1])).mean
            errors.append(self.sensor.innovation(z[:, i], expected) - with_trailing(bias, 1))
        return np.stack(errors, axis=1)


def _last_measurements(z: Array) -> Array:
    """Return the last existing value of each component and run (n_z, M) of z (n_z, S, M), or NaN."""
    latest = np.full((len(z), z.shape[-1]), np.nan)
    for at_step in np.moveaxis(z, 1, 0):
        latest = np.where(np.isnan(at_step), latest, at_step)
    return latest
