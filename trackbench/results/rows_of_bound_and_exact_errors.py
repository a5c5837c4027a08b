"""Rows of lower bounds and of exact errors, which stand in the results beside those of the runs."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from trackbench.config.bound_and_exact_errors import exact_label
from trackbench.config.experiment import Experiment
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.bound_rows import bound_steps, bound_summary
from trackbench.evaluation.exact_errors import exact_rows, exact_series
from trackbench.evaluation.nees import sizes as sizes_of_nees
from trackbench.evaluation.per_step_columns import StepColumns
from trackbench.evaluation.summary_rows import SummaryRow


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
