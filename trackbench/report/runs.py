"""Values per run from per_run.csv, read in pieces: a data frame of it takes ten times their size."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from trackbench.core.arrays import Array

Runs: TypeAlias = dict[tuple[str, str], Array]
"""Values (M,) in the order of the runs, NaN where lost, by (filter, metric)."""

_ROWS = 1 << 16  # of a piece: its strings take some ten megabytes


def read_runs(
    path: Path, grid: Mapping[str, Any], labels: list[str]
) -> dict[tuple[Any, ...], Runs]:
    """The filters' runs by the values of the grid's columns, whose types are given; packed or not."""
    import pandas as pd

    keys = [*grid, "filter", "metric"]
    of_filter = pd.CategoricalDtype(labels)  # given, since a label "10" would become a number
    types: Any = {**grid, "filter": of_filter, "metric": "category", "value": float}
    found: dict[tuple[Any, ...], dict[tuple[str, str], Any]] = {}
    with pd.read_csv(
        path,
        usecols=list(types),
        dtype=types,
        chunksize=_ROWS,
        keep_default_na=False,
        na_values={"value": NAN},
    ) as pieces:
        for piece in pieces:
            groups = piece.groupby(keys, sort=False, observed=True)["value"]
            for (*point, label, metric), values in groups:
                parts = found.setdefault(tuple(point), {}).setdefault((label, metric), [])
                parts.append(values.to_numpy(copy=True))
    for runs in found.values():
        for key, parts in runs.items():
            runs[key] = np.concatenate(parts)
    return found


NAN = ["nan"]
"""How the CSV files write what is no number."""
