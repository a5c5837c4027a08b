"""File sweep.csv of a sweep: one tidy table of one statistic of each metric."""

import numpy as np

from trackbench.csv_writer import write_csv
from trackbench.evaluation.metric_expression import measured
from trackbench.report.tables_and_figures import Results


def write_sweep(results: Results) -> None:
    """Write ``sweep.csv``: one statistic of each metric, rms of errors, ANEES, mean of the rest."""
    summary = results.columns("summary")
    is_shown = np.array([_is_headline(name) for name in summary["metric"]], dtype=bool)
    rows = summary.chosen(is_shown)
    # Iterated over, `Columns` yields the names of its columns.
    write_csv(results.target / "sweep.csv", list(rows), rows.tuples(rows))


def _is_headline(metric: str) -> bool:
    """Test whether a row of summary.csv is in sweep.csv, by the name of its metric.

    Each metric has one row there: rms of an RMSE, the ANEES in place of the NEES, mean of any other.
    """
    m = measured(metric)
    definition = m.definition
    if definition.over_steps == "rms":  # an RMSE, or an RMS difference from the reference
        return m.statistic == "rms"
    # A metric per component, as the ANEES, has a single row, whose name has no statistic.
    return definition.per_component or (m.statistic == "mean" and definition.name != "nees")
