"""A results folder: its tables and figures by name, the points of its grid.

A table or figure that fails becomes a line with its place; the others are made.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from trackbench.config.build import build_kind, hints_of
from trackbench.config.experiment import Point
from trackbench.config.grid import filters_of, is_of_scenario, single_paths, values_of
from trackbench.config.mistakes import unknown
from trackbench.config.overrides import split_path
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
from trackbench.report.paired import (
    Pair,
    compared_statistic,
    named_errors_first,
    pairs_of,
    primary_metrics,
)
from trackbench.report.plotting import style
from trackbench.report.table import LinkedTexts, Table, results_html
from trackbench.results.folder import ResultsFolder
from trackbench.results.folder_contents import DEFAULT, TRACK
from trackbench.results.point_facts import GridPoint
from trackbench.statistics.comparison import Sample

if TYPE_CHECKING:
    from matplotlib.figure import Figure


T = TypeVar("T")

_ERROR = re.compile(r"rms\((?P<metric>rmse(?:_(?P<quantity>\w+))?)\)")
"""A row of summary.csv: ``rms(rmse_position)``."""
NO_FILTER_RAN = "none of its filters ran"
"""Why a figure is not drawn."""
_MOST_ROWS = 50
"""Of more there is `sweep.csv`."""


def default_keys(
    group: Group, metrics: Iterable[str], points: int, filters: int, config: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the config keys of the default table or figure; empty if there is none.

    ``group`` is "tables" or "figures". The table shows the first two errors over the whole run among
    ``metrics``, those of summary.csv. Errors that ``config`` names under `score` come first. ``points``
    and ``filters`` are the numbers of grid points and filters: a table with too many rows is left out.
    """
    metrics = list(dict.fromkeys(metrics))
    # A row such as rms(rmse_position), by its metric rmse_position.
    rows = {match["metric"]: match for match in map(_ERROR.fullmatch, metrics) if match}
    errors = [rows[name] for name in named_errors_first(config, [*rows])]
    if group == "figures":
        if points > 1 or not errors:
            return {}
        return {"kind": "rmse-vs-time", "x": "time", "metric": measure(errors[0]["metric"])}
    columns = {}
    for error in errors[:2]:
        words = "RMSE"
        if error["quantity"]:
            words += f" of {error['quantity']}"
        row = error[0]  # the whole text
        columns[phrases.in_unit(words, unit_of(error["metric"]))] = row
    if errors and "anees" in metrics:
        columns["ANEES"] = "anees"
    if not errors and "mean(nis)" in metrics:
        columns["NIS"] = "mean(nis)"
    if not columns or points * filters > _MOST_ROWS:
        return {}
    measures = {head: measure(text) for head, text in columns.items()}
    return {"kind": "metrics", "title": "Errors over the whole run", "columns": measures}


@dataclass(frozen=True, repr=False)
class Results(ResultsFolder):
    """A results folder with the tables and figures that are made of it.

    Tables and figures of plugins get one: see `ResultsFolder` for its numbers and facts.
    """

    out: Path | None = None
    """where tables and verdicts are written, if not into the folder"""
    unmade: dict[str, str] = field(default_factory=dict, init=False, compare=False)
    """tables, figures and other outputs that failed, with the reasons"""
    known_rankings: dict[str, list[Any]] = field(default_factory=dict, init=False, compare=False)
    """rankings computed so far, by metric"""
    _judged_steps: dict[tuple[Any, ...], dict[tuple[str, str], Array]] = field(
        default_factory=dict, init=False, compare=False
    )
    """results of `judged_steps` so far, by point of the grid"""

    def __repr__(self) -> str:
        filters = counted(len(self.filters), "filter")
        runs = counted(self.config["runs"], "run")
        return f"<Results in {self.folder}: {self.title}; {filters}, {runs}>"

    def _repr_html_(self) -> str:
        tables = [table.texts() for table in self.tables.values()]
        picture = self._repr_png_()
        return results_html(self.title, [f"{self.folder}/", *self.unmade_lines], tables, picture)

    def _repr_png_(self) -> bytes | None:
        """Return the key figure as PNG; None if there is none, if it fails, or without its tracks."""
        figure = self.parts("figures").get(self.key_figure)
        # A figure of tracks cannot be drawn if every filter failed: then no tracks are stored.
        if figure is None or (figure.shown_runs and not self.shown):
            return None
        from trackbench.report.plotting.canvas import png

        output = f"figure {self.key_figure}"
        return self.attempt(output, lambda: png(self.figure()), default=None, exhibit=figure)

    def figure(self, name: str = "") -> "Figure":
        """Return a figure of the config, for matplotlib to go on with.

        Parameters
        ----------
        name : name of the figure in the config; default: the key figure

        Raises
        ------
        UserError : there is no figure of that name, or none of its filters ran
        """
        figures = self.parts("figures")
        if name in self.idle_figures:
            raise UserError(Problem(Mark("figure"), name, NO_FILTER_RAN))
        # Without a name it is the key figure, if there is any figure.
        if name not in figures and (name or not figures):
            raise UserError(Problem(Mark("figure"), name, unknown(name, [*figures])))
        spec = figures[name or self.key_figure]
        with style.rc_context():
            # A figure that compares some of the filters shows the best ones, too.
            return style.lay_out(spec.with_best(self).draw(self))

    @property
    def key_figure(self) -> str:
        """Name of the key figure; empty if there is none."""
        figures = self.parts("figures")
        named = self.config.get("key_figure")
        if named in figures:
            return named
        return next(iter(figures), "")

    @property
    def target(self) -> Path:
        """Folder that tables and verdicts are written to."""
        return self.out or self.folder

    def parts(self, group: Group) -> dict[str, Any]:
        """Return the experiment's tables or figures, built from the config.

        A config without tables has the default one, and the default figure if it has no others than
        the track that `load` adds.

        Parameters
        ----------
        group : "tables" or "figures"

        Returns
        -------
        Tables or figures by name, without those whose plugin is not loaded, and without figures none
        of whose filters ran.

        Raises
        ------
        UserError : a table or figure of the config is mistaken
        """
        built = self._build_parts(group)
        if group == "tables":
            return built
        return {name: spec for name, spec in built.items() if not self._is_idle(spec)}

    @cached_property
    def idle_figures(self) -> list[str]:
        """Names of the figures none of whose filters ran, as with ``--only``; they are not drawn."""
        return [name for name, spec in self._build_parts("figures").items() if self._is_idle(spec)]

    def _is_idle(self, figure: Any) -> bool:
        """Test whether a figure names filters, and none of them ran."""
        return bool(figure.filters) and not self.chosen(figure.filters)

    def _build_parts(self, group: Group) -> dict[str, Any]:
        """Return the tables or figures of the config by name, without those of missing plugins."""
        has_tables = bool(self.config.get("tables"))
        has_own_figures = not {*(self.config.get("figures") or ())} <= {TRACK}
        takes_default = not has_tables and (group == "tables" or not has_own_figures)
        built = self._default_parts(group) if takes_default else {}
        unavailable = self.unavailable_kinds(group)
        source = replace(self.source, problems=[])
        for name in self.config.get(group) or {}:
            if name not in unavailable:
                part = build_kind(group, source, (group, name))
                if "{" in getattr(part, "title", ""):
                    part = replace(part, title=self.fill_title(part.title))
                built[name] = part
        source.check()
        return built

    def _default_parts(self, group: Group) -> dict[str, Any]:
        """Make the default tables or figures of an experiment that names none."""
        metrics = self.columns("summary")["metric"]
        points = len(self.grid_points)
        keys = default_keys(group, metrics, points, len(self.labels), self.config)
        if not keys:
            return {}
        kind = kinds(group)[keys.pop("kind")]
        return {DEFAULT: kind(**keys)}

    @cached_property
    def tables(self) -> dict[str, Table]:
        """Experiment's tables by name, without those of plugins that fail."""
        tables = {}
        for name, spec in self.parts("tables").items():
            with self.without(f"table {name}", spec):
                tables[name] = self.with_units(as_table(spec.table(self), spec))
        return tables

    def with_units(self, table: Table) -> Table:
        """Set units of the grid's paths in a table, and texts of those that vary together; return it.

        The head of paths that vary together is the first of them.
        """
        table.units = {
            path: phrases.with_raised_powers(unit) for path, unit in self.grid_units.items()
        }
        for path in self.grid:
            if len(single_paths(path)) > 1:
                table.linked[single_paths(path)[0]] = self._linked_texts(path)
        return table

    def _linked_texts(self, path: str) -> LinkedTexts:
        """Return how a table shows the values of paths that vary together: by the keys that differ."""
        values = list(dict.fromkeys(str(point[path]) for point in self.points()))
        points, number = phrases.distinct_points([{path: value} for value in values])
        paths = list(points[0])
        if number == 1:
            texts = [str(*point.values()) for point in points]
            return LinkedTexts(head="", texts=dict(zip(values, texts, strict=True)))
        names = dict.fromkeys(phrases.quantity(single_path)[0] for single_path in paths)
        texts = [phrases.heading(point, self.grid_units) for point in points]
        return LinkedTexts(head=", ".join(names), texts=dict(zip(values, texts, strict=True)))

    @property
    def unmade_lines(self) -> list[str]:
        """Failures of tables, figures and other outputs, a line each."""
        return [f"{output} failed: {reason}" for output, reason in self.unmade.items()]

    @contextmanager
    def without(self, output: str, exhibit: Any = None) -> Iterator[None]:
        """Continue without a failing output, and note the reason.

        ``output`` names it in messages; ``exhibit`` is its table or figure, if it has one.
        """
        try:
            with catch_errors(exhibit):
                yield
        except OutputError as error:
            self.unmade[output] = str(error)

    def attempt(self, output: str, make: Callable[[], T], default: T, exhibit: Any = None) -> T:
        """Return what ``make`` returns; the default if it fails, and note the reason.

        ``output`` names it in messages; ``exhibit`` is its table or figure, if it has one.
        """
        with self.without(output, exhibit):
            return make()
        return default

    @cached_property
    def pairs(self) -> list[tuple[GridPoint, list[Pair]]]:
        """Comparisons of every pair of filters on common runs, a list for each point of the grid."""
        pairs_by_point = []
        for point in self.points():
            runs = self.runs(point)
            steps = self.judged_steps(point)
            metrics = list(dict.fromkeys(metric for _, metric in runs))
            pairs: list[Pair] = []
            for metric in primary_metrics(metrics):
                statistic = compared_statistic(self.config, metric)
                samples = {}
                for label in self.labels:
                    key = (label, metric)
                    if key in runs:
                        samples[label] = Sample.from_values(runs[key], statistic, steps.get(key))
                pairs += pairs_of(metric, samples)
            pairs_by_point.append((point, pairs))
        return pairs_by_point

    @property
    def batches(self) -> int:
        """Number of batches of consecutive runs, each of which a verdict omits; 1 in old folders."""
        return int(self.config.get("verdict_seeds", 1))

    def judged_steps(self, point: GridPoint) -> dict[tuple[str, str], Array]:
        """Return what each step (T,) of a recording's one run adds to a number, by (filter, metric).

        The mean over the steps is the number. The steps are those that count; one without a value is
        NaN. The mapping is empty unless the results are those of one recorded run.
        """
        key = tuple(point.items())
        if self._judged_steps.get(key):
            return self._judged_steps[key]
        judged = self.facts(point).judged
        runs = self.runs(point)
        values_by_metric = self._judged_steps.setdefault(key, {})
        if not judged:
            return values_by_metric
        first_step, last_step = judged
        per_step = self.columns("per_step", point)
        for label, metric in runs:
            series = per_step.where(filter=label, metric=metric)
            if metric not in primary_metrics([metric]) or not len(series):
                continue
            steps = series["step"]
            series = series.chosen((steps >= first_step) & (steps <= last_step))
            values = np.full(last_step - first_step + 1, np.nan)
            values[series["step"].astype(int) - first_step] = series["value"]
            # R = sqrt(mean e^2) changes by (e^2 - R^2) / (2 R) per step, to first order. The step's
            # value is R with this change: (R + e^2 / R) / 2.
            if measured(metric).definition.name == "rmse":
                rmse = float(runs[label, metric][0])
                values = 0.5 * (rmse + np.square(values) / rmse) if rmse else 0.0 * values
            values_by_metric[label, metric] = values
        return values_by_metric

    def line_style(self, label: str) -> dict[str, Any]:
        """Return the usual color and dash of a filter in the figures of the experiment.

        The reference, the bound and the floor or baseline of any figure are black or gray in every
        figure. A figure of several filters takes `line_styles`.

        Parameters
        ----------
        label : label of a filter of the config

        Returns
        -------
        Keyword arguments of matplotlib's ``plot``.
        """
        return self._usual_looks[label]

    def line_styles(
        self, labels: Sequence[str], floor: str | None = None, baseline: str | None = None
    ) -> dict[str, dict[str, Any]]:
        """Return color and dash of each filter that one figure draws.

        A filter has its usual look unless another one of this figure has the color already. Only if
        there are more filters than colors, two have the same color, and different dashes.

        Parameters
        ----------
        labels : all labels that the figure draws, in their order
        floor : label of the figure's floor, which is black
        baseline : label of the figure's baseline, which is gray

        Returns
        -------
        Keyword arguments of matplotlib's ``plot``, by label.
        """
        looks = {label: self.line_style(label) for label in labels}
        for label, reference_look in ((baseline, style.BASELINE), (floor, style.FLOOR)):
            if label in looks and looks[label]["color"] != reference_look["color"]:
                looks[label] = reference_look
        return style.distinct_looks(looks)

    @cached_property
    def _usual_looks(self) -> dict[str, dict[str, Any]]:
        """Color and dash of each label of the config, also of filters that this run leaves out."""
        black: list[str] = []
        gray: list[str] = []
        for figure in self.figure_configs.values():
            for key, labels in (("floor", black), ("baseline", gray)):
                if isinstance(figure.get(key), str):
                    labels.append(figure[key])
        black += [
            label for label in (self.config.get("reference"), self.config.get("bound")) if label
        ]
        black += self.exact
        looks = dict.fromkeys(gray, style.BASELINE)
        for number, label in enumerate(dict.fromkeys(black)):
            looks[label] = style.reference_line(number)
        others = [label for label in self.config["filters"] if label not in looks]
        drawn_together: list[list[str]] = []
        for figure in self.figure_configs.values():
            wanted = figure.get("filters") or others
            drawn_together.append([label for label in others if label in wanted])
        for label, number in style.number_lines(others, drawn_together).items():
            looks[label] = style.line(number)
        return looks

    def axis(self, path: str) -> str:
        """Return a swept path as the label of an axis: ``q (m^2/s^3)``."""
        return phrases.axis(path, self.grid_units)

    @cached_property
    def grid_units(self) -> dict[str, str]:
        """Unit of each single path of the grid whose key has one and whose name does not end in it.

        If no component of the state has a unit, that of the time is unknown, too.
        """
        units: dict[str, str] = {}
        for path in chain.from_iterable(map(single_paths, self.grid)):
            _, unit_in_name = phrases.quantity(path)
            if unit_in_name:
                continue
            unit = self.unit_of_key(split_path(self.source, path)) or self._unit_of_component(path)
            is_time = path == "scenario.T"
            if unit and not (is_time and not any(self._component_units.values())):
                units[path] = unit
        return units

    def point_heading(self, point: GridPoint) -> str:
        """Return a grid point in words, by the keys that differ; empty without a grid."""
        points = self.points()
        return phrases.distinct_headings(points, self.grid_units)[points.index(point)]

    @cached_property
    def _component_units(self) -> dict[str, str]:
        """Unit of each component of the truth's state by name; empty if none is known."""
        facts = self.facts(self.points()[0])
        return {name: facts.component(c)[1] for c, name in enumerate(facts.components)}

    def _unit_of_component(self, path: str) -> str:
        """Return the unit of a component of the initial state that a path sets; else empty."""
        parent, _, component = path.rpartition(".")
        if parent in ("scenario.start.mean", "scenario.start.sigma", "scenario.target.initial"):
            return self._component_units.get(component, "")
        return ""

    def unit_of_key(self, keys: Sequence[str | int]) -> str:
        """Return the unit of a key of the config; empty if none is known.

        The ``keys`` are its path, such as `filters`, `EKF`, `motion`, `q`, or `scenario`, `sensor`, 0,
        `sigma`.
        """
        if keys[0] == "filters":
            group = "filters"
            settings = self.config["filters"][keys[1]]
            inner_keys = keys[2:]
        else:
            group = "scenarios"
            settings = self.config[str(keys[0])]
            inner_keys = keys[1:]
        if not inner_keys:  # the path is that of a whole filter or scenario
            return ""
        return _unit(settings, group=group, cls=None, keys=inner_keys)


def _unit(
    settings: Any, group: str | None, cls: type[Any] | None, keys: Sequence[str | int]
) -> str:
    """Return the unit of the key at the path ``keys`` in ``settings``.

    The settings are those of a component of ``group``, or of the dataclass ``cls``. Empty if the
    component is unknown or the key has no unit.
    """
    key = str(keys[0])
    inner_keys = keys[1:]
    if group is not None:
        # Only a filter may lack its kind: it is an EKF.
        cls = kinds(cast(Group, group)).get(settings.get("kind", "ekf"))
    hint = None
    if cls is not None:
        hint = hints_of(cls).get(key)
    if key == "assume" and hint is None and inner_keys:
        # A filter without this key takes the model of the scenario.
        return _unit(settings.get(key) or {}, group=None, cls=Assume, keys=inner_keys)
    if hint is None:
        return ""
    # A key of a component or dataclass inside this one.
    if inner_keys:
        inner_settings = settings.get(key)
        # The item of a list, such as one of several sensors.
        index = inner_keys[0]
        if isinstance(index, int) and isinstance(inner_settings, list | tuple):
            inner_settings = inner_settings[index]
            inner_keys = inner_keys[1:]
        if not inner_keys:
            return ""
        if not isinstance(inner_settings, dict):
            return ""
        inner_classes = dataclasses_in(hint)
        inner_class = inner_classes[0] if len(inner_classes) == 1 else None
        return _unit(inner_settings, part_group(hint), inner_class, inner_keys)
    # The unit that another key's value decides, else the unit of the key.
    annotations = annotations_of(hint)
    for annotation in annotations:
        if isinstance(annotation, UnitIf) and settings.get(annotation.key) == annotation.value:
            return annotation.unit
    for annotation in annotations:
        if isinstance(annotation, Unit):
            return annotation.unit
    return ""


class OutputError(Exception):
    """Reason why an output is missing, as text: a drawing process may be unable to pickle the error."""


class PartialReportError(RunError):
    """Some tables or figures could not be made; all else is written."""

    def __init__(self, lines: Sequence[str], written: Sequence[Path]) -> None:
        super().__init__("; ".join(lines))
        self.lines = list(lines)
        self.written = list(written)


@contextmanager
def catch_errors(exhibit: Any = None) -> Iterator[None]:
    """Raise OutputError for an exception of a plugin's table or figure, and for a bug of the package.

    A finished run is worth more than any of its outputs. Errors with a line of their own pass.
    ``exhibit`` is the table or figure that is made, if it is one.
    """
    try:
        with plugin_code(exhibit) if is_foreign(exhibit) else nullcontext():
            yield
    except PluginError as error:
        raise OutputError(str(error)) from None
    except (OutputError, UserError, RunError, OSError):
        raise
    except Exception as error:
        raise OutputError(package_line(error)) from error


def as_table(table: object, exhibit: Any) -> Table:
    """Return ``table``, which the table kind ``exhibit`` returned, if it can be written.

    Raises WrongReturnError if it is not a `Table`, or if it is a plugin's and cannot be written. An
    error of the package's own kinds passes.
    """
    if not isinstance(table, Table):
        raise WrongReturnError("table", f"table gives a {type(table).__name__}, not a Table")
    # Every form of the table is made once, so that an error shows before any file is written.
    try:
        table.csv_rows()
        table.markdown()
        table.texts().tex("")
    except Exception as error:
        if not is_foreign(exhibit):
            raise
        message = f"the table cannot be written: {message_of(error)}"
        raise WrongReturnError("table", message) from None
    return table


def as_figure(figure: object) -> "Figure":
    """Return a plugin's figure; raises WrongReturnError if it is none."""
    from matplotlib.figure import Figure

    if not isinstance(figure, Figure):
        raise WrongReturnError("draw", f"draw gives a {type(figure).__name__}, not a Figure")
    return figure


def missing_paths(points: Sequence[Point], **paths: str | None) -> dict[str, str]:
    """Return the mistakes of keys that name no path of the grid, by key; empty if there are none.

    ``paths`` are the keys with their values; None stands for a key that is not set.
    """
    grid = list(points[0].values)
    problems = {}
    for key, path in paths.items():
        if path is None or path in grid:
            continue
        if grid:
            problems[key] = f"{path!r} is no path of the grid; {unknown(path, grid)}"
        else:
            problems[key] = "there is no grid"
    return problems


def scenes(results: Results) -> list[GridPoint]:
    """List the combinations of the values that the grid gives the scenario, in order.

    If the grid does not vary the scenario, the list has one empty combination.
    """
    paths = [path for path in results.grid if is_of_scenario(path)]
    combinations: list[GridPoint] = []
    for point in results.points():
        scene = {path: point[path] for path in paths}
        if scene not in combinations:
            combinations.append(scene)
    return combinations


def points_of(results: Results, scene: GridPoint) -> list[GridPoint]:
    """Select the points of the grid with these scenario values, one of `scenes`."""
    return [point for point in results.points() if scene.items() <= point.items()]


def own_values(results: Results, point: GridPoint, label: str) -> GridPoint:
    """Return the values that a point of the grid gives the filter ``label``, by single path."""
    # Paths that vary together have a list of values. It is a text in a point that is read from a file,
    # so take the point of the config.
    values = point
    index = results.index_of(point)
    if index is not None:
        values = results.grid_points[index]
    value_by_path: GridPoint = {}
    for path, value in values.items():
        value_by_path |= zip(single_paths(path), values_of(path, value), strict=True)
    labels = results.config["filters"]
    filter_values = {}
    for path, value in value_by_path.items():
        if label in filters_of(path, labels):
            filter_values[path] = value
    return filter_values


def named_form(label: str, keys: GridPoint, variants: Sequence[GridPoint]) -> str:
    """Name a form of a filter by its label and the keys that differ between its forms: ``EKF (q = 2)``.

    ``keys`` are those of this form with their values, ``variants`` those of every form of the filter.
    """
    differing = {}
    for key, value in keys.items():
        if any(variant.get(key) != value for variant in variants):
            differing[key] = value
    if not differing:
        return label
    return f"{label} ({phrases.heading(differing)})"
