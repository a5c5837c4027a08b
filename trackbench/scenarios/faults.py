"""Faults: stretches of a run in which a sensor measures worse than filters assume.

A fault changes measurements that were drawn without it, but the scans of a start. All other random
numbers stay, so that a run and its twin without faults are paired.
"""

import zlib
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple, cast

import numpy as np

from trackbench.core.arrays import Array, Index, Mask, fixed, settled_row, with_trailing
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError
from trackbench.metrics import in_window
from trackbench.models.base import Sensor, has_density
from trackbench.models.sensors.base import (
    ScaledNoise,
    SensorBase,
    Sensors,
    rows_of,
    sensors_of,
)
from trackbench.scenarios.delays import stream_number
from trackbench.scenarios.fault_kinds import AnyFault as AnyFault
from trackbench.scenarios.fault_kinds import Bias, Fault, Freeze, LargerNoise, Stretch


class FaultContext(NamedTuple):
    """Sensors of a scenario with faults, and its steps from the first state: numbers and times, s."""

    sensor: Sensors
    steps: Index
    times: Array
    starts_with_scans: bool = False
    """measurements of the start precede the steps"""

    def rows(self, fault: Fault) -> slice:
        """Return the rows of the measurement that a fault changes."""
        return slice(None) if fault.sensor is None else rows_of(self.sensor)[fault.sensor - 1]

    def sensors(self, fault: Fault) -> tuple[SensorBase, ...]:
        """Return the sensors that a fault changes."""
        every = sensors_of(self.sensor)
        return every if fault.sensor is None else (every[fault.sensor - 1],)

    def components(self, fault: Fault) -> tuple[str, ...]:
        """Return the names of the components that a fault changes."""
        return (self.sensor if fault.sensor is None else self.sensors(fault)[0]).components

    def measured(self, fault: Fault) -> Mask:
        """Return which measured steps (T,) have a fault."""
        return fault.inside(self.steps[1:], self.times[1:])

    def check(self, faults: Sequence[Fault], taken: Mapping[str, object], truth: bool) -> None:
        """Raise InvalidKeyError for a fault outside the run, of no sensor, or whose name is taken."""
        names = [*taken]
        for i, fault in enumerate(faults):
            try:
                self._check(fault, names, truth)
            except InvalidKeyError as error:
                raise InvalidKeyError(str(error), "faults", i, *error.path) from None
            names += [fault.name, f"after {fault.name}"]

    def _check(self, fault: Fault, names: Sequence[str], truth: bool) -> None:
        sensors, (first, last) = len(sensors_of(self.sensor)), self.times[[1, -1]]
        if fault.sensor is not None and fault.sensor > sensors:
            what = f"{fault.sensor} is no sensor: this scenario has {sensors}"
            raise InvalidKeyError(what, "sensor")
        if not self.measured(fault).any():
            what = f"no measurement is in it: they are at {first:g} to {last:g} s, "
            what += f"steps {self.steps[1]} to {self.steps[-1]}"
            key = "steps" if fault.steps else "to" if fault.from_ is None else "from"
            raise InvalidKeyError(what, key)
        for name in (fault.name, f"after {fault.name}"):
            if name in names:
                what = f"there is a window {name!r} already: choose another name"
                raise InvalidKeyError(what, "name")
        if fault.uses_noise and not truth:
            what = "multiplies errors, which are known with a truth only; take bias or blackout"
            raise InvalidKeyError(what, "kind")
        changes_errors = fault.uses_noise or isinstance(fault, Bias)
        if changes_errors and any(getattr(s, "is_count", False) for s in self.sensors(fault)):
            what = "a count (`noise: poisson`) has no such error; take blackout or freeze"
            raise InvalidKeyError(what, "kind")
        if isinstance(fault, Freeze) and not self._measures_before(fault):
            what = "no measurement is before this fault that a frozen sensor could repeat; "
            what += "begin later, or take blackout"
            key = "steps" if fault.steps else "kind" if fault.from_ is None else "from"
            raise InvalidKeyError(what, key)
        fault.check(self.components(fault))

    def _measures_before(self, fault: Fault) -> bool:
        """Test whether each of the fault's sensors measures before it, by its period."""
        earlier = self.steps[1:][: int(np.argmax(self.measured(fault)))]
        if self.starts_with_scans:
            return True
        sensors = self.sensors(fault)
        return all(((earlier - one.offset) % one.period == 0).any() for one in sensors)

    def windows(self, faults: Sequence[Fault], scored: Mask) -> dict[str, Mask]:
        """Select the steps (K,) of each fault, and those after it up to the next one."""
        out, places = {}, np.arange(len(self.steps))
        with_fault = np.zeros(len(self.steps), dtype=np.bool_)
        for fault in faults:
            with_fault[1:] |= self.measured(fault)
        ends = {fault: np.flatnonzero(self.measured(fault))[[0, -1]] + 1 for fault in faults}
        for fault, (_, last) in ends.items():
            later = [first for first, _ in ends.values() if first > last]
            inside = np.insert(self.measured(fault), 0, False)
            out[fault.name] = scored & inside
            after = (places > last) & (places < min(later, default=len(places)))
            out[f"after {fault.name}"] = scored & after & ~with_fault
        return out

    def with_faults(
        self, faults: Sequence[Fault], truth: Array, z: Array, scans: Array, rng: Streams
    ) -> Array:
        """Add the faults to measurements (n_z, T, M) in order of time; ``scans`` precede them."""
        z = z.copy()
        numbers = self._stream_numbers(faults)
        for fault in self._in_order(faults):
            rows, inside = self.rows(fault), self.measured(fault)
            earlier = np.concatenate([scans, z[:, : int(np.argmax(inside))]], axis=1)[rows]
            stretch = self._stretch(fault, z)._replace(before=_latest(earlier))
            if isinstance(fault, Freeze):
                self._check_frozen(fault, stretch)
            # Draws depend on the names alone.
            opened = cache(partial(cast(RunStreams, rng).beside, numbers[fault.name]))
            stretch = stretch._replace(streams=opened)
            if fault.uses_noise:
                # The errors as earlier faults have made them, those of a bias or a frozen value too.
                stretch = stretch._replace(noise=self._noise(truth, z, inside)[rows])
            z[rows, inside] = fault.faulty(stretch)
        return z

    def _stream_numbers(self, faults: Sequence[Fault]) -> dict[str, int]:
        """Return the number of each fault's random streams: the CRC-32 of its name, if it is free.

        Few names have one CRC-32. The fault that is listed first keeps it; another has the next number.
        """
        numbers: dict[str, int] = {}
        taken = {stream_number(n) for n in range(len(sensors_of(self.sensor)))}
        for fault in faults:
            number = zlib.crc32(fault.name.encode())
            while number in taken:
                number += 1
            taken.add(number)
            numbers[fault.name] = number
        return numbers

    def _in_order(self, faults: Sequence[Fault]) -> list[Fault]:
        """Sort the faults by their first steps, those of one step as they are listed."""
        return sorted(faults, key=lambda fault: int(np.argmax(self.measured(fault))))

    def _check_frozen(self, fault: Fault, stretch: Stretch) -> None:
        """Raise ValueError for a recorded sensor that freezes before its first measurement."""
        certain = all(one.detection == 1 for one in self.sensors(fault))
        measured = ~np.isnan(stretch.z).all(axis=(1, 2))
        unknown = np.isnan(stretch.before).all(axis=1)
        if certain and (measured & unknown).any():
            name = stretch.components[int(np.argmax(measured & unknown))]
            what = f"the fault {fault.name!r} freezes `{name}` before its first measurement"
            raise ValueError(f"{what}; begin later, or take blackout")

    def corrected(self, faults: Sequence[Fault], z: Array) -> Array:
        """Correct measurements (n_z, T, M) for a filter that knows of the faults."""
        z = z.copy()
        ordered = self._in_order(faults)
        for i, fault in enumerate(ordered):
            part = self.rows(fault), self.measured(fault)
            stretch = self._stretch(fault, z)
            corrected = fault.corrected(stretch)
            factor = self._factor(ordered[i + 1 :])[part]
            if (factor != 1.0).any():
                # Later faults have multiplied the error, too.
                corrected = z[part] - factor[..., None] * (z[part] - corrected)
            z[part] = corrected
        return z

    def _factor(self, faults: Sequence[Fault]) -> Array:
        """Return the factor (n_z, T) of these faults on errors of earlier ones; NaN if it is drawn."""
        factor = np.ones((len(self.sensor.components), len(self.steps) - 1))
        for fault in faults:
            if isinstance(fault, LargerNoise):
                factor[self.rows(fault), self.measured(fault)] *= fault.known_factor
        return factor

    def known_sensor(self, faults: Sequence[Fault], assumed: Sensors) -> Sensor:
        """Give the assumed sensor the noise of the faults; raises InvalidKeyError."""
        if not faults:
            raise InvalidKeyError("has no effect: the scenario has no `faults`", "assume", "faults")
        scales = np.ones((len(self.sensor.components), len(self.steps) - 1))
        ordered = self._in_order(faults)
        for i, fault in enumerate(ordered):
            factor = self._factor(ordered[i + 1 :])[self.rows(fault), self.measured(fault)]
            if isinstance(fault, Bias) and np.isnan(factor).any():
                what = f"a later fault multiplies the bias of {fault.name!r} by a random factor, "
                what += (
                    "and no filter knows its law; give the later one a `factor` without a `share`"
                )
                raise InvalidKeyError(what, "assume", "faults")
        for fault in faults:
            if fault.variance == np.inf:
                what = f"the density of {fault.name!r} has no variance about the truth: it is uniform, "
                raise InvalidKeyError(what + "or Student's t with df <= 2", "assume", "faults")
            scales[self.rows(fault), self.measured(fault)] *= np.sqrt(fault.variance)
        if (scales == 1.0).all():
            return assumed
        if has_density(assumed):
            what = "noise that is not normal has no known law in a fault that multiplies it"
            raise InvalidKeyError(what, "assume", "faults")
        return ScaledNoise(assumed, int(self.steps[1]), fixed(scales))

    def _stretch(self, fault: Fault, z: Array) -> Stretch:
        """Cut out the measurements of a fault's sensor in its steps."""
        inside = self.measured(fault)
        times = self.times[1:][inside]
        elapsed = times - (times[0] if fault.from_ is None else fault.from_)
        return Stretch(z[self.rows(fault), inside], elapsed, self.components(fault))

    def _noise(self, truth: Array, z: Array, inside: Mask) -> Array:
        """Return errors (n_z, S, M) of the measurements without the sensors' biases."""
        bias = np.zeros(len(z))
        for sensor, rows in zip(sensors_of(self.sensor), rows_of(self.sensor), strict=True):
            bias[rows] = sensor.bias or 0.0
        errors = []
        for i in np.flatnonzero(inside).tolist():
            expected = self.sensor.measurement(truth[:, i + 1], int(self.steps[i + 1])).mean
            errors.append(self.sensor.innovation(z[:, i], expected) - with_trailing(bias, 1))
        return np.stack(errors, axis=1)


def recovery(
    context: FaultContext,
    faults: Sequence[Fault],
    windows: Mapping[str, Mask],
    values: Mapping[str, Array],
) -> dict[str, Array]:
    """Measure ``recovery_s`` and ``not_recovered`` (M,) of each fault, by the first quantity's error.

    A run has recovered at the first step from which on its excess error stays below the limit, up to the
    next fault. Its time counts from the last step with the fault.
    """
    out: dict[str, Array] = {}
    series = next((name for name in values if name.partition("_")[0] == "damage"), None)
    if series is None:
        return out
    damage, squared = values[series], values[series.replace("damage", "squared", 1)]
    for fault in faults:
        after = windows.get(f"after {fault.name}")
        if after is None:
            continue
        # Step 1: the limit is a share of the twin's RMSE after the fault.
        twin = np.square(np.sqrt(squared[after]) - damage[after])
        known = ~np.isnan(twin)
        limit = fault.recovered * np.sqrt(total(np.where(known, twin, 0.0), 0) / known.sum(axis=0))
        # Step 2: the last step, from that of the fault's end on, with a larger excess.
        last = int(np.flatnonzero(context.measured(fault))[-1]) + 1
        places = np.append(last, np.flatnonzero(after))
        recovered = settled_row(damage[places] > limit)
        times = np.append(context.times[places] - context.times[last], np.nan)
        seconds = np.where(np.isnan(limit), np.nan, times[recovered])
        out[in_window("recovery_s", fault.name)] = seconds
        late = (recovered == len(places)).astype(float)
        out[in_window("not_recovered", fault.name)] = np.where(np.isnan(limit), np.nan, late)
    return out


def _latest(z: Array) -> Array:
    """Take each run's last value that exists (n_z, M); NaN without any."""
    out = np.full((len(z), z.shape[-1]), np.nan)
    for column in np.moveaxis(z, 1, 0):
        out = np.where(np.isnan(column), out, column)
    return out
