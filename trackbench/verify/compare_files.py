"""Compare the files of the runs of a stored results folder with recomputed ones, byte for byte."""

import csv
import filecmp
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trackbench.core.arrays import Array
from trackbench.csv_writer import shortened
from trackbench.errors import counted, counted_with_verb, form_for
from trackbench.evaluation.metric_expression import TIME_MEAN, measured
from trackbench.report.tables_and_figures import Results
from trackbench.results.file_names import ARRIVALS, DATA_FILES, PER_RUN_ARRAYS
from trackbench.results.missing_and_changed_files import check_digests
from trackbench.results.significant_digits import DIGITS

if TYPE_CHECKING:
    import pandas as pd

_TRACKS = ("shown.npz", "tracks.npz")
_NUMBERS = ("value", "stderr")


def compare_first_runs(stored: Results, computed: Results) -> Iterator[str]:
    """Yield a line on each difference in the first runs, and in the numbers that do not depend on runs.

    ``computed`` are results of the first runs, computed again, and ``stored`` those of all runs.
    """
    runs = computed.config["runs"]
    yield from compare_frames(
        stored.per_run_file, _values_of_runs(stored, runs), _values_of_runs(computed, runs)
    )
    keys = [*stored.grid, "filter", "metric"]
    lost_filters = _filters_without_runs(computed)
    # The attribute of `Results` with the rows of a file, and the file, which may be one of arrays.
    for name, file in (("summary", "summary.csv"), ("per_step", stored.per_step_file)):
        if not (stored.folder / file).is_file():
            continue
        # Without metrics that exist only if some run has them: the first runs may have none.
        frame = _without_unused(getattr(stored, name))
        frame_again = _without_unused(getattr(computed, name))
        rows = set(frame[keys].itertuples(index=False, name=None))
        rows_again = set(frame_again[keys].itertuples(index=False, name=None))
        # A filter that loses all of the first runs has no rows over the steps of runs. The last key of a
        # row is its metric.
        missing = {row for row in rows - rows_again if row[:-1] not in lost_filters}
        if missing or rows_again - rows:
            yield f"{file}: has other rows than are computed again"
            continue
        yield from compare_frames(
            file,
            frame[frame["filter"].isin(stored.labels_without_runs)],
            frame_again[frame_again["filter"].isin(stored.labels_without_runs)],
        )
    for name in _TRACKS:
        if (computed.folder / name).is_file() and (stored.folder / name).is_file():
            yield from compare_arrays(name, stored, computed)
    yield from compare_arrivals(stored, computed)


def _filters_without_runs(results: Results) -> set[tuple[object, ...]]:
    """Return the grid values and labels, as a row begins with them, of filters that lost every run."""
    keys = [*results.grid, "filter"]
    lost = results.per_run[results.per_run["metric"] == "lost"]
    is_lost = lost["value"].ne(0.0).groupby([lost[key] for key in keys]).all()
    return {row if isinstance(row, tuple) else (row,) for row in is_lost.index[is_lost]}


def _without_unused(frame: "pd.DataFrame") -> "pd.DataFrame":
    """Return the rows of a table without the metrics ``unused_...``.

    They are the numbers of components that a NEES lacks, as those that the filter knows exactly. Such a
    metric exists only if there is a run in which a NEES lacks components.
    """
    return frame[~frame["metric"].str.startswith("unused_")]


def compare_arrivals(stored: Results, computed: Results) -> Iterator[str]:
    """Yield a line if the arrival times of delayed measurements in the recomputed runs differ.

    Older folders have no file of arrivals, which is no difference.
    """
    if not (stored.folder / ARRIVALS).is_file():
        return
    if not (computed.folder / ARRIVALS).is_file():
        yield f"{ARRIVALS}: no measurement has a delay when it is computed again"
        return
    runs = computed.config["runs"]
    rows = _rows_of_runs(stored.folder / ARRIVALS, runs)
    rows_again = _rows_of_runs(computed.folder / ARRIVALS, runs)
    pairs = [(row, again) for row, again in zip_longest(rows, rows_again) if row != again]
    if pairs:
        cells, expected_cells = pairs[0]
        row = ",".join(cells or ["nothing"])
        expected = ",".join(expected_cells or ["nothing"])
        rows_that_differ = counted_with_verb(len(pairs), "row", "differs", "differ")
        number = f"{rows_that_differ} from what is computed again"
        yield f"{ARRIVALS}: {number}; the first is {row!r}, it should be {expected!r}"


def _rows_of_runs(path: Path, runs: int) -> list[list[str]]:
    """Return the heading of a file of arrivals and its rows of the first runs."""
    with path.open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    column = heading.index("run")
    return [heading, *(row for row in rows if int(row[column]) < runs)]


def _values_of_runs(results: Results, runs: int) -> "pd.DataFrame":
    """Return the rows of the values per run of the first runs.

    Each run's share of a time mean is left out, as it depends on all runs.
    """
    frame = results.per_run
    metrics = frame["metric"].unique()
    shares = [metric for metric in metrics if measured(metric).statistic == TIME_MEAN]
    frame = frame[(frame["run"] < runs) & ~frame["metric"].isin(shares)]
    if results.per_run_file == PER_RUN_ARRAYS:
        # The numbers of very many runs are stored in a file of arrays with all digits. Those of fewer
        # runs are in per_run.csv, which has fewer digits.
        rounded = shortened(frame["value"].tolist(), DIGITS["per_run.csv"])
        frame = frame.assign(value=list(map(float, rounded)))
    return frame


def compare_all_runs(stored: Results, computed: Results) -> Iterator[str]:
    """Yield a line on each file of a run that differs from the recomputed one.

    ``computed`` has all runs. A file that is not stored, as in a clone by git, is compared by its digest
    in the manifest.
    """
    digests = stored.manifest["files"]
    for name in (*DATA_FILES, "summary.csv", ARRIVALS, "tracks.npz"):
        path = stored.folder / name
        path_again = computed.folder / name
        if path.is_file():
            if not path_again.is_file() or not filecmp.cmp(path, path_again, shallow=False):
                yield from _explain(name, stored, computed)
        elif name in digests and check_digests(computed.folder, {name: digests[name]}).changed:
            yield f"{name}: has another digest when it is computed again"


def _explain(name: str, stored: Results, computed: Results) -> Iterator[str]:
    """Yield the differences of two files of this name whose bytes differ.

    Files of tracks may have equal arrays that are packed in another way: then there is no difference.
    """
    if name in _TRACKS:
        yield from compare_arrays(name, stored, computed)
        return
    if name == ARRIVALS:
        lines = list(compare_arrivals(stored, computed))
    else:
        frame = Path(name).stem  # `Results` has an attribute of this name with the rows
        lines = list(compare_frames(name, getattr(stored, frame), getattr(computed, frame)))
    yield from lines or [f"{name}: has other bytes when it is computed again, of equal numbers"]


def compare_frames(name: str, stored: "pd.DataFrame", computed: "pd.DataFrame") -> Iterator[str]:
    """Yield a line for each filter whose numbers differ, or one line if the frames have other rows.

    A frame has the numbers in columns value and stderr, and the columns that identify them, such as
    filter and metric. ``name`` is that of the file in the lines.
    """
    keys = [column for column in computed if column not in _NUMBERS]
    a = stored.reset_index(drop=True)
    b = computed.reset_index(drop=True)
    if not a[keys].equals(b[keys]):
        first, expected = _first_other_keys(a[keys], b[keys])
        rows = "has other rows than are computed again"
        yield f"{name}: {rows}; the first is {first!r}, it should be {expected!r}"
        return
    columns = [column for column in _NUMBERS if column in a]
    for label in a["filter"].unique():
        is_of_filter = (a["filter"] == label).to_numpy()
        numbers = a.loc[is_of_filter, columns].to_numpy()
        numbers_again = b.loc[is_of_filter, columns].to_numpy()
        yield from describe_difference(f"{name}: {label}", numbers, numbers_again)


def _first_other_keys(stored: "pd.DataFrame", computed: "pd.DataFrame") -> tuple[str, str]:
    """Return the first stored row that differs, and the computed row in its place, as texts.

    The frames have only the columns that identify a row, such as filter, step and metric. The text is
    ``nothing`` for a row that one of the frames lacks.
    """
    rows = stored.itertuples(index=False, name=None)
    rows_again = computed.itertuples(index=False, name=None)
    for row, again in zip_longest(rows, rows_again):
        if row != again:
            first = ", ".join(map(str, row or ["nothing"]))
            expected = ", ".join(map(str, again or ["nothing"]))
            return first, expected
    return "nothing", "nothing"


def compare_arrays(name: str, stored: Results, computed: Results) -> Iterator[str]:
    """Yield a line for each array that differs in the file of tracks ``name``, in the recomputed runs.

    The last axis of an array is the run.
    """
    arrays = stored.arrays(name)
    arrays_again = computed.arrays(name)
    if arrays.keys() != arrays_again.keys():
        yield f"{name}: holds other arrays than are computed again"
        return
    for key, array_again in arrays_again.items():
        first_runs = arrays[key][..., : array_again.shape[-1]]
        yield from describe_difference(f"{name}: {key}", first_runs, array_again)


def describe_difference(place: str, stored: Array, computed: Array) -> Iterator[str]:
    """Yield a line on unequal numbers: how many, and the largest relative difference.

    ``place`` names the numbers in the line: the file, and the filter or the array.
    """
    if stored.shape != computed.shape:
        yield f"{place}: has shape {stored.shape}, computed again {computed.shape}"
        return
    differs = (stored != computed) & ~(np.isnan(stored) & np.isnan(computed))
    if differs.any():
        largest = largest_share(stored[differs], computed[differs])
        size = f"by {largest:.1e} of the value at most"
        number = int(differs.sum())
        verb = form_for(number, "differs", "differ")
        yield f"{place}: {number} of {counted(differs.size, 'number')} {verb}, {size}"


@np.errstate(all="ignore")
def largest_share(a: Array, b: Array) -> float:
    """Return the largest difference of two arrays (n,), relative to the larger of both values.

    All values differ from each other: they are neither both zero nor both NaN. The result is inf if one
    of two values is NaN or infinite.
    """
    share = np.abs(a - b) / np.maximum(np.abs(a), np.abs(b))
    return float(np.nan_to_num(share, nan=np.inf).max())
