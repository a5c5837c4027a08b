"""Headline, table and notes of a gate: which numbers are worse or removed, for a pull request."""

from math import isnan

from trackbench.commands.compare_new_with_stored import Verdict
from trackbench.errors import counted
from trackbench.report.findings import phrases
from trackbench.report.folder_comparison import table_figure_and_sentences
from trackbench.report.markdown_table import TextTable
from trackbench.statistics.significance_rules import EQUAL, WORSE


def gate_table(verdict: Verdict, name: str, worse: str) -> TextTable:
    """Tabulate the numbers of the changed filters in both results, with a headline and notes.

    ``name`` is that of the stored results or revision, ``worse`` the limit as typed.
    """
    # The headline names the numbers that are worse or gone, else the filters that were compared.
    parts = []
    worse_numbers = table_figure_and_sentences.changes(verdict.rows, WORSE)
    worse_numbers += [str(failure) for failure in verdict.failed]
    if worse_numbers:
        parts.append(f"worse: {phrases.listed(worse_numbers)}")
    if verdict.removed:
        removed = phrases.listed([str(item) for item in verdict.removed])
        parts.append(f"incomplete: removed {removed}")
    if not parts:
        is_unchanged = all(row.how == EQUAL for row in verdict.rows)
        compared = phrases.listed([phrases.named(label) for label in verdict.compared])
        parts.append(f"{'unchanged' if is_unchanged else 'not worse'}: {compared}")
    title = f"{verdict.name} is {'; '.join(parts)}"
    table = table_figure_and_sentences.table_of(title, verdict.rows, (name, "now"), has_tests=True)
    # A number that was tested has a p-value.
    runs_of_tests = [row.difference.runs for row in verdict.rows if not isnan(row.change.p)]
    if runs_of_tests:
        numbers = counted(len(runs_of_tests), "number")
        runs = counted(max(runs_of_tests), "run")
        limit = f"limit {worse} for all together (Holm's correction)"
        table.notes.append(f"{numbers} tested on {runs}; {limit}.")
    table.notes += verdict.notes
    return table
