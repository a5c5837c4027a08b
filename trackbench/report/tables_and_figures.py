"""Tables and figures of an experiment by name, made of a results folder, and their units and colors.

A table or figure that fails becomes a line with its place; the others are made.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.config.added_tables_and_figures import exhibits_without_tuning
from trackbench.config.build_components import build_kind
from trackbench.config.did_you_mean import unknown
from trackbench.config.grid import single_paths
from trackbench.core.arrays import Array
from trackbench.errors import Mark, Problem, UserError, counted
from trackbench.registry import Group, of_kind
from trackbench.report.contributions_of_steps import contributions_of_steps
from trackbench.report.default_error_table_and_figure import default_keys
from trackbench.report.findings import grid_headings, metric_phrases
from trackbench.report.key_figure import key_figure
from trackbench.report.notebook_html import results_html
from trackbench.report.output_errors import NotedFailures
from trackbench.report.pairs_of_filters import Pair, every_pair
from trackbench.report.plotting import file_formats, filter_colors, style
from trackbench.report.plotting.filter_colors import usual_looks
from trackbench.report.plugin_tables_and_figures import as_table, unavailable_kinds
from trackbench.report.table import Table
from trackbench.report.units_of_config_keys import grid_units, unit_of_key
from trackbench.results.file_names import DEFAULT, TRACK
from trackbench.results.points_json import GridPoint
from trackbench.results.read_folder import ResultsFolder

if TYPE_CHECKING:
    from matplotlib.figure import Figure


NO_FILTER_RAN = "none of its filters ran"
"""Why a figure is not drawn."""


@dataclass(frozen=True, repr=False)
class Results(ResultsFolder, NotedFailures):
    """A results folder with the tables and figures that are made of it.

    Tables and figures of plugins get one: see `ResultsFolder` for its numbers and facts.
    """

    out: Path | None = None
    """where tables and verdicts are written, if not into the folder"""
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
        """Return the key figure as PNG; None if there is none, if it fails, or without its tracks.

        IPython calls this method to show the results in a notebook.
        """
        figure = self.parts("figures").get(self.key_figure)
        # A figure with ``shown_runs`` needs stored tracks. There are none if every filter failed.
        if figure is None or (figure.shown_runs and not self.shown):
            return None
        from trackbench.report.plotting.notebook_figure import png

        output = f"figure {self.key_figure}"
        # ``exhibit`` is the figure that is drawn: an error in it is reported as that of its plugin.
        return self.attempt(output, lambda: png(self.figure()), default=None, exhibit=figure)

    def figure(self, name: str = "") -> "Figure":
        """Return a figure of the config, for matplotlib to go on with.

        Parameters
        ----------
        name
            name of the figure in the config; empty means the key figure

        Returns
        -------
        matplotlib.figure.Figure
            figure with its layout done

        Raises
        ------
        UserError
            if there is no figure of that name, or none of its filters ran
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
            return file_formats.lay_out(spec.with_best(self).draw(self))

    @property
    def key_figure(self) -> str:
        """Name of the key figure: that of the config, else the first figure; empty without figures."""
        return key_figure(self.config, self.parts("figures"))

    @property
    def target(self) -> Path:
        """Folder that tables and verdicts are written to."""
        return self.out or self.folder

    def parts(self, group: Group) -> dict[str, Any]:
        """Return the experiment's tables or figures, built from the config.

        A config without tables has the default table, and the default figure if it has no figure but
        `TRACK`. Loading a config adds the figure `TRACK`, of a path in the plane, if the user names
        neither a table nor a figure.

        Parameters
        ----------
        group
            ``tables`` or ``figures``

        Returns
        -------
        dict
            tables or figures by name, without those whose plugin is not loaded, and without figures none
            of whose filters ran

        Raises
        ------
        UserError
            if a table or figure of the config is mistaken
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
        """Return the tables or figures of the config by name, without those of missing plugins.

        The default table is among them if the config names no table. The default figure is among them if
        the config names neither a table nor a figure. Those of tuning do not count.
        """
        has_tables = bool(exhibits_without_tuning(self.config.get("tables")))
        # The figure `TRACK` is added as a config is loaded, and is none that the user has named.
        has_own_figures = not {*exhibits_without_tuning(self.config.get("figures"))} <= {TRACK}
        takes_default = not has_tables and (group == "tables" or not has_own_figures)
        built = self._default_parts(group) if takes_default else {}
        unavailable = unavailable_kinds(self.config, group)
        # Mistakes are collected in a list of their own, and raised together at the end.
        source = replace(self.source, problems=[])
        for name in self.config.get(group) or {}:
            if name not in unavailable:
                part = build_kind(group, source, (group, name))
                if "{" in getattr(part, "title", ""):  # such as {runs}
                    part = replace(part, title=self.fill_title(part.title))
                built[name] = part
        source.check()
        return built

    def _default_parts(self, group: Group) -> dict[str, Any]:
        """Make the default table or figure of an experiment that names none; empty if there is none."""
        metrics = self.columns("summary")["metric"]
        points = len(self.grid_points)
        keys = default_keys(group, metrics, points, len(self.labels), self.config)
        if not keys:
            return {}
        kind = of_kind(group, keys.pop("kind"))
        assert kind is not None, "the default tables and figures are kinds of the package"
        return {DEFAULT: kind(**keys)}

    @cached_property
    def tables(self) -> dict[str, Table]:
        """Experiment's tables by name, without those that fail; `unmade` has the reasons."""
        tables = {}
        for name, spec in self.parts("tables").items():
            with self.continued_after_failure(f"table {name}", spec):
                tables[name] = self.with_units(as_table(spec.table(self), spec))
        return tables

    def with_units(self, table: Table) -> Table:
        """Set units of the grid's paths in a table, and texts of those that vary together; return it.

        Paths that vary together have one column in the table, with the first path as its key header.
        ``linked`` has, by this header, the text that stands for each of their values, a list.

        Parameters
        ----------
        table
            table of these results; it is changed

        Returns
        -------
        Table
            the table itself
        """
        table.units = {
            path: metric_phrases.with_raised_powers(unit) for path, unit in self.grid_units.items()
        }
        for path in self.grid:
            if len(single_paths(path)) > 1:
                # Each value of the grid once.
                values = list(dict.fromkeys(str(point[path]) for point in self.points()))
                texts = grid_headings.texts_of_linked_paths(path, values, self.grid_units)
                table.linked[single_paths(path)[0]] = texts
        return table

    @cached_property
    def pairs(self) -> list[tuple[GridPoint, list[Pair]]]:
        """Comparisons of every pair of filters on common runs, a list for each point of the grid."""
        pairs_by_point = []
        for point in self.points():
            runs = self.runs(point)
            pairs = every_pair(self.config, self.labels, runs, self.judged_steps(point))
            pairs_by_point.append((point, pairs))
        return pairs_by_point

    @property
    def batches(self) -> int:
        """Number of batches of consecutive runs, each of which a verdict omits; 1 in old folders."""
        return int(self.config.get("verdict_seeds", 1))

    @property
    def steps_decide(self) -> bool:
        """True if each point of the grid is one recorded run, whose steps decide what differs."""
        return all(self.facts(point).judged is not None for point in self.points())

    def judged_steps(self, point: GridPoint) -> dict[tuple[str, str], Array]:
        """Return what each step of a recording's one run adds to a number.

        They are the `contributions_of_steps`, computed once.

        Parameters
        ----------
        point
            one of ``points()``

        Returns
        -------
        dict
            contributions (T,) of the steps by (filter, metric); empty unless the results are those of
            one recorded run
        """
        key = tuple(point.items())
        if key not in self._judged_steps:
            self._judged_steps[key] = contributions_of_steps(self, point)
        return self._judged_steps[key]

    def line_style(self, label: str) -> dict[str, Any]:
        """Return the usual color and dash of a filter in the figures of the experiment.

        The reference, the bound and the floor or baseline of any figure are black or gray in every
        figure. A figure of several filters takes `line_styles`.

        Parameters
        ----------
        label
            label of a filter of the config

        Returns
        -------
        dict
            keyword arguments of matplotlib's ``plot``
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
        labels
            all labels that the figure draws, in their order
        floor
            label of the figure's floor, which is black; None for none
        baseline
            label of the figure's baseline, which is gray; None for none

        Returns
        -------
        dict
            keyword arguments of matplotlib's ``plot``, by label
        """
        usual_looks = {label: self.line_style(label) for label in labels}
        return filter_colors.looks_in_figure(usual_looks, floor, baseline)

    @cached_property
    def _usual_looks(self) -> dict[str, dict[str, Any]]:
        """Color and dash of each label of the config, also of filters that this run leaves out."""
        return usual_looks(self.config, self.figure_configs, self.exact)

    def axis(self, path: str) -> str:
        """Return a swept path as the label of an axis: ``q (m^2/s^3)``."""
        return grid_headings.axis(path, self.grid_units)

    @cached_property
    def grid_units(self) -> dict[str, str]:
        """Unit of each single path of the grid whose key has one and whose name does not end in it.

        If no component of the state has a unit, that of the time is unknown, too.
        """
        return grid_units(self)

    def point_heading(self, point: GridPoint) -> str:
        """Return a grid point in words, by the keys that differ; empty without a grid.

        Parameters
        ----------
        point
            one of ``points()``

        Returns
        -------
        str
            keys, values and units, such as ``sigma = 10 m``
        """
        points = self.points()
        return grid_headings.distinct_headings(points, self.grid_units)[points.index(point)]

    def unit_of_key(self, keys: Sequence[str | int]) -> str:
        """Return the unit of a key of the config; empty if none is known.

        Parameters
        ----------
        keys
            path of the key, such as `filters`, `EKF`, `motion`, `q`, or `scenario`, `sensor`, 0, `sigma`

        Returns
        -------
        str
            unit, such as ``m``
        """
        return unit_of_key(self.config, keys)
