"""Cell of a filter's measure: its number, and over how many of the runs it is if not over all."""

from trackbench.evaluation.metric_expression import Measure
from trackbench.report.expressions import Evaluator
from trackbench.report.table import Cell


def measured_cell(evaluator: Evaluator, m: Measure) -> Cell:
    """Return the cell of a filter's measure: its row of summary.csv, or without one its evaluation.

    The cell says so if only some of the runs that are not lost have a value.
    """
    # A share is evaluated, as its interval needs the number of runs with the event.
    stored = None if m.is_share else evaluator.stored.get((m.filter, str(m)))
    term = stored or evaluator.term(m)
    suffix = ""
    runs_not_lost = len(evaluator.runs.get((m.filter, "lost"), ())) - term.lost
    if m.is_over_runs and 0 < term.runs < runs_not_lost:
        suffix = f" ({term.runs} of {runs_not_lost} runs)"
    return Cell.of(term, evaluator.collapse_words(m))._replace(suffix=suffix)
