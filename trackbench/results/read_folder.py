"""Read a results folder: its config, the facts of its run, its numbers and tracks."""

from collections.abc import Container, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.config.bound_and_exact_errors import exact_label
from trackbench.config.chosen_filters import labels_to_run
from trackbench.config.grid import points_of_resolved_config, single_paths
from trackbench.config.published_numbers_and_claims import Published
from trackbench.config.read_published_files import read_published
from trackbench.config.standard_problem import citation_of
from trackbench.core.arrays import Array
from trackbench.errors import UserError
from trackbench.plugins.plugin_errors import message_of
from trackbench.results.file_names import (
    COLUMNS,
    DATA_FILES,
    PER_RUN_ARRAYS,
    PER_STEP_ARRAYS,
    TIMING,
    file_of_runs,
    file_of_steps,
)
from trackbench.results.manifest import read_manifest, steps_of_point
from trackbench.results.points_json import (
    POINTS_FILE,
    GridPoint,
    PointFacts,
    array_prefix,
    points_in,
)
from trackbench.results.read_csv import parse_of, read_columns, read_runs
from trackbench.results.read_npz import read_run_arrays, read_steps
from trackbench.results.rows_and_columns import Columns, PointRuns, Runs, rows_of_runs
from trackbench.results.significant_digits import digits_of_values
from trackbench.tuning.record_of_trials import Record, chosen_values, read_tuning
from trackbench.yaml_source import Source, read

if TYPE_CHECKING:
    import pandas as pd

RUN_AGAIN = "run the experiment again"


@dataclass(frozen=True, repr=False)
class ResultsFolder:
    """A results folder, each of its files read at its first use."""

    folder: Path
    run_facts: dict[str, Any] | None = None
    """content of the manifest, until it is written"""
    point_facts: tuple[PointFacts, ...] | None = None
    """facts about the points, instead of those in the folder"""
    run_values: tuple[Runs, ...] | None = None
    """numbers of per_run.csv at each point of the config's grid, if they need not be read"""
    _columns: dict[str, Columns] = field(default_factory=dict, init=False, compare=False)

    @cached_property
    def source(self) -> Source:
        """Resolved config with positions."""
        return read(self.folder / "config.yaml")

    @property
    def config_text(self) -> str:
        """Text of the resolved config, as its file has it."""
        return (self.folder / "config.yaml").read_text(encoding="utf-8")

    @property
    def config(self) -> dict[str, Any]:
        """Resolved config, in which defaults are written out, as a mapping."""
        config = self.source.data
        assert isinstance(config, dict)
        return config

    def fill_title(self, text: str) -> str:
        """Return a title with the number of runs in place of ``{runs}``."""
        return text.replace("{runs}", str(self.config["runs"]))

    @property
    def title(self) -> str:
        """Return the experiment's title, or else its name."""
        return self.fill_title(self.config["title"] or self.config["name"])

    @property
    def citation(self) -> str:
        """``trackbench/ungm v1, 400 runs`` of a standard problem; else an empty text."""
        return citation_of(self.config)

    @property
    def figure_configs(self) -> dict[str, dict[str, Any]]:
        """Config's figures as mappings."""
        return self.config.get("figures") or {}

    @cached_property
    def published(self) -> Published:
        """Published numbers and claims that the results are compared with."""
        paths = self.config.get("published", [])
        mark = self.source.mark(("published",))  # place of the key in the config, for messages
        return read_published(self.folder, paths, self.config["name"], mark=mark)

    @property
    def labels(self) -> list[str]:
        """Labels of all rows in the results: of filters, of exact errors and of the lower bound.

        Filters are in the config's order. The label of a filter's exact errors follows the filter's, and
        the bound's label is the last.
        """
        labels: list[str] = []
        for label in self.filters:
            labels.append(label)
            if exact_label(label) in self.exact:
                labels.append(exact_label(label))
        bound = self.config.get("bound")
        if bound:
            labels.append(bound)
        return labels

    @cached_property
    def exact(self) -> list[str]:
        """Labels of the exact errors, ``KF, exact``, of the filters under the config's key `exact`."""
        return [exact_label(label) for label in self.config.get("exact", [])]

    @cached_property
    def labels_without_runs(self) -> list[str]:
        """Labels of the exact errors and of the lower bound, whose numbers are not of runs."""
        bound = self.config.get("bound")
        if bound:
            return [*self.exact, bound]
        return self.exact

    def chosen(self, wanted: Container[str] | None, with_exact_errors: bool = False) -> list[str]:
        """Return the labels that a table or figure shows, in the order of `labels`.

        They are those in ``wanted``. If it is None they are all labels, those of exact errors only
        ``with_exact_errors``. A filter's exact errors have a label of their own: ``KF, exact``.
        """
        if wanted is not None:
            return [label for label in self.labels if label in wanted]
        return [label for label in self.labels if with_exact_errors or label not in self.exact]

    @property
    def filters(self) -> list[str]:
        """Labels of the filters that were run, in the config's order."""
        config = self.config
        return labels_to_run(config["filters"], config.get("only", []), config.get("reference"))

    @property
    def grid(self) -> list[str]:
        """Paths that the experiment varies: leading columns of every frame."""
        return list(self.config["grid"])

    @property
    def grid_heads(self) -> list[str]:
        """Paths as headings of a table: of paths that vary together, the first."""
        return [single_paths(path)[0] for path in self.grid]

    @cached_property
    def grid_points(self) -> list[dict[str, Any]]:
        """All points of the config's grid, also those where every filter failed."""
        return points_of_resolved_config(self.config)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Facts of the experiment and of its run: steps, failures, versions, times."""
        if self.run_facts is not None:
            return self.run_facts
        with self.reading("manifest.json"):
            return read_manifest(self.folder)

    @property
    def experiment_runs(self) -> int | None:
        """Runs of the experiment if an option such as ``--quick`` took fewer; else None."""
        return self.manifest.get("experiment_runs")

    @property
    def data_notes(self) -> list[str]:
        """Notes on the data that the run printed, such as measurements that contradict the truth."""
        return [str(note) for note in self.manifest.get("data_notes", [])]

    @property
    def deterministic(self) -> list[str]:
        """Labels of the filters whose numbers hold no randomness: no draws, recorded data."""
        return self.manifest.get("deterministic", [])

    def digits_of(self, label: str) -> int:
        """Return the number of significant digits of a filter's values in per_run.csv."""
        values = []
        for values_of_point in self._runs.values():
            # Values (M,) of the runs by filter and metric.
            values += [
                x for (filter_label, _), x in values_of_point.items() if filter_label == label
            ]
        return digits_of_values(values)

    @property
    def loops_over_runs(self) -> list[str]:
        """Labels of the filters that take one run after the other in Python, and so more time."""
        return self.manifest.get("loops_over_runs", [])

    @property
    def programs(self) -> list[str]:
        """Labels of the filters that were run and are programs in other languages."""
        entries = self.config["filters"]
        return [label for label in self.filters if entries[label]["kind"] == "external"]

    @property
    def failed(self) -> list[dict[str, Any]]:
        """Filters that raised: ``filter``, ``reason`` and the grid point's values."""
        return self.manifest["failed"]

    def facts(self, point: GridPoint) -> PointFacts:
        """Return the facts about a grid point from points.json, such as the keys of its scenario.

        ``point`` has the values of the grid's paths. Raises UserError if the file does not have it.
        """
        for facts in self._facts:
            if same_point(facts.values, point):
                return facts
        raise UserError(f"{self.folder / POINTS_FILE}: {point} is not in it: {RUN_AGAIN}")

    @cached_property
    def _facts(self) -> tuple[PointFacts, ...]:
        """Facts about all points: those given in place of the folder's, or those of points.json."""
        if self.point_facts is not None:
            return self.point_facts
        with self.reading(POINTS_FILE) as path:
            return tuple(points_in(path.read_text(encoding="utf-8")))

    @cached_property
    def per_run(self) -> "pd.DataFrame":
        """Return the numbers per run, ``filter,run,metric,value``; tables and figures use `runs`."""
        return self._frame("per_run")

    @cached_property
    def per_step(self) -> "pd.DataFrame":
        """Return per_step.csv or per_step.npz, ``filter,step,time,metric,value,stderr,runs``."""
        return self._frame("per_step")

    @cached_property
    def summary(self) -> "pd.DataFrame":
        """Return summary.csv, ``filter,metric,value,stderr,runs,lost``."""
        return self._frame("summary")

    @cached_property
    def timing(self) -> "pd.DataFrame":
        """Return timing.csv, ``filter,runs,cpu_s,cpu_s_per_run,stderr,repeats,...``."""
        return self._frame("timing")

    @cached_property
    def shown(self) -> dict[str, Array]:
        """Return the arrays of shown.npz at all points; empty if every filter failed."""
        return self.arrays("shown.npz")

    def arrays(self, name: str) -> dict[str, Array]:
        """Return the arrays of a file; empty if there is no such file."""
        if not (self.folder / name).is_file():
            return {}
        with self.reading(name) as path, path.open("rb") as file, np.load(file) as arrays:
            return dict(arrays)

    @cached_property
    def saved(self) -> dict[str, Array]:
        """Arrays of tracks.npz, every run's, at all points; empty if none were saved."""
        return self.arrays("tracks.npz")

    def tracks(self, point: GridPoint, every_run: bool = False) -> dict[str, Array]:
        """Return tracks of the first runs: ``truth``, ``measurements``, ``mean/<filter>``, ``steps``.

        With ``every_run`` they are the tracks of all runs, if these were saved. The result is empty if
        every filter failed at the point.
        """
        i = self.index_of(point)
        if i is None:
            return {}
        arrays: dict[str, Array] = {}
        if every_run:
            arrays = self.saved
        if not arrays:
            arrays = self.shown
        # The file has the arrays of all points; their names begin with the point's number.
        prefix = array_prefix(i, len(self.grid_points))
        return {
            name.removeprefix(prefix): array
            for name, array in arrays.items()
            if name.startswith(prefix)
        }

    def steps(self, point: GridPoint) -> int:
        """Return the number of steps of a run at a point; raises UserError if the manifest lacks it."""
        # A point that the config's grid does not have (None) counts as the first.
        number = steps_of_point(self.manifest, self.index_of(point) or 0)
        if number is None:
            message = "does not say how many steps a run has"
            raise UserError(f"{self.folder / 'manifest.json'}: {message}: {RUN_AGAIN}")
        return number

    def runs(self, point: GridPoint) -> Runs:
        """Return the values per run at a point; empty if every filter failed there."""
        return self._runs.get(tuple(point.values()), {})

    @cached_property
    def _runs(self) -> PointRuns:
        """Values per run at each point: those of the run just made, or read from the file.

        The file has arrays if there are very many runs, otherwise it is per_run.csv.
        """
        if self.run_values is not None:
            point_runs: PointRuns = {}
            for point, runs in zip(self._points_as_read(), self.run_values, strict=True):
                # None: the point has no row in summary.csv, as every filter failed there.
                if point is not None:
                    point_runs[tuple(point.values())] = runs
            return point_runs
        with self.reading(self.per_run_file) as path:
            if self.per_run_file == PER_RUN_ARRAYS:
                return read_run_arrays(path, self._points_as_read(), self.filters)
            return read_runs(path, self.columns("summary"), self.grid, self.filters)

    @contextmanager
    def reading(self, name: str) -> Iterator[Path]:
        """Yield the path of the file ``name``; turn any error within the block into a UserError."""
        path = self.folder / name
        # Older versions wrote timing.csv to the folder itself.
        if name == "timing.csv" and not path.is_file():
            path = self.folder / TIMING
        if not path.is_file():
            why = " (git keeps its digest alone)" if name in DATA_FILES else ""
            raise UserError(f"{path}: is missing{why}: {RUN_AGAIN}")
        try:
            yield path
        except Exception as error:
            raise UserError(f"{path}: cannot be read, {message_of(error)}: {RUN_AGAIN}") from error

    def points(self) -> list[dict[str, Any]]:
        """Return the grid's points in summary.csv, in its order; one empty point without a grid.

        A point has the values of the grid's paths, by path. If every filter failed at every point, all
        points of the config are returned.
        """
        summary = self.columns("summary")
        if not self.grid or not len(summary):
            return self.grid_points
        rows = dict.fromkeys(summary.tuples(self.grid))  # each point once
        return [dict(zip(self.grid, row, strict=True)) for row in rows]

    def index_of(self, point: GridPoint) -> int | None:
        """Return a point's number in the config's grid; None if the grid does not have it."""
        for i, config_point in enumerate(self.grid_points):
            if same_point(config_point, point):
                return i
        return None

    def columns(self, name: str, point: Mapping[str, Any] = MappingProxyType({})) -> Columns:
        """Return the rows of the table ``name``, at one grid point or at all.

        Tables are `summary`, `per_step` and `timing`. Each file is read once.
        """
        if name not in self._columns:
            self._columns[name] = self._read(name)
        return self._columns[name].rows_with(point)

    def _read(self, name: str) -> Columns:
        """Read a table of rows by its name, ``per_run``, ``per_step``, ``summary`` or ``timing``.

        A CSV file has the columns of the grid itself. If the runs are very long or very many, the
        numbers per step or per run are in a file of arrays, whose columns are named here.
        """
        if name == "per_step" and self.per_step_file == PER_STEP_ARRAYS:
            columns = [*self.grid, *COLUMNS["per_step.csv"]]
            with self.reading(PER_STEP_ARRAYS) as path:
                return read_steps(path, columns, self._points_as_read())
        if name == "per_run" and self.per_run_file == PER_RUN_ARRAYS:
            return rows_of_runs(self._runs, [*self.grid, *COLUMNS["per_run.csv"]])
        file = f"{name}.csv"
        with self.reading(file) as path:
            return read_columns(path, COLUMNS[file])

    def _frame(self, name: str) -> "pd.DataFrame":
        """Return the table ``name``, such as ``per_run``, as a pandas data frame."""
        import pandas as pd  # takes long to import

        # The arrays are read-only; the user gets a copy that can be changed.
        return pd.DataFrame(self._read(name).arrays, copy=True)

    @property
    def per_run_file(self) -> str:
        """Name of the file with the numbers per run, which is another of very many runs."""
        return file_of_runs(self.folder)

    @property
    def has_runs(self) -> bool:
        """True if the folder has the numbers per run, of which git keeps the digest alone."""
        return (self.folder / self.per_run_file).is_file()

    @property
    def per_step_file(self) -> str:
        """Name of the file with the numbers per step, which is another of very long runs."""
        return file_of_steps(self.folder)

    def _points_as_read(self) -> list[dict[str, Any] | None]:
        """Return all points of the config's grid, with their values as they are read from summary.csv.

        A value of the config is written as text and read as the type of the file's column. If the text
        is no value of this type, the point has no row in the file, as every filter failed there: None
        stands for it.
        """
        summary = self.columns("summary")
        parses = {path: parse_of(summary[path]) for path in self.grid}
        points: list[dict[str, Any] | None] = []
        for config_point in self.grid_points:
            try:
                point = {path: parses[path](_cell(value)) for path, value in config_point.items()}
            except (ValueError, KeyError):  # no number, or neither of the texts True and False
                points.append(None)
            else:
                points.append(point)
        return points

    @cached_property
    def tuning(self) -> dict[str, Record]:
        """All trials of the tuned filters, by label; empty without tuning.csv."""
        if not (self.folder / "tuning.csv").is_file():
            return {}
        with self.reading("tuning.csv") as path, path.open(encoding="utf-8", newline="") as file:
            records = read_tuning(file, self.config.get("tune", {}), chosen_values(self.source))
        failures = self.manifest.get("training_failures", {})
        for label, record in records.items():
            record.first_failure = str(failures.get(label, ""))
        return records


def same_point(point: GridPoint, read_back: dict[str, Any]) -> bool:
    """Test whether a point of the config equals one that was read from a CSV file.

    Both have the values of the grid's paths, by path. Null and lists are texts in the file.
    """
    for path, value in point.items():
        if value != read_back[path] and _cell(value) != str(read_back[path]):
            return False
    return True


def _cell(value: Any) -> str:
    """Return the text of a grid's value in a CSV file."""
    if value is None:
        return ""
    return str(value)
