"""Scenario `recorded`: measurements, and perhaps the truth, from files of one's own."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.streams import RunStreams, Streams
from trackbench.keys import DataError, DataFile, Finite, NonNegative, PartOf, Place
from trackbench.models.base import Model
from trackbench.registry import register
from trackbench.scenarios.base import Scenario, Simulation
from trackbench.scenarios.recordings import Recording, read_recording


@register("scenarios", "recorded")
@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded(Scenario):
    """Recorded data, filtered with the motion, sensor, steps and prior of another scenario.

    Runs count from 0 in the order of their numbers in the file. A step without a row, or with an
    empty cell, is predicted over. Without truth there are no error metrics; NIS, tracks and
    figures are there. Units are SI and radians, as everywhere inside.
    """

    like: Annotated[Scenario, PartOf("scenarios")]
    """scenario (kind and keys) whose motion, sensor, steps, windows and prior are used"""
    measurements: DataFile
    """CSV with the columns run, step and the sensor's components"""
    truth: DataFile | None = None
    """CSV with the columns run, step and the state's components; may hold the prior's step too"""
    prior_mean: tuple[Finite, ...] | None = None
    """mean of the first state, one number per component; default: the prior of `like`"""
    prior_sigma: tuple[NonNegative, ...] | None = None
    """standard deviations of the first state; with prior_mean only"""

    def __post_init__(self) -> None:
        if (self.prior_mean is None) != (self.prior_sigma is None):
            raise ValueError("prior_mean and prior_sigma go together")
        n = len(self.model.motion.components)
        for given in (self.prior_mean, self.prior_sigma):
            if given is not None and len(given) != n:
                names = ", ".join(self.model.motion.components)
                raise ValueError(f"the prior needs {n} numbers: {names}")
        truth, seen = self._read()
        content = hashlib.sha256(truth.tobytes() + seen.tobytes()).hexdigest()
        object.__setattr__(self, "_data", (truth, seen))
        keys = tuple(getattr(self, f.name) for f in fields(self))
        object.__setattr__(self, "_identity", (*keys, content))

    # Equal keys are not enough: a file may have been edited since it was read.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, Recorded) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        key: tuple[Any, ...] = self.__dict__.get("_identity", ())
        return key

    @property
    def model(self) -> Model:
        """Motion and sensor of `like`."""
        return self.like.model

    @property
    def steps(self) -> Index:
        """Steps of `like`."""
        return np.asarray(self.like.steps)

    @property
    def times(self) -> Array:
        """Times of `like`, s."""
        return np.asarray(self.like.times)

    @property
    def windows(self) -> dict[str, Mask]:
        """Windows of `like`."""
        return dict(self.like.windows)

    @property
    def lost_beyond(self) -> float | None:
        """Error beyond which a run counts as lost, of `like`."""
        return self.like.lost_beyond

    def run_metrics(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Further metrics of `like`, if there is a truth to hold them to."""
        return self.like.run_metrics(values) if self.has_truth else {}

    @property
    def contents(self) -> dict[str, str]:
        """Digest of all numbers that were read, by file."""
        paths = (self.measurements, self.truth)
        return {path: self._key[-1] for path in paths if path is not None}

    @property
    def has_truth(self) -> bool:
        """Whether errors can be measured."""
        return self.truth is not None

    @property
    def recorded_runs(self) -> int:
        """How many runs there are."""
        return int(self._recording[0].shape[-1])

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """The recorded runs of these numbers; a run beyond the last is empty."""
        assert isinstance(rng, RunStreams)
        truth, seen = (_columns(values, rng.runs) for values in self._recording)
        return Simulation(truth, seen, self._prior(rng, runs))

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Error vectors of `like`."""
        return self.like.errors(mean, truth)

    def _prior(self, rng: Streams, runs: int) -> Distribution:
        if self.prior_mean is None or self.prior_sigma is None:
            return self.like.simulate(rng, runs).prior
        mean = np.repeat(np.array(self.prior_mean)[:, None], runs, axis=1)
        return Gaussian(mean, np.diag(np.square(self.prior_sigma)))

    @property
    def _recording(self) -> tuple[Array, Array]:
        data: tuple[Array, Array] = self.__dict__["_data"]
        return data

    def _read(self) -> tuple[Array, Array]:
        """Truth (n_x, T + 1, M) and measurements (n_z, T, M) of the recorded runs."""
        steps = [int(k) for k in self.steps]
        seen = read_recording(self.measurements, self.model.sensor.components, steps[1:])
        names = self.model.motion.components
        if self.truth is None:
            empty = np.full((len(names), len(steps), len(seen.runs)), np.nan)
            return empty, seen.values
        return self._matched(read_recording(self.truth, names, steps), seen), seen.values

    def _matched(self, truth: Recording, seen: Recording) -> Array:
        strangers = sorted(set(truth.runs) - set(seen.runs))
        if strangers:
            assert self.truth is not None
            what = f"run {strangers[0]} has no measurements in {self.measurements}"
            raise DataError(Place(self.truth, 1, 1, what))
        out = np.full((*truth.values.shape[:2], len(seen.runs)), np.nan)
        out[..., [seen.runs.index(run) for run in truth.runs]] = truth.values
        return out


def _columns(values: Array, runs: tuple[int, ...]) -> Array:
    """The columns of these runs, NaN for runs that were not recorded."""
    out = np.full((*values.shape[:2], len(runs)), np.nan)
    there = [m for m in runs if m < values.shape[-1]]
    out[..., : len(there)] = values[..., there]
    return out
