"""Keys `bound` and `exact`: check that bounds and exact errors exist, label and compute them."""

from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple

from trackbench.config.experiment import Experiment, Point
from trackbench.config.experiment_keys import Settings
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.bound_rows import bound_steps, bound_summary
from trackbench.evaluation.exact_errors import exact_rows, exact_series, is_exact, why_not_exact
from trackbench.evaluation.metric_expression import Measure
from trackbench.evaluation.nees import sizes as sizes_of_nees
from trackbench.evaluation.per_step_columns import StepColumns
from trackbench.evaluation.summary_rows import SummaryRow
from trackbench.plugins.plugin_errors import plugin_code
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Source


def check_bound(source: Source, scenario: Scenario) -> None:
    """Check that a requested lower bound exists."""
    if source.data.get("bound") is None:
        return
    why = scenario.why_no_bound  # None if there is a bound; empty if its lack has no further reason
    if why is not None:
        message = f"scenario {scenario.kind} has no lower bounds"
        if why:
            message += f": {why}"
        source.add_problem(("bound",), message)


def check_exact(source: Source, settings: Settings, point: Point) -> None:
    """Check that the filters whose exact errors are requested are linear, and so is the scenario."""
    for i, label in enumerate(settings.exact):
        if label not in point.filters:
            continue  # `only` leaves it out
        tracker = point.filters[label]
        assume = point.assumed.get(label)
        with plugin_code(tracker, point.scenario, assume):
            # Neither the seed nor the number of runs matters.
            one_run = BlockTask(
                scenario=point.scenario,
                filter=tracker,
                seed=0,
                index=0,
                width=1,
                runs_used=1,
                assume=assume,
            )
            why = why_not_exact(one_run)
        if why is not None:
            source.add_problem(("exact", i), f"{label} has no exact errors: {why}")


def exact_label(label: str) -> str:
    """Label the exact errors of a filter in tables and figures."""
    return f"{label}, exact"


class RowsWithoutRuns(NamedTuple):
    """Rows of a lower bound or of a filter's exact errors at one point of the grid."""

    point: int
    """number of the point"""
    label: str
    summary: Iterable[SummaryRow]
    """rows of summary.csv"""
    steps: Iterable[StepColumns]
    """columns of per_step.csv"""


def rows_without_runs(experiment: Experiment) -> Iterator[RowsWithoutRuns]:
    """Yield the rows of lower bounds and exact errors; exact errors have no standard errors.

    The config's key `bound` is the label of the bound, if there is one, and `exact` lists the labels of
    the filters whose exact errors are computed.
    """
    settings = experiment.settings
    for i, point in enumerate(experiment.points):
        scenario = point.scenario
        if settings.bound:
            bounds = scenario.bounds()
            # Bounds from all batches of simulated paths but one: they give the standard error.
            without_batch = scenario.bounds_without_batch()
            yield RowsWithoutRuns(
                point=i,
                label=settings.bound,
                summary=bound_summary(bounds, scenario.windows, without_batch),
                steps=bound_steps(bounds, without_batch),
            )
        for name in settings.exact:
            if name not in point.filters:
                continue
            # One run of fixed numbers in place of noise: the seed has no effect.
            task = BlockTask(
                scenario=scenario,
                filter=point.filters[name],
                seed=0,
                index=0,
                width=1,
                runs_used=1,
                assume=point.assumed.get(name),
                hold_out=settings.hold_out,
            )
            summary, steps = exact_rows(
                exact_series(task), sizes_of_nees(scenario), scenario.windows
            )
            yield RowsWithoutRuns(point=i, label=exact_label(name), summary=summary, steps=steps)


def why_not_controlled(measure: Measure, exact_labels: Collection[str]) -> str:
    """Explain why a measure ``controlled(...)`` has no exact value to correct by; empty if it has.

    ``exact_labels`` are the filters of the key `exact`.
    """
    has_exact_value = measure.other in exact_labels and is_exact(measure)
    if measure.relation != "controlled" or has_exact_value:
        return ""
    message = f"'{measure}' needs a filter of `exact` and a mean of squares"
    return f"{message}, such as rms(rmse) or anees"
