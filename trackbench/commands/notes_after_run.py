"""Notes after a run: reused blocks, dead workers, lost runs, undrawn figures, failed filters."""

from collections.abc import Iterator, Mapping

from trackbench.config.experiment import Experiment
from trackbench.core.random_streams import RunStreams
from trackbench.errors import counted, counted_with_verb
from trackbench.execution.plan import Key
from trackbench.execution.run_plans import Outcome
from trackbench.execution.worker_death_messages import deaths_note
from trackbench.filters.external import External
from trackbench.filters.float32_digits import PRINT_ALL_DIGITS
from trackbench.report.findings.phrases import named
from trackbench.report.tables_and_figures import Results
from trackbench.results.counts_of_lost_runs import Losses
from trackbench.tuning.record_of_trials import Record
from trackbench.tuning.remarks_on_keys import remarks_on_vain_trials


def run_lines(outcome: Outcome) -> Iterator[str]:
    """Yield lines on reused and damaged blocks, on workers that died, and on too little memory."""
    if outcome.reused:
        finished = outcome.reused + outcome.computed
        yield f"reused {outcome.reused} of {counted(finished, 'block')} from {outcome.store.root}/"
    if outcome.damaged:
        yield f"{counted_with_verb(outcome.damaged, 'damaged block')} computed again"
    if outcome.deaths:
        yield deaths_note(outcome.deaths)
    if outcome.crowding:
        yield f"note: {outcome.crowding}"


def loss_notes(experiment: Experiment, losses: dict[Key, Losses]) -> Iterator[str]:
    """Yield a note for each filter that lost some of its runs.

    A filter that lost all of them counts as failed, in `failure_lines`.
    """
    for key, loss in losses.items():
        if loss.lost and not loss.is_total:
            yield f"{experiment.title_of(key)}: {loss}"


def tuning_notes(tuning: Mapping[str, Record]) -> Iterator[str]:
    """Yield notes on the trials of each tuned filter that failed, and on its keys without effect.

    ``tuning`` has the trials by the filter's label.
    """
    for label, record in tuning.items():
        for remark in remarks_on_vain_trials(record):
            yield f"tuning of {named(label)}: {remark}"


def bound_notes(experiment: Experiment) -> Iterator[str]:
    """Yield the cautions of the scenarios' lower error bounds, each once; none without a bound.

    A caution is a reason to doubt a bound, such as that few simulated paths carry its information.
    """
    bound = experiment.settings.bound
    if not bound:
        return
    bound_cautions = [point.scenario.bound_caution for point in experiment.points]
    for caution in dict.fromkeys(bound_cautions):
        if caution:
            yield f"{bound}: {caution}"


def digit_notes(experiment: Experiment, outcome: Outcome) -> Iterator[str]:
    """Yield a note for each filter that is a program and prints its estimates with too few digits.

    Those of float32 are too few at large coordinates. The program is run once more, on the first run of
    the first point of the grid.
    """
    point = experiment.points[0]
    failed = {label for _, label in outcome.failures}  # by number of the point, and label
    for label, tracker in point.filters.items():
        if not isinstance(tracker, External) or label in failed:
            continue
        scenario = point.assumed_scenario(label)
        data = scenario.simulate(RunStreams(experiment.settings.seed, range(1)), 1)
        prior = scenario.assumed_prior(1) or data.prior  # None: filters assume the simulated prior
        first_step = int(scenario.steps[1])  # of the first measurement; steps[0] is the prior's
        # `too_few` and `advice` are words for a note; empty if there is nothing to say.
        digits = tracker.digits(scenario.model, prior, data.measurements, first_step)
        if digits.too_few:
            yield f"{label}: answers have {digits.too_few}: {PRINT_ALL_DIGITS}"
        elif digits.advice:
            yield f"{label}: {digits.advice}"


def idle_figure_notes(results: Results) -> Iterator[str]:
    """Yield a note on the figures that are not drawn, as none of their filters ran."""
    if results.idle_figures:
        names = ", ".join(results.idle_figures)
        yield f"figures that are not drawn, because none of their filters ran: {names}"


def failure_lines(
    experiment: Experiment, outcome: Outcome, losses: dict[Key, Losses]
) -> Iterator[str]:
    """Yield a line for each filter that failed, lost all runs, or has no distance to the reference.

    ``losses`` are the lost runs of the filters that did not fail. The distance is the RMS difference
    from the estimates of the reference filter, which may itself have failed.
    """
    for key, why in outcome.failures.items():
        yield f"{experiment.title_of(key)} failed: {why}"
    for key, loss in losses.items():
        if loss.is_total:
            yield f"{experiment.title_of(key)} failed: {loss}"
        if not loss.has_distance:
            reference = experiment.settings.reference
            yield f"{experiment.title_of(key)} has no distance: the reference {reference} failed"
