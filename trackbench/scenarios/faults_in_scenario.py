"""Measurements with faults: their check, random numbers, and what a filter that knows of them has."""

import zlib
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple, cast

import numpy as np

from trackbench.core.arrays import Array, Index, Mask, with_trailing
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.core.read_only import fixed
from trackbench.durations import time_text
from trackbench.field_types import InvalidKeyError
from trackbench.models.base import Sensor
from trackbench.models.likelihood import has_own_density
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.noise import ScaledNoise
from trackbench.models.sensors.stacked import Sensors, rows_of, sensors_of
from trackbench.scenarios.delays import stream_number
from trackbench.scenarios.faults import Bias, Fault, Freeze, LargerNoise, Stretch


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

        ``taken`` has the names of other windows. Without a truth, ``has_truth`` is False, and no fault
        can change errors.
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
        """Return the scored steps (K,) of each fault, and those after it up to the next one, by name."""
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
        """Return measurements z (n_z, T, M) with the faults, which are added in order of time.

        The ``truth`` is (n_x, T + 1, M). ``scans`` (n_z, S, M) are those of the start, before z. Each
        fault draws from streams of its own, beside ``rng``. Their number depends on the fault's name
        alone, so that another fault does not change its draws.
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
        """Return measurements z (n_z, T, M) as a filter that knows of the faults corrects them.

        A filter subtracts a known bias, for example, and leaves out the values of a frozen sensor.
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

        ``assumed`` is the sensor without faults. Only its noise changes: `corrected` subtracts a known
        bias from the measurements. Raises InvalidKeyError if no sensor has such noise.
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
