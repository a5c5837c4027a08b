"""Figure kind `track`: truth, measurements and estimates of a run in the plane."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array, Index
from trackbench.field_types import Count, Natural
from trackbench.models.plane_components import rows_in_plane
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.findings import grid_headings
from trackbench.report.findings.phrases import listed, named
from trackbench.report.findings.ranking import rankings
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_colors, style
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.panels import add_title_and_legend
from trackbench.report.plotting.scales import length_unit
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint, PointFacts
from trackbench.scenarios.base import Scenario

_HEADINGS = ("heading", "theta", "yaw", "psi", "course", "direction", "orientation")
"""Names of a state's component that is drawn as arrows, if it is an angle."""
_CHANGING_TARGETS = ("measured", "driven", "random-legs")
"""Targets that take another path in every run, while the figure has that of the first run."""
_ARROWS = 16
_ARROW_LENGTH = 0.06
"""Number of arrows, and their length as a share of the path's extent."""
_FAR = 4.0
"""Extent, as a multiple of that of the tracks, beyond which a picture with a sensor shows no track."""


@register("figures", "track")
@dataclass(frozen=True, kw_only=True)
class Track(FigureKind):
    """The true track in the plane, its sensors and, one panel per filter, estimates of the first runs.

    Unless it names filters, one panel shows the first run's estimates of the best ones. If it names
    several, the best filter has a panel, too. If the target takes another path in every run, as in
    recordings, it is the first run alone. Of a grid it is the first point.
    """

    filters: tuple[str, ...] = ()
    """labels, a panel each; none draws the best over each other"""
    best: Natural = 3
    """number of the best filters, if no filters are named; 0 draws the truth alone"""
    runs: Count = 50
    """number of runs drawn over each other"""
    components: tuple[int | str, int | str] | None = None
    """names, or numbers from 0, of the two components that are drawn; default: those of the position,
    which are those of the error `position` of the score, or else px and py"""
    measurements: bool = True
    """sensors, and the first run's measurements as dots where a sensor tells positions"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject a figure without anything to draw, and components that the state does not have.

        Return the reason by key, ``""`` for the figure as a whole; empty if all is well.
        """
        # The tracks of every point are stored, so that the components must exist in the states of all.
        last = min(len(p.scenario.components) for p in points) - 1
        for point in points:
            if self.components is None and self._rows_of(point.scenario) is None:
                state = ", ".join(point.scenario.components)
                message = f"shows positions, and the state{_place_of(point, points)} is {state}"
                return {"": f"{message}: name its two as `components`, or take `estimates`"}
        if not (self.filters or self.best) and not all(p.scenario.has_truth for p in points):
            return {"filters": "there is no truth to draw: name the filters whose tracks to draw"}
        for component in self.components or ():
            if not isinstance(component, str) and not 0 <= component <= last:
                message = f"{list(self.components or ())}: the state has components 0 to {last}"
                return {"components": message}
            for point in points:
                known = point.scenario.components
                if isinstance(component, str) and component not in known:
                    message = f"{component!r} is no component{_place_of(point, points)}"
                    return {"components": f"{message}; known: {', '.join(known)}"}
        return {}

    def _rows(
        self, names: Sequence[str], errors: Mapping[str, Sequence[str]]
    ) -> tuple[int, int] | None:
        """Return the rows of a state that are drawn as x and y; None if it has no position.

        ``names`` are the components of the state. ``errors`` are the components of each error that the
        score names, such as ``position``.
        """
        if self.components is None:
            return rows_in_plane(names, errors)
        x, y = (names.index(c) if isinstance(c, str) else c for c in self.components)
        return x, y

    def _rows_of(self, scenario: Scenario) -> tuple[int, int] | None:
        """Return the rows that are drawn of a scenario's state; None if it has no position."""
        score = getattr(scenario, "score", None)  # a scenario of a plugin may have none
        return self._rows(scenario.components, score.errors if score is not None else {})

    @property
    def shown_runs(self) -> int:
        """Runs whose tracks must be kept."""
        if self.filters:
            return self.runs
        return 1  # the best filters are drawn in the first run

    @property
    def shown_components(self) -> tuple[int, ...]:
        """Components that are drawn of those tracks, as lines; which ones is looked up by name."""
        return ()

    def shown_components_of(self, scenario: Scenario) -> tuple[int, ...]:
        """Return the components that are drawn of a scenario's state: two positions, and a heading."""
        rows = self._rows_of(scenario) or ()
        return (*rows, *heading_rows(scenario.components, scenario.angles))

    @property
    def shown_measurements(self) -> bool:
        """True if the figure needs the measured positions of the first run."""
        return self.measurements

    def default_caption(self, results: Results) -> str:
        """Return whose estimates are shown, of how many runs, and at which point of a grid."""
        runs = min(self.shown_runs, results.config["runs"])
        point = _first_point(results)
        # If the target takes another path in every run, only the first run is drawn.
        if _paths_differ(results.facts(point)):
            runs = 1
        which_runs = f"the first {runs} runs"
        if runs == 1:
            which_runs = "the first run"
        labels = [named(label) for label in self.filters or self._best_filters(results)]
        if len(results.grid_points) > 1:
            which_runs += f" at {grid_headings.heading(point)}"
        if len(self.filters) > 1:
            return f"The target in the plane in {which_runs}, a panel for each of {listed(labels)}."
        caption = f"The target in the plane in {which_runs}"
        if labels:
            caption += f", with the estimates of {listed(labels)}"
        return f"{caption}."

    def draw(self, results: Results) -> Figure:
        """Return a panel per filter, or one of the best filters; all have equal scales."""
        point = _first_point(results)
        facts = results.facts(point)
        scene = self._read_scene(results, results.tracks(point), facts)
        # All positions (2, n) that are drawn of the first run set the unit and the size of the figure.
        positions = [scene.truth, scene.measured, *scene.sensors.values()]
        positions += [place[:, None] for place in scene.landmarks.values()]
        positions += [estimate[..., 0] for estimate in scene.estimates.values()]
        meters_per_unit, unit = plane_unit(*positions)
        panels = max(len(self.filters), 1)
        width, height = _fit_figure(panels, *(xy / meters_per_unit for xy in positions))
        figure, axes = style.subplots(
            1, panels, height, width, squeeze=False, sharex=True, sharey=True
        )
        for index, ax in enumerate(axes[0]):
            label = self.filters[index] if self.filters else ""
            self._draw_panel(ax, results, scene, label, meters_per_unit, turning=facts.spans)
            ax.set_aspect("equal")
            ax.set_xlabel(f"x ({unit})")
            ax.locator_params(nbins=5)
            ax.set_title(style.wrap_label(label))
        axes[0][0].set_ylabel(f"y ({unit})")
        title = self.title
        if len(results.grid_points) > 1:
            title = f"{title} ({caption_parts.heading(results, point)})".strip()
        return add_title_and_legend(figure, title)

    def _read_scene(
        self, results: Results, tracks: dict[str, Array], facts: PointFacts
    ) -> "_Scene":
        """Read what the figure draws at a grid point: truth, estimates, measurements and sensors.

        ``tracks`` and ``facts`` are those of the point; tracks have the axes (component, step, run).
        Sensors and landmarks far from the target are left out.
        """
        errors = (facts.scenario.get("score") or {}).get("errors") or {}
        rows = self._rows(facts.components, errors)
        assert rows is not None  # `conflicts` rejects a state without a position
        components = list(rows)
        # Measurements and sensors are drawn only over positions, not over other components.
        is_position = rows == rows_in_plane(facts.components, errors)
        truth = tracks["truth"][components, :, 0]
        # In other runs the target may take another path than the truth that is drawn.
        runs = 1 if _paths_differ(facts) else self.runs
        estimates: dict[str, Array] = {}
        for label in self.filters or self._best_filters(results):
            if f"mean/{label}" in tracks:
                estimates[label] = tracks[f"mean/{label}"][components, :, :runs]
        measured = np.empty((2, 0))
        sensors: dict[str, Array] = {}
        landmarks: dict[str, Array] = {}
        all_sensors = [name for name in tracks if name.startswith("sensor/")]
        if self.measurements and is_position:
            if "seen" in tracks:  # measured positions, of which a height is left out
                measured = tracks["seen"][:2, :, 0]
            first_run = [truth, measured, *(estimate[..., 0] for estimate in estimates.values())]
            for name in all_sensors:
                if _is_near(tracks[name], first_run):
                    sensors[name.removeprefix("sensor/")] = tracks[name]
            # Landmarks of a recording have the names of its sensors, others their numbers, from 1.
            landmark_names = (facts.scenario.get("target") or {}).get("sensors") or ()
            for name in tracks:
                if name.startswith("landmark/") and _is_near(tracks[name][:, None], first_run):
                    number = name.removeprefix("landmark/")
                    landmark = landmark_names[int(number) - 1] if landmark_names else number
                    landmarks[str(landmark)] = tracks[name]
        # Poses by the label of the panel, a filter's or "" for the one panel of the best filters. They
        # are those of the truth in every panel. If it has no heading, a panel has those of its filter,
        # and the panel of the best filters those of the first, which is the best. Empty without a
        # heading in the state.
        poses: dict[str, _Poses] = {}
        for row in heading_rows(facts.components, facts.angles or ()):
            for label, estimate in estimates.items():
                headings = tracks[f"mean/{label}"][row, :, 0]
                poses[label] = _Poses(path=estimate[..., 0], headings=headings)
            headings = tracks["truth"][row, :, 0]
            of_truth = _Poses(path=truth, headings=headings, name="Heading of the truth")
            if len(of_truth.known_steps):
                poses = dict.fromkeys(["", *estimates], of_truth)
            elif not self.filters and poses:
                poses[""] = next(iter(poses.values()))
        return _Scene(
            landmarks=landmarks,
            poses=poses,
            truth=truth,
            times=tracks["times"],
            measured=measured,
            estimates=estimates,
            sensors=sensors,
            has_many_sensors=len(all_sensors) > 1,
        )

    def _draw_panel(
        self,
        ax: Axes,
        results: Results,
        scene: "_Scene",
        label: str,
        meters_per_unit: float,
        turning: Iterable[Sequence[float]],
    ) -> None:
        """Draw the scene with the estimates of the filter ``label``.

        If the figure names no filters, the label is empty, and the estimates are those of the best
        filters. ``meters_per_unit`` is the length of a unit of the axes. ``turning`` has the first and
        last time, s, of each maneuver.
        """
        if scene.measured.size:
            x, y = scene.measured / meters_per_unit
            ax.plot(
                x,
                y,
                ".",
                color="#bbbbbb",
                markersize=2.0,
                label="Measurements, first run",
                rasterized=True,
                zorder=0,
            )
        if label in scene.estimates:  # the filter did not fail
            color = results.line_styles(self.filters)[label]["color"]
            _draw_runs(ax, scene.estimates[label] / meters_per_unit, label, color)
        if not self.filters:
            _draw_best(ax, results, scene.estimates, meters_per_unit)
        truth = scene.truth / meters_per_unit
        most_runs = max((each.shape[-1] for each in scene.estimates.values()), default=0)
        draw_truth(ax, truth, scene.times, turning, estimated_runs=most_runs)
        for number, path in scene.sensors.items():
            name = f"Sensor {number}" if scene.has_many_sensors else "Sensor"
            draw_sensor(ax, path / meters_per_unit, name)
        _draw_landmarks(ax, scene.landmarks, meters_per_unit)
        # A filter that failed has no poses of its own: its panel has those of "", the truth's, if known.
        poses = scene.poses.get(label) or scene.poses.get("")
        if poses is not None:
            _draw_headings(ax, poses, meters_per_unit)

    def _best_filters(self, results: Results) -> list[str]:
        """Return the first ``best`` filters of the first ranking; without one, those of the config."""
        labels: list[str] = []
        all_rankings = rankings(results)
        if all_rankings:
            labels = [contender.label for contender in all_rankings[0].order]
        return (labels or results.filters)[: self.best]


def _place_of(point: Point, points: Sequence[Point]) -> str:
    """Return the words "at" and the values of a point of the grid; empty if there is no other point."""
    if len(points) == 1:
        return ""
    return f" at {grid_headings.heading(point.values)}"


def _first_point(results: Results) -> GridPoint:
    """Return the first point of the grid at which not every filter failed."""
    return next(filter(results.tracks, results.grid_points))


def _paths_differ(facts: PointFacts) -> bool:
    """Test whether the target takes another path in every run."""
    target = facts.scenario.get("target") or {}
    return target.get("kind") in _CHANGING_TARGETS


def _draw_runs(ax: Axes, estimates: Array, label: str, color: str) -> None:
    """Draw a filter's estimates (2, T, runs) over each other, and an opaque line in the legend."""
    x, y = estimates
    runs = x.shape[1]
    name = label
    width = 1.0
    if runs > 1:
        name = f"{label}, {runs} runs"
        width = 0.6
    # The more runs, the fainter each, as they overlap.
    opacity = min(1.0, max(0.15, 2.0 / runs))
    ax.plot(x, y, color=color, linewidth=width, alpha=opacity, rasterized=True)
    ax.plot([], [], color=color, linewidth=1.0, label=style.wrap_label(name))


@dataclass(frozen=True, kw_only=True)
class _Scene:
    """Tracks in the plane at one grid point, in meters, with T steps."""

    truth: Array
    """true positions in the first run, (2, T)"""
    times: Array
    """times of the steps, (T,), s"""
    measured: Array
    """measured positions in the first run, (2, T - 1); (2, 0) if none are drawn"""
    estimates: dict[str, Array]
    """estimated positions by label, (2, T, runs)"""
    sensors: dict[str, Array]
    """paths of the sensors near the target, by number, (2, T)"""
    has_many_sensors: bool
    """whether sensors need their number, although only those near the target are drawn"""
    landmarks: dict[str, Array]
    """places of the landmarks near the target, by name or number, (2,)"""
    poses: dict[str, "_Poses"]
    """positions and headings by the label of a panel, empty for the panel of the best filters"""


class _Poses(NamedTuple):
    """Path whose headings are drawn as arrows."""

    path: Array
    """positions, (2, T)"""
    headings: Array
    """heading from x to y, rad, (T,)"""
    name: str = "Heading"
    """name in the legend"""

    @property
    def known_steps(self) -> Index:
        """Indices of the steps at which both position and heading are known."""
        return np.flatnonzero(np.isfinite(self.path).all(axis=0) & np.isfinite(self.headings))


def _draw_best(
    ax: Axes, results: Results, estimates: Mapping[str, Array], meters_per_unit: float
) -> None:
    """Draw the first run's estimates of the best filters, the best on top.

    ``estimates`` (2, T, runs) are by label, the best first. A solid line that would hide an equal line
    is drawn below all others. ``meters_per_unit`` is the length of a unit of the axes.
    """
    looks = results.line_styles(list(estimates))
    for rank, (label, estimate) in enumerate(estimates.items()):
        look = looks[label]
        # Every estimate equals itself: more than one equal estimate means another one.
        equal = [np.allclose(estimate, other, equal_nan=True) for other in estimates.values()]
        depth = rank
        if sum(equal) > 1 and look["linestyle"] == "-":
            depth = len(estimates)
        x, y = estimate[..., 0] / meters_per_unit
        # A line without a zorder, such as the truth's, has 2.
        ax.plot(x, y, label=label, **look, zorder=1.9 - 0.1 * depth)


def plane_unit(*tracks: Array) -> tuple[float, str]:
    """Return meters per unit of the axes, and the unit's name, for tracks (2, T) in m: (1000, "km")."""
    points = _known_points(tracks)
    if not points.size:
        return length_unit(0.0)
    return length_unit(float(np.ptp(points, axis=1).max()))


def _known_points(tracks: Sequence[Array]) -> Array:
    """Return the points (2, n) of all tracks (2, T) whose two coordinates are known."""
    points = np.concatenate(tracks, axis=1)
    return points[:, np.isfinite(points).all(axis=0)]


def _is_near(path: Array, tracks: Sequence[Array]) -> bool:
    """Test whether a sensor's ``path`` (2, T) is so near that a picture still shows the ``tracks`` well.

    With the path, the picture may be at most `_FAR` times as large as without.
    """
    points = _known_points(tracks)
    if not points.size:
        return False
    with_path = np.concatenate([points, path], axis=1)
    extent = np.ptp(points, axis=1).max()
    return bool(np.ptp(with_path, axis=1).max() <= _FAR * extent)


def draw_sensor(ax: Axes, path: Array, name: str) -> None:
    """Draw a triangle where a sensor begins, and its path (2, T); ``name`` is that of the legend."""
    x, y = path
    ax.plot(x, y, color=filter_colors.COLORS[1], linewidth=1.0)
    ax.plot(x[:1], y[:1], "^", color=filter_colors.COLORS[1], markersize=8, label=name)


def heading_rows(components: Sequence[str], angles: Collection[str]) -> list[int]:
    """Return a list of the index of the heading in a state; empty if the state has none.

    The heading is an angle with a usual name, such as ``heading`` or ``yaw``.
    """
    for name in _HEADINGS:
        if name in components and name in angles:
            return [list(components).index(name)]
    return []


def _draw_landmarks(ax: Axes, places: Mapping[str, Array], meters_per_unit: float) -> None:
    """Draw landmarks with their names; ``places`` (2,), m, are by name."""
    for name, place in places.items():
        x, y = place / meters_per_unit
        ax.margins(0.1)  # for the names beside the outermost landmarks
        ax.plot([x], [y], "s", color="#777777", markersize=5, label="Landmarks")
        ax.annotate(name, (x, y), (4, 4), textcoords="offset points", fontsize=7)


def _draw_headings(ax: Axes, poses: _Poses, meters_per_unit: float) -> None:
    """Draw headings as arrows at some points of their path."""
    known = poses.known_steps
    if not len(known):
        return
    path = poses.path / meters_per_unit
    length = _ARROW_LENGTH * np.ptp(path[:, known], axis=1).max()
    chosen = known[np.linspace(0, len(known) - 1, _ARROWS).astype(int)]
    for x, y, angle in zip(*path[:, chosen], poses.headings[chosen], strict=True):
        tip = (x + length * np.cos(angle), y + length * np.sin(angle))
        arrow = {
            "arrowstyle": "-|>",
            "color": "black",
            "linewidth": 0.8,
            "shrinkA": 0,
            "shrinkB": 0,
        }
        ax.annotate("", tip, (x, y), arrowprops=arrow)
    ax.plot([], [], color="black", marker=">", linewidth=0.8, markersize=4, label=poses.name)


def _fit_figure(panels: int, *tracks: Array) -> tuple[float, float]:
    """Return width and height, in, of a figure whose panels fit these tracks (2, T)."""
    points = _known_points(tracks)
    track_width = 1.0
    track_height = 1.0
    if points.size:
        track_width, track_height = np.ptp(points, axis=1)
    ticks_in = 0.8  # beside each panel
    room = sheet().width_in / panels - ticks_in
    # Height over width; a longer panel would have no room for its ticks.
    ratio = float(np.clip(track_height / max(track_width, 1e-9), 0.15, 10.0))
    highest_in = 4.0
    panel_width = min(room, highest_in / ratio)
    least_width_in = 3.4  # for the legend
    width = max(panels * (panel_width + ticks_in), least_width_in)
    title_and_legend_in = 1.3
    return width, panel_width * ratio + title_and_legend_in


def draw_truth(
    ax: Axes,
    path: Array,
    times: Array,
    turning: Iterable[Sequence[float]],
    estimated_runs: int,
) -> None:
    """Draw the true path, its start, and the spans in which it turns.

    The path is a broad light line below the estimates of one run, and a thin line above those of
    several. These would cover a shade, so that the spans are a thicker line there.

    Parameters
    ----------
    ax
        axes of the plane
    path
        true positions (2, T), in the unit of the axes, NaN where unknown. Without a known one nothing is
        drawn
    times
        times (T,) of the path in s
    turning
        first and last time in s of each span
    estimated_runs
        number of runs whose estimates are drawn
    """
    is_known = np.asarray(np.isfinite(path).all(axis=0))
    if not is_known.any():
        return
    x, y = path
    look = style.TRUTH
    if estimated_runs == 1:
        look = style.TRUTH_BELOW
    elif estimated_runs > 1:
        look = style.TRUTH | {"linewidth": 0.7}
    ax.plot(x, y, label="Truth", **look)
    # A known point between unknown ones makes no line, and is drawn as a dot.
    is_beside_known = np.zeros_like(is_known)
    is_beside_known[1:] |= is_known[:-1]
    is_beside_known[:-1] |= is_known[1:]
    is_alone = is_known & ~is_beside_known
    if is_alone.any():
        point_look = look | {"linestyle": "", "marker": ".", "markersize": 2.0}
        ax.plot(x[is_alone], y[is_alone], **point_look)
    maneuver_look: LineStyle = {"color": style.MANEUVER, "linewidth": 6, "zorder": 0.5}
    if estimated_runs > 1:
        maneuver_look = style.TRUTH | {"linewidth": 2.4}
    for start, end in turning:
        during = (times >= start) & (times <= end)
        ax.plot(x[during], y[during], label="Maneuvers", **maneuver_look)
    first_known = np.flatnonzero(is_known)[0]
    ax.plot(x[first_known], y[first_known], "o", color="black", markersize=4, label="Start")
