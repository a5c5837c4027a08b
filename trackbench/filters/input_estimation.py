"""Filters that meet a maneuver by other means: VDF of 1982, input estimation of 1987."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.input_estimation import Hypotheses, hypotheses
from trackbench.core.kalman import Innovation
from trackbench.filters.adaptive import AdaptiveKF, Switched
from trackbench.filters.axes import axis_step, both_axes, choose, over_axes, per_axis, site
from trackbench.filters.base import PLANAR_POSITION, Filter
from trackbench.filters.switching import Detector, Exit
from trackbench.keys import Count, NonNegative, OpenShare, Positive
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.registry import register


@register("filters", "vdf")
@dataclass(frozen=True, kw_only=True)
class VDF(Filter[Switched]):
    """Variable-dimension filter (Bar-Shalom & Birmiwal 1982).

    A fading sum of the NIS raises the alarm; the maneuver is taken to have begun one window before, and
    the data are refiltered from there. It ends when the acceleration is insignificant. There is no
    onset estimate, no least window and no second decision. No alarm is raised before step 20.
    """

    nmf: ConstantVelocity
    """motion in quiet"""
    mf: ConstantAcceleration
    """motion in a maneuver"""
    gamma: OpenShare = 0.8
    """fading factor of the NIS; the window is 1 / (1 - gamma) samples"""
    eta: Positive | None = None
    """threshold of the fading sum; give this or alpha"""
    alpha: OpenShare | None = None
    """false-alarm probability at one sample"""
    p: Count = 2
    """samples over which the acceleration's significance is summed"""
    Ta: Positive = 9.49
    """threshold of that sum"""
    needs: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    excused: ClassVar[dict[str, str]] = {"kalman": "believes in motions of its own"}
    counts: ClassVar[frozenset[str]] = frozenset({"alarm"})

    def __post_init__(self) -> None:
        if (self.eta is None) == (self.alpha is None):
            raise ValueError("give one of eta and alpha")

    @property
    def machine(self) -> AdaptiveKF:
        """The same filter in the words of `adaptive-kf`."""
        return AdaptiveKF(
            nmf=self.nmf,
            mf=self.mf,
            detector=Detector(kind="fading", gamma=self.gamma, eta=self.eta, alpha=self.alpha),
            exit=Exit(p=self.p, Ta=self.Ta),
            initialise="barshalom",
        )

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """A window that does not fit the scenario's runs."""
        found = self.machine.conflicts(scenario)
        return {"gamma": next(iter(found.values()))} if found else {}

    def cautions(self, scenario: Scene) -> list[str]:
        """What the exit test will do on the scenario's smallest turn."""
        return self.machine.cautions(scenario)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Switched:
        """Every run quiet, at the prior."""
        return self.machine.init(model, prior, rng)

    def step(self, model: Model, state: Switched, z: Array, k: int, rng: Generator) -> Switched:
        """One step of the switching filter."""
        return self.machine.step(model, state, z, k, rng)

    def estimate(self, state: Switched) -> Gaussian:
        """Position and velocity of the filter that is on."""
        return self.machine.estimate(state)

    def log_likelihood(self, state: Switched) -> Array:
        """That of the filter that was on."""
        return self.machine.log_likelihood(state)

    def diagnostics(self, state: Switched) -> dict[str, Array]:
        """``nis``, ``mode``, ``alarm`` and ``alarm_age_s`` as of `adaptive-kf`."""
        return self.machine.diagnostics(state)


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
    needs: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    excused: ClassVar[dict[str, str]] = {"kalman": "believes in motions of its own"}
    counts: ClassVar[frozenset[str]] = frozenset({"alarm"})

    @property
    def detector(self) -> Detector:
        """The detector in the words of `adaptive-kf`."""
        return Detector(eta=self.eta, window_s=self.window_s, min_window_s=self.min_window_s)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Windows that do not fit the scenario's runs."""
        found = self.detector.conflicts(site(scenario.model).T, float(scenario.times[-1]))
        return {key.removeprefix("detector."): what for key, what in found.items()}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Corrected:
        """The prior."""
        quiet, here = per_axis(prior), site(model)
        runs, axes = quiet.mean.shape[-1], quiet.cov.shape[2]
        inputs = hypotheses(self.detector.window(here.T), axes, runs)
        unknown = np.full(runs, np.nan)
        return Corrected(quiet, inputs, unknown, np.zeros(runs, dtype=np.bool_), unknown)

    def step(self, model: Model, state: Corrected, z: Array, k: int, rng: Generator) -> Corrected:
        """Predict, update, and add the input of the most significant onset where it is one."""
        T, R = site(model)
        motion = self.motion.axis(T)
        quiet, seen = axis_step(state.quiet, motion, z, R)
        g = np.array([T * T / 2, T])
        inputs = state.inputs.advanced(k, motion.F, g, quiet, seen, R)
        zeta = inputs.significance()
        slot, runs = zeta.argmax(axis=0), np.arange(zeta.shape[1])
        age = k - inputs.onset(slot, k)
        alarm = (zeta[slot, runs] > self.eta) & (age >= self.detector.min_window(T))
        alarm &= k >= self.detector.start
        if alarm.any():
            # Where there is no alarm the slot may hold no information, and what is found is not used.
            found = inputs.chosen(slot, runs)
            quiet = choose(alarm, found.corrected(quiet), quiet)
            inputs = inputs.restarted(alarm, k)
        missing = np.isnan(seen.nu).any(axis=(0, 1))
        nis = np.where(missing, np.nan, over_axes(seen.nis))
        since = np.where(alarm, age * T, np.nan)
        return Corrected(quiet, inputs.opened(k), nis, alarm, since, seen)

    def estimate(self, state: Corrected) -> Gaussian:
        """The corrected filter."""
        return both_axes(state.quiet)

    def log_likelihood(self, state: Corrected) -> Array:
        """log N(innovation; 0, S) (M,) of the filter before a correction."""
        if state.seen is None:
            return np.full(state.nis.shape, np.nan)
        missing = np.isnan(state.seen.nu).any(axis=(0, 1))
        return np.where(missing, np.nan, over_axes(state.seen.log_likelihood))

    def diagnostics(self, state: Corrected) -> dict[str, Array]:
        """``nis``; ``mode`` and ``alarm``: 1 where the state was just corrected; ``alarm_age_s``."""
        alarm = state.alarm.astype(float)
        return {"nis": state.nis, "mode": alarm, "alarm": alarm, "alarm_age_s": state.age}
