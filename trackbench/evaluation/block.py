"""One block of runs: simulate, filter, reduce to metrics.

A block is always computed whole and then trimmed to the runs that are wanted, so run m comes out the
same in a batch of 10 or of 10 000.
"""

import time
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array, Mask, frozen, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.streams import RunStreams, aside_stream, block_stream
from trackbench.evaluation import calibration, foretelling
from trackbench.evaluation.calibration import Calibration, evidence
from trackbench.evaluation.checked import (
    check_axes,
    check_estimate,
    check_names,
    checked_numbers,
    told_to_copy,
)
from trackbench.evaluation.derived import ConsistencySeries, observed
from trackbench.evaluation.foretelling import Foretelling, Told
from trackbench.evaluation.metrics import (
    FOUND,
    StepSums,
    per_run_metrics,
    series,
    step_sums,
)
from trackbench.filters.base import AnyFilter
from trackbench.models.assumed import Assume
from trackbench.models.base import Model, extra_std
from trackbench.models.extended import extended
from trackbench.scenarios.base import Scenario, Simulation

Kind: TypeAlias = foretelling.Kind | calibration.Kind


@dataclass(frozen=True)
class BlockTask:
    """What to compute: runs ``index * width`` onwards, ``used`` of the block's ``width``.

    A block of negative index holds training runs, from run -1 down: -1 the first ``width`` of them.
    Only numbers per run are kept of it.
    """

    scenario: Scenario
    filter: AnyFilter
    seed: int
    index: int
    width: int
    used: int
    reference: AnyFilter | None = None
    """filter whose estimates distances are measured to, if any"""
    shown: int = 0
    """keep whole tracks of runs below this number"""
    keep_covariance: bool = False
    """keep the covariances of the shown tracks too"""
    keep_steps: tuple[str, ...] = ()
    """series kept per run and step, for their medians"""
    assume: Assume | None = None
    """what the filter assumes that is not the scenario's"""
    foretold: tuple[Kind, ...] = ()
    """what the filter is asked beside its estimate: of measurements before it is given them, and of
    where in its posterior the truth lies"""
    hold_out: int | None = None
    """every so many-th measurement of a run is not given to the filter"""
    also: tuple[int, ...] = field(default=(), compare=False)
    """numbers of the block's runs over which it is reduced, too: a batch may stop there, or go on"""

    @property
    def seen(self) -> Scenario:
        """The scenario with the model that the filter assumes."""
        return self.scenario if self.assume is None else self.scenario.believing(self.assume)

    @property
    def first_run(self) -> int:
        """Number of the block's first run."""
        return self.index * self.width if self.index >= 0 else (self.index + 1) * self.width - 1

    @property
    def data(self) -> Simulation:
        """The whole block's data."""
        return simulate(self.scenario.unscored, self.seed, self.first_run, self.width)

    @property
    def alone(self) -> "BlockTask":
        """Equal for all tasks of which the filter makes the same estimates."""
        alone = BlockTask(self.scenario.unscored, self.filter, self.seed, self.index, self.width, 0)
        return replace(alone, assume=self.assume, foretold=self.foretold, hold_out=self.hold_out)

    @property
    def of_reference(self) -> "BlockTask":
        """The reference's own task."""
        assert self.reference is not None
        told: tuple[Kind, ...] = ("score",) if "evidence" in self.foretold else ()
        return replace(self.alone, filter=self.reference, assume=None, foretold=told)

    def shown_of(self, used: int) -> int:
        """How many of the block's first ``used`` runs are shown with their whole tracks."""
        return 0 if self.index < 0 else max(0, min(self.shown - self.first_run, used))


class Tracks(NamedTuple):
    """Whole tracks of r runs: truth and mean (n_x, T + 1, r), measurements (n_z, T, r)."""

    truth: Array
    measurements: Array
    mean: Array
    cov: Array | None


class BlockResult(NamedTuple):
    """Metrics of the block's used runs; no particles, no tracks but the shown ones."""

    per_run: dict[str, Array]
    steps: dict[str, StepSums]
    kept: dict[str, Array]
    tracks: Tracks | None
    cpu_s: float
    width: int


class Filtered(NamedTuple):
    """mean (n_x, T + 1, M), nees (T + 1, M), cov of the first runs, diagnostics (T + 1, M), CPU s."""

    mean: Array
    nees: Array
    cov: Array | None
    diagnostics: dict[str, Array]
    cpu_s: float


def run_block(task: BlockTask) -> BlockResult:
    """Simulate the block's runs, filter them, and reduce the errors to metrics."""
    return run_whole_block(task)[task.used]


def run_whole_block(task: BlockTask) -> dict[int, BlockResult]:
    """The block reduced over the runs that are used, and over all of its width.

    The second costs next to nothing, and is what a later batch of more runs needs.
    """
    _keep_freed_memory()
    with np.errstate(all="ignore"):  # a run that leaves the numbers is counted, not warned about
        data = task.data
        result = passed(task.alone, task.shown_of(task.width) if task.keep_covariance else 0)
        exact = None if task.reference is None else passed(task.of_reference, 0)
        exact_mean = None if exact is None else exact.mean
        values = series(task.scenario, data.truth, result.mean, result.nees, exact_mean)
        values |= result.diagnostics
        if exact is not None and "evidence" in task.foretold:
            values |= evidence(values, exact.diagnostics)
        check_names(task.filter.counts)
        finite = _stayed_finite(result.mean)
        # Over the whole block, then trimmed: numpy adds up a single column in another order.
        per_run = per_run_metrics(task.scenario, values, task.filter.counts, finite)
        return {
            used: _trimmed(task, data, result, values, per_run, used)
            for used in {task.used, task.width, *task.also}
        }


def _stayed_finite(mean: Array) -> Mask:
    """Which runs (M,) have every component at every step that the filter estimates in any run."""
    there = np.isfinite(mean)
    estimated = there.any(axis=(1, 2))  # a converted measurement, say, has no velocity
    return np.asarray(there[estimated].all(axis=(0, 1)) & estimated.any())


def _trimmed(
    task: BlockTask,
    data: Simulation,
    result: Filtered,
    values: dict[str, Array],
    per_run: dict[str, Array],
    used: int,
) -> BlockResult:
    values = {name: rows[:, :used] for name, rows in values.items()}
    per_run = {name: numbers[:used] for name, numbers in per_run.items()}
    kept = [name for name in task.keep_steps if name in values]
    tracks, shown = None, task.shown_of(used)
    if shown:
        cov = None if result.cov is None else result.cov[..., :shown]
        seen = data.measurements[..., :shown]
        tracks = Tracks(data.truth[..., :shown], seen, result.mean[..., :shown], cov)
    return BlockResult(
        per_run=per_run,
        steps={
            name: step_sums(rows, per_run["lost"])
            for name, rows in values.items()
            if task.index >= 0
        },
        kept={n: np.where(per_run["lost"] == FOUND, values[n], np.nan) for n in kept},
        tracks=tracks,
        cpu_s=result.cpu_s,
        width=task.width,
    )


@lru_cache(maxsize=1)
def _keep_freed_memory() -> None:
    """Let the arrays of one step reuse the memory of the last, which can halve the time of a step.

    The GNU allocator gives freed memory back to the system, to fetch it again page by page a moment
    later, unless it has once freed a larger block (up to 32 MiB). This one is never touched.
    """
    np.empty(31 << 20, dtype=np.uint8)


@lru_cache(maxsize=2)
def simulate(scenario: Scenario, seed: int, first_run: int, width: int) -> Simulation:
    """The block's data; cached, because every filter of a block sees the same, and read-only."""
    step = 1 if first_run >= 0 else -1
    rng = RunStreams(seed, range(first_run, first_run + step * width, step))
    return frozen(scenario.simulate(rng, width))


@lru_cache(maxsize=2)
def passed(task: BlockTask, covariances: int) -> Filtered:
    """A filter's way through its block, read-only; cached for tasks that only score it otherwise.

    And for those of other filters that have it as their reference.
    """
    return frozen(estimate(task, task.data, covariances))


@told_to_copy()
def estimate(task: BlockTask, data: Simulation, covariances: int = 0) -> Filtered:
    """Run the filter over the block's data; estimates of every step, the prior's included.

    Only the filter is timed. Covariances are kept of the first runs only. Raises ValueError if the
    filter writes to what it is given, or gives back what is no estimate.
    """
    scenario, tracker, n = task.scenario, task.filter, len(data.truth)
    model, rng = frozen(task.seen.model), block_stream(task.seed, task.index)
    aside = aside_stream(task.seed, task.index)
    telling = Foretelling(tracker, model, data.measurements, task.foretold, task.hold_out, aside)
    prior, every = prior_of(data, model), len(model.motion.components)
    mean = np.empty((n, len(scenario.steps), task.width))
    cov, noted, others = [], [], []
    consistency, clock = ConsistencySeries(scenario, task.width), _Clock()
    judged = Calibration(tracker, scenario.components, task.foretold if scenario.has_truth else ())
    with clock:
        state = tracker.init(model, prior, rng)
        found = tracker.estimate(state)
    for i, k in enumerate(scenario.steps):
        if i > 0:
            before = state if telling.is_idle else telling.kept(state)
            with clock:
                state = tracker.step(model, state, telling.given[:, i - 1], int(k), rng)
                found = tracker.estimate(state)
            noted.append(checked_numbers("diagnostic", tracker.diagnostics(state), task.width))
        check_estimate(found, (n, every), task.width)
        if i == 0:
            check_axes(found, prior.mean)
        elif not telling.is_idle:
            telling.add(Told(before, state, found, int(k)), i - 1)
        found = _own_part(found, n)
        mean[:, i] = found.mean  # copied, as the rest is: the filter may go on writing to its own
        consistency.add(mean[:, i], found.cov, data.truth[:, i])
        judged.add(state, found, data.truth[:, i])
        others.append(observed(scenario, tracker, state, data.truth[:, i]))
        if covariances:
            each = np.broadcast_to(
                with_trailing(found.cov, 1, leading=2), (*found.cov.shape[:2], task.width)
            )
            cov.append(each[..., :covariances].copy())
    kept = np.stack(cov, axis=2) if cov else None
    errors = consistency.series()
    errors |= judged.series(errors["nees"])
    if not data.prior.cov.any():
        for rows in errors.values():
            rows[0] = np.nan  # the first state is known exactly: there is nothing to judge
    nees = errors.pop("nees")
    notes = _stacked(noted) | errors
    notes |= {name: np.stack([o[name] for o in others]) for name in others[0]}
    return Filtered(mean, nees, kept, notes | telling.series(), clock.cpu_s)


def prior_of(data: Simulation, model: Model) -> Distribution:
    """The prior of the state that a filter assumes, which may have more components than the truth."""
    if len(model.motion.components) <= len(data.truth):
        return data.prior
    return frozen(extended(data.prior, extra_std(model.motion)))


def _own_part(found: Gaussian, n: int) -> Gaussian:
    """The truth's components of an estimate: the first n of those of the model."""
    return found if len(found.mean) == n else Gaussian(found.mean[:n], found.cov[:n, :n])


class _Clock:
    """Adds up the CPU time of the blocks it is entered for."""

    cpu_s = 0.0

    def __enter__(self) -> None:
        self._started = time.process_time()

    def __exit__(self, *_: object) -> None:
        self.cpu_s += time.process_time() - self._started


def _stacked(noted: list[dict[str, Array]]) -> dict[str, Array]:
    names = noted[0] if noted else {}
    check_names(names)
    rows = {name: np.stack([note[name] for note in noted]) for name in names}
    return {name: np.vstack([np.full_like(r[:1], np.nan), r]) for name, r in rows.items()}
