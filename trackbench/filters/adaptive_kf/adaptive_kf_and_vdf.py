"""Kinds `adaptive-kf` and `vdf`: constant velocity in quiet flight, acceleration in a maneuver.

Tang, Sun & Liu, adaptive-kf paper, section 3, after Bar-Shalom & Birmiwal 1982, Bogler 1987 and
Park, Seo & Lee 1995. ``step`` is the paper's Figure 1, ``_run_filters`` is section 3.2, and the
functions below it are section 3.1 in its order. NMF and MF are the paper's non-maneuvering and
maneuvering filter. Each run has its own mode: a switch is a mask over runs.
"""

from abc import abstractmethod
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, Literal, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.read_only import fixed
from trackbench.core.sums import total
from trackbench.field_types import Count, OpenShare, Positive
from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import (
    CONFIRM_EVERY_ALARM,
    PAPER_EXIT,
    Detector,
    Exit,
    SecondDecision,
    exit_cautions,
    explain_thresholds,
    significance_threshold,
)
from trackbench.filters.adaptive_kf.per_axis import (
    Sampling,
    axis_step,
    both_axes,
    first_components,
    is_missing,
    per_axis,
    sampling_of,
    sum_over_axes,
    where_runs,
)
from trackbench.filters.adaptive_kf.refilter_from_onset import History, initial_history, refilter
from trackbench.filters.base import PLANAR_POSITION, Filter, JoinableFilter
from trackbench.filters.input_estimation import Hypotheses, empty_hypotheses
from trackbench.models.assume import OWN_MOTION
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.registry import register

NMF = 0
BOTH = 1
MF = 2
"""Filters that are on in a run."""
_TEN_PERCENT_POINT = significance_threshold(0.1)


class Parameters(NamedTuple):
    """Motions of both filters, and the decisions between them."""

    nmf: ConstantVelocity
    """motion of the non-maneuvering filter"""
    mf: ConstantAcceleration
    """motion of the maneuvering filter"""
    detector: Detector
    """first decision: whether the target maneuvers, and since when"""
    dlw: SecondDecision
    """second decision, the paper's decision logic window: whether the MF goes on alone"""
    exit: Exit
    """test that ends a maneuver"""
    initialize: Literal["ie", "barshalom"]
    """start of the MF: the estimated input added, or data refiltered from the onset (1982)"""

    @property
    def estimates_inputs(self) -> bool:
        """True if the MF or the onset needs the estimated inputs."""
        return self.initialize == "ie" or self.detector.onset_rule == "argmax"


class Mode(NamedTuple):
    """Filters that are on in each run (M,), the step since when, and the second decision's evidence."""

    active: Index
    since: Index
    evidence: Array
    """log-likelihood of the MF over that of the NMF, summed while both are on"""

    def switch(self, active: Index, k: int) -> "Mode":
        """Return the mode with the ``active`` filters (M,) switched on: NMF, BOTH or MF.

        Runs that change do so at step k.
        """
        return self._replace(active=active, since=np.where(active != self.active, k, self.since))


class DetectorState(NamedTuple):
    """Statistics of the decisions."""

    rho: Array
    """fading sum of the NIS (M,)"""
    inputs: Hypotheses
    """estimated input for each onset of the window"""
    history: History | None
    """window that is refiltered, with `initialize: barshalom`"""
    significance: Array
    """significance of the acceleration in the last p samples (p, M)"""


class StepRecord(NamedTuple):
    """Results of the last step (M,), for diagnostics and likelihood."""

    nis: Array
    """NIS of the reported filter"""
    alarm: Mask
    """the first decision has just found a maneuver"""
    age: Array
    """time since its onset, s; NaN without an alarm"""
    zeta: Array
    """zeta of the oldest onset"""
    nmf: Innovation | None = None
    """innovation of the NMF; None before the first step"""
    mf: Innovation | None = None
    """innovation of the MF; None if it was off in all runs"""
    reports_mf: Mask | None = None
    """the MF was the reported filter when the measurement came"""


class AdaptiveState(NamedTuple):
    """NMF (2 components per axis) and MF (3 components) of M runs, and the decisions between them."""

    nmf: Gaussian
    mf: Gaussian
    mode: Mode
    detector: DetectorState
    record: StepRecord


class VariableDimension(Filter[AdaptiveState]):
    """Base: a detector starts the MF, a second decision confirms it, a test on it ends it."""

    @property
    @abstractmethod
    def parameters(self) -> Parameters:
        """Motions and decisions, from the filter's keys."""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject windows that do not fit into the scenario's runs."""
        T = sampling_of(scenario.model).T
        return self.parameters.detector.conflicts(T, float(scenario.times[-1]))

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report an assumed motion as idle: the filter's motions are `nmf` and `mf`."""
        return OWN_MOTION

    def cautions(self, scenario: Scene) -> list[str]:
        """Note an exit test that fires in the scenario's smallest turn, or never after a long one."""
        T, R = sampling_of(scenario.model)
        smallest = min(scenario.turns, default=None)  # acceleration, m/s^2
        return exit_cautions(self.parameters.exit, self.parameters.mf, T, R, smallest)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> AdaptiveState:
        """Start the non-maneuvering filter (NMF) at the prior; the maneuvering one (MF) is off."""
        p = self.parameters
        nmf = per_axis(prior)
        runs = nmf.mean.shape[-1]
        axes = nmf.cov.shape[2]  # 1 if both axes of the plane share their covariance, else 2
        # One onset hypothesis per sample of the detection window.
        window = p.detector.window(sampling_of(model).T)
        # Only an MF that refilters the data since the onset needs past posteriors and measurements.
        past = initial_history(nmf, window) if p.initialize == "barshalom" else None
        # The MF has no estimate before the first alarm: mean zero, unit covariance.
        identity = np.broadcast_to(np.eye(3)[:, :, None, None], (3, 3, axes, runs))
        zero = np.zeros(runs)
        unknown = np.full(runs, np.nan)
        return AdaptiveState(
            nmf=nmf,
            mf=Gaussian(np.zeros((3, 2, runs)), identity),
            mode=Mode(
                active=np.full(runs, NMF), since=np.zeros(runs, dtype=np.intp), evidence=zero
            ),
            detector=DetectorState(
                rho=zero,
                inputs=empty_hypotheses(window, axes, runs),
                history=past,
                # Infinite: the exit test cannot fire before all the samples that it sums, exit.p of
                # them, are known.
                significance=np.full((p.exit.p, runs), np.inf),
            ),
            record=StepRecord(
                nis=unknown, alarm=np.zeros(runs, dtype=np.bool_), age=unknown, zeta=unknown
            ),
        )

    def step(
        self, model: Model, state: AdaptiveState, z: Array, k: int, rng: Generator
    ) -> AdaptiveState:
        """Run the filters, then decide: maneuver, confirmation, end (adaptive-kf paper, Figure 1)."""
        p = self.parameters
        sampling = sampling_of(model)
        # The non-maneuvering filter (NMF) is updated with the measurement, and the maneuvering one (MF)
        # if any run has it on; the statistics follow.
        state, nmf_nis = _run_filters(p, state, z, sampling)
        state = _update_statistics(p, state, nmf_nis, z, k, sampling)
        # First decision: is the target maneuvering, and since when? Then the MF starts.
        state, alarm, slot = _first_decision(p, state, k, sampling)
        if alarm.any():
            state = _start_mf(p, state, alarm, slot, k, sampling)
        # Second decision: n samples after the alarm the likelier filter goes on alone. `decided` marks
        # the runs in which these are over, `confirmed` those in which the MF goes on.
        confirmed, decided = _second_decision(p, state.mode, alarm, k)
        # Exit: `over` marks the runs in which the MF's acceleration is no longer significant.
        over = _exit_test(p, state, k, sampling)
        if (alarm | decided | over).any():
            # Both are on after an alarm; the MF goes on alone if it is confirmed, else the NMF.
            active = np.where(alarm, BOTH, np.where(decided | over, NMF, state.mode.active))
            # The exit test of a confirmed MF waits until all samples in its sum are this MF's own.
            significance = np.where(confirmed, np.inf, state.detector.significance)
            state = state._replace(
                mode=state.mode.switch(np.where(confirmed, MF, active), k),
                detector=state.detector._replace(significance=significance),
            )
            state = _return_to_nmf(state, over, k)
        return _advance_windows(state, k)

    def estimate(self, state: AdaptiveState) -> Gaussian:
        """Return position and velocity of the MF where it is on alone, else of the NMF."""
        mf = first_components(state.mf, 2)
        return both_axes(where_runs(state.mode.active == MF, mf, state.nmf))

    def log_likelihood(self, state: AdaptiveState) -> Array:
        """Evaluate log N(innovation; 0, S) (M,) of the filter that was reported before the step.

        That is the maneuvering filter (MF) in runs where it was on alone, else the non-maneuvering one
        (NMF).
        """
        nmf = state.record.nmf
        mf = state.record.mf
        if nmf is None:  # before the first step
            return np.full(state.record.nis.shape, np.nan)
        # The axes are independent: their log-likelihoods add up.
        value = sum_over_axes(nmf.log_likelihood)
        # Without an innovation of the MF it was off in all runs.
        if mf is not None and state.record.reports_mf is not None:
            value = np.where(state.record.reports_mf, sum_over_axes(mf.log_likelihood), value)
        # A step without a measurement has no predictive likelihood.
        return np.where(is_missing(nmf), np.nan, value)

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of `diagnostics`."""
        is_argmax = self.parameters.detector.onset_rule == "argmax"
        names = {"nis", "mode", "alarm", "alarm_age_s"}
        if is_argmax:
            names |= {"zeta", "zeta_beyond"}
        return frozenset(names)

    def diagnostics(self, state: AdaptiveState) -> dict[str, Array]:
        """Report ``nis``, ``mode``, ``alarm``, ``alarm_age_s``, ``zeta`` and ``zeta_beyond``.

        ``mode``: 1 where the maneuvering filter is on alone, 0 where the non-maneuvering one is, or both
        are between an alarm and its confirmation. ``alarm``: 1 where the first decision, the detector,
        has just found a maneuver. ``alarm_age_s``: time since its onset. If the onset is the argmax of
        zeta: ``zeta``, the significance of an acceleration, of the window's oldest onset (adaptive-kf
        paper, eq. 5: chi-square with two degrees of freedom in straight flight), and ``zeta_beyond``: 1
        above the 10 % point of that law.
        """
        record = state.record
        values = {
            "nis": record.nis,
            "mode": (state.mode.active == MF).astype(float),
            "alarm": record.alarm.astype(float),
            "alarm_age_s": record.age,
        }
        if self.parameters.detector.onset_rule == "argmax":
            beyond = (record.zeta > _TEN_PERCENT_POINT).astype(float)
            values |= {"zeta": record.zeta, "zeta_beyond": beyond}
        return values


def _run_filters(
    p: Parameters, state: AdaptiveState, z: Array, sampling: Sampling
) -> tuple[AdaptiveState, Array]:
    """Predict and update both filters, and compare them while both are on.

    They are the paper's non-maneuvering filter (NMF) and maneuvering filter (MF). Return the new state,
    and the NIS (M,) of the NMF, which is zero without a measurement.
    """
    T, R = sampling
    active = state.mode.active
    # The NMF in every run, the MF if any run has it on.
    nmf, of_nmf = axis_step(state.nmf, p.nmf.axis(T), z, R)
    mf = state.mf
    of_mf = None
    nis = nmf_nis = sum_over_axes(of_nmf.nis)
    evidence = np.zeros_like(state.mode.evidence)
    if (active != NMF).any():
        # In runs that have the MF off its state moves on, too; it is overwritten when the MF starts.
        mf, of_mf = axis_step(state.mf, p.mf.axis(T), z, R)
        # The NIS of the MF is reported where it is on alone.
        nis = np.where(active == MF, sum_over_axes(of_mf.nis), nis)
        # Evidence of the second decision: sum of log p(z | MF) - log p(z | NMF) while both are on.
        if (active == BOTH).any():
            ratio = sum_over_axes(of_mf.log_likelihood) - sum_over_axes(of_nmf.log_likelihood)
            evidence = np.where(active == BOTH, state.mode.evidence + ratio, 0.0)
    nis = np.where(is_missing(of_nmf), np.nan, nis)
    record = state.record._replace(nis=nis, nmf=of_nmf, mf=of_mf, reports_mf=active == MF)
    mode = state.mode._replace(evidence=evidence)
    return state._replace(nmf=nmf, mf=mf, mode=mode, record=record), nmf_nis


def _update_statistics(
    p: Parameters, state: AdaptiveState, nis: Array, z: Array, k: int, sampling: Sampling
) -> AdaptiveState:
    """Update the statistics of the first decision and of the exit test.

    ``nis`` (M,) is that of the non-maneuvering filter (NMF), 0 without a measurement, and z is (2, M).
    The statistics are rho, the fading sum of the NIS, and zeta, the significance of the acceleration
    that is estimated for each possible onset. The exit test reads the significance of the acceleration
    in the maneuvering filter (MF).
    """
    T, R = sampling
    # `past` is the history of the NMF, which only an MF that starts by refiltering needs.
    rho, inputs, past, significance = state.detector
    innovation = state.record.nmf
    assert innovation is not None
    # rho(k) = gamma rho(k-1) + NIS(k)
    rho = np.where(is_missing(innovation), rho, p.detector.gamma * rho + nis)
    # Acceleration and zeta for every onset in the window: an acceleration a adds [T^2/2, T]' a to
    # position and velocity.
    if p.estimates_inputs:
        g = np.array([T * T / 2, T])
        inputs = inputs.update(k, p.nmf.axis(T).F, g, state.nmf, innovation, R)
    else:
        inputs = inputs.with_start(k)  # only the earliest possible onset is stored
    if past is not None:
        past = past.add_measurement(z, k)
    # Exit test: a' P_a^-1 a of the MF's acceleration. `significance` (exit.p, M) has the last samples;
    # the newest replaces the oldest.
    if state.record.mf is not None:
        newest = sum_over_axes(np.square(state.mf.mean[2]) / state.mf.cov[2, 2])
        significance = np.concatenate([significance[1:], newest[None]])
    detector = DetectorState(rho=rho, inputs=inputs, history=past, significance=significance)
    return state._replace(detector=detector)


def _first_decision(
    p: Parameters, state: AdaptiveState, k: int, sampling: Sampling
) -> tuple[AdaptiveState, Mask, Index]:
    """Raise the alarms, and find the onset of each run's maneuver (adaptive-kf paper, eqs. 5 to 7).

    Return the state with the record of the alarms, the runs (M,) with an alarm, and the slots (M,) of
    the onsets in the window. The statistic is zeta, the significance of the estimated acceleration, for
    the kind "ie" (input estimation), else rho, the fading sum of the NIS.
    """
    detector = p.detector
    rho, inputs, past, _ = state.detector
    runs = np.arange(len(rho))
    oldest_zeta = state.record.zeta  # NaN unless the onset is the argmax of zeta
    # Onset t*: argmax of zeta over the window, or a fixed age, which is the newest onset as printed in
    # the paper, or the oldest of the window.
    statistic = rho
    if detector.onset_rule == "argmax":
        zeta = inputs.significance()
        slot = zeta.argmax(axis=0)
        if detector.kind == "ie":
            statistic = zeta[slot, runs]
        # For the diagnostics: unlike the largest zeta, that of a fixed onset is chi-square.
        oldest_zeta = zeta[inputs.slot_of(inputs.width, k), runs]
    else:
        age = 1 if detector.onset_rule == "paper" else inputs.width
        slot = inputs.slot_of(age, k)
        if detector.kind == "ie":
            statistic = inputs.significance().max(axis=0)
    onset = inputs.onset(slot, k)
    # Alarm: the statistic exceeds eta while the NMF (filter of straight flight) is on alone.
    alarm = (statistic > detector.threshold) & (state.mode.active == NMF) & (k >= detector.start)
    # An onset within the minimum window xi_min postpones the decision.
    alarm &= k - onset >= detector.min_window(sampling.T)
    # An MF that refilters the data, from the history `past`, starts at the first measurement after the
    # onset.
    if past is not None:
        alarm &= past.has_measurement(onset + 1)
    age_s = np.where(alarm, (k - onset) * sampling.T, np.nan)
    record = state.record._replace(alarm=alarm, age=age_s, zeta=oldest_zeta)
    return state._replace(record=record), alarm, slot


def _start_mf(
    p: Parameters, state: AdaptiveState, alarm: Mask, slot: Index, k: int, sampling: Sampling
) -> AdaptiveState:
    """Start the maneuvering filter (MF) in the runs with an ``alarm`` (M,), at their onsets t*.

    ``slot`` (M,) is the place of each onset in the window. The MF starts from the non-maneuvering filter
    (NMF) of now and the estimated acceleration (`initialize: ie`), or from the NMF at the onset, whose
    history is stored with `initialize: barshalom`.
    """
    runs = np.flatnonzero(alarm)
    inputs = state.detector.inputs
    past = state.detector.history
    if past is None:
        # The estimated input becomes the acceleration; its effect is added to position and velocity.
        nmf = Gaussian(state.nmf.mean[..., runs], state.nmf.cov[..., runs])
        started = inputs.select(slot[runs], runs).augment(nmf)
    else:
        # Start at the onset, and filter the measurements since then again.
        onset = inputs.onset(slot, k)[runs]
        motion = p.mf.axis(sampling.T)
        if motion.Q.ndim > 2:  # (3, 3, 1, M): filters with different q are joined side by side
            motion = motion._replace(Q=motion.Q[..., runs])
        started = refilter(past, onset, runs, k, motion, sampling)
    # Only the alarmed runs change.
    mean = state.mf.mean.copy()
    cov = state.mf.cov.copy()
    mean[..., runs] = started.mean
    cov[..., runs] = started.cov
    return state._replace(mf=Gaussian(mean, cov))


def _second_decision(p: Parameters, mode: Mode, alarm: Mask, k: int) -> tuple[Mask, Mask]:
    """Return the runs (M,) whose maneuver is confirmed, and those in which the comparison has ended.

    Non-maneuvering and maneuvering filter (MF) are compared by their log-likelihood ratio, the evidence.
    ``alarm`` (M,) marks the runs with an alarm at this step.
    """
    n = p.dlw.n  # length of the decision logic window (dlw), in samples
    # Decide n samples after the alarm; the MF wins with positive evidence (n = 0: at once).
    decided = (mode.active == BOTH) & (k - mode.since >= n)
    confirmed = decided & (mode.evidence > 0.0) | alarm & (n == 0)
    return confirmed, decided


def _exit_test(p: Parameters, state: AdaptiveState, k: int, sampling: Sampling) -> Mask:
    """Return the runs (M,) in which the maneuvering filter (MF) ends: no significant acceleration."""
    # The MF has been on alone for at least `hold_s`: `since` is the step at which it was confirmed.
    long_enough = (k - state.mode.since) * sampling.T >= p.exit.hold_s
    # The sum of the significances a' P_a^-1 a of the last `exit.p` samples is below Ta.
    insignificant = total(state.detector.significance, axis=0) < p.exit.Ta
    return (state.mode.active == MF) & long_enough & insignificant


def _return_to_nmf(state: AdaptiveState, over: Mask, k: int) -> AdaptiveState:
    """Start the non-maneuvering filter (NMF) again in the runs ``over`` (M,), with empty statistics.

    It starts from position and velocity of the maneuvering filter (MF), which `step` has switched off in
    these runs. The statistics are rho, the fading sum of the NIS, and the estimated inputs.
    """
    if not over.any():
        return state
    detector = state.detector._replace(
        rho=np.where(over, 0.0, state.detector.rho),
        inputs=state.detector.inputs.reset(over, k),
    )
    # Drop the acceleration from the MF state.
    nmf = where_runs(over, first_components(state.mf, 2), state.nmf)
    return state._replace(nmf=nmf, detector=detector)


def _advance_windows(state: AdaptiveState, k: int) -> AdaptiveState:
    """Replace the oldest onset in the window by the one after step k, and store the NMF's posterior."""
    detector = state.detector._replace(inputs=state.detector.inputs.add_onset(k))
    if detector.history is not None:
        detector = detector._replace(history=detector.history.add_posterior(state.nmf, k))
    return state._replace(detector=detector)


class JoinableVariableDimension(VariableDimension, JoinableFilter[AdaptiveState]):
    """Base of the filters that `SideBySide` joins."""

    def structure(self, scenario: Scene) -> Hashable:
        """Return the choices between algorithms and the lengths of arrays.

        Filters for which these are equal can be joined.
        """
        p = self.parameters
        window = p.detector.window(sampling_of(scenario.model).T)
        choices = (p.detector.kind, p.detector.onset_rule, p.initialize)
        lengths = (window, p.exit.p)
        return (type(self), *choices, *lengths)

    def joined(self, filters: Sequence[Filter[AdaptiveState]], width: int) -> "SideBySide":
        """Join the filters side by side."""
        return SideBySide(cast("tuple[VariableDimension, ...]", tuple(filters)), width)


@dataclass(frozen=True)
class SideBySide(VariableDimension):
    """Filters of one `structure`, each for ``width`` runs."""

    filters: tuple[VariableDimension, ...]
    width: int

    @cached_property
    def parameters(self) -> Parameters:
        """Motions of the non-maneuvering (nmf) and maneuvering filter (mf), and the decisions, per run.

        The decisions are ``detector``, the decision logic window ``dlw``, and ``exit``.
        """
        parameters = [single.parameters for single in self.filters]

        def joined(name: str) -> Any:
            return _PerRun([getattr(p, name) for p in parameters], self.width)

        return Parameters(
            nmf=joined("nmf"),
            mf=joined("mf"),
            detector=joined("detector"),
            dlw=joined("dlw"),
            exit=joined("exit"),
            initialize=parameters[0].initialize,  # equal in all filters of one `structure`
        )


class _PerRun:
    """Stand-in for several objects of a class, each for ``width`` runs.

    Its attributes, and the results of its methods, are those of the objects if these are equal, else
    arrays with a value per run.
    """

    def __init__(self, parts: Sequence[Any], width: int) -> None:
        self._parts = parts
        self._width = width

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of all objects as one, or a method that does so with its results."""
        values = [getattr(part, name) for part in self._parts]
        stacked = self._method(values) if callable(values[0]) else _per_run(values, self._width)
        self.__dict__[name] = stacked  # looked up at every step
        return stacked

    def _method(self, methods: Sequence[Callable[..., Any]]) -> Callable[..., Any]:
        return cache(lambda *args: _per_run([m(*args) for m in methods], self._width))


def _per_run(values: Sequence[Any], width: int) -> Any:
    """Return the value of several filters if it is equal for all, else an array over their runs.

    Each filter has ``width`` of the M runs. Numbers become (M,), matrices (n, n, 1, M): the axis of
    length 1 is that of the axes of the plane, along which all motions are alike.
    """
    first = values[0]
    if isinstance(first, tuple):  # F and Q of a motion
        columns = (_per_run(column, width) for column in zip(*values, strict=True))
        return type(first)(*columns)
    if all(np.array_equal(value, first) for value in values):
        return first
    rows = np.repeat(np.stack(values, axis=-1), width, axis=-1)
    return fixed(rows[:, :, None] if rows.ndim == 3 else rows)


@register("filters", "adaptive-kf")
@dataclass(frozen=True, kw_only=True)
class AdaptiveKF(JoinableVariableDimension):
    """Adaptive Kalman filter: a detector switches from constant velocity to constant acceleration.

    Tang, Sun & Liu, adaptive-kf paper, section 3, after Bar-Shalom & Birmiwal 1982, Bogler 1987 and
    Park, Seo & Lee 1995. The paper states no process noise: both filters have a key q.
    """

    nmf: ConstantVelocity
    """motion of the non-maneuvering filter: {q: ..., noise_gain: standard | printed}"""
    mf: ConstantAcceleration
    """motion of the maneuvering filter; the detector estimates its first acceleration"""
    detector: Detector
    """first decision: statistic, threshold, window, onset"""
    dlw: SecondDecision = CONFIRM_EVERY_ALARM
    """second decision, between both filters"""
    exit: Exit = PAPER_EXIT
    """return to the non-maneuvering filter"""
    initialize: Literal["ie", "barshalom"] = "ie"
    """start of the maneuvering filter: estimated input added, or refiltered from the onset (1982)"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"alarm"})
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "paper-eta35": {"detector": {"kind": "fading-ie", "gamma": 0.8, "eta": 35.0}},
        "paper-eta20": {"detector": {"kind": "fading-ie", "gamma": 0.8, "eta": 20.0}},
        "seconds": {
            "detector": {"kind": "ie", "eta": 20.0, "window_s": 60.0, "min_window_s": 15.0},
            "exit": {"p": 2, "Ta": 9.49, "hold_s": 30.0},
        },
    }

    @property
    def parameters(self) -> Parameters:
        """Motions of the non-maneuvering (nmf) and maneuvering filter (mf), and the decisions.

        ``detector`` raises alarms, ``dlw``, the decision logic window, confirms or rejects them, and
        ``exit`` ends a maneuver.
        """
        return Parameters(
            nmf=self.nmf,
            mf=self.mf,
            detector=self.detector,
            dlw=self.dlw,
            exit=self.exit,
            initialize=self.initialize,
        )

    @classmethod
    def explain(cls) -> str:
        """Explain the false-alarm probabilities of the thresholds in the paper."""
        return explain_thresholds()


@register("filters", "vdf")
@dataclass(frozen=True, kw_only=True)
class VDF(JoinableVariableDimension):
    """Variable-dimension filter: refilters the last window with an acceleration after an alarm.

    Bar-Shalom & Birmiwal 1982. A fading sum of the NIS raises the alarm, not before step 20. The
    onset of the maneuver is the begin of the window. The maneuver ends when the acceleration is
    insignificant.
    """

    nmf: ConstantVelocity
    """motion in quiet flight"""
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
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "has motions of its own"}
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"alarm"})

    def __post_init__(self) -> None:
        if (self.eta is None) == (self.alpha is None):
            raise ValueError("give one of eta and alpha")

    @property
    def parameters(self) -> Parameters:
        """Motions of the non-maneuvering (nmf) and maneuvering filter (mf), and the decisions.

        The fading sum of the NIS raises alarms, and the onset is the oldest sample of the sum's window.
        """
        # A fading detector without a key `onset` takes the begin of its window.
        detector = Detector(kind="fading", gamma=self.gamma, eta=self.eta, alpha=self.alpha)
        leave = Exit(p=self.p, Ta=self.Ta)
        return Parameters(
            nmf=self.nmf,
            mf=self.mf,
            detector=detector,
            dlw=CONFIRM_EVERY_ALARM,  # second decision (decision logic window)
            exit=leave,
            initialize="barshalom",  # the maneuvering filter refilters the data since the onset
        )

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a window that does not fit into the scenario's runs."""
        misfits = super().conflicts(scenario)
        if not misfits:
            return {}
        # The only window is that of `gamma`.
        return {"gamma": next(iter(misfits.values()))}
