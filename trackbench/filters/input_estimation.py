"""Input estimation filter: corrects the state by the estimated input of a maneuver (1979, 1987)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.field_types import NonNegative, Positive, Unit
from trackbench.filters.adaptive_kf.decision_keys import Detector
from trackbench.filters.adaptive_kf.maneuver_estimate import Hypotheses, empty_hypotheses
from trackbench.filters.adaptive_kf.per_axis import (
    axis_step,
    both_axes,
    is_missing,
    per_axis,
    sampling_of,
    sum_over_axes,
    where_runs,
)
from trackbench.filters.base import PLANAR_POSITION, Filter
from trackbench.models.assume import OWN_MOTION
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.registry import register


class Corrected(NamedTuple):
    """Filter (2, 2, M) with the estimated inputs of the window."""

    filter: Gaussian
    inputs: Hypotheses
    nis: Array
    alarm: Mask
    """runs (M,) corrected in the last step"""
    age: Array
    """time since the onset of their input (M,), s"""
    innovation: Innovation | None = None


@register("filters", "input-estimation")
@dataclass(frozen=True, kw_only=True)
class InputEstimation(Filter[Corrected]):
    """Input estimation filter: constant velocity, corrected by the input of a detected maneuver.

    Chan, Hu & Plant 1979; Bogler 1987. If the input of an onset in the window is significant, the
    filter adds it with its uncertainty, ``x + M u`` and ``P + M L M'``, and the window begins
    again. No alarm is raised before step 20.
    """

    motion: ConstantVelocity
    """motion of the filter"""
    eta: Positive = 20.0
    """threshold of zeta, chi-square with two degrees of freedom for one onset"""
    window_s: Annotated[Positive, Unit("s")] = 60.0
    """length of the window of onsets, s"""
    min_window_s: NonNegative = 15.0
    """least age of an onset, s: a more recent one postpones the correction"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "has motions of its own"}
    diagnostic_names = frozenset({"nis", "mode", "alarm", "alarm_age_s"})
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"alarm"})

    @property
    def detector(self) -> Detector:
        """Detector, as one of `adaptive-kf`."""
        return Detector(eta=self.eta, window_s=self.window_s, min_window_s=self.min_window_s)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject windows that do not fit into the scenario's runs."""
        T = sampling_of(scenario.model).T
        misfits = self.detector.conflicts(T, float(scenario.times[-1]))
        # The detector's keys are keys of this filter.
        return {key.removeprefix("detector."): message for key, message in misfits.items()}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report an assumed motion as idle: the filter's own is `motion`."""
        return OWN_MOTION

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Corrected:
        """Start the filter at the prior, without inputs."""
        state = per_axis(prior)
        runs = state.mean.shape[-1]
        # The covariance is (2, 2, A, M), with A = 1 if both axes of the plane share it.
        axes = state.cov.shape[2]
        inputs = empty_hypotheses(self.detector.window(sampling_of(model).T), axes, runs)
        unknown = np.full(runs, np.nan)
        no_alarm = np.zeros(runs, dtype=np.bool_)
        # `age` is the time since the onset of the input in s, NaN without an alarm.
        return Corrected(filter=state, inputs=inputs, nis=unknown, alarm=no_alarm, age=unknown)

    def step(self, model: Model, state: Corrected, z: Array, k: int, rng: Generator) -> Corrected:
        """Predict, update, and add the input of the most significant onset."""
        # Step 1: predict and update with constant velocity.
        T, R = sampling_of(model)
        motion = self.motion.axis(T)
        posterior, innovation = axis_step(state.filter, motion, z, R)
        # Step 2: update, for every onset, the estimated input and its significance zeta, which without
        # an input is chi-square of two degrees. An acceleration adds [T^2/2, T]' a.
        g = np.array([T * T / 2, T])
        inputs = state.inputs.update(k, motion.F, g, posterior, innovation, R)
        zeta = inputs.significance()  # (W, M), of W onsets
        # Step 3: alarm if the largest zeta exceeds eta, its onset is old enough, and the detector is on,
        # from its step `start`.
        slot = zeta.argmax(axis=0)
        runs = np.arange(zeta.shape[1])
        age = k - inputs.onset(slot, k)  # steps
        alarm = (zeta[slot, runs] > self.eta) & (age >= self.detector.min_window(T))
        alarm &= k >= self.detector.start
        # Step 4: in the runs with an alarm add the input u of variance L, by its effect M on the state:
        # x + M u, P + M L M'. In other runs u may be NaN, and `where_runs` leaves it out.
        if alarm.any():
            corrected = inputs.select(slot, runs).correct(posterior)
            posterior = where_runs(alarm, corrected, posterior)
            inputs = inputs.reset(alarm, k)
        nis = np.where(is_missing(innovation), np.nan, sum_over_axes(innovation.nis))
        age_s = np.where(alarm, age * T, np.nan)
        return Corrected(
            filter=posterior,
            inputs=inputs.add_onset(k),
            nis=nis,
            alarm=alarm,
            age=age_s,
            innovation=innovation,
        )

    def estimate(self, state: Corrected) -> Gaussian:
        """Return the corrected filter."""
        return both_axes(state.filter)

    def log_likelihood(self, state: Corrected) -> Array:
        """Evaluate log N(innovation; 0, S) (M,) of the filter before a correction."""
        if state.innovation is None:
            return np.full(state.nis.shape, np.nan)
        log_likelihood = sum_over_axes(state.innovation.log_likelihood)
        return np.where(is_missing(state.innovation), np.nan, log_likelihood)

    def diagnostics(self, state: Corrected) -> dict[str, Array]:
        """Report ``nis``, ``alarm_age_s``, and ``mode`` and ``alarm``: 1 where just corrected."""
        alarm = state.alarm.astype(float)
        return {"nis": state.nis, "mode": alarm, "alarm": alarm, "alarm_age_s": state.age}
