"""Table kind `consistency`: do errors and innovations fit their covariances?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables.consistency_band_notes import (
    DegreesOfFreedom,
    notes_on_bands_of_steps,
)
from trackbench.report.tables.innovations import innovation_cell, refused_column
from trackbench.report.tables_and_figures import Results
from trackbench.results.rows_and_columns import Columns
from trackbench.statistics.consistency_bands import AcceptedNis, nis_band
from trackbench.statistics.sample_statistics import Estimate


@register("tables", "consistency")
@dataclass(frozen=True, kw_only=True)
class Consistency(TableKind):
    """Normalized errors and innovations over the runs at each step, and their chi-square bands.

    ANEES and ANIS are NEES and NIS over the number n of components: 1 if consistent. Components that are
    known exactly, not measured, or refused by a gate do not count. Averaged over M runs at one step they
    are chi-square of M n degrees of freedom over M n; a consistent filter stays in the 95 % band in 95 %
    of the steps (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.3). What a gate accepts has a smaller
    ANIS, and a filter with a gate has the band of that.
    """

    requires: ClassVar[dict[str, str]] = {"anees": "per_step", "nis": "per_step"}

    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: Digits = 3
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Fill a row for each filter: shares of the steps at which ANEES and ANIS lie in their bands."""
        evaluators = {tuple(point.items()): Evaluator(results, point) for point in results.points()}
        refused = refused_column(evaluators.values())
        # The space makes the two headings of bands different.
        heads = ["ANEES, median step", "steps in its band"]
        heads += ["ANIS, median step", "steps in its band ", *refused]
        table = Table(self.title, [*results.grid_heads, "Filter"], heads, self.digits)
        # Degrees of freedom at the steps of all filters, for the notes on the bands.
        degrees: dict[str, DegreesOfFreedom] = {"ANEES": {}, "ANIS": {}}
        for point, evaluator in evaluators.items():
            facts = results.facts(dict(point))
            per_step = results.columns("per_step", dict(point))
            for label in results.chosen(self.filters):
                rows = per_step.where(filter=label)
                # ANEES is stored per component. No gate limits the errors of the state.
                anees = rows.where(metric="anees")
                states = len(facts.components)
                degrees_of_anees = degrees_of(rows, "anees", states)
                degrees["ANEES"].setdefault((states, None), set()).update(degrees_of_anees.tolist())
                cells = _cells(anees["value"], degrees_of_anees, None)
                # NIS is stored as it is: ANIS = NIS / n, where n is the number of components that were
                # used at the step, a mean over the runs.
                nis = rows.where(metric="nis")
                measured_components = len(facts.measured)
                degrees_of_nis = degrees_of(rows, "nis", measured_components)
                # Distribution of the NIS that the filter's gate accepts; None without a gate.
                accepted = facts.accepted_nis(label)
                law = (measured_components, accepted)
                degrees["ANIS"].setdefault(law, set()).update(degrees_of_nis.tolist())
                anis = nis["value"] / (degrees_of_nis / nis["runs"])
                cells += _cells(anis, degrees_of_nis, accepted)
                cells += [innovation_cell(evaluator, label, m) for m in refused.values()]
                table.add([*(str(value) for _, value in point), label], cells)
        table.notes += notes_on_bands_of_steps(degrees, int(results.config["runs"]))
        return table


def degrees_of(rows: Columns, metric: str, n: int) -> Array:
    """Count the degrees of freedom of a metric's sum over the runs, at the steps that have it.

    Each run has n degrees, less those components that are not measured or are known exactly.

    Parameters
    ----------
    rows
        rows of one filter in per_step.csv
    metric
        "nis", "anees", or the ANEES of a part of the state such as "anees_position"
    n
        number of its components

    Returns
    -------
    array (K,)
        degrees of freedom at the K steps that have the metric
    """
    chosen = rows.where(metric=metric)
    # The mean number of components that a run lacks is stored as unused_nees, unused_nees_position, ...
    series = metric.replace("anees", "nees", 1)
    unused = rows.where(metric=f"unused_{series}")
    unused_at_step = dict(zip(unused["step"].tolist(), unused["value"].tolist(), strict=True))
    used = np.array([n - unused_at_step.get(step, 0.0) for step in chosen["step"].tolist()])
    return np.asarray(chosen["runs"] * used)


def _cells(values: Array, degrees: Array, accepted: AcceptedNis | None) -> list[Cell]:
    """Return a cell with the median of the values over the steps, and one with the share in their bands.

    ``values`` (K,) are mean normalized squares per component at K steps, and ``degrees`` (K,) their
    degrees of freedom.
    ``accepted`` is the distribution of what a filter's gate accepts; None without a gate.
    """
    if not len(values):
        return [Cell.missing(), Cell.missing()]
    # A band for each number of degrees of freedom that a step has.
    bands = {number: nis_band(number, accepted) for number in set(degrees.tolist())}
    low, high = np.array([bands[number] for number in degrees.tolist()]).T
    median = float(np.median(values))
    inside = float(((values >= low) & (values <= high)).mean())
    # Steps depend on each other, so no standard error is claimed. ``runs`` is the number of steps here.
    return [Cell(Estimate(x, np.nan), runs=len(values), lost=0) for x in (median, inside)]
