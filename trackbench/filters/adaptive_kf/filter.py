"""Constant velocity in quiet, constant acceleration in a maneuver: section 3 of the adaptive-kf paper.

Tang, Sun & Liu, after Bar-Shalom & Birmiwal 1982, Bogler 1987 and Park, Seo & Lee 1995. ``step`` is the
paper's Figure 1, section 3.2 is ``_filtered``, and the functions below it are section 3.1 in its order.
Modes and covariances are per run; a switch is a mask over runs.
"""

from abc import abstractmethod
from typing import Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.fading_memory import significance_threshold
from trackbench.core.input_estimation import Hypotheses, empty_hypotheses
from trackbench.core.kalman import Innovation
from trackbench.core.sums import total
from trackbench.filters.adaptive_kf.decisions import Detector, Exit, SecondDecision, exit_cautions
from trackbench.filters.adaptive_kf.per_axis import (
    Site,
    axis_step,
    both_axes,
    choose,
    first_components,
    over_axes,
    per_axis,
    site,
)
from trackbench.filters.adaptive_kf.restart import History, history, refiltered
from trackbench.filters.base import OWN_MOTION, Filter
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity

QUIET, BOTH, TURNING = 0, 1, 2
_TENTH = significance_threshold(0.1)


class Logic(NamedTuple):
    """Motions of the non-maneuvering and the maneuvering filter (NMF, MF), and the decisions on them.

    ``initialise`` is the augmented start: the estimated input added, or data refiltered from the onset
    on (1982).
    """

    nmf: ConstantVelocity
    mf: ConstantAcceleration
    detector: Detector
    dlw: SecondDecision
    exit: Exit
    initialise: Literal["ie", "barshalom"]

    @property
    def estimates_inputs(self) -> bool:
        """Whether anything is made of the estimated inputs."""
        return self.initialise == "ie" or self.detector.onset_rule == "argmax"


class Mode(NamedTuple):
    """Per run (M,): QUIET, BOTH or TURNING; the step it began; the second decision's evidence."""

    on: Index
    since: Index
    evidence: Array

    def switched(self, on: Index, k: int) -> "Mode":
        """Other filters on at step k."""
        return self._replace(on=on, since=np.where(on != self.on, k, self.since))


class Watch(NamedTuple):
    """What the decisions stand on.

    ``rho`` (M,) is the fading sum, ``inputs`` what an input of each onset would have been, ``past`` the
    window that is refiltered, ``recent`` (p, M) the acceleration's significance.
    """

    rho: Array
    inputs: Hypotheses
    past: History | None
    recent: Array


class Seen(NamedTuple):
    """What the last scan told (M,): NIS of the reported filter, and the first decision.

    ``alarm`` is where it has just been made, ``age`` how long before, s, the maneuver is then taken to
    have begun, else NaN; ``zeta`` of the oldest onset; ``innovations`` of both filters, and where the
    maneuvering one was on.
    """

    nis: Array
    alarm: Mask
    age: Array
    zeta: Array
    innovations: tuple[Innovation, Innovation | None, Mask] | None = None


class Switched(NamedTuple):
    """The NMF (2 components per axis) and the MF (3) of M runs, and what decides between them."""

    quiet: Gaussian
    turning: Gaussian
    mode: Mode
    watch: Watch
    seen: Seen


class VariableDimension(Filter[Switched]):
    """A detector starts an augmented filter, a second decision confirms it, a test on it ends it."""

    @property
    @abstractmethod
    def logic(self) -> Logic:
        """Motions and decisions, from the filter's keys."""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Windows that do not fit the scenario's runs."""
        return self.logic.detector.conflicts(site(scenario.model).T, float(scenario.times[-1]))

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Its motions are `nmf` and `mf`."""
        return OWN_MOTION

    def cautions(self, scenario: Scene) -> list[str]:
        """What the exit test will do on the scenario's smallest turn."""
        here = site(scenario.model)
        smallest = min(scenario.turns, default=None)
        return exit_cautions(self.logic.exit, self.logic.mf, here.T, here.R, smallest)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Switched:
        """Every run quiet, at the prior."""
        logic, quiet = self.logic, per_axis(prior)
        runs, axes = quiet.mean.shape[-1], quiet.cov.shape[2]
        window = logic.detector.window(site(model).T)
        idle = np.broadcast_to(np.eye(3)[:, :, None, None], (3, 3, axes, runs))
        zero, unknown = np.zeros(runs), np.full(runs, np.nan)
        past = history(quiet, window) if logic.initialise == "barshalom" else None
        never = np.full((logic.exit.p, runs), np.inf)
        return Switched(
            quiet,
            Gaussian(np.zeros((3, 2, runs)), idle),
            Mode(np.full(runs, QUIET), np.zeros(runs, dtype=np.intp), zero),
            Watch(zero, empty_hypotheses(window, axes, runs), past, never),
            Seen(unknown, np.zeros(runs, dtype=np.bool_), unknown, unknown),
        )

    def step(self, model: Model, state: Switched, z: Array, k: int, rng: Generator) -> Switched:
        """Both filters, then the three decisions: alarm, confirmation, exit (Figure 1)."""
        logic, here = self.logic, site(model)
        s = _filtered(logic, state, z, k, here)
        s, alarm, slot = _first_decision(logic, s, k, here)
        if alarm.any():
            s = _augmented(logic, s, alarm, slot, k, here)
        confirmed, decided = _second_decision(logic, s.mode, alarm, k)
        over = _is_over(logic, s, k, here)
        if (alarm | decided | over).any():
            on = np.where(alarm, BOTH, np.where(decided | over, QUIET, s.mode.on))
            recent = np.where(confirmed, np.inf, s.watch.recent)
            s = s._replace(
                mode=s.mode.switched(np.where(confirmed, TURNING, on), k),
                watch=s.watch._replace(recent=recent),
            )
            s = _quietened(s, over, k)
        return _remembered(s, k)

    def estimate(self, state: Switched) -> Gaussian:
        """The maneuvering filter's position and velocity where it is on, else the other's."""
        turning = first_components(state.turning, 2)
        return both_axes(choose(state.mode.on == TURNING, turning, state.quiet))

    def log_likelihood(self, state: Switched) -> Array:
        """log N(innovation; 0, S) (M,) of the filter that was on when the measurement came."""
        if state.seen.innovations is None:
            return np.full(state.seen.nis.shape, np.nan)
        quiet, turning, on = state.seen.innovations
        value = over_axes(quiet.log_likelihood)
        if turning is not None:
            value = np.where(on, over_axes(turning.log_likelihood), value)
        return np.where(np.isnan(quiet.nu).any(axis=(0, 1)), np.nan, value)

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        of_onset = {"zeta", "zeta_beyond"} if self.logic.detector.onset_rule == "argmax" else set()
        return frozenset({"nis", "mode", "alarm", "alarm_age_s", *of_onset})

    def diagnostics(self, state: Switched) -> dict[str, Array]:
        """``nis``; ``mode``: 1 in the maneuvering filter; ``alarm``: the first decision, made now.

        ``alarm_age_s`` time since the onset that an alarm takes for true. Where that is the argmax of
        zeta: ``zeta`` of the window's oldest onset (eq. 5: in straight flight chi-square with two
        degrees of freedom), and ``zeta_beyond``: 1 above that law's 10 % point.
        """
        seen = state.seen
        out = {
            "nis": seen.nis,
            "mode": (state.mode.on == TURNING).astype(float),
            "alarm": seen.alarm.astype(float),
            "alarm_age_s": seen.age,
        }
        if self.logic.detector.onset_rule == "argmax":
            beyond = (seen.zeta > _TENTH).astype(float)
            out |= {"zeta": seen.zeta, "zeta_beyond": beyond}
        return out


def _filtered(logic: Logic, s: Switched, z: Array, k: int, here: Site) -> Switched:
    """Section 3.2: the NMF, and the MF where it runs (eqs. 8-12), and what they are watched by."""
    (T, R), watch, on = here, s.watch, s.mode.on
    motion = logic.nmf.axis(T)
    quiet, seen = axis_step(s.quiet, motion, z, R)
    nis, ratio = over_axes(seen.nis), np.zeros_like(watch.rho)
    turning, recent, reported, seen_turning = s.turning, watch.recent, nis, None
    if (on != QUIET).any():
        turning, seen_turning = axis_step(s.turning, logic.mf.axis(T), z, R)
        if (on == BOTH).any():
            ratio = over_axes(seen_turning.log_likelihood) - over_axes(seen.log_likelihood)
        significance = over_axes(np.square(turning.mean[2]) / turning.cov[2, 2])
        recent = np.concatenate([recent[1:], significance[None]])
        reported = np.where(on == TURNING, over_axes(seen_turning.nis), nis)
    missing = np.isnan(seen.nu).any(axis=(0, 1))
    if logic.estimates_inputs:
        g = np.array([T * T / 2, T])
        inputs = watch.inputs.update(k, motion.F, g, quiet, seen, R)
    else:
        inputs = watch.inputs.with_start(k)
    past = watch.past.measured(z, k) if watch.past is not None else None
    rho = np.where(missing, watch.rho, logic.detector.gamma * watch.rho + nis)
    evidence = np.where(on == BOTH, s.mode.evidence + ratio, 0.0)
    return Switched(
        quiet,
        turning,
        s.mode._replace(evidence=evidence),
        Watch(rho, inputs, past, recent),
        s.seen._replace(
            nis=np.where(missing, np.nan, reported),
            innovations=(seen, seen_turning, on == TURNING),
        ),
    )


def _first_decision(logic: Logic, s: Switched, k: int, here: Site) -> tuple[Switched, Mask, Index]:
    """Is the target maneuvering (eqs. 5, 6), and since when (eq. 7)? The onset's slot per run."""
    detector, (rho, inputs, past, _) = logic.detector, s.watch
    runs, oldest = np.arange(len(rho)), s.seen.zeta
    if detector.onset_rule == "argmax":
        zeta = inputs.significance()
        slot = zeta.argmax(axis=0)
        best = zeta[slot, runs]
        oldest = zeta[inputs.slot_of(inputs.width, k), runs]
    else:
        age = 1 if detector.onset_rule == "paper" else inputs.width
        slot = inputs.slot_of(age, k)
        best = inputs.significance().max(axis=0) if detector.kind == "ie" else rho
    statistic = best if detector.kind == "ie" else rho
    onset = inputs.onset(slot, k)
    alarm = (statistic > detector.threshold) & (s.mode.on == QUIET) & (k >= detector.start)
    alarm &= k - onset >= detector.min_window(here.T)  # xi_min: else the decision is postponed
    if past is not None:
        alarm &= past.known(onset + 1)
    age_s = np.where(alarm, (k - onset) * here.T, np.nan)
    return s._replace(seen=s.seen._replace(alarm=alarm, age=age_s, zeta=oldest)), alarm, slot


def _augmented(logic: Logic, s: Switched, alarm: Mask, slot: Index, k: int, here: Site) -> Switched:
    """The maneuvering filter of the alarmed runs started at their onsets t*."""
    runs, inputs = np.flatnonzero(alarm), s.watch.inputs
    if s.watch.past is None:
        here_and_now = Gaussian(s.quiet.mean[..., runs], s.quiet.cov[..., runs])
        started = inputs.select(slot[runs], runs).augment(here_and_now)
    else:
        onset = inputs.onset(slot, k)[runs]
        started = refiltered(s.watch.past, onset, runs, k, logic.mf.axis(here.T), here)
    mean, cov = s.turning.mean.copy(), s.turning.cov.copy()
    mean[..., runs], cov[..., runs] = started.mean, started.cov
    return s._replace(turning=Gaussian(mean, cov))


def _second_decision(logic: Logic, mode: Mode, alarm: Mask, k: int) -> tuple[Mask, Mask]:
    """Runs whose alarm is believed, and those of which both filters have run long enough."""
    n = logic.dlw.n
    decided = (mode.on == BOTH) & (k - mode.since >= n)
    return decided & (mode.evidence > 0.0) | alarm & (n == 0), decided


def _is_over(logic: Logic, s: Switched, k: int, here: Site) -> Mask:
    """The acceleration has been insignificant over the last p samples (M,)."""
    held = (k - s.mode.since) * here.T >= logic.exit.hold_s
    return (s.mode.on == TURNING) & held & (total(s.watch.recent, axis=0) < logic.exit.Ta)


def _quietened(s: Switched, over: Mask, k: int) -> Switched:
    """The non-maneuvering filter taken up again from the maneuvering one's marginal."""
    if not over.any():
        return s
    rho, inputs = np.where(over, 0.0, s.watch.rho), s.watch.inputs.reset(over, k)
    return s._replace(
        quiet=choose(over, first_components(s.turning, 2), s.quiet),
        watch=s.watch._replace(rho=rho, inputs=inputs),
    )


def _remembered(s: Switched, k: int) -> Switched:
    """The windows moved on by one step."""
    past = s.watch.past.filtered(s.quiet, k) if s.watch.past is not None else None
    return s._replace(watch=s.watch._replace(inputs=s.watch.inputs.add_onset(k), past=past))
