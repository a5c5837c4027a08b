"""Figure kind `particles`: the particles of one run over a few steps, with weights and ancestry."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.field_types import Count, Natural
from trackbench.metrics import unit_of
from trackbench.registry import register
from trackbench.report.figures import captions
from trackbench.report.findings import phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results

_AREA = 8.0
"""Area in points^2 of a particle of mean weight."""
_LARGEST = 120.0
"""Area in points^2 of the largest particle."""


@register("figures", "particles")
@dataclass(frozen=True, kw_only=True)
class ParticlesOfOneRun(FigureKind):
    """The particles of one run over a few steps: a dot's area is its weight, a line leads to its parent.

    One panel per filter. A parent is the particle of the step before that a particle was resampled from;
    filters without this information have no lines.
    """

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all with particles"""
    run: Count = 1
    """number of the run, from 1"""
    component: Count = 1
    """number of the state's component, from 1"""
    steps: tuple[Natural, Natural] = (0, 5)
    """first and last step"""
    y_label: str = ""
    """label of the vertical axis, with its unit; default: the component"""
    numbers: ClassVar[tuple[str, ...]] = ("run", "component")

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject steps that are not in the run, and filters without particles."""
        first, last = self.steps
        run_steps = points[0].scenario.steps
        if not run_steps[0] <= first <= last <= run_steps[-1]:
            problem = f"{[first, last]} are no steps of {run_steps[0]} to {run_steps[-1]}"
            return {"steps": problem}
        filters = points[0].filters
        labels = list(filters) if self.filters is None else self.filters
        chosen = [filters[label] for label in labels if label in filters]
        # A filter whose entry has a mistake is None: its mistake is reported alone.
        if any(entry is None or entry.particle_count > 1 for entry in chosen):
            return {}
        key = "" if self.filters is None else "filters"
        return {key: "no filter here has particles"}

    @property
    def shown_particles(self) -> tuple[int, int]:
        """First and last step of which the particles must be kept."""
        return self.steps

    def default_caption(self, results: Results) -> str:
        """Return component, filters, run and steps."""
        first, last = self.steps
        tracks = results.tracks(results.grid_points[0])
        labels = [b for b in results.chosen(self.filters) if f"particles/{b}" in tracks]
        component = results.facts(results.grid_points[0]).components[self.component - 1]
        words = f"particles of {captions.filters(labels)} for {component} in run {self.run}"
        caption = captions.sentence(f"{words}, steps {first} to {last}")
        return f"{caption} The area of a dot is its weight; a line leads to the particle's parent."

    def draw(self, results: Results) -> Figure:
        """Return a panel per filter of the first grid point."""
        point = results.grid_points[0]
        tracks = results.tracks(point)
        labels = [b for b in results.chosen(self.filters) if f"particles/{b}" in tracks]
        figure, axes = style.make_panels(max(len(labels), 1), 1, 3.0, sharey=True)
        looks = results.line_styles(labels)
        if labels:
            for (ax,), label in zip(axes, labels, strict=True):
                ax.set_title(style.wrap_label(label))
                self._draw_panel(ax, tracks, label, looks[label]["color"])
                ax.set_xlabel("Step k")
        component = results.facts(point).components[self.component - 1]
        y_label = phrases.in_unit(component, unit_of(f"rmse_{component}"))
        axes[0][0].set_ylabel(self.y_label or y_label)
        return style.add_title_and_legend(figure, self.title)

    def _draw_panel(self, ax: Axes, tracks: dict[str, Array], label: str, color: str) -> None:
        first, last = self.steps
        shown = (tracks["steps"] >= first) & (tracks["steps"] <= last)
        steps = tracks["steps"][shown]
        particles = _read_particles(tracks, label, steps, self.component - 1, self.run - 1)
        _draw_ancestry(ax, steps, particles)
        _draw_particles(ax, steps, particles, color)
        if np.isfinite(particles.parents).any():
            ax.plot([], [], color="#999999", linewidth=0.6, label="To the parent")
        truth = tracks["truth"][self.component - 1, shown, self.run - 1]
        ax.plot(steps, truth, label="Truth", zorder=3, **style.TRUTH)


@dataclass(frozen=True, kw_only=True)
class _Particles:
    """One component of a filter's N particles in one run, at K steps; NaN for a missing particle."""

    positions: Array
    """values of the component, (K, N)"""
    weights: Array
    """(K, N), with sum 1 at each step"""
    parents: Array
    """numbers of the particles at the step before, from 0, (K, N); NaN where the parent is unknown"""


def _read_particles(
    tracks: dict[str, Array], label: str, steps: Array, component: int, run: int
) -> _Particles:
    """Read a filter's particles from the tracks of a grid point, at the steps (K,).

    ``component`` and ``run`` count from 0.
    """
    # Rows are the components of the state, then weights, then parents: (n + 2, K, N, runs).
    rows = tracks[f"particles/{label}"][..., run]
    # The file may have more steps, for other figures.
    places = np.searchsorted(tracks["particle_steps"], steps)
    rows = rows[:, places]
    return _Particles(positions=rows[component], weights=rows[-2], parents=rows[-1])


def _draw_ancestry(ax: Axes, steps: Array, particles: _Particles) -> None:
    """Draw a line from each particle to its parent, where that is known."""
    positions = particles.positions
    for i in range(1, len(steps)):
        children = np.flatnonzero(np.isfinite(particles.parents[i]))
        parents = particles.parents[i][children].astype(int)
        ends = np.stack([positions[i - 1][parents], positions[i][children]])
        ax.plot(steps[[i - 1, i]], ends, color="#999999", linewidth=0.3, zorder=1, rasterized=True)


def _draw_particles(ax: Axes, steps: Array, particles: _Particles, color: str) -> None:
    """Draw each particle as a dot whose area is proportional to its weight."""
    count = np.isfinite(particles.weights).sum(axis=1, keepdims=True)
    area = np.minimum(_AREA * count * particles.weights, _LARGEST)
    ax.scatter(
        np.broadcast_to(steps[:, None], particles.positions.shape),
        particles.positions,
        area,
        color=color,
        alpha=0.5,
        linewidths=0.0,
        zorder=2,
        rasterized=True,
    )
    ax.scatter([], [], _AREA, color=style.ANY, label="Particles, area by weight")
