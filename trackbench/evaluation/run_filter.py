"""Run one filter over one block of runs: time each step, validate the estimates, compute errors."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import arrays
from trackbench.core.angles import moments_together, near, particles_together
from trackbench.core.arrays import Array, LatestResults, Mask, Seal, any_nan, freeze
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.random_streams import aside_stream, block_stream, side_by_side
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.consistency_and_calibration import (
    Calibration,
    ConsistencySeries,
    observed,
)
from trackbench.evaluation.late_measurements import Deliveries, Refilter, deliveries
from trackbench.evaluation.predictive_scores import PredictionScorer, Step, after_first
from trackbench.evaluation.validate_output import (
    check_axes,
    check_estimate,
    check_names,
    check_numbers,
    explain_read_only_errors,
)
from trackbench.extension_points import foreign_parts
from trackbench.filters.base import AnyFilter, Steps, WrongReturnError, has_expectations
from trackbench.filters.external import ProgramRunError
from trackbench.filters.particle_base import PFState
from trackbench.filters.program import programs_cpu_s
from trackbench.models.base import Model, extra_std
from trackbench.models.priors import augment_prior
from trackbench.models.sensors.base import Sensors, rows_of
from trackbench.scenarios.base import Simulation

_AT_ONCE = (
    32_768  # runs times steps that a filter may take in one call: the arrays stay in the cache
)


Series: TypeAlias = dict[str, Array] | None
"""Arrays (T + 1, M) by name; None before the first step."""


class FilterOutput(NamedTuple):
    """mean (n_x, T + 1, M), nees (T + 1, M), cov of the first runs, diagnostics (T + 1, M), CPU s.

    And the first runs' particles (n_x + 2, S, N, r), with weights and parents, if S steps are shown. Of
    several sensors with a gate each also the refused components (n_z, T, M).
    """

    mean: Array
    nees: Array
    cov: Array | None
    diagnostics: dict[str, Array]
    cpu_s: float
    particles: Array | None = None
    refused: Mask | None = None


@explain_read_only_errors()
def run_filter(task: BlockTask, data: Simulation, covariances: int = 0) -> FilterOutput:
    """Run the filter over the block's data; estimates of every step, the prior's included.

    Only the filter is timed. Covariances are recorded of the first runs only. Raises ValueError if the
    filter writes to what it is given, or gives back what is no estimate.
    """
    tracker, model = task.filter, freeze(task.assumed_scenario.model)
    rng, aside = (_stream_of(task, stream) for stream in (block_stream, aside_stream))
    delivered, clock = deliveries(task, data), _Clock()
    data, wanted = _as_assumed(task, data), task.predictive_metrics
    scorer = PredictionScorer(tracker, model, data.measurements, wanted, task.hold_out, aside)
    refilter = _refilter(task, model, delivered, scorer.visible, rng, clock)
    scorer.visible = delivered.given(scorer.visible) if delivered else scorer.visible
    prior, recorder = prior_of(data, model), _Recorder(task, data, model, covariances)
    with _sealed(task, data, scorer.visible, prior, model):
        with clock:
            # Step 1: initialize from the prior.
            state = tracker.init(model, prior, rng)
            estimate = tracker.estimate(state)
        states = [state]
        if not tracker.smooths:
            recorder.add(state, estimate)
        check_axes(estimate, prior.mean)
        # Step 2: one timed step per measurement, or many in one call; recording is not timed.
        steps, at_once = task.scenario.steps[1:].tolist(), max(1, _AT_ONCE // task.runs)
        one_by_one = tracker.smooths or recorder.needs_states
        for first in range(0, len(steps), at_once):
            part = slice(first, first + at_once)
            with clock:
                z = scorer.visible[:, part]
                ahead = None if refilter else _steps_ahead(tracker, model, state, z, steps[first])
            if ahead and not one_by_one and scorer.add_steps(ahead, part, steps[part]):
                recorder.add_steps(ahead)
                state = ahead.state(-1)
                continue
            for i, k in enumerate(steps[part], first):
                if refilter is not None:
                    state = refilter.state_before(i, state)
                before = state if scorer.disabled else scorer.snapshot(state)
                with clock:
                    if ahead is None:
                        state = tracker.step(model, state, scorer.visible[:, i], k, rng)
                    else:
                        state = ahead.state(i - first)
                    estimate = tracker.estimate(state)
                recorder.note(diagnostics := tracker.diagnostics(state))
                refused = tracker.refused(state)
                recorder.note_refused(refused)
                not_used = diagnostics.get("gated") if refused is None else refused
                if tracker.smooths:
                    states.append(state)
                else:
                    recorder.add(state, estimate)
                # The state before the step predicts the measurement.
                scorer.add(Step(before, state, estimate, k, not_used), i)
        if tracker.smooths:
            with clock:
                # Step 3: a smoother goes back through all states; these estimates are recorded.
                states = tracker.smoothed(model, states, int(task.scenario.steps[0]), rng)
            for state in states:
                recorder.add(state, tracker.estimate(state))
        late = delivered.counts() if delivered else {}
        return recorder.filtered(scorer.visible, scorer.series() | late, clock.cpu_s)


def _stream_of(task: BlockTask, stream: Callable[[int, int], Generator]) -> Generator:
    """Return a stream of the blocks; the scores' own leaves the filter's random numbers as they are."""
    return side_by_side([stream(task.seed, block) for block in task.blocks], task.width)


def _refilter(
    task: BlockTask,
    model: Model,
    delivered: Deliveries | None,
    z: Array,
    rng: Generator,
    clock: "_Clock",
) -> Refilter | None:
    """Return the states to go back to, if the filter goes back."""
    if delivered is None or not delivered.refilters:
        return None
    tracker, steps = task.filter, task.scenario.steps[1:].tolist()

    def repeat(state: Any, z: Array, first: int) -> Iterator[Any]:
        ahead = _steps_ahead(tracker, model, state, z, steps[first])
        for i in range(z.shape[1]):
            if ahead is None:
                state = tracker.step(model, state, z[:, i], steps[first + i], rng)
            yield state if ahead is None else ahead.state(i)

    def copy(state: Any) -> Any:
        # A step of a program, and one of a plugin that breaks the contract, changes its state.
        is_changed = tracker.loops_over_runs or foreign_parts(tracker)
        return deepcopy(state, {id(model): model}) if is_changed else state

    return Refilter(z, delivered, repeat, copy, rng, clock)


def _as_assumed(task: BlockTask, data: Simulation) -> Simulation:
    """Return the data with the filter's prior, and without the errors of faults that it knows."""
    assumed = task.assumed_scenario
    prior, z = assumed.assumed_prior(data.truth.shape[-1]), data.measurements
    return freeze(
        data._replace(prior=prior or data.prior, measurements=assumed.assumed_measurements(z))
    )


def _steps_ahead(tracker: AnyFilter, model: Model, state: Any, z: Array, k: int) -> Steps | None:
    """Return the steps with the measurements z (n_z, T, M); None without the hook `all_steps`."""
    steps = tracker.all_steps(model, state, z, k)
    if steps is not None and steps.estimate.mean.shape[1:] != z.shape[1:]:
        what = f"gives {steps.estimate.mean.shape[1]} states for {z.shape[1]} measurements"
        raise WrongReturnError("all_steps", what)
    return steps


@contextmanager
def _sealed(task: BlockTask, *shared: Any) -> Iterator[None]:
    """Raise WrongReturnError if code of a plugin writes to what filters share, and undo it.

    numpy cannot write to it; a library that takes an array's address can.
    """
    if not foreign_parts((task.filter, task.scenario, task.assume)):
        yield
        return
    seal = Seal(shared, arrays.cached_results())
    try:
        yield
    finally:
        if seal.mend():
            what = "writes to measurements, a prior or matrices that all filters of the block share"
            raise WrongReturnError("step", f"{what}: copy an array before you write to it")


def prior_of(data: Simulation, model: Model) -> Distribution:
    """Return the prior of the filter's state, which may have extra components."""
    if len(model.motion.components) <= len(data.truth):
        return data.prior
    return freeze(augment_prior(data.prior, extra_std(model.motion)))


def _run_filter(task: BlockTask, covariances: int) -> FilterOutput:
    try:
        output = run_filter(task, task.data, covariances)
    except ProgramRunError as error:
        raise error.after(task.first_run) from None
    for a in (output.mean, output.nees, output.cov, *output.diagnostics.values()):
        if a is not None:
            a.flags.writeable = False  # without a copy: no filter sees it
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
        self._task, self._data, self._covariances = task, data, covariances
        self._sizes = len(data.truth), len(model.motion.components)
        self._mean = np.empty(data.truth.shape)
        self._covs: list[Array] = []
        self._noted: Series = None
        self._observed: Series = None
        self._refused: list[Mask] = []
        self._has_several_sensors = len(rows_of(cast(Sensors, task.scenario.true_sensor))) > 1
        self._next_note, self._next = 1, 0  # the first state has no diagnostics
        scenario, tracker = task.scenario, task.filter
        self._consistency = ConsistencySeries(scenario, self._mean, data.truth)
        wanted = task.predictive_metrics if scenario.has_truth else ()
        self._judged = Calibration(scenario.components, wanted)
        self._angles = scenario.angle_rows
        self._clouds = _ParticleRecorder(task, self._sizes[0])
        self.needs_states = has_expectations(tracker) or not self._judged.disabled
        """whether what is recorded depends on more than estimates and diagnostics"""

    def note(self, diagnostics: dict[str, Array]) -> None:
        """Record the diagnostics of a step."""
        check_numbers("diagnostic", diagnostics, self._task.runs)
        if self._noted is None:
            check_names(diagnostics)
        self._noted = self._filled(self._noted, self._next_note, diagnostics)
        self._next_note += 1

    def note_refused(self, refused: Mask | None) -> None:
        """Record which components (n_z, M) the gates of several sensors refused at a step."""
        if refused is not None and self._has_several_sensors:
            self._refused.append(refused)

    def add(self, state: Any, estimate: Gaussian) -> None:
        """Record a step's state and estimate; score the truth's components of the estimate."""
        check_estimate(estimate, self._sizes, self._task.runs)
        k, n = self._next, self._sizes[0]
        # Drop the components that only the filter's motion has: the truth has none of them.
        if len(estimate.mean) > n:
            estimate = Gaussian(estimate.mean[:n], estimate.cov[:n, :n])
        posterior = None
        if self._angles or self._clouds.wanted or not self._judged.disabled:
            posterior = self._task.filter.posterior(state)
        if self._angles and isinstance(posterior, ParticlePosterior):
            # Particles on both sides of an angle's cut have their mean direction.
            cloud = posterior.particles
            cloud = cloud._replace(x=cloud.x[:n])
            together = particles_together(cloud, estimate.mean, self._angles)
            estimate, posterior = (
                moments_together(estimate, cloud, together),
                ParticlePosterior(together),
            )
        self._clouds.add(state, posterior, int(self._task.scenario.steps[k]))
        self._mean[:, k] = estimate.mean
        self._consistency.add(estimate.cov)
        if self.needs_states:
            truth = near(self._data.truth[:, k], estimate.mean, self._angles)
            self._judged.add(posterior, estimate, truth)
            rows = observed(self._task.scenario, self._task.filter, state, truth)
            self._observed = self._filled(self._observed, k, rows)
        if self._covariances:
            self._covs.append(per_run_moments(estimate).cov[..., : self._covariances].copy())
        self._next += 1

    def add_steps(self, steps: Steps) -> None:
        """Record the estimates and diagnostics of many steps."""
        check_estimate(steps.estimate, self._sizes, *steps.estimate.mean.shape[1:])
        mean, cov = (a[: self._sizes[0]] for a in (steps.estimate.mean, steps.estimate.cov))
        n, count, runs = mean.shape
        check_numbers("diagnostic", steps.diagnostics, count, runs)
        part = slice(self._next, self._next + count)
        self._noted = self._filled(self._noted, part, steps.diagnostics)
        self._mean[:, part] = mean
        self._consistency.add_steps(cov[:, :n])
        if self._covariances:
            per_run = np.broadcast_to(cov[:, :n], (n, n, count, runs))
            self._covs += [*np.moveaxis(per_run[..., : self._covariances], 2, 0).copy()]
        self._next = self._next_note = part.stop

    def filtered(self, z: Array, predictive: dict[str, Array], cpu_s: float) -> FilterOutput:
        """Return the output, with the predictive series; z (n_z, T, M) are the measurements."""
        errors = self._consistency.series()
        errors |= self._judged.series(errors)
        if not self._data.prior.cov.any():
            for rows in errors.values():
                rows[0] = np.nan  # the first state is known exactly: there is nothing to judge
        nees = errors.pop("nees")
        nis = (self._noted or {}).get("nis")
        refused = np.stack(self._refused, axis=1) if self._refused else None
        if nis is not None and (any_nan(z) or (refused is not None and refused.any())):
            # Components that the NIS of a step lacks, where it has any.
            unused = np.isnan(z) if refused is None else np.isnan(z) | refused
            missing = after_first(unused.sum(axis=0).astype(float))
            errors["unused_nis"] = np.where(np.isnan(nis), np.nan, missing)
        # Covariances of the shown runs (n, n, T + 1, r).
        cov = np.stack(self._covs, axis=2) if self._covs else None
        series = (self._noted or {}) | errors | (self._observed or {}) | predictive
        return FilterOutput(
            mean=self._mean,
            nees=nees,
            cov=cov,
            diagnostics=series,
            cpu_s=cpu_s,
            particles=self._clouds.recorded(),
            refused=refused,
        )

    def _filled(self, series: Series, steps: int | slice, rows: dict[str, Array]) -> Series:
        """Enter the rows of some steps; all steps have the names of the first."""
        if series is None:
            series = {name: np.full(self._data.truth.shape[1:], np.nan) for name in rows}
        for name, values in series.items():
            values[steps] = rows[name]
        return series


class _ParticleRecorder:
    """Recorder of the first runs' particles at the steps of figures, each with its weight and parent.

    A parent is the place (0, 1, ...) among the step before of the particle that this one is moved from.
    """

    def __init__(self, task: BlockTask, n: int) -> None:
        first, last = task.particle_steps or (0, -1)
        self._runs, self._n = task.runs_with_tracks_among(task.runs), n
        self.wanted = range(first, last + 1) if self._runs else range(0)
        self._clouds: list[Array] = []
        self._origin: Array | None = None

    def add(self, state: Any, posterior: Posterior | None, k: int) -> None:
        """Record the state at step k; any other than one of particles is left out."""
        if posterior is None or not isinstance(posterior, ParticlePosterior):
            return  # `isinstance` of a Protocol's subclass takes as long as a small step
        if k in self.wanted:
            x, w = (a[..., : self._runs, :] for a in posterior.particles)
            unknown = np.full(w.shape, np.nan)
            parents = unknown if self._origin is None else self._origin[: self._runs]
            self._clouds.append(np.concatenate([x[: self._n], w[None], parents[None]]))
        self._origin = None
        if k + 1 in self.wanted and isinstance(state, PFState) and state.origin is not None:
            # Flat indices count on from run to run.
            runs, N = posterior.particles.w.shape
            self._origin = state.origin - float(N) * np.arange(runs)[:, None]

    def recorded(self) -> Array | None:
        """Return what was recorded (n_x + 2, S, N, r), NaN where a step had fewer particles."""
        if not self._clouds:
            return None
        most = max(cloud.shape[-1] for cloud in self._clouds)
        out = np.full((*self._clouds[0].shape[:-1], most, len(self._clouds)), np.nan)
        for i, cloud in enumerate(self._clouds):
            out[..., : cloud.shape[-1], i] = cloud
        return np.ascontiguousarray(out.transpose(0, 3, 2, 1))


class _Clock:
    """Adds up the CPU time of the blocks it is entered for."""

    cpu_s = 0.0

    def __enter__(self) -> None:
        self._started = time.process_time() + programs_cpu_s()

    def __exit__(self, *_: object) -> None:
        self.cpu_s += time.process_time() + programs_cpu_s() - self._started
