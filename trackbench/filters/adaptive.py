"""Variable-dimension filters: constant velocity in quiet, constant acceleration in a maneuver.

Modes and covariances are per run; a switch is a mask over runs.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.fading import significance_threshold, tail
from trackbench.core.input_estimation import Hypotheses, hypotheses
from trackbench.core.kalman import Innovation
from trackbench.core.sums import total
from trackbench.filters.axes import (
    Site,
    axis_step,
    both_axes,
    choose,
    first_components,
    over_axes,
    per_axis,
    site,
)
from trackbench.filters.base import PLANAR_POSITION, Filter
from trackbench.filters.refiltering import History, history, refiltered
from trackbench.filters.switching import (
    BELIEVE,
    PAPER_EXIT,
    Detector,
    Exit,
    SecondDecision,
    exit_cautions,
)
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.registry import register

QUIET, BOTH, TURNING = 0, 1, 2
_TENTH = significance_threshold(0.1)


class Switched(NamedTuple):
    """Both filters of M runs and what decides between them.

    ``quiet`` is the non-maneuvering filter (2 components per axis), ``turning`` the maneuvering one
    (3); ``mode`` (M,) which is on, ``since`` the step it began; ``rho`` the fading sum; ``evidence``
    the log-likelihood ratio of the second decision; ``recent`` (p, M) the acceleration's significance;
    ``nis`` of the reported filter; ``alarm`` where the first decision has just been made, ``age`` how
    long before, s, the maneuver is then taken to have begun, else NaN; ``zeta`` of the oldest onset;
    ``seen`` both filters' innovations, and where the maneuvering one was on.
    """

    quiet: Gaussian
    turning: Gaussian
    mode: Index
    since: Index
    rho: Array
    inputs: Hypotheses
    past: History | None
    evidence: Array
    recent: Array
    nis: Array
    zeta: Array
    alarm: Mask
    age: Array
    seen: tuple[Innovation, Innovation | None, Mask] | None = None


@register("filters", "adaptive-kf")
@dataclass(frozen=True, kw_only=True)
class AdaptiveKF(Filter[Switched]):
    """Adaptive Kalman filter: a detector starts an augmented filter, a test on it ends it.

    Tang, Sun & Liu, adaptive Kalman filter paper, section 3, after Bar-Shalom & Birmiwal 1982,
    Bogler 1987 and Park, Seo & Lee 1995. The paper states no process noise: both are keys here.
    """

    nmf: ConstantVelocity
    """motion of the non-maneuvering filter: {q: ..., noise_gain: standard | printed}"""
    mf: ConstantAcceleration
    """motion of the maneuvering filter; its first acceleration is the estimated one"""
    detector: Detector
    """first decision: statistic, threshold, window, onset"""
    dlw: SecondDecision = BELIEVE
    """second decision, between both filters"""
    exit: Exit = PAPER_EXIT
    """return to the non-maneuvering filter"""
    initialise: Literal["ie", "barshalom"] = "ie"
    """augmented start: estimated input added, or refiltered from the onset (1982)"""
    needs: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    counts: ClassVar[frozenset[str]] = frozenset({"alarm"})
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "paper-eta35": {"detector": {"kind": "fading-ie", "gamma": 0.8, "eta": 35.0}},
        "paper-eta20": {"detector": {"kind": "fading-ie", "gamma": 0.8, "eta": 20.0}},
        "seconds": {
            "detector": {"kind": "ie", "eta": 20.0, "window_s": 60.0, "min_window_s": 15.0},
            "exit": {"p": 2, "Ta": 9.49, "hold_s": 30.0},
        },
    }

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Windows that do not fit the scenario's runs."""
        return self.detector.conflicts(site(scenario.model).T, float(scenario.times[-1]))

    def cautions(self, scenario: Scene) -> list[str]:
        """What the exit test will do on the scenario's smallest turn."""
        here = site(scenario.model)
        smallest = min(scenario.turns, default=None)
        return exit_cautions(self.exit, self.mf, here.T, here.R, smallest)

    @classmethod
    def explain(cls) -> str:
        """What the paper's thresholds mean as false-alarm probabilities."""
        rows = [
            f"  eta = {eta:g}: P(rho > eta) = {tail(eta, 0.8):.2g} per sample at gamma = 0.8, "
            f"P(zeta > eta) = {np.exp(-eta / 2):.2g} per onset"
            for eta in (20.0, 35.0)
        ]
        head = "Without a maneuver (two axes, consistent filter, long run):"
        return "\n".join([head, *rows])

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Switched:
        """Every run quiet, at the prior."""
        quiet, here = per_axis(prior), site(model)
        runs, axes = quiet.mean.shape[-1], quiet.cov.shape[2]
        window = self.detector.window(here.T)
        idle = np.broadcast_to(np.eye(3)[:, :, None, None], (3, 3, axes, runs))
        zero, unknown = np.zeros(runs), np.full(runs, np.nan)
        return Switched(
            quiet=quiet,
            turning=Gaussian(np.zeros((3, 2, runs)), idle),
            mode=np.full(runs, QUIET),
            since=np.zeros(runs, dtype=np.intp),
            rho=zero,
            inputs=hypotheses(window, axes, runs),
            past=history(quiet, window) if self.initialise == "barshalom" else None,
            evidence=zero,
            recent=np.full((self.exit.p, runs), np.inf),
            nis=unknown,
            zeta=unknown,
            alarm=np.zeros(runs, dtype=np.bool_),
            age=unknown,
        )

    def step(self, model: Model, state: Switched, z: Array, k: int, rng: Generator) -> Switched:
        """Both filters, then the three decisions: alarm, confirmation, exit."""
        here = site(model)
        state, likelihoods = self._filtered(state, z, k, here)
        was, (alarm, slot, zeta) = state.mode, self._alarm(state, k, here)
        age = np.full(len(was), np.nan)
        if alarm.any():
            age = np.where(alarm, (k - state.inputs.onset(slot, k)) * here.T, age)
            state = self._augmented(state, alarm, slot, k, here)
        evidence = np.where(was == BOTH, state.evidence + likelihoods, 0.0)
        decided = (was == BOTH) & (k - state.since >= self.dlw.n)
        over = (was == TURNING) & self._is_over(state, k, here)
        state = state._replace(evidence=evidence, alarm=alarm, age=age, zeta=zeta)
        if (alarm | decided | over).any():
            confirmed = decided & (evidence > 0.0) | alarm & (self.dlw.n == 0)
            mode = np.where(alarm, BOTH, np.where(decided | over, QUIET, was))
            mode = np.where(confirmed, TURNING, mode)
            state = state._replace(
                mode=mode,
                since=np.where(mode != was, k, state.since),
                recent=np.where(confirmed, np.inf, state.recent),
            )
            state = self._quietened(state, over, k)
        return self._remembered(state, k)

    def estimate(self, state: Switched) -> Gaussian:
        """The maneuvering filter's position and velocity where it is on, else the other's."""
        turning = first_components(state.turning, 2)
        return both_axes(choose(state.mode == TURNING, turning, state.quiet))

    def log_likelihood(self, state: Switched) -> Array:
        """log N(innovation; 0, S) (M,) of the filter that was on when the measurement came."""
        if state.seen is None:
            return np.full(state.nis.shape, np.nan)
        quiet, turning, on = state.seen
        value = over_axes(quiet.log_likelihood)
        if turning is not None:
            value = np.where(on, over_axes(turning.log_likelihood), value)
        return np.where(np.isnan(quiet.nu).any(axis=(0, 1)), np.nan, value)

    def diagnostics(self, state: Switched) -> dict[str, Array]:
        """``nis``; ``mode``: 1 in the maneuvering filter; ``alarm``: the first decision, made now.

        ``alarm_age_s`` time since the onset that an alarm takes for true. Where that is the argmax of
        zeta: ``zeta`` of the window's oldest onset (eq. 5: in straight flight chi-square with two
        degrees of freedom), and ``zeta_beyond``: 1 above that law's 10 % point.
        """
        out = {
            "nis": state.nis,
            "mode": (state.mode == TURNING).astype(float),
            "alarm": state.alarm.astype(float),
            "alarm_age_s": state.age,
        }
        if self.detector.onset_rule == "argmax":
            beyond = (state.zeta > _TENTH).astype(float)
            out |= {"zeta": state.zeta, "zeta_beyond": beyond}
        return out

    def _filtered(self, s: Switched, z: Array, k: int, here: Site) -> tuple[Switched, Array]:
        """Both filters' steps, the statistics, and the log-likelihood ratio of turning (M,)."""
        T, R = here
        motion = self.nmf.axis(T)
        quiet, seen = axis_step(s.quiet, motion, z, R)
        nis, ratio = over_axes(seen.nis), np.zeros_like(s.rho)
        turning, recent, reported, seen_turning = s.turning, s.recent, nis, None
        if (s.mode != QUIET).any():
            turning, seen_turning = axis_step(s.turning, self.mf.axis(T), z, R)
            if (s.mode == BOTH).any():
                ratio = over_axes(seen_turning.log_likelihood) - over_axes(seen.log_likelihood)
            significance = over_axes(np.square(turning.mean[2]) / turning.cov[2, 2])
            recent = np.concatenate([s.recent[1:], significance[None]])
            reported = np.where(s.mode == TURNING, over_axes(seen_turning.nis), nis)
        missing = np.isnan(seen.nu).any(axis=(0, 1))
        inputs, past = s.inputs, s.past
        if self._estimates_inputs:
            g = np.array([T * T / 2, T])
            inputs = inputs.advanced(k, motion.F, g, quiet, seen, R)
        else:
            inputs = inputs.begun(k)
        if past is not None:
            past = past.measured(z, k)
        moved = s._replace(
            quiet=quiet,
            turning=turning,
            rho=np.where(missing, s.rho, self.detector.gamma * s.rho + nis),
            inputs=inputs,
            past=past,
            recent=recent,
            nis=np.where(missing, np.nan, reported),
            seen=(seen, seen_turning, s.mode == TURNING),
        )
        return moved, ratio

    @property
    def _estimates_inputs(self) -> bool:
        return self.initialise == "ie" or self.detector.onset_rule == "argmax"

    def _alarm(self, s: Switched, k: int, here: Site) -> tuple[Mask, Index, Array]:
        """The first decision (eqs. 5-7): which runs (M,), the slot of each one's onset, and ``zeta``."""
        detector, runs, oldest = self.detector, np.arange(len(s.rho)), s.zeta
        if detector.onset_rule == "argmax":
            zeta = s.inputs.significance()
            slot = zeta.argmax(axis=0)
            best = zeta[slot, runs]
            oldest = zeta[s.inputs.slot_of(s.inputs.width, k), runs]
        else:
            age = 1 if detector.onset_rule == "paper" else s.inputs.width
            slot = s.inputs.slot_of(age, k)
            best = s.rho
            if detector.kind == "ie":
                best = s.inputs.significance().max(axis=0)
        statistic = best if detector.kind == "ie" else s.rho
        onset = s.inputs.onset(slot, k)
        old_enough = k - onset >= detector.min_window(here.T)
        alarm = (statistic > detector.threshold) & old_enough & (s.mode == QUIET)
        if s.past is not None:
            alarm &= s.past.known(onset + 1)
        return alarm & (k >= detector.start), slot, oldest

    def _augmented(self, s: Switched, alarm: Mask, slot: Index, k: int, here: Site) -> Switched:
        """The maneuvering filter of the alarmed runs started at their onsets."""
        runs = np.flatnonzero(alarm)
        if s.past is None:
            here_and_now = Gaussian(s.quiet.mean[..., runs], s.quiet.cov[..., runs])
            started = s.inputs.chosen(slot[runs], runs).augmented(here_and_now)
        else:
            onset = s.inputs.onset(slot, k)[runs]
            started = refiltered(s.past, onset, runs, k, self.mf.axis(here.T), here)
        mean, cov = s.turning.mean.copy(), s.turning.cov.copy()
        mean[..., runs], cov[..., runs] = started.mean, started.cov
        return s._replace(turning=Gaussian(mean, cov))

    def _is_over(self, s: Switched, k: int, here: Site) -> Mask:
        """The acceleration has been insignificant over the last p samples (M,)."""
        held = (k - s.since) * here.T >= self.exit.hold_s
        return held & (total(s.recent, axis=0) < self.exit.Ta)

    def _quietened(self, s: Switched, over: Mask, k: int) -> Switched:
        """The non-maneuvering filter taken up again from the maneuvering one's marginal."""
        if not over.any():
            return s
        return s._replace(
            quiet=choose(over, first_components(s.turning, 2), s.quiet),
            rho=np.where(over, 0.0, s.rho),
            inputs=s.inputs.restarted(over, k),
        )

    def _remembered(self, s: Switched, k: int) -> Switched:
        """The windows moved on by one step."""
        past = s.past.filtered(s.quiet, k) if s.past is not None else None
        return s._replace(inputs=s.inputs.opened(k), past=past)
