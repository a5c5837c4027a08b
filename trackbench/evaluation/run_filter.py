"""Run one filter over one block of runs: time each step, validate the estimates, compute errors."""

import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from trackbench.core import arrays
from trackbench.core.arrays import Array, LatestResults, Seal, freeze
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.random_streams import aside_stream, block_stream, side_by_side
from trackbench.evaluation.block import MOST_STACKED, BlockTask
from trackbench.evaluation.consistency_and_calibration import (
    Calibration,
    ConsistencySeries,
    observed,
)
from trackbench.evaluation.predictive_scores import PredictionScorer, Step, after_first
from trackbench.evaluation.validate_output import (
    check_axes,
    check_estimate,
    check_names,
    checked_numbers,
    explain_read_only_errors,
)
from trackbench.extension_points import foreign_parts
from trackbench.filters.base import AnyFilter, WrongReturnError
from trackbench.models.base import Model, extra_std
from trackbench.models.priors import augment_prior
from trackbench.scenarios.base import Simulation

_STEPS_AT_ONCE = 128  # that a filter may take in one call: their arrays take memory


class FilterOutput(NamedTuple):
    """mean (n_x, T + 1, M), nees (T + 1, M), cov of the first runs, diagnostics (T + 1, M), CPU s."""

    mean: Array
    nees: Array
    cov: Array | None
    diagnostics: dict[str, Array]
    cpu_s: float


class ReferenceOutput(NamedTuple):
    """mean (n_x, T + 1, M) of the reference, and its log-likelihood series by name."""

    mean: Array
    diagnostics: dict[str, Array]


@lru_cache(maxsize=MOST_STACKED)
def run_reference(task: BlockTask) -> ReferenceOutput:
    """Return the reference's way through a block, read-only; cached for all filters of a stack."""
    output = run_filter_cached(task, 0)
    series = {n: rows for n, rows in output.diagnostics.items() if n == "log_likelihood"}
    return ReferenceOutput(output.mean, series)


@explain_read_only_errors()
def run_filter(task: BlockTask, data: Simulation, covariances: int = 0) -> FilterOutput:
    """Run the filter over the block's data; estimates of every step, the prior's included.

    Only the filter is timed. Covariances are recorded of the first runs only. Raises ValueError if the
    filter writes to what it is given, or gives back what is no estimate.
    """
    tracker, model = task.filter, freeze(task.assumed_scenario.model)
    # The scores' own stream leaves the filter's random numbers as they are without scores.
    rng = side_by_side([block_stream(task.seed, block) for block in task.blocks], task.width)
    aside = side_by_side([aside_stream(task.seed, block) for block in task.blocks], task.width)
    scorer = PredictionScorer(
        tracker, model, data.measurements, task.predictive_metrics, task.hold_out, aside
    )
    assumed_prior = task.assumed_scenario.assumed_prior(data.truth.shape[-1])
    if assumed_prior is not None:
        data = data._replace(prior=freeze(assumed_prior))
    prior, clock = prior_of(data, model), _Clock()
    recorder = _Recorder(task, data, model, covariances)
    with _sealed(task, data, scorer.visible, prior, model):
        with clock:
            # Step 1: initialize from the prior.
            state = tracker.init(model, prior, rng)
            found = tracker.estimate(state)
        states = [state]
        if not tracker.smooths:
            recorder.add(state, found)
        check_axes(found, prior.mean)
        # Step 2: one timed step per measurement, or many in one call; recording is not timed.
        ahead: list[tuple[Any, Gaussian]] = []
        for i, k in enumerate(task.scenario.steps[1:].tolist()):
            before = state if scorer.disabled else scorer.snapshot(state)
            with clock if not ahead else nullcontext():
                if i % _STEPS_AT_ONCE == 0:
                    next_scans = scorer.visible[:, i : i + _STEPS_AT_ONCE]
                    ahead = _steps_ahead(tracker, model, state, next_scans, k)
                if ahead:
                    state, found = ahead.pop(0)
                else:
                    state = tracker.step(model, state, scorer.visible[:, i], k, rng)
                    found = tracker.estimate(state)
            recorder.note(tracker.diagnostics(state))
            if tracker.smooths:
                states.append(state)
            else:
                recorder.add(state, found)
            # Score with the state before the step, from which the measurement is predicted.
            if not scorer.disabled:
                scorer.add(Step(before, state, found, k), i)
        if tracker.smooths:
            with clock:
                # Step 3: a smoother goes back through all states; these estimates are recorded.
                states = tracker.smoothed(model, states, int(task.scenario.steps[0]), rng)
            for state in states:
                recorder.add(state, tracker.estimate(state))
        return recorder.filtered(scorer.series(), clock.cpu_s)


def _steps_ahead(
    tracker: AnyFilter, model: Model, state: Any, z: Array, k: int
) -> list[tuple[Any, Gaussian]]:
    """Return state and estimate after each measurement of z (n_z, T, M); empty without `all_steps`."""
    states = tracker.all_steps(model, state, z, k) or []
    if states and len(states) != z.shape[1]:
        what = f"returns {len(states)} states for {z.shape[1]} measurements"
        raise WrongReturnError("all_steps", what)
    return [(state, tracker.estimate(state)) for state in states]


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
    return freeze(run_filter(task, task.data, covariances))


run_filter_cached = LatestResults(_run_filter, size=1)
"""A filter's output over its block, read-only; cached for tasks that score it in another way."""


class _Recorder:
    """Recorder of copies, step by step, since the filter may write to its own arrays."""

    def __init__(self, task: BlockTask, data: Simulation, model: Model, covariances: int) -> None:
        self._task, self._data, self._covariances = task, data, covariances
        self._sizes = len(data.truth), len(model.motion.components)
        self._means: list[Array] = []
        self._covs: list[Array] = []
        self._noted: list[dict[str, Array]] = []
        self._observed: list[dict[str, Array]] = []
        scenario, tracker = task.scenario, task.filter
        self._consistency = ConsistencySeries(scenario, task.runs)
        wanted = task.predictive_metrics if scenario.has_truth else ()
        self._judged = Calibration(tracker, scenario.components, wanted)

    def note(self, diagnostics: dict[str, Array]) -> None:
        """Record the diagnostics of a step."""
        self._noted.append(checked_numbers("diagnostic", diagnostics, self._task.runs))

    def add(self, state: Any, found: Gaussian) -> None:
        """Record a step's state and estimate; score the truth's components of the estimate."""
        check_estimate(found, self._sizes, self._task.runs)
        # Drop the components that only the filter's motion has: the truth has none of them.
        (n, _), truth = self._sizes, self._data.truth[:, len(self._means)]
        if len(found.mean) > n:
            found = Gaussian(found.mean[:n], found.cov[:n, :n])
        mean = np.array(found.mean, dtype=np.float64)
        self._means.append(mean)
        self._consistency.add(mean, found.cov, truth)
        self._judged.add(state, found, truth)
        self._observed.append(observed(self._task.scenario, self._task.filter, state, truth))
        if self._covariances:
            self._covs.append(per_run_moments(found).cov[..., : self._covariances].copy())

    def filtered(self, told: dict[str, Array], cpu_s: float) -> FilterOutput:
        """Return the output, with the predictive series."""
        errors = self._consistency.series()
        errors |= self._judged.series(errors["nees"])
        if not self._data.prior.cov.any():
            for rows in errors.values():
                rows[0] = np.nan  # the first state is known exactly: there is nothing to judge
        nees = errors.pop("nees")
        names = self._noted[0] if self._noted else {}
        check_names(names)
        # Diagnostics start at the first measurement: NaN at the first state.
        series = {name: after_first(np.stack([n[name] for n in self._noted])) for name in names}
        series |= errors
        series |= {n: np.stack([o[n] for o in self._observed]) for n in self._observed[0]}
        # Covariances of the shown runs (n, n, T + 1, r).
        cov = np.stack(self._covs, axis=2) if self._covs else None
        return FilterOutput(np.stack(self._means, axis=1), nees, cov, series | told, cpu_s)


class _Clock:
    """Adds up the CPU time of the blocks it is entered for."""

    cpu_s = 0.0

    def __enter__(self) -> None:
        self._started = time.process_time()

    def __exit__(self, *_: object) -> None:
        self.cpu_s += time.process_time() - self._started
