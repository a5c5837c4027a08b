"""Values per run from per_run.csv, group by group: all rows at once would take ten times their size."""

import csv
from collections.abc import Collection, Mapping
from itertools import groupby
from operator import itemgetter
from typing import Any, TextIO, TypeAlias

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.report.columns import Parse, check_heads

Runs: TypeAlias = dict[tuple[str, str], Array]
"""Values (M,) in the order of the runs, NaN where lost, by (filter, metric), read-only."""


def read_runs(
    file: TextIO, grid: Mapping[str, Parse], labels: Collection[str]
) -> dict[tuple[Any, ...], Runs]:
    """The filters' runs by the values of the grid's columns, whose texts stand for what is given."""
    rows = csv.reader(file)
    head = next(rows, [])
    check_heads(head, ["filter", "metric", "value"])
    value, found = (
        itemgetter(head.index("value")),
        dict[tuple[Any, ...], dict[tuple[str, str], list[Array]]](),
    )
    keys = itemgetter(*(head.index(name) for name in (*grid, "filter", "metric")))
    for (*texts, label, metric), group in groupby(rows, keys):
        if label in labels:
            point = tuple(parse(text) for parse, text in zip(grid.values(), texts, strict=True))
            values = np.fromiter(map(float, map(value, group)), float)
            found.setdefault(point, {}).setdefault((label, metric), []).append(values)
    return {
        point: {key: fixed(np.concatenate(parts)) for key, parts in runs.items()}
        for point, runs in found.items()
    }
