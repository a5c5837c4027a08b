"""A filter that meets a maneuver by adding the input that it estimates (1979, 1987)."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.input_estimation import Hypotheses, empty_hypotheses
from trackbench.core.kalman import Innovation
from trackbench.field_types import NonNegative, Positive
from trackbench.filters.adaptive_kf.decisions import Detector
from trackbench.filters.adaptive_kf.per_axis import (
    axis_step,
    both_axes,
    choose,
    over_axes,
    per_axis,
    site,
)
from trackbench.filters.base import OWN_MOTION, PLANAR_POSITION, Filter
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.registry import register


class Corrected(NamedTuple):
    """The filter (2, 2, M), its hypotheses, the NIS, the runs corrected now, and the inputs' age, s.

    ``seen`` is the innovation, once there is one.
    """

    quiet: Gaussian
    inputs: Hypotheses
    nis: Array
    alarm: Mask
    age: Array
    seen: Innovation | None = None


@register("filters", "input-estimation")
@dataclass(frozen=True, kw_only=True)
class InputEstimation(Filter[Corrected]):
    """Input estimation: a constant-velocity filter whose state is corrected by a detected input.

    Chan, Hu & Plant 1979; Bogler 1987. A significant input of any onset in the window is added with its
    uncertainty, ``x + M u`` and ``P + M L M'``, and the window begins anew; the model stays the same.
    No alarm is raised before step 20.
    """

    motion: ConstantVelocity
    """motion of the filter"""
    eta: Positive = 20.0
    """threshold of zeta, chi-square with two degrees of freedom for one onset"""
    window_s: Positive = 60.0
    """length of the window of onsets, s"""
    min_window_s: NonNegative = 15.0
    """an onset nearer than this is waited for, s"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "believes in motions of its own"}
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"alarm"})

    @property
    def detector(self) -> Detector:
        """The detector in the words of `adaptive-kf`."""
        return Detector(eta=self.eta, window_s=self.window_s, min_window_s=self.min_window_s)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Windows that do not fit the scenario's runs."""
        found = self.detector.conflicts(site(scenario.model).T, float(scenario.times[-1]))
        return {key.removeprefix("detector."): what for key, what in found.items()}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Its motion is `motion`."""
        return OWN_MOTION

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Corrected:
        """The prior."""
        quiet, here = per_axis(prior), site(model)
        runs, axes = quiet.mean.shape[-1], quiet.cov.shape[2]
        inputs = empty_hypotheses(self.detector.window(here.T), axes, runs)
        unknown = np.full(runs, np.nan)
        return Corrected(quiet, inputs, unknown, np.zeros(runs, dtype=np.bool_), unknown)

    def step(self, model: Model, state: Corrected, z: Array, k: int, rng: Generator) -> Corrected:
        """Predict, update, and add the input of the most significant onset where it is one."""
        T, R = site(model)
        motion = self.motion.axis(T)
        quiet, seen = axis_step(state.quiet, motion, z, R)
        g = np.array([T * T / 2, T])
        inputs = state.inputs.update(k, motion.F, g, quiet, seen, R)
        zeta = inputs.significance()
        slot, runs = zeta.argmax(axis=0), np.arange(zeta.shape[1])
        age = k - inputs.onset(slot, k)
        alarm = (zeta[slot, runs] > self.eta) & (age >= self.detector.min_window(T))
        alarm &= k >= self.detector.start
        if alarm.any():
            # Where there is no alarm the slot may hold no information, and what is found is not used.
            found = inputs.select(slot, runs)
            quiet = choose(alarm, found.correct(quiet), quiet)
            inputs = inputs.reset(alarm, k)
        missing = np.isnan(seen.nu).any(axis=(0, 1))
        nis = np.where(missing, np.nan, over_axes(seen.nis))
        since = np.where(alarm, age * T, np.nan)
        return Corrected(quiet, inputs.add_onset(k), nis, alarm, since, seen)

    def estimate(self, state: Corrected) -> Gaussian:
        """The corrected filter."""
        return both_axes(state.quiet)

    def log_likelihood(self, state: Corrected) -> Array:
        """log N(innovation; 0, S) (M,) of the filter before a correction."""
        if state.seen is None:
            return np.full(state.nis.shape, np.nan)
        missing = np.isnan(state.seen.nu).any(axis=(0, 1))
        return np.where(missing, np.nan, over_axes(state.seen.log_likelihood))

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return frozenset({"nis", "mode", "alarm", "alarm_age_s"})

    def diagnostics(self, state: Corrected) -> dict[str, Array]:
        """``nis``; ``mode`` and ``alarm``: 1 where the state was just corrected; ``alarm_age_s``."""
        alarm = state.alarm.astype(float)
        return {"nis": state.nis, "mode": alarm, "alarm": alarm, "alarm_age_s": state.age}
