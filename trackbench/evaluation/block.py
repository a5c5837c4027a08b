"""A block of runs: what is to be computed of it, its data, and what comes of it.

A block is always computed whole and then trimmed to the runs that are wanted, so run m comes out the
same in a batch of 10 or of 10 000.
"""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array, LatestResults, freeze
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation import consistency_and_calibration as calibration
from trackbench.evaluation import predictive_scores
from trackbench.evaluation.error_series import StepSums
from trackbench.filters.base import AnyFilter
from trackbench.models.sensors.base import Assume
from trackbench.scenarios.base import Scenario, Simulation

MOST_STACKED = 8
"""Blocks that are filtered side by side at most."""
Kind: TypeAlias = predictive_scores.Kind | calibration.Kind


@dataclass(frozen=True)
class BlockTask:
    """Task of a block: runs ``index * width`` onwards, ``runs_used`` of the block's ``width``.

    A block of negative index holds training runs, from run -1 down: -1 the first ``width`` of them.
    Only numbers per run are kept of it.
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
    particle_steps: tuple[int, int] | None = None
    """keep the particles of the shown tracks from the first to the last of these steps"""
    keep_steps: tuple[str, ...] = ()
    """series kept per run and step, for their medians"""
    assume: Assume | None = None
    """what the filter assumes that is not the scenario's"""
    predictive_metrics: tuple[Kind, ...] = ()
    """what the filter is asked beside its estimate: of measurements before it is given them, and of
    where in its posterior the truth lies"""
    hold_out: int | None = None
    """every so many-th measurement of a run is not given to the filter"""
    extra_run_counts: tuple[int, ...] = field(default=(), compare=False)
    """numbers of the block's runs over which it is reduced, too: a batch may stop there, or go on"""
    stacked: int = 1
    """blocks from this one outwards that are filtered side by side, each with its own random numbers"""
    copies: int = 1
    """number of filters that filter the same runs side by side; ``filter`` is the joined one"""

    @property
    def assumed_scenario(self) -> Scenario:
        """Scenario with the model that the filter assumes."""
        return self.scenario if self.assume is None else self.scenario.with_assumptions(self.assume)

    @property
    def first_run(self) -> int:
        """Number of the block's first run."""
        return self.index * self.width if self.index >= 0 else (self.index + 1) * self.width - 1

    @property
    def runs(self) -> int:
        """Number of runs that are filtered together."""
        return self.stacked * self.copies * self.width

    @property
    def blocks(self) -> list[int]:
        """Numbers of the stacked blocks: training blocks count down."""
        step = 1 if self.index >= 0 else -1
        return [*range(self.index, self.index + step * self.stacked, step)] * self.copies

    @property
    def data(self) -> Simulation:
        """Data of the whole block, or stack of blocks."""
        scenario, width = self.scenario.without_scoring, self.stacked * self.width
        if self.copies == 1:
            return simulate(scenario, self.seed, self.first_run, width)
        return simulate_copies(scenario, self.seed, self.first_run, width, self.copies)

    @property
    def filtering_key(self) -> "BlockTask":
        """Task that is equal for all tasks of which the filter makes the same estimates."""
        alone = BlockTask(
            self.scenario.without_scoring, self.filter, self.seed, self.index, self.width, 0
        )
        return replace(
            alone,
            assume=self.assume,
            predictive_metrics=self.predictive_metrics,
            hold_out=self.hold_out,
            stacked=self.stacked,
            copies=self.copies,
            particle_steps=self.particle_steps,
            runs_with_tracks=self.runs_with_tracks if self.particle_steps else 0,
        )

    @property
    def reference_task(self) -> "BlockTask":
        """The reference's own task, as it is among the filters."""
        assert self.reference is not None
        return replace(self.filtering_key, filter=self.reference, assume=self.reference_assume)

    @property
    def twin_task(self) -> "BlockTask | None":
        """Task of the same filter in the same runs without faults; None if there are none."""
        scenario = self.scenario.without_faults
        if scenario is self.scenario:
            return None
        assume = None if self.assume is None else replace(self.assume, faults=None)
        return replace(self.filtering_key, scenario=scenario.without_scoring, assume=assume)

    def runs_with_tracks_among(self, used: int) -> int:
        """Count the block's first ``used`` runs whose whole tracks are stored."""
        return 0 if self.index < 0 else max(0, min(self.runs_with_tracks - self.first_run, used))


class Tracks(NamedTuple):
    """Whole tracks of r runs: truth and mean (n_x, T + 1, r), measurements (n_z, T, r)."""

    truth: Array
    measurements: Array
    mean: Array
    cov: Array | None
    particles: Array | None = None
    """states, weights and parents of some steps' N particles (n_x + 2, S, N, r), NaN where unknown"""


class BlockResult(NamedTuple):
    """Metrics of the block's used runs; no particles, no tracks but the shown ones."""

    per_run: dict[str, Array]
    steps: dict[str, StepSums]
    run_series: dict[str, Array]
    tracks: Tracks | None
    cpu_s: float
    width: int


def _simulate(scenario: Scenario, seed: int, first_run: int, width: int) -> Simulation:
    # Training runs count down: -1, -2, ...
    step = 1 if first_run >= 0 else -1
    rng = RunStreams(seed, range(first_run, first_run + step * width, step))
    return freeze(scenario.simulate(rng, width))


simulate = LatestResults(_simulate, size=2)
"""The block's data, read-only; cached, because every filter of a block gets the same data."""


def _simulate_copies(
    scenario: Scenario, seed: int, first_run: int, width: int, copies: int
) -> Simulation:
    """Repeat the same runs several times, with the prior's moments."""
    data = simulate(scenario, seed, first_run, width)

    def repeated(rows: Any) -> Any:
        return np.concatenate([rows] * copies, axis=-1)

    mean, cov = data.prior.mean, data.prior.cov
    prior = Gaussian(repeated(mean), repeated(cov) if cov.ndim > 2 else cov)
    arrival = None if data.arrival is None else repeated(data.arrival)
    return freeze(Simulation(repeated(data.truth), repeated(data.measurements), prior, arrival))


simulate_copies = LatestResults(_simulate_copies, size=1)
"""The data of a block that several filters filter side by side, read-only."""
