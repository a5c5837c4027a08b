"""A results folder: its tables and figures by name, the points of its grid.

A table or figure that fails becomes a line with its place; the others are made.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from trackbench.config.build import build_kind, hints_of
from trackbench.config.experiment import Point
from trackbench.config.grid import filters_of, is_of_scenario, single_paths, values_of
from trackbench.config.includes import split_path
from trackbench.config.mistakes import unknown
from trackbench.core.arrays import Array
from trackbench.errors import Mark, Problem, RunError, UserError, counted
from trackbench.evaluation.metric_expression import measure, measured
from trackbench.extension_points import is_foreign
from trackbench.field_types import Unit, UnitIf, annotations_of, dataclasses_in, part_group
from trackbench.filters.base import WrongReturnError
from trackbench.metrics import unit_of
from trackbench.models.sensors.base import Assume
from trackbench.plugins.errors import PluginError, message_of, package_line, plugin_code
from trackbench.registry import Group, kinds
from trackbench.report.findings import phrases
from trackbench.report.paired import Pair, compared_statistic, pairs_of, primary_metrics
from trackbench.report.plotting import style
from trackbench.report.table import Table, results_html
from trackbench.results.folder import ResultsFolder
from trackbench.results.folder_contents import DEFAULT, TRACK
from trackbench.results.point_facts import GridPoint
from trackbench.statistics.comparison import Sample

if TYPE_CHECKING:
    from matplotlib.figure import Figure


T = TypeVar("T")

_ERROR = re.compile(r"rms\((rmse(?:_(\w+))?)\)")
_MOST_ROWS = 50
"""Of more there is `sweep.csv`."""


def default_keys(group: Group, metrics: Iterable[str], points: int, filters: int) -> dict[str, Any]:
    """Return keys of the default table or figure; none if too large or unmeasured.

    ``metrics`` are those of summary.csv: the first two errors over the whole run are shown.
    """
    metrics = list(dict.fromkeys(metrics))
    errors = [match for match in map(_ERROR.fullmatch, metrics) if match]
    if group == "figures":
        if points > 1 or not errors:
            return {}
        return {"kind": "rmse-vs-time", "x": "time", "metric": measure(errors[0][1])}
    columns = {}
    for error in errors[:2]:
        words = f"RMSE of {error[2]}" if error[2] else "RMSE"
        columns[phrases.in_unit(words, unit_of(error[1]))] = error[0]
    consistent = {"ANEES": "anees"} if errors else {"NIS": "mean(nis)"}
    columns |= {head: text for head, text in consistent.items() if text in metrics}
    if not columns or points * filters > _MOST_ROWS:
        return {}
    measured = {head: measure(text) for head, text in columns.items()}
    return {"kind": "metrics", "title": "Errors over the whole run", "columns": measured}


@dataclass(frozen=True, repr=False)
class Results(ResultsFolder):
    """A results folder with the tables and figures that are made of it."""

    out: Path | None = None
    """where tables and verdicts are written, if not into the folder"""
    unmade: dict[str, str] = field(default_factory=dict, init=False, compare=False)
    """tables, figures and other outputs that failed, with the reasons"""
    known_rankings: dict[str, list[Any]] = field(default_factory=dict, init=False, compare=False)
    """rankings computed so far, by metric"""
    _judged_steps: dict[tuple[Any, ...], dict[tuple[str, str], Array]] = field(
        default_factory=dict, init=False, compare=False
    )

    def __repr__(self) -> str:
        what = f"{counted(len(self.filters), 'filter')}, {counted(self.config['runs'], 'run')}"
        return f"<Results in {self.folder}: {self.title}; {what}>"

    def _repr_html_(self) -> str:
        tables = (table.texts() for table in self.tables.values())
        picture, shown = self._repr_png_(), [*tables]
        return results_html(self.title, [f"{self.folder}/", *self.unmade_lines], shown, picture)

    def _repr_png_(self) -> bytes | None:
        """Return the key figure; none where no filter has a track that it could show."""
        key = self.parts("figures").get(self.key_figure)
        if key is None or (key.shown_runs and not self.shown):
            return None
        from trackbench.report.plotting.canvas import png

        return self.attempt(f"figure {self.key_figure}", lambda: png(self.figure()), None, key)

    def figure(self, name: str = "") -> "Figure":
        """Return a figure of the config, for matplotlib to go on with; the key figure if none is named.

        Raises UserError if there is none of that name.
        """
        figures = self.parts("figures")
        if name not in figures and (name or not figures):
            raise UserError(Problem(Mark("figure"), name, unknown(name, [*figures])))
        with style.rc_context():
            return style.lay_out(figures[name or self.key_figure].with_best(self).draw(self))

    @property
    def key_figure(self) -> str:
        """Name of the key figure; empty if there is none."""
        figures = self.parts("figures")
        named = self.config.get("key_figure")
        return named if named in figures else next(iter(figures), "")

    @property
    def target(self) -> Path:
        """Folder that tables and verdicts are written to."""
        return self.out or self.folder

    def parts(self, group: Group) -> dict[str, Any]:
        """Return the experiment's tables or figures, built from the config.

        A config without tables has the default one, and the default figure if it has no others than
        the track that `load` adds.
        """
        has_tables, figures = bool(self.config.get("tables")), self.config.get("figures") or ()
        by_default = not has_tables and (group == "tables" or {*figures} <= {TRACK})
        built = self._default(group) if by_default else {}
        left_out, source = self.unavailable_kinds(group), replace(self.source, problems=[])
        for name in self.config.get(group) or {}:
            if name not in left_out:
                part = built[name] = build_kind(group, source, (group, name))
                if "{" in getattr(part, "title", ""):
                    built[name] = replace(part, title=self.fill_title(part.title))
        source.check()
        return built

    def _default(self, group: Group) -> dict[str, Any]:
        """Make the default tables or figures of an experiment that names none."""
        metrics = self.columns("summary")["metric"]
        keys = default_keys(group, metrics, len(self.grid_points), len(self.labels))
        return {DEFAULT: kinds(group)[keys.pop("kind")](**keys)} if keys else {}

    @cached_property
    def tables(self) -> dict[str, Table]:
        """Experiment's tables by name, without those of plugins that fail."""
        tables = {}
        for name, spec in self.parts("tables").items():
            with self.without(f"table {name}", spec):
                tables[name] = self.with_units(as_table(spec.table(self), spec))
        return tables

    def with_units(self, table: Table) -> Table:
        """Return the table with the units of the grid's paths, and which of these are linked."""
        table.units = {single_paths(path)[0]: unit for path, unit in self.grid_units.items()}
        for paths in map(single_paths, self.grid):
            if len(paths) > 1:
                table.linked[paths[0]] = len(paths)
        return table

    @property
    def unmade_lines(self) -> list[str]:
        """Failures of tables, figures and other outputs, a line each."""
        return [f"{what} failed: {why}" for what, why in self.unmade.items()]

    @contextmanager
    def without(self, what: str, part: Any = None) -> Iterator[None]:
        """Continue without a failing output, and note the reason; ``part`` is its table or figure."""
        try:
            with catch_errors(part):
                yield
        except OutputError as error:
            self.unmade[what] = str(error)

    def attempt(self, what: str, make: Callable[[], T], default: T, part: Any = None) -> T:
        """Return what ``make`` returns; the default if it fails, and note the reason."""
        with self.without(what, part):
            return make()
        return default

    @cached_property
    def pairs(self) -> list[tuple[GridPoint, list[Pair]]]:
        """Every pair of filters on common runs, by point of the grid."""
        every = []
        for point in self.points():
            runs, steps, pairs = self.runs(point), self.judged_steps(point), list[Pair]()
            for metric in primary_metrics(list(dict.fromkeys(m for _, m in runs))):
                statistic, samples = compared_statistic(self.config, metric), {}
                for key in ((label, metric) for label in self.labels):
                    if key in runs:
                        samples[key[0]] = Sample.of(runs[key], statistic, steps.get(key))
                pairs += pairs_of(metric, samples)
            every.append((point, pairs))
        return every

    @property
    def batches(self) -> int:
        """Batches of consecutive runs, each of which a verdict leaves out; one in old folders."""
        return int(self.config.get("verdict_seeds", 1))

    def judged_steps(self, point: GridPoint) -> dict[tuple[str, str], Array]:
        """Return what each step (T,) of one recorded run adds to a number, by (filter, metric).

        The mean is the number; steps without a value are NaN.
        """
        judged, runs = self.facts(point).judged, self.runs(point)
        out = self._judged_steps.setdefault(tuple(point.items()), {})
        if out or not judged:
            return out
        first, last = judged
        rows = self.columns("per_step", point)
        for label, metric in runs:
            of = rows.where(filter=label, metric=metric)
            if metric in primary_metrics([metric]) and len(of):
                of = of.chosen((of["step"] >= first) & (of["step"] <= last))
                values = np.full(last - first + 1, np.nan)
                values[of["step"].astype(int) - first] = of["value"]
                whole = float(runs[label, metric][0])
                # R = sqrt(mean e^2) changes by (e^2 - R^2) / (2 R) per step, to first order.
                if measured(metric).family[0].name == "rmse":
                    values = 0.5 * (whole + np.square(values) / whole) if whole else 0.0 * values
                out[label, metric] = values
        return out

    def line_style(self, label: str) -> dict[str, Any]:
        """Return color and dash of a filter, the same in every figure of the experiment.

        The floor or baseline of any figure is drawn as such in all figures.
        """
        default = style.line([*self.config["filters"], label].index(label))
        return self._references.get(label, default)

    @cached_property
    def _references(self) -> dict[str, dict[str, Any]]:
        looks = dict.fromkeys(self.exact, style.EXACT)
        for key, look in (("baseline", style.BASELINE), ("floor", style.FLOOR)):
            labels = (figure.get(key) for figure in self.figure_configs.values())
            looks |= {label: look for label in labels if isinstance(label, str)}
        return looks

    def axis(self, path: str) -> str:
        """Return a swept path as the label of an axis: ``q (m^2/s^3)``."""
        words, unit = phrases.quantity(path)
        return phrases.in_unit(words, unit or self.grid_units.get(path, ""))

    @cached_property
    def grid_units(self) -> dict[str, str]:
        """Units of paths of the grid that the keys' documentation names, not the keys."""
        units: dict[str, str] = {}
        for path in (p for p in self.grid if not phrases.quantity(p)[1]):
            keys = split_path(self.source, single_paths(path)[0])
            first, *rest = (str(key) for key in keys if not isinstance(key, int))
            part, group = self.config[first], "scenarios"
            if first == "filters":
                part, group, rest = part[rest[0]], "filters", rest[1:]
            if rest and (unit := _unit(part, group, None, rest)):
                units[path] = unit
        return units


def _unit(part: Any, group: str | None, cls: type[Any] | None, keys: Sequence[str]) -> str:
    """Return the unit of the key at the path ``keys`` in the settings ``part``.

    They are those of a component of ``group``, or of the dataclass ``cls``. Empty if the component is
    unknown or the key has no unit.
    """
    key, *rest = keys
    if group is not None:
        cls = kinds(cast(Group, group)).get(part.get("kind", "ekf"))
    hint = None if cls is None else hints_of(cls).get(key)
    if key == "assume" and hint is None:
        return _unit(part[key], None, Assume, rest)
    if cls is None or hint is None:
        return ""
    if rest:
        inner, nested = part.get(key), dataclasses_in(hint)
        only = nested[0] if len(nested) == 1 else None
        return _unit(inner, part_group(hint), only, rest) if isinstance(inner, dict) else ""
    marks = annotations_of(hint)
    special = (m.unit for m in marks if isinstance(m, UnitIf) and part.get(m.key) == m.value)
    return next(special, next((m.unit for m in marks if isinstance(m, Unit)), ""))


class OutputError(Exception):
    """Reason why an output is missing, as text: a drawing process may be unable to pickle the error."""


class PartialReportError(RunError):
    """Some tables or figures could not be made; all else is written."""

    def __init__(self, lines: Sequence[str], written: Sequence[Path]) -> None:
        super().__init__("; ".join(lines))
        self.lines, self.written = list(lines), list(written)


@contextmanager
def catch_errors(part: Any = None) -> Iterator[None]:
    """Raise OutputError for an exception of a plugin's table or figure, and for a bug of the package.

    A finished run is worth more than any of its outputs. Errors with a line of their own pass.
    """
    try:
        with plugin_code(part) if is_foreign(part) else nullcontext():
            yield
    except PluginError as error:
        raise OutputError(str(error)) from None
    except (OutputError, UserError, RunError, OSError):
        raise
    except Exception as error:
        raise OutputError(package_line(error)) from error


def as_table(table: object, part: Any) -> Table:
    """Return the table of a kind; raises WrongReturnError if it is none, or cannot be written."""
    if not isinstance(table, Table):
        raise WrongReturnError("table", f"table gives a {type(table).__name__}, not a Table")
    try:
        table.csv_rows(), table.markdown(), table.texts().tex("")
    except Exception as error:
        if not is_foreign(part):
            raise
        what = f"the table cannot be written: {message_of(error)}"
        raise WrongReturnError("table", what) from None
    return table


def as_figure(figure: object) -> "Figure":
    """Return a plugin's figure; raises WrongReturnError if it is none."""
    from matplotlib.figure import Figure

    if not isinstance(figure, Figure):
        raise WrongReturnError("draw", f"draw gives a {type(figure).__name__}, not a Figure")
    return figure


def missing_paths(points: Sequence[Point], **wanted: str | None) -> dict[str, str]:
    """Explain which keys name no path of the grid, by key."""
    grid, wrong = list(points[0].values), {}
    for key, path in wanted.items():
        if path is not None and path not in grid:
            what = f"{path!r} is no path of the grid; {unknown(path, grid)}"
            wrong[key] = what if grid else "there is no grid"
    return wrong


def scenes(results: Results) -> list[GridPoint]:
    """List the grid's combinations of scenario values, in order; one empty one without any."""
    paths = [path for path in results.grid if is_of_scenario(path)]
    every: list[GridPoint] = []
    for point in results.points():
        scene = {path: point[path] for path in paths}
        if scene not in every:
            every.append(scene)
    return every


def points_of(results: Results, scene: GridPoint) -> list[GridPoint]:
    """Select the points of the grid with these scenario values."""
    return [point for point in results.points() if scene.items() <= point.items()]


def own_values(results: Results, point: GridPoint, label: str) -> GridPoint:
    """Select the values that a point gives a filter, by single path."""
    place = results.index_of(point)
    values = point if place is None else results.grid_points[place]  # lists, where files have words
    singles: GridPoint = {}
    for path, value in values.items():
        singles |= zip(single_paths(path), values_of(path, value), strict=True)
    every = results.config["filters"]
    return {path: value for path, value in singles.items() if label in filters_of(path, every)}


def named_form(label: str, keys: GridPoint, others: Sequence[GridPoint]) -> str:
    """Name a filter by its label and the keys that differ between its forms."""
    differing = {}
    for key, value in keys.items():
        if any(other.get(key) != value for other in others):
            differing[key] = value
    return f"{label} ({phrases.heading(differing)})" if differing else label
