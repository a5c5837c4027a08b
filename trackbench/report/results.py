"""A results folder, read back."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from io import TextIOWrapper
from pathlib import Path
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any, TextIO, cast

import numpy as np

from trackbench.core.arrays import Array
from trackbench.experiment.problems import Mark, Problem, UserError, counted
from trackbench.experiment.reading.compose import split_path
from trackbench.experiment.reading.parts import build_kind
from trackbench.experiment.reading.validate import unknown
from trackbench.experiment.storing.given import FILE, Given, points_in
from trackbench.experiment.storing.outputs import DEFAULT
from trackbench.experiment.storing.packing import opened, there
from trackbench.experiment.storing.tracks import prefix_of
from trackbench.registry import Group, kinds
from trackbench.report import style
from trackbench.report.asked import Asked
from trackbench.report.columns import Columns, read_columns
from trackbench.report.defaults import default_keys
from trackbench.report.notebook import results_html
from trackbench.report.paired import Pair, pairs_at
from trackbench.report.runs import Runs, read_runs
from trackbench.report.table import Table
from trackbench.tuning.record import Record, read_tuning
from trackbench.tuning.settings import tuned

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Results(Asked):
    """The files of one results folder, as data frames and arrays, read when asked for."""

    facts: dict[str, Any] | None = None
    """what the manifest is going to say, as long as it is not written"""
    out: Path | None = None
    """where tables and verdicts are written, if not into the folder"""
    points_given: tuple[Given, ...] | None = None
    """what is known of the points, if not by the folder"""

    def __repr__(self) -> str:
        what = f"{counted(len(self.filters), 'filter')}, {counted(self.config['runs'], 'run')}"
        return f"<Results in {self.folder}: {self.title}; {what}>"

    def _repr_html_(self) -> str:
        tables = (table.texts() for table in self.tables.values())
        return results_html(self.title, [f"{self.folder}/"], tables, self._repr_png_())

    def _repr_png_(self) -> bytes | None:
        """The key figure; none where no filter has a track that it could show."""
        key = self.parts("figures").get(self.key_figure)
        if key is None or (key.shown_runs and not self.shown):
            return None
        from trackbench.report.canvas import png

        return png(self.figure())

    def figure(self, name: str = "") -> "Figure":
        """A figure of the config, for matplotlib to go on with; the key figure if none is named.

        Raises UserError if there is none of that name.
        """
        figures = self.parts("figures")
        if name not in figures and (name or not figures):
            raise UserError(Problem(Mark("figure"), name, unknown(name, [*figures])))
        with style.house():
            return style.settled(figures[name or self.key_figure].draw(self))

    @property
    def key_figure(self) -> str:
        """Name of the figure that stands for all; empty if there is none."""
        figures = self.parts("figures")
        named = self.config.get("key_figure")
        return named if named in figures else next(iter(figures), "")

    @property
    def target(self) -> Path:
        """Where tables and verdicts are written."""
        return self.out or self.folder

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Versions, platform, times."""
        if self.facts is not None:
            return self.facts
        manifest = json.loads((self.folder / "manifest.json").read_text(encoding="utf-8"))
        assert isinstance(manifest, dict)
        return manifest

    @property
    def one_by_one(self) -> list[str]:
        """Labels of the filters whose runs are looped over in Python, which their times show."""
        found: list[str] = self.manifest.get("one_by_one", [])
        return found

    @property
    def failed(self) -> list[dict[str, Any]]:
        """Filters that raised: ``filter``, ``reason`` and the grid point's values."""
        found: list[dict[str, Any]] = self.manifest["failed"]
        return found

    def parts(self, group: Group) -> dict[str, Any]:
        """The experiment's tables or figures, built from the config; of plugins if they are loaded."""
        if not self.config.get("tables") and not self.config.get("figures"):
            return self._default(group)
        problems: list[Problem] = []
        left_out = self.left_out(group)
        names = [name for name in self.config.get(group, {}) if name not in left_out]
        built = {name: build_kind(group, self.source, (group, name), problems) for name in names}
        if problems:
            raise UserError(*sorted(set(problems)))
        titled = {name for name, part in built.items() if "{" in getattr(part, "title", "")}
        return {
            name: replace(part, title=self.filled(part.title)) if name in titled else part
            for name, part in built.items()
        }

    def _default(self, group: Group) -> dict[str, Any]:
        """What an experiment shows that asks for nothing."""
        metrics = self.columns("summary")["metric"]
        keys = default_keys(group, metrics, len(self.every_point), len(self.labels))
        return {DEFAULT: kinds(group)[keys.pop("kind")](**keys)} if keys else {}

    def given(self, point: dict[str, Any]) -> Given:
        """What is known of a point besides its numbers: scenario, filters, components, shading."""
        found = next((g for g in self._given if is_same(g.values, point)), None)
        if found is None:
            raise UserError(f"{self.folder / FILE}: {point} is not in it: run the experiment again")
        return found

    @cached_property
    def _given(self) -> tuple[Given, ...]:
        if self.points_given is not None:
            return self.points_given
        try:
            return tuple(points_in(self._path(FILE).read_text(encoding="utf-8")))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            what = "cannot be read: run the experiment again"
            raise UserError(f"{self.folder / FILE}: {what}") from None

    @cached_property
    def per_run(self) -> "pd.DataFrame":
        """``filter,run,metric,value``: for people; tables and figures take `runs`."""
        return self._frame("per_run.csv")

    @cached_property
    def per_step(self) -> "pd.DataFrame":
        """``filter,step,time,metric,value,stderr,runs``."""
        return self._frame("per_step.csv")

    @cached_property
    def summary(self) -> "pd.DataFrame":
        """``filter,metric,value,stderr,runs,lost``."""
        return self._frame("summary.csv")

    @cached_property
    def timing(self) -> "pd.DataFrame":
        """``filter,runs,cpu_s,cpu_s_per_run,stderr``."""
        return self._frame("timing.csv")

    @cached_property
    def shown(self) -> dict[str, Array]:
        """What shown.npz holds of all points of the grid; empty if every filter failed."""
        path = self.folder / "shown.npz"
        if not path.is_file():
            return {}
        with np.load(path) as arrays:
            return dict(arrays)

    def tracks(self, point: dict[str, Any]) -> dict[str, Array]:
        """Whole tracks of the first runs: ``truth``, ``measurements``, ``mean/<filter>``, ``steps``.

        None where every filter failed: such points count, too.
        """
        i = self.place(point)
        prefix = prefix_of(i or 0, len(self.every_point))
        return {
            name.removeprefix(prefix): array
            for name, array in self.shown.items()
            if i is not None and name.startswith(prefix)
        }

    def steps(self, point: dict[str, Any]) -> int:
        """Steps that a filter takes in a run at a point."""
        found, place = self.manifest.get("steps"), self.place(point) or 0
        number = found[place] if isinstance(found, list) and place < len(found) else found
        if not isinstance(number, int) or number < 1:
            what = "does not say how many steps a run has: run the experiment again"
            raise UserError(f"{self.folder / 'manifest.json'}: {what}")
        return number

    def runs(self, point: dict[str, Any]) -> Runs:
        """Values per run at a point; none if every filter failed there."""
        return self._runs.get(tuple(point.values()), {})

    @cached_property
    def _runs(self) -> dict[tuple[Any, ...], Runs]:
        parses = self.columns("summary").parses
        with self.open("per_run.csv") as file:
            return read_runs(file, {path: parses[path] for path in self.grid}, self.filters)

    @cached_property
    def tables(self) -> dict[str, Table]:
        """The experiment's tables by name."""
        return {name: spec.table(self) for name, spec in self.parts("tables").items()}

    @cached_property
    def pairs(self) -> list[tuple[dict[str, Any], list[Pair]]]:
        """Every pair of filters on common runs, by point of the grid."""
        return [(point, pairs_at(self.runs(point), self.labels)) for point in self.points()]

    @cached_property
    def tuning(self) -> dict[str, Record]:
        """Every trial of the filters that were tuned, by label; none if there is no tuning.csv."""
        if not (self.folder / "tuning.csv").is_file():
            return {}
        with self.open("tuning.csv") as file:
            return read_tuning(file, self.config.get("tune", {}), self._taken)

    @property
    def _taken(self) -> dict[str, dict[str, Any]]:
        """What the config's tuned filters have for the keys that are tuned, by the filter's label."""
        return {
            label: {key: self._at(f"filters.{tuned(label)}.{key}") for key in keys}
            for label, keys in self.config.get("tune", {}).items()
        }

    def _at(self, path: str) -> Any:
        """A value of the config; nothing if it is not there."""
        value: Any = self.config
        for key in split_path(self.source, path):
            there = value if isinstance(value, dict) else dict(enumerate(value or ()))
            value = there.get(key)
        return value

    def open(self, name: str) -> TextIO:
        """One of the CSV files as text."""
        return TextIOWrapper(
            cast(IO[bytes], opened(self._path(name))), encoding="utf-8", newline=""
        )

    def points(self) -> list[dict[str, Any]]:
        """The points that have results, in order; one empty point without a grid."""
        summary = self.columns("summary")
        if not self.grid or not len(summary):  # every filter failed
            return self.every_point
        rows = dict.fromkeys(summary.tuples(self.grid))
        return [dict(zip(self.grid, row, strict=True)) for row in rows]

    def place(self, point: dict[str, Any]) -> int | None:
        """A point's number in the config's grid; None if it is not there any more."""
        return next((i for i, given in enumerate(self.every_point) if is_same(given, point)), None)

    def columns(self, name: str, point: Mapping[str, Any] = MappingProxyType({})) -> Columns:
        """Rows of `summary`, `per_step` or `timing`, at a grid point or all of them."""
        if name not in self._columns:
            with self.open(f"{name}.csv") as file:
                self._columns[name] = read_columns(file)
        return self._columns[name].at(point)

    @cached_property
    def _columns(self) -> dict[str, Columns]:
        return {}

    def at(self, frame: "pd.DataFrame", point: dict[str, Any]) -> "pd.DataFrame":
        """The rows of one grid point."""
        for path, value in point.items():
            frame = frame[frame[path] == value]
        return frame

    def _frame(self, name: str) -> "pd.DataFrame":
        import pandas as pd

        missing = {key: ["nan"] for key in _NUMBERS}  # no others: a filter may be called nan
        return pd.read_csv(self._path(name), dtype=_TYPES, keep_default_na=False, na_values=missing)

    def _path(self, name: str) -> Path:
        """The file, or what it was packed into to keep large results in git."""
        path = there(self.folder / name)
        if path is None:
            raise UserError(f"{self.folder / name}: is missing: run the experiment again")
        return path


def is_same(point: dict[str, Any], read_back: dict[str, Any]) -> bool:
    """Whether a point of the config is one of the files, where nothing and lists are words."""
    pairs = ((value, read_back[path]) for path, value in point.items())
    return all(a == b or ("" if a is None else str(a)) == str(b) for a, b in pairs)


_NUMBERS = ("time", "value", "stderr", "cpu_s", "cpu_s_per_run")
_TYPES: Any = {
    "filter": str,
    **dict.fromkeys(["run", "step", "runs", "lost"], int),
    **dict.fromkeys(_NUMBERS, float),
}
"""Of columns, so that they are the same in a file without rows, where every filter failed."""
