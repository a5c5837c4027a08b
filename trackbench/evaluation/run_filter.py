"""Run one filter over one block of runs: time each step, deliver measurements, record estimates."""

import time
from collections.abc import Callable

from numpy.random import Generator

from trackbench.core.distributions import Distribution
from trackbench.core.random_streams import aside_stream, block_stream, side_by_side
from trackbench.core.read_only import explain_read_only_errors, freeze
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.deliver_late_measurements import deliveries
from trackbench.evaluation.filter_output import FilterOutput, Recorder
from trackbench.evaluation.predictive_and_held_out_scores import (
    PredictionScorer,
    Step,
)
from trackbench.evaluation.refilter_late_measurements import make_refilter
from trackbench.evaluation.state_copies import make_state_copier
from trackbench.evaluation.validate_returned_arrays import (
    check_axes,
)
from trackbench.evaluation.writes_to_shared_arrays import sealed
from trackbench.filters.base import Steps, filter_many
from trackbench.filters.external_process import programs_cpu_s
from trackbench.filters.failed_step import UnderWay
from trackbench.models.augmented_priors import augment_prior
from trackbench.models.base import Model, extra_std
from trackbench.scenarios.base import Simulation

_AT_ONCE = 32_768
"""Runs times steps that a filter may take in one call, so that the arrays stay in the cache."""


@explain_read_only_errors()
def run_filter(task: BlockTask, data: Simulation, covariances: int = 0) -> FilterOutput:
    """Run the filter over the block's data. Only the filter is timed.

    Parameters
    ----------
    task
        filter, scenario and runs of the block
    data
        data of the task's scenario, usually `BlockTask.data`
    covariances
        number of first runs whose covariances are recorded

    Returns
    -------
    FilterOutput
        estimates (n_x, T + 1, M) of the prior and of every step, and series (T + 1, M)

    Raises
    ------
    ValueError
        if the filter writes to its arguments, or returns something that is no estimate
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
        refilter = make_refilter(task, model, delivered, scorer.visible, rng, clock)
    if delivered is not None:
        # A late measurement stands at the step at which the filter gets it.
        scorer.visible = delivered.given(scorer.visible)
    prior = prior_of(assumed_data, model)
    recorder = Recorder(task, assumed_data, model, covariances)
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
                    many = filter_many(tracker, model, state, z, steps[first])
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


def _assumed_data(task: BlockTask, data: Simulation) -> Simulation:
    """Return the data with the prior that the filter assumes, and without the errors of known faults."""
    assumed = task.assumed_scenario
    # None if the filter assumes no other prior.
    prior = assumed.assumed_prior(data.truth.shape[-1]) or data.prior
    measurements = assumed.assumed_measurements(data.measurements)
    return freeze(data._replace(prior=prior, measurements=measurements))


def prior_of(data: Simulation, model: Model) -> Distribution:
    """Return the prior of the filter's state, which may have more components than the truth.

    The additional components have the mean 0 and the standard deviations that the motion names.
    """
    if len(model.motion.components) <= len(data.truth):
        return data.prior
    return freeze(augment_prior(data.prior, extra_std(model.motion)))


class _Clock:
    """Context that adds up the CPU time spent within it, the time of external programs included."""

    cpu_s = 0.0

    def __enter__(self) -> None:
        self._started = time.process_time() + programs_cpu_s()

    def __exit__(self, *_: object) -> None:
        self.cpu_s += time.process_time() + programs_cpu_s() - self._started
