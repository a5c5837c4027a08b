"""Columns of a ranking: heads, CPU times, the bound's point, and which columns are left out as empty."""

from collections.abc import Sequence
from math import nan

from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.cpu_time_notes import RUN_BY_RUN, time_of_programs
from trackbench.report.findings.ranking import Ranking
from trackbench.report.markdown_table import TextTable
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint

ERROR_CELL = 1
RATIO_CELL = 2
CONSISTENCY_CELL = 4
"""Index of the cell with this content in a row of the ranking; the CPU time is the last cell."""

LOST = "Lost runs"
ANEES = "ANEES"
TIME = "CPU per run"


def cpu_seconds(results: Results, candidate: Candidate) -> float:
    """Return the CPU seconds of a filter's run; NaN if they were not measured."""
    rows = results.columns("timing", candidate.point).where(filter=candidate.label)
    if not len(rows):
        return nan
    return float(rows["cpu_s_per_run"][0])


def finish_table(results: Results, table: TextTable, names_losses: bool = True) -> TextTable:
    """Leave out the empty columns of a ranking, add its last note, and set its column heads.

    If no run is lost, the title says so, unless ``names_losses`` is False.
    """
    # Step 1: the first three columns stay in every table. Any other needs a cell that says something.
    columns = []
    for i, head in enumerate(table.heads):
        is_empty = all(row[i].text in ("–", "0") for row in table.rows)
        if i < 3 or not is_empty:
            columns.append(i)
        if head == LOST and is_empty and names_losses:
            table.title += "; no lost runs"
    # Step 2: a star marks the CPU time of a filter that loops over the runs in Python.
    if any(row[-1].text.endswith("*") for row in table.rows):
        table.notes.append(f"*: {RUN_BY_RUN}")
        if results.programs:
            table.notes.append(time_of_programs(results.programs))
    # Step 3: without NEES, which needs a truth, the column of consistency is about ANIS.
    has_nees = any(name == "nees" for _, name in results.runs(results.points()[0]))
    heads = []
    for i in columns:
        head = table.heads[i]
        if head == ANEES and not has_nees:
            head = "ANIS"
        heads.append(head)
    table.heads = heads
    table.rows = [[row[i] for i in columns] for row in table.rows]
    return table


def span(texts: Sequence[str]) -> str:
    """Join the first and last text: ``2 to 5``; ``2`` if they are equal, empty if there are none."""
    if not texts:
        return ""
    return " to ".join(dict.fromkeys((texts[0], texts[-1])))


def bound_point(results: Results, ranking: Ranking) -> GridPoint:
    """Return the point of the grid at which the bound and exact errors of a ranking are taken.

    The scenario has the values of the ranking, and all other paths have their first values.
    """
    return results.points()[0] | ranking.scene
