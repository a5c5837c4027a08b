"""Which numbers of two results folders are compared, and whether they are paired on common runs.

Run ``i`` of two folders with one seed and one scenario has one truth and one set of measurements, so
the difference of a metric per run has less noise than either value. Without per_run.csv, or with
another seed or scenario, the numbers of both folders are independent, and their variances add up.
"""

from collections.abc import Callable, Collection, Iterable
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.summary_rows import per_component
from trackbench.report.folder_comparison.tests_and_verdicts import Row, judge_rows, rows_of
from trackbench.report.mean_or_rms_of_metric import compared_statistic
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.results.significant_digits import DIGITS
from trackbench.statistics.comparison import Sample
from trackbench.statistics.estimates import RunEstimate


def compare_folders(a: Results, b: Results) -> tuple[list[Row], str]:
    """Compare every filter and metric of two results folders.

    Parameters
    ----------
    a, b
        results folders; changes are from a to b

    Returns
    -------
    tuple[list[Row], str]
        rows with verdicts, and the reason why the runs are not paired, empty if they are.
    """
    points = [point for point in a.points() if point in b.points()]
    # A function of a metric: the statistic by which the tables of the first folder compare it.
    statistics = partial(compared_statistic, a.config)
    why_unpaired = _why_unpaired(a, b, points)
    both_have_runs = a.has_runs and b.has_runs
    # Filters whose numbers have no randomness.
    exact = set(a.deterministic) & set(b.deterministic)
    # One per_run.csv may have 15 digits of such a filter and the other, of an older version, only 7.
    # Then `_numbers` rounds the values of both to 7 digits. Without values per run the rows of
    # summary.csv are compared, which have 7 digits in all versions.
    labels_to_round = set()
    if both_have_runs:
        labels_to_round = {label for label in exact if a.digits_of(label) != b.digits_of(label)}
    rows: list[Row] = []
    for point in points:
        # Paired runs are those that both folders have: the first ``runs`` of each.
        runs = None
        if not why_unpaired:
            columns = [*a.runs(point).values(), *b.runs(point).values()]
            runs = min(map(len, columns), default=None)
        first = _numbers(a, point, both_have_runs, runs, statistics, labels_to_round)
        second = _numbers(b, point, both_have_runs, runs, statistics, labels_to_round)
        for (label, metric), number in first.items():
            other = second.get((label, metric))
            if other is not None:
                rows += rows_of(
                    (point, label, metric),
                    number,
                    other,
                    paired=not why_unpaired,
                    is_exact=label in exact,
                )
    return judge_rows(rows), why_unpaired


def _why_unpaired(a: Results, b: Results, points: Iterable[GridPoint]) -> str:
    """Explain why run i of one folder is not run i of the other; empty if it is."""
    for results in (a, b):
        if not results.has_runs:
            return f"{results.folder} has no per_run.csv: the errors of summary.csv are used"
    if a.manifest["seed"] != b.manifest["seed"]:
        return f"the seeds differ ({a.manifest['seed']} and {b.manifest['seed']})"
    for point in points:
        scenario_a = _compared_scenario(a, point)
        scenario_b = _compared_scenario(b, point)
        if not _agree(scenario_a, scenario_b, a.folder, b.folder):
            return "the scenarios differ"
    return ""


def _compared_scenario(results: Results, point: GridPoint) -> dict[str, Any]:
    """Return what decides the truth and the measurements: keys of the scenario, and the number of steps.

    The number of steps is under ``#``, which is no key of a scenario. ``assume`` has a constant, so that
    it makes no difference: the model that filters assume changes no data.
    """
    return {**results.facts(point).scenario, "#": results.steps(point), "assume": 0}


def _agree(a: Any, b: Any, folder_a: Path, folder_b: Path) -> bool:
    """Test whether two scenarios, or values in them, agree in all common keys, at all depths.

    Scenarios are stored with all defaults. If one of two scenarios of a kind lacks a key, another
    version of trackbench wrote it, and the key does not count.

    Two different texts agree if they are paths of files, from ``folder_a`` and ``folder_b``, with the
    same content.
    """
    if isinstance(a, dict) and isinstance(b, dict):
        return all(_agree(a[key], b[key], folder_a, folder_b) for key in a.keys() & b.keys())
    if isinstance(a, list) and isinstance(b, list):
        pairs = zip(a, b, strict=False)
        return len(a) == len(b) and all(_agree(x, y, folder_a, folder_b) for x, y in pairs)
    if isinstance(a, str) and isinstance(b, str) and a != b:
        file_a = folder_a / a
        file_b = folder_b / b
        if not (file_a.is_file() and file_b.is_file()):
            return False
        return file_a.read_bytes() == file_b.read_bytes()
    return bool(a == b)


def _numbers(
    results: Results,
    point: GridPoint,
    from_runs: bool,
    runs: int | None,
    statistics: Callable[[str], str],
    labels_to_round: Collection[str],
) -> dict[tuple[str, str], Sample | RunEstimate]:
    """Return the metrics of each filter, ``anees`` in place of ``nees``, by filter and name.

    With ``from_runs`` they are samples of the first ``runs`` values of per_run.csv, of all if None.
    Otherwise they are the rows of summary.csv. ``statistics`` returns the statistic by which a metric is
    compared. The filters ``labels_to_round`` have values of more digits in only one of the two compared
    folders: their values per run are rounded to the usual digits.
    """
    sizes = results.facts(point).sizes  # number of components of each NEES
    if not from_runs:
        return {**_summary_rows(results, point, statistics)}
    samples: dict[tuple[str, str], Sample | RunEstimate] = {}
    for (label, metric), stored_values in results.runs(point).items():
        values = stored_values
        if label in labels_to_round:
            digits = DIGITS["per_run.csv"]
            values = np.array([float(f"{value:.{digits}g}") for value in stored_values])
        # A lost run counts as 1, another as 0, so that the mean is the share of lost runs.
        if metric == "lost":
            values = (values != 0.0) * 1.0
        first_values = values[:runs]
        # Normalized squares are compared per component: `nees` is replaced with `anees`. Of any other
        # metric `per_component` yields nothing.
        values_by_name = {}
        for name, components in per_component(measured(metric), sizes):
            values_by_name[name] = first_values / components
        for name, named_values in (values_by_name or {metric: first_values}).items():
            samples[label, name] = Sample(named_values, statistics(name))
    return samples


def _summary_rows(
    results: Results, point: GridPoint, statistics: Callable[[str], str]
) -> dict[tuple[str, str], RunEstimate]:
    """Return the rows of summary.csv that are compared, and the share of lost runs.

    The keys are filter and metric. ``statistics`` returns the statistic by which a metric is compared.
    """
    filters = results.filters
    numbers = {}
    for row in results.columns("summary", point).records():
        m = measured(row["metric"])
        label = row["filter"]
        # Bounds and exact errors are no filters. A metric with several statistics is compared by one; a
        # row without a statistic, such as anees, is compared as it is.
        if label not in filters or not (m.is_row or m.statistic == statistics(m.metric)):
            continue
        # A mean has the name of its metric, as in `with_statistic`: `rmse`, but `rms(rmse)`.
        name = m.name if m.statistic in ("", "mean") else str(m)
        numbers[label, name] = RunEstimate(
            value=row["value"], stderr=row["stderr"], influences=None, runs=row["runs"]
        )
        # The number of lost runs is equal in all rows of the filter. A metric that some runs do not
        # measure has fewer runs: the row with the most runs has all of them.
        all_runs = row["runs"] + row["lost"]
        share = numbers.get((label, "lost"))
        if share is None or all_runs > share.runs:
            numbers[label, "lost"] = RunEstimate(
                value=row["lost"] / all_runs, stderr=nan, influences=None, runs=all_runs
            )
    return numbers
