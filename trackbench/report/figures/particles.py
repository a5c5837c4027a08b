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
from trackbench.report.findings import phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results

_LARGEST = 120.0
_AREA = 8.0
"""Area in points^2 of a particle of mean weight, and of the largest."""


@register("figures", "particles")
@dataclass(frozen=True, kw_only=True)
class ParticlesOfOneRun(FigureKind):
    """The particles of one run over a few steps: a dot's area is its weight, a line leads to its parent.

    One panel per filter. A parent is the particle of the step before that a particle was resampled from;
    filters that do not tell it have no lines.
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
        of_run = points[0].scenario.steps
        if not of_run[0] <= first <= last <= of_run[-1]:
            return {"steps": f"{[first, last]} are no steps of {of_run[0]} to {of_run[-1]}"}
        trackers = points[0].filters
        labels = [*trackers] if self.filters is None else self.filters
        chosen = [trackers[label] for label in labels if label in trackers]
        # A filter whose entry has a mistake is None: its mistake is reported alone.
        if not any(tracker is None or tracker.particle_count > 1 for tracker in chosen):
            return {"" if self.filters is None else "filters": "no filter here has particles"}
        return {}

    @property
    def shown_particles(self) -> tuple[int, int]:
        """First and last step of which the particles must be kept."""
        return self.steps

    def draw(self, results: Results) -> Figure:
        """Return a panel per filter of the first grid point."""
        point = results.grid_points[0]
        tracks = results.tracks(point)
        labels = [b for b in results.chosen(self.filters) if f"particles/{b}" in tracks]
        figure, axes = style.panels(max(len(labels), 1), 1, 3.0, sharey=True)
        for (ax,), label in zip(axes, labels, strict=True) if labels else ():
            ax.set_title(style.wrap_label(label))
            self._panel(ax, tracks, label, results.line_style(label)["color"])
            ax.set_xlabel("Step k")
        component = results.facts(point).components[self.component - 1]
        label = phrases.in_unit(component, unit_of(f"rmse_{component}"))
        axes[0][0].set_ylabel(self.y_label or label)
        return style.finished(figure, self.title)

    def _panel(self, ax: Axes, tracks: dict[str, Array], label: str, color: str) -> None:
        (first, last), c, run = self.steps, self.component - 1, self.run - 1
        shown = (tracks["steps"] >= first) & (tracks["steps"] <= last)
        k = tracks["steps"][shown]
        # The file may have more steps, of other figures.
        places = np.searchsorted(tracks["particle_steps"], k)
        clouds = tracks[f"particles/{label}"][..., run][:, places]
        x, w, parents = clouds[c], clouds[-2], clouds[-1]
        for i in range(1, len(k)):
            # A line from each particle to its parent, where that is known.
            born = np.flatnonzero(np.isfinite(parents[i]))
            ends = np.stack([x[i - 1][parents[i][born].astype(int)], x[i][born]])
            ax.plot(k[[i - 1, i]], ends, color="#999999", linewidth=0.3, zorder=1, rasterized=True)
        count = np.isfinite(w).sum(axis=1, keepdims=True)
        area = np.minimum(_AREA * count * w, _LARGEST)
        ax.scatter(np.broadcast_to(k[:, None], x.shape), x, area, color=color, alpha=0.5,
                   linewidths=0.0, zorder=2, rasterized=True)  # fmt: skip
        ax.scatter([], [], _AREA, color=style.ANY, label="Particles, area by weight")
        if np.isfinite(parents).any():
            ax.plot([], [], color="#999999", linewidth=0.6, label="To the parent")
        ax.plot(k, tracks["truth"][c, shown, run], label="Truth", zorder=3, **style.TRUTH)
