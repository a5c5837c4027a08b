"""Read the npz files of a results folder: numbers per step of very long runs, per run of very many."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.core.read_only import fixed
from trackbench.results.points_json import array_prefix
from trackbench.results.rows_and_columns import Columns, PointRuns, Runs, Series, SeriesColumns

NO_ROW = -1
"""Number of runs at a step that per_step.csv would have no row of; a bound has rows of no runs."""


def read_steps(
    path: Path, columns: Sequence[str], points: Sequence[Mapping[str, Any] | None]
) -> Columns:
    """Read ``per_step.npz`` as the rows of per_step.csv.

    ``columns`` are the names of that file's columns, the grid's paths first. ``points`` are the values
    of the grid's points by path, None for a point without results.
    """
    with path.open("rb") as file, np.load(file) as archive:
        arrays = dict(archive)
    series = []
    for i, point in enumerate(points):
        if point is None:
            continue
        prefix = array_prefix(i, len(points))
        head = f"{prefix}value/"
        for name, value in arrays.items():
            if not name.startswith(head):
                continue
            label_and_metric = name.removeprefix(head)
            label, _, metric = label_and_metric.rpartition("/")
            runs = arrays[f"{prefix}runs/{label_and_metric}"]
            stderr = arrays.get(f"{prefix}stderr/{label_and_metric}")
            if stderr is None:
                stderr = np.full(len(value), np.nan)
            # Steps of which per_step.csv would have a row.
            known = np.flatnonzero(runs != NO_ROW)
            series.append(
                Series(
                    constants={**point, "filter": label, "metric": metric},
                    numbers={
                        "step": arrays[f"{prefix}step"][known],
                        "time": arrays[f"{prefix}time"][known],
                        "value": value[known].astype(float),
                        "stderr": stderr[known].astype(float),
                        "runs": runs[known],
                    },
                )
            )
    return SeriesColumns(series, columns)


def read_run_arrays(
    path: Path, points: Sequence[Mapping[str, Any] | None], labels: Collection[str]
) -> PointRuns:
    """Read ``per_run.npz``: the values per run by filter and metric, at each point of the grid.

    ``points`` are the values of the grid's points by path, None for a point without results; ``labels``
    are the filters to read. The key of a point in the result is the tuple of its values. Points of which
    no filter is read are left out.
    """
    with path.open("rb") as file, np.load(file) as archive:
        arrays = dict(archive)
    point_runs: PointRuns = {}
    for i, point in enumerate(points):
        if point is None:
            continue
        head = f"{array_prefix(i, len(points))}value/"
        runs_of_point: Runs = {}
        for name, values in arrays.items():
            label, _, metric = name.removeprefix(head).rpartition("/")
            if name.startswith(head) and label in labels:
                runs_of_point[label, metric] = fixed(values)
        if runs_of_point:
            point_runs[tuple(point.values())] = runs_of_point
    return point_runs
