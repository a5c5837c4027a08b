"""Run one filter over one block of runs: time each step, validate the estimates, compute errors."""

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.random import Generator

from trackbench.component_parts import foreign_parts
from trackbench.core.angles import moments_together, near, particles_together
from trackbench.core.arrays import Array, Mask, any_nan
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.latest_results import LatestResults
from trackbench.core.posterior_scores import ParticlePosterior
from trackbench.core.random_streams import aside_stream, block_stream, side_by_side
from trackbench.core.read_only import explain_read_only_errors, freeze
from trackbench.errors import counted
from trackbench.evaluation.allowed_metric_names import check_diagnostic_names
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.calibration import Calibration
from trackbench.evaluation.late_measurements import Deliveries, Refilter, deliveries
from trackbench.evaluation.nees import ConsistencySeries, leave_out_known_start
from trackbench.evaluation.posterior_mean_errors import observable_errors
from trackbench.evaluation.predictive_scores import PredictionScorer, Step, with_nan_first
from trackbench.evaluation.shared_arrays import sealed
from trackbench.evaluation.state_copies import make_state_copier
from trackbench.evaluation.validate_output import (
    check_axes,
    check_estimate,
    check_numbers,
    check_symmetry,
)
from trackbench.filters.base import AnyFilter, Steps, WrongReturnError, has_expectations
from trackbench.filters.external import ProgramRunError
from trackbench.filters.external_process import programs_cpu_s
from trackbench.filters.failed_step import UnderWay
from trackbench.models.augmented_priors import augment_prior
from trackbench.models.base import Model, extra_std
from trackbench.models.sensors.stacked import Sensors, rows_of
from trackbench.scenarios.base import Simulation

_AT_ONCE = 32_768
"""Runs times steps that a filter may take in one call, so that the arrays stay in the cache."""
Series: TypeAlias = dict[str, Array] | None
"""Arrays (T + 1, M) by name; None before the first step."""


class FilterOutput(NamedTuple):
    """Estimates and diagnostics of one filter over one block of M runs and T steps."""

    mean: Array
    """estimates (n_x, T + 1, M), the first from the prior"""
    nees: Array
    """normalized error squared (T + 1, M)"""
    cov: Array | None
    """covariances (n_x, n_x, T + 1, r) of the first r runs"""
    diagnostics: dict[str, Array]
    """series (T + 1, M) by name"""
    cpu_s: float
    """CPU seconds of the filter"""
    refused: Mask | None = None
    """refused components (n_z, T, M), if several sensors have a gate each"""
    indefinite: Mask | None = None
    """covariances (T + 1, M) that are not positive definite; None if all are"""


@explain_read_only_errors()
def run_filter(task: BlockTask, data: Simulation, covariances: int = 0) -> FilterOutput:
    """Run the filter over the block's data; return the estimates of the prior and of every step.

    ``data`` are those of the task's scenario, usually `BlockTask.data`. Only the filter is timed.
    ``covariances`` is the number of first runs whose covariances are recorded. Raises ValueError if the
    filter writes to its arguments, or returns something that is no estimate.
    """
    tracker = task.filter
    model = freeze(task.assumed_scenario.model)
    rng = _join_streams(task, block_stream)
    # Additional steps that only the scores need draw from another stream, so that the filter's random
    # numbers do not depend on the scores.
    aside = _join_streams(task, aside_stream)
    clock = _Clock()
    copy_state = make_state_copier(tracker, model)
    # Delivery of measurements that may arrive late; None if all arrive on time. For a late measurement a
    # filter may go back to the measurement's own step, and repeat the steps since (`refilter`).
    delivered = deliveries(task, data)
    assumed_data = _assumed_data(task, data)
    scorer = PredictionScorer(
        tracker,
        model,
        assumed_data.measurements,
        task.predictive_metrics,
        task.hold_out,
        aside,
    )
    refilter = None
    if delivered is not None and delivered.refilters:
        refilter = _make_refilter(task, model, delivered, scorer.visible, rng, clock)
    if delivered is not None:
        # A late measurement stands at the step at which the filter gets it.
        scorer.visible = delivered.given(scorer.visible)
    prior = prior_of(assumed_data, model)
    recorder = _Recorder(task, assumed_data, model, covariances)
    under_way = UnderWay(first=0, last=0)  # the first state
    with under_way, sealed(task, assumed_data, scorer.visible, prior, model):
        with clock:
            # Step 1: initialize from the prior.
            state = tracker.init(model, prior, rng)
            estimate = tracker.estimate(state)
        states = []
        if tracker.smooths:
            states.append(copy_state(state))  # the next step of a plugin may change the state
        else:
            recorder.add(state, estimate)
        check_axes(estimate, prior.mean)
        # Step 2: one timed step per measurement, or many in one call; recording is not timed.
        steps = task.scenario.steps[1:].tolist()
        at_once = max(1, _AT_ONCE // task.runs)
        if tracker.runs_program:
            at_once = len(steps)  # a program would begin each run again in each piece
        # A smoother and some recorded series need the state of every step.
        step_by_step = tracker.smooths or recorder.needs_states
        for first in range(0, len(steps), at_once):
            piece = slice(first, first + at_once)
            # Results of all steps of the piece; None if the filter makes one step at a time. So does one
            # that may go back.
            many: Steps | None = None
            under_way.first = first + 1
            under_way.last = min(first + at_once, len(steps))
            with clock:
                z = scorer.visible[:, piece]
                if refilter is None:
                    many = _filter_many(tracker, model, state, z, steps[first])
            # If nothing needs single states, the piece is recorded as a whole. The scorer returns False,
            # and adds nothing, if it needs single states.
            if many and not step_by_step and scorer.add_steps(many, piece, steps[piece]):
                recorder.add_steps(many)
                state = many.state(-1)
                continue
            for i, k in enumerate(steps[piece], first):
                under_way.first = under_way.last = i + 1
                if refilter is not None:
                    state = refilter.state_before(i, state)
                before = state
                if not scorer.disabled:
                    before = copy_state(state)  # scores may repeat the step from here
                with clock:
                    if many is None:
                        state = tracker.step(model, state, scorer.visible[:, i], k, rng)
                    else:
                        state = many.state(i - first)
                    estimate = tracker.estimate(state)
                diagnostics = tracker.diagnostics(state)
                recorder.add_diagnostics(diagnostics)
                refused = tracker.refused(state)
                recorder.add_refused(refused)
                if tracker.smooths:
                    states.append(copy_state(state))
                else:
                    recorder.add(state, estimate)
                # A gate marks the measurements that the step has not used: components (n_z, M) if there
                # are several sensors, else whole runs (M,).
                not_used = diagnostics.get("gated") if refused is None else refused
                scorer.add(Step(before, state, estimate, k, not_used), i)
        under_way.first = under_way.last = None
        if tracker.smooths:
            with clock:
                # Step 3: a smoother goes back through all states; these estimates are recorded.
                states = tracker.smoothed(model, states, int(task.scenario.steps[0]), rng)
            for state in states:
                recorder.add(state, tracker.estimate(state))
        predictive = scorer.series()
        if delivered is not None:
            predictive |= delivered.counts()
        return recorder.output(scorer.visible, predictive, clock.cpu_s)


def _join_streams(task: BlockTask, stream: Callable[[int, int], Generator]) -> Generator:
    """Join the random streams of the task's blocks; ``stream`` makes one from the seed and a block."""
    return side_by_side([stream(task.seed, block) for block in task.blocks], task.width)


def _make_refilter(
    task: BlockTask,
    model: Model,
    delivered: Deliveries,
    z: Array,
    rng: Generator,
    clock: "_Clock",
) -> Refilter:
    """Return the `Refilter` that repeats steps when a measurement of z (n_z, T, M) arrives late.

    ``delivered`` has the arrivals. ``rng`` is the stream of the filter, and ``clock`` times the steps.
    """
    tracker = task.filter
    steps = task.scenario.steps[1:].tolist()  # without that of the prior

    def repeat(state: Any, z: Array, first: int) -> Iterator[Any]:
        """Repeat some steps from ``state``; yield the state after each measurement of z (n_z, L, M).

        ``first`` is the index of the first step that is repeated.
        """
        # None if the filter has no `all_steps`.
        many = _filter_many(tracker, model, state, z, steps[first])
        for i in range(z.shape[1]):
            if many is None:
                state = tracker.step(model, state, z[:, i], steps[first + i], rng)
                yield state
            else:
                yield many.state(i)

    return Refilter(z, delivered, repeat, make_state_copier(tracker, model), rng, clock)


def _assumed_data(task: BlockTask, data: Simulation) -> Simulation:
    """Return the data with the prior that the filter assumes, and without the errors of known faults."""
    assumed = task.assumed_scenario
    # None if the filter assumes no other prior.
    prior = assumed.assumed_prior(data.truth.shape[-1]) or data.prior
    measurements = assumed.assumed_measurements(data.measurements)
    return freeze(data._replace(prior=prior, measurements=measurements))


def _filter_many(tracker: AnyFilter, model: Model, state: Any, z: Array, k: int) -> Steps | None:
    """Filter the measurements z (n_z, T, M) in one call; None if the filter has no `all_steps`.

    ``k`` is the number of the first of these steps. Raises WrongReturnError if the number of states is
    not that of the measurements.
    """
    steps = tracker.all_steps(model, state, z, k)
    if steps is not None and steps.estimate.mean.shape[1:] != z.shape[1:]:
        states = counted(steps.estimate.mean.shape[1], "state")
        message = f"gives {states} for {counted(z.shape[1], 'measurement')}"
        raise WrongReturnError("all_steps", message)
    return steps


def prior_of(data: Simulation, model: Model) -> Distribution:
    """Return the prior of the filter's state, which may have more components than the truth.

    The additional components have the mean 0 and the standard deviations that the motion names.
    """
    if len(model.motion.components) <= len(data.truth):
        return data.prior
    return freeze(augment_prior(data.prior, extra_std(model.motion)))


def _run_filter(task: BlockTask, covariances: int) -> FilterOutput:
    """Run the filter over the block's own data; the output is read-only.

    ``covariances`` is the number of first runs whose covariances are recorded.
    """
    try:
        output = run_filter(task, task.data, covariances)
    except ProgramRunError as error:
        # The error counts runs from the block's first one: name the run of the experiment.
        raise error.with_run(task.run_number(error.run)) from None
    for values in (output.mean, output.nees, output.cov, *output.diagnostics.values()):
        if values is not None:
            values.flags.writeable = False  # no copy is needed, as no filter has these arrays
    return output


run_filter_cached = LatestResults(_run_filter, size=1)
"""A filter's output over its block, read-only; cached for tasks that score it in another way."""
run_reference = LatestResults(lambda task: _run_filter(task, 0), size=1)
"""The reference's output over a block, read-only; cached for all filters, itself among them."""
run_twin = LatestResults(lambda task: _run_filter(task, 0), size=1)
"""A filter's output without faults, read-only; cached for tasks that score it in another way."""


class _Recorder:
    """Recorder of copies, step by step, since the filter may write to its own arrays."""

    def __init__(self, task: BlockTask, data: Simulation, model: Model, covariances: int) -> None:
        """Begin before the estimate of the prior.

        ``model`` is the one that the filter assumes. ``covariances`` is the number of first runs whose
        covariances are recorded.
        """
        scenario = task.scenario
        self._task = task
        self._is_of_plugin = bool(foreign_parts(task.filter))
        self._data = data
        self._runs_with_covariance = covariances  # number of first runs; 0 for none
        # Components of the truth, and of the motion that the filter assumes.
        self._sizes = (len(data.truth), len(model.motion.components))
        self._mean = np.empty(data.truth.shape)
        # By step: covariances (n, n, r) of the first r runs, and refused components (n_z, M).
        self._covs: list[Array] = []
        self._refused: list[Mask] = []
        # The filter's diagnostics, and the errors of the scenario's observables.
        self._diagnostics: Series = None
        self._observables: Series = None
        self._has_several_sensors = len(rows_of(cast(Sensors, scenario.true_sensor))) > 1
        # Indices of the steps that are recorded next. A smoother's estimates are recorded after all
        # diagnostics.
        self._next_step = 0
        self._next_diagnostics = 1  # the first state has no diagnostics
        self._consistency = ConsistencySeries(scenario, self._mean, data.truth)
        # Calibration compares a posterior with the truth.
        wanted = task.predictive_metrics if scenario.has_truth else ()
        self._calibration = Calibration(scenario.components, wanted)
        self._angles = scenario.angle_rows
        self.needs_states = has_expectations(task.filter) or not self._calibration.disabled
        """True if the recorded series depend on more than estimates and diagnostics"""

    def add_diagnostics(self, diagnostics: dict[str, Array]) -> None:
        """Record the diagnostics (M,) of the next step, by name."""
        check_numbers("diagnostic", diagnostics, self._task.runs)
        if self._diagnostics is None:  # all steps have the names of the first
            check_diagnostic_names(diagnostics)
        self._diagnostics = self._filled(self._diagnostics, self._next_diagnostics, diagnostics)
        self._next_diagnostics += 1

    def add_refused(self, refused: Mask | None) -> None:
        """Record which components (n_z, M) the gates of several sensors refused at a step."""
        if refused is not None and self._has_several_sensors:
            self._refused.append(refused)

    def add(self, state: Any, estimate: Gaussian) -> None:
        """Record the state and the estimate of the next step, in the components of the truth."""
        check_estimate(estimate, self._sizes, self._task.runs)
        if self._is_of_plugin:
            check_symmetry(estimate.cov)
        k = self._next_step
        n, _ = self._sizes  # the number of the truth's components
        # Drop the components that only the filter's motion has: the truth has none of them.
        if len(estimate.mean) > n:
            estimate = Gaussian(estimate.mean[:n], estimate.cov[:n, :n])
        # A posterior is needed for angles, and for series of calibration if any is requested.
        posterior = None
        if self._angles or not self._calibration.disabled:
            posterior = self._task.filter.posterior(state)
        if self._angles and isinstance(posterior, ParticlePosterior):
            # Particles on both sides of the jump of an angle by 2 pi are averaged about one direction,
            # in the truth's components. Without angles the posterior itself compares only these.
            particles = posterior.particles
            particles = particles._replace(x=particles.x[:n])
            together = particles_together(particles, estimate.mean, self._angles)
            estimate = moments_together(estimate, particles, together)
            posterior = ParticlePosterior(together)
        self._mean[:, k] = estimate.mean
        self._consistency.add(estimate.cov)
        if self.needs_states:
            truth = near(self._data.truth[:, k], estimate.mean, self._angles)
            self._calibration.add(posterior, estimate, truth)
            rows = observable_errors(self._task.scenario, self._task.filter, state, truth)
            self._observables = self._filled(self._observables, k, rows)
        if self._runs_with_covariance:
            self._covs.append(
                per_run_moments(estimate).cov[..., : self._runs_with_covariance].copy()
            )
        self._next_step += 1

    def add_steps(self, steps: Steps) -> None:
        """Record the estimates and diagnostics of the next steps, which the filter made in one call."""
        check_estimate(steps.estimate, self._sizes, *steps.estimate.mean.shape[1:])
        if self._is_of_plugin:
            check_symmetry(steps.estimate.cov)
        # Only the truth's components, which come first. The second size is that of the filter's state.
        n, _ = self._sizes
        mean = steps.estimate.mean[:n]
        cov = steps.estimate.cov[:n, :n]
        _, count, runs = mean.shape
        check_numbers("diagnostic", steps.diagnostics, count, runs)
        piece = slice(self._next_step, self._next_step + count)
        self._diagnostics = self._filled(self._diagnostics, piece, steps.diagnostics)
        self._mean[:, piece] = mean
        self._consistency.add_steps(cov)
        if self._runs_with_covariance:
            # One array (n, n, r) for each step, of the first r runs.
            per_run = np.broadcast_to(cov, (n, n, count, runs))
            self._covs += [*np.moveaxis(per_run[..., : self._runs_with_covariance], 2, 0).copy()]
        # Both are equal here: a smoother, whose estimates come after all diagnostics, is recorded by
        # `add`.
        self._next_step = piece.stop
        self._next_diagnostics = piece.stop

    def output(self, z: Array, predictive: dict[str, Array], cpu_s: float) -> FilterOutput:
        """Return the output of the filter after the last step.

        z (n_z, T, M) are the measurements that the filter was given, ``predictive`` the predictive
        series, and ``cpu_s`` the CPU seconds of the filter.
        """
        series = self._consistency.series()
        series |= self._calibration.series(series)
        leave_out_known_start(series, self._data.prior.cov)
        nees = series.pop("nees")
        diagnostics = self._diagnostics or {}
        nis = diagnostics.get("nis")
        # Components (n_z, T, M) that the gates of several sensors refused; None if there are no such
        # gates.
        refused = np.stack(self._refused, axis=1) if self._refused else None
        if nis is not None and (any_nan(z) or (refused is not None and refused.any())):
            # Number of components that each NIS lacks; NaN if a step has no NIS.
            unused = np.isnan(z)
            if refused is not None:
                unused |= refused
            number = with_nan_first(unused.sum(axis=0).astype(float))
            series["unused_nis"] = np.where(np.isnan(nis), np.nan, number)
        # Covariances of the shown runs (n, n, T + 1, r).
        cov = np.stack(self._covs, axis=2) if self._covs else None
        # Errors of the functions of the state that the scenario names, such as the range.
        observables = self._observables or {}
        return FilterOutput(
            mean=self._mean,
            nees=nees,
            cov=cov,
            diagnostics=diagnostics | series | observables | predictive,
            cpu_s=cpu_s,
            refused=refused,
            indefinite=self._consistency.indefinite,
        )

    def _filled(self, series: Series, steps: int | slice, rows: dict[str, Array]) -> Series:
        """Write the values of some steps to the series (T + 1, M), and return the series.

        ``steps`` is the index of one step, with ``rows`` (M,) by name, or the slice of several, with
        ``rows`` (S, M). If ``series`` is None, new ones are made. All steps have the names of the first.
        """
        if series is None:
            series = {name: np.full(self._data.truth.shape[1:], np.nan) for name in rows}
        for name, values in series.items():
            values[steps] = rows[name]
        return series


class _Clock:
    """Context that adds up the CPU time spent within it, the time of external programs included."""

    cpu_s = 0.0

    def __enter__(self) -> None:
        self._started = time.process_time() + programs_cpu_s()

    def __exit__(self, *_: object) -> None:
        self.cpu_s += time.process_time() + programs_cpu_s() - self._started
