"""Task of a block of runs: scenario, filter, seed and runs; the task of its first steps.

A block is always computed whole and then trimmed to the requested runs. So run m has the same bytes in a
batch of 10 as in one of 10 000.
"""

from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, cast

from trackbench.evaluation import calibration_series, predictive_and_held_out_scores
from trackbench.evaluation.simulated_runs import numbers_from, simulate_copies
from trackbench.filters.base import AnyFilter
from trackbench.models.assume import Assume
from trackbench.scenarios.base import Scenario, Simulation

Kind: TypeAlias = predictive_and_held_out_scores.Kind | calibration_series.Kind


MOST_STACKED = 8
"""Blocks that are filtered side by side at most."""


@dataclass(frozen=True)
class BlockTask:
    """Task of a block: runs from ``index * width`` on, of which the first ``runs_used`` are reported.

    A block of negative index has training runs, whose numbers count down from -1: the block -1 has the
    first ``width`` of them. Only its numbers per run are stored.
    """

    scenario: Scenario
    filter: AnyFilter
    seed: int
    index: int
    width: int
    runs_used: int
    reference: AnyFilter | None = None
    """filter whose estimates distances are measured to, if any"""
    reference_assume: Assume | None = None
    """known faults of the reference"""
    runs_with_tracks: int = 0
    """keep whole tracks of runs below this number"""
    keep_covariance: bool = False
    """keep the covariances of the shown tracks too"""
    keep_steps: tuple[str, ...] = ()
    """series kept per run and step, for their medians"""
    assume: Assume | None = None
    """parts of the filter's model that differ from the scenario's"""
    predictive_metrics: tuple[Kind, ...] = ()
    """metrics computed from more than the estimates: from the filter's predictions of measurements, and
    from the place of the truth in its posterior"""
    hold_out: int | None = None
    """every so many-th measurement of a run is not given to the filter"""
    extra_run_counts: tuple[int, ...] = field(default=(), compare=False)
    """further numbers of the block's runs to compute metrics for: the batch may stop after so many"""
    stacked: int = 1
    """number of consecutive blocks of `width` runs, this one first, that are filtered side by side, each
    with its own random numbers"""
    copies: int = 1
    """number of filters that filter the same runs side by side; ``filter`` is the joined one"""

    @property
    def assumed_scenario(self) -> Scenario:
        """Scenario with the model that the filter assumes."""
        if self.assume is None:
            return self.scenario
        return self.scenario.with_assumptions(self.assume)

    @property
    def first_run(self) -> int:
        """Number of the block's first run.

        Training runs count down from -1. With ten runs per block the block -1 has the runs -1 to -10,
        and the block -2 begins with the run -11.
        """
        if self.is_training:
            return (self.index + 1) * self.width - 1
        return self.index * self.width

    def run_number(self, position: int) -> int:
        """Return the number of the run at this position in the block, counted from 0."""
        return numbers_from(self.first_run, self.width)[position]

    @property
    def is_training(self) -> bool:
        """True if the runs are training runs, of which only the numbers per run are stored."""
        return self.index < 0

    @property
    def runs(self) -> int:
        """Number of runs that are filtered together."""
        return self.stacked * self.copies * self.width

    @property
    def blocks(self) -> list[int]:
        """Indices of the blocks that are filtered side by side, in the order of their runs.

        Each of several joined filters has the same blocks, so that these are repeated.
        """
        return [*numbers_from(self.index, self.stacked)] * self.copies

    @property
    def data(self) -> Simulation:
        """Simulated or recorded data of all runs that are filtered side by side, from a cache.

        They are the runs of `stacked` consecutive blocks. If several filters are joined to one, each of
        the `copies` filters gets these same runs, one filter's after the other's.
        """
        width = self.stacked * self.width
        return simulate_copies(
            self.scenario.without_scoring, self.seed, self.first_run, width, self.copies
        )

    @property
    def filtering_task(self) -> "BlockTask":
        """Task that is equal for all tasks in which the filter computes the same output.

        It has the fields that the output of the filter depends on, and for all others one value. So no
        runs are used (0): a filter always runs over the whole block. The output contains the predictive
        metrics, which are computed while the filter runs, and all runs that are filtered side by side
        (``stacked``, ``copies``).
        """
        return BlockTask(
            scenario=self.scenario.without_scoring,
            filter=self.filter,
            seed=self.seed,
            index=self.index,
            width=self.width,
            runs_used=0,
            assume=self.assume,
            predictive_metrics=self.predictive_metrics,
            hold_out=self.hold_out,
            stacked=self.stacked,
            copies=self.copies,
        )

    @property
    def reference_task(self) -> "BlockTask":
        """Task of the reference in the same runs.

        It has only what the output of the reference depends on (`filtering_task`). So it is equal to the
        `filtering_task` of the reference itself, if the reference is also one of the filters.
        """
        assert self.reference is not None
        return replace(self.filtering_task, filter=self.reference, assume=self.reference_assume)

    def runs_with_tracks_among(self, used: int) -> int:
        """Count the block's first ``used`` runs whose whole tracks are stored.

        They are those with numbers below `runs_with_tracks`.
        """
        if self.is_training:
            return 0
        return max(0, min(self.runs_with_tracks - self.first_run, used))


def first_steps(task: BlockTask, data: Simulation, steps: int) -> tuple[BlockTask, Simulation]:
    """Return the task and the data of the first steps after the first state.

    Parameters
    ----------
    task
        task of a whole block
    data
        data of the block
    steps
        number of steps

    Returns
    -------
    task : BlockTask
        task of the shorter scenario, without what only metrics and files need
    data : Simulation
        truth (n_x, steps + 1, M) and measurements (n_z, steps, M)
    """
    scenario = cast(Scenario, _FirstSteps(task.scenario, steps))
    first_data = data._replace(
        truth=data.truth[:, : steps + 1],
        measurements=data.measurements[:, :steps],
    )
    if data.arrival is not None:
        first_data = first_data._replace(arrival=data.arrival[:, :steps])
    # The task without what only metrics and files need.
    return replace(task.filtering_task, scenario=scenario), first_data


class _FirstSteps:
    """The first steps of a scenario, which is otherwise itself."""

    def __init__(self, scenario: Scenario, steps: int) -> None:
        self._scenario = scenario
        self.steps = scenario.steps[: steps + 1]
        self.times = scenario.times[: steps + 1]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._scenario, name)
