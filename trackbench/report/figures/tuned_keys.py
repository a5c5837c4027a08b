"""Figure kind `tuning`: the objective over each key that was tuned."""

from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar

from trackbench.config.tuning import Axis
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results
from trackbench.report.tables.tuning import words_of
from trackbench.tuning.search import Record

_ABROAD = 3.0  # of the best half's spread: trials further up are off the page
_BARS = 4.0  # standard errors of the best that the page shows at least


@register("figures", "tuning")
@dataclass(frozen=True, kw_only=True)
class TuningFigure(FigureKind):
    """Every trial of a filter over each of its keys; the best, and what is within its standard error.

    Trials in which runs were lost are crosses. Triangles are far above the page.
    """

    label_keys: ClassVar[tuple[str, ...]] = ("filter",)

    filter: str
    """label of the filter that is tuned"""

    def draw(self, results: Results) -> Figure:
        """Return a panel per key."""
        record = results.tuning.get(self.filter)
        axes = record.axes if record is not None else ()
        figure, panels = style.panel_grid(len(axes), 2.4, 0.5)
        for ax, axis in zip(panels, axes, strict=False):
            _panel(ax, results.tuning[self.filter], axis)
        figure.supylabel(words_of(results.config["tuning"]["metric"]))
        style.set_title(figure, self.title or style.wrap_label(self.filter, 80))
        return figure


def _panel(ax: Axes, record: Record, axis: Axis) -> None:
    def x(value: object) -> float:
        return float(axis.choices.index(value) if axis.choices else value)  # type: ignore[arg-type]

    best, near = record.best, record.within(axis)
    trials = [t for t in record.trials if isfinite(t.objective)]
    top, band = _top([t.objective for t in trials], best.stderr), style.COLORS[4]
    ax.axhspan(best.objective, best.objective + best.stderr, color=band, alpha=0.35, linewidth=0)
    if near and not axis.choices:
        ax.axvspan(x(near[0]), x(near[-1]), color=band, alpha=0.2, linewidth=0)
    line = sorted((x(t.values[axis.key]), min(t.objective, top)) for t in record.beside(axis))
    if not axis.choices:
        ax.plot(*zip(*line, strict=True), color=style.COLORS[0], linewidth=0.6, alpha=0.6)
    for t in trials:
        marker = "^" if t.objective > top else "x" if t.lost else "o"
        height = min(t.objective, top)
        ax.plot(x(t.values[axis.key]), height, marker, color=style.COLORS[0], markersize=3.5)
    if isfinite(best.objective):
        look: Any = {"fmt": "D", "color": style.COLORS[1], "capsize": 2, "zorder": 4}
        ax.errorbar(x(best.values[axis.key]), best.objective, best.stderr, **look)
    if axis.log:
        ax.set_xscale("log")
    if axis.choices:
        ax.set_xticks(range(len(axis.choices)), [phrases.number(c) for c in axis.choices])
    else:
        ax.set_xlim(axis.low, axis.high)
        ax.margins(y=0.08)
    ax.set_xlabel(style.wrap_label(axis.key, 40))


def _top(objectives: list[float], stderr: float) -> float:
    """Limit the axis so that trials near the best stay distinguishable."""
    ranked = sorted(objectives)
    if not ranked:
        return 0.0
    middle = ranked[len(ranked) // 2]
    near = max(middle + _ABROAD * (middle - ranked[0]), ranked[0] + _BARS * stderr)
    return min(ranked[-1], near)
