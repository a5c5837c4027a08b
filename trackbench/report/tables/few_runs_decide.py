"""Notes on errors of which a few runs decide the number of a filter."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from trackbench.evaluation.metric_expression import Expression
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.phrases import listed, named
from trackbench.statistics.heavy_tails import has_heavy_tail
from trackbench.statistics.sample_statistics import STATISTICS, influence, interval


def few_runs_notes(
    evaluator: Evaluator, labels: Sequence[str], columns: Collection[Expression]
) -> Iterator[str]:
    """Yield a warning for each error of which a few runs decide a filter's number.

    Parameters
    ----------
    evaluator
        results at one point of the grid
    labels
        filters in the rows of the table
    columns
        measures in its columns

    Yields
    ------
    str
        sentence with the medians of these filters, which the few runs do not change
    """
    # Step 1: medians of the filters' errors that have a heavy tail, by error and filter.
    medians: dict[str, dict[str, str]] = {}
    for column in columns:
        if not column.is_error or column.relation:
            continue
        for label in labels:
            m = column.of(label)
            values_of_runs = evaluator.per_run(m)
            if values_of_runs is None:
                continue
            statistic, values = values_of_runs
            if statistic not in ("mean", "rms", "variance"):
                continue
            x = values[np.isfinite(values)]
            if has_heavy_tail(influence(statistic, x)):
                middle = STATISTICS["median"](x).value
                low, high = interval("median", x)
                name = m.metric
                if m.window:
                    name += f"[{m.window}]"
                text = f"{named(label)} {middle:.3g} ({low:.3g} to {high:.3g})"
                medians.setdefault(name, {})[label] = text
    # Step 2: a sentence for each error.
    place = evaluator.results.point_heading(evaluator.point)
    where = f" at {place}" if place else ""
    for name, text_by_label in medians.items():
        message = f"A few runs decide the {name}{where}, so its ± may be too small"
        yield f"{message}; medians: {listed(list(text_by_label.values()))}."
