"""The files of a sweep: sweep.csv, and a figure per metric: lines over one path, heat maps over two."""

from collections.abc import Iterable
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.experiment.files import made, write_bytes
from trackbench.report import style
from trackbench.report.results import Results
from trackbench.report.sweep import Best, Sweep, best_points, write_sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_TEXT = 8  # values along an axis up to which a heat map says its numbers


def render_sweep(results: Results, formats: Iterable[str]) -> list[Best]:
    """Write ``sweep.csv`` and ``figures/sweep-<metric>``; returns each filter's best point."""
    sweep, figures = Sweep(results), made(results.folder / "figures")
    write_sweep(sweep)
    forms = style.forms(formats)
    for metric in sweep.metrics if forms else ():
        with style.house():
            figure = _drawn(sweep, metric)
            if figure is None:
                continue
            for form in forms:
                path = figures / f"{file_name(metric)}.{form}"
                write_bytes(path, style.content(figure, form))
        style.close(figure)
    return list(best_points(sweep))


def _drawn(sweep: Sweep, metric: str) -> "Figure | None":
    """The metric over one or two swept paths; None for more, or if no filter has a number."""
    if len(sweep.paths) == 1:
        return _lines(sweep, metric)
    return _heat_maps(sweep, metric) if len(sweep.paths) == 2 else None


def _lines(sweep: Sweep, metric: str) -> "Figure | None":
    (path,) = sweep.paths
    values = sweep.axis(path)
    numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    figure, ax = style.subplots()
    drawn = False
    for label in sweep.results.labels:
        scores = [s for s in sweep.scores(label, metric) if np.isfinite(s.value)]
        if not scores:
            continue
        x = [s.point[0] if numeric else values.index(s.point[0]) for s in scores]
        y, stderr = (np.array([getattr(s, a) for s in scores]) for a in ("value", "stderr"))
        bars = np.where(np.isfinite(stderr), 2 * stderr, 0.0)
        look = sweep.results.look(label)
        ax.plot(x, y, label=label, marker="o", markersize=3, **look)
        ax.errorbar(x, y, bars, fmt="none", color=look["color"], capsize=2, label=f"_{label}")
        drawn = True
    if not drawn:
        style.close(figure)
        return None
    ax.set_xlabel(style.axis(path))
    ax.set_ylabel(metric)
    _scale(ax, values, numeric)
    style.legend_outside(figure, ax)
    return figure


def _scale(ax: "Axes", values: list[Any], numeric: bool) -> None:
    if not numeric:
        ax.set_xticks(range(len(values)), [str(v) for v in values])
    elif min(values) > 0 and max(values) >= 50 * min(values):
        ax.set_xscale("log")


def _heat_maps(sweep: Sweep, metric: str) -> "Figure | None":
    """A panel per filter that varies, on one colour scale; the smallest value is framed."""
    across, down = (sweep.axis(path) for path in sweep.paths)
    fields = {label: _field(sweep, label, metric) for label in sweep.varying}
    fields = {label: field for label, field in fields.items() if np.isfinite(field).any()}
    if not fields:
        return None
    columns = min(3, len(fields))
    rows = ceil(len(fields) / columns)
    figure, axes = style.subplots(rows, columns, height_in=0.6 + 2.6 * rows, squeeze=False)
    finite = np.concatenate([f[np.isfinite(f)] for f in fields.values()])
    for ax, (label, field) in zip(axes.flat, fields.items(), strict=False):
        image = ax.imshow(
            field, origin="lower", aspect="auto", vmin=finite.min(), vmax=finite.max()
        )
        ax.set_xticks(range(len(across)), [style.number(v) for v in across])
        ax.set_yticks(range(len(down)), [style.number(v) for v in down])
        ax.set_title(label)
        ax.grid(visible=False)
        _write_values(ax, field, finite, few=columns == 1)
        _frame_smallest(ax, field)
    for ax in axes.flat[len(fields) :]:
        ax.set_axis_off()
    figure.supxlabel(style.axis(sweep.paths[0]))
    figure.supylabel(style.axis(sweep.paths[1]))
    figure.colorbar(image, ax=axes, label=metric)
    return figure


def _field(sweep: Sweep, label: str, metric: str) -> Array:
    """The metric (values of the second path, values of the first), NaN where there is none."""
    across, down = (sweep.axis(path) for path in sweep.paths)
    field = np.full((len(down), len(across)), np.nan)
    for score in sweep.scores(label, metric):
        field[down.index(score.point[1]), across.index(score.point[0])] = score.value
    return np.where(np.isfinite(field), field, np.nan)


def _write_values(ax: "Axes", field: Array, finite: Array, few: bool) -> None:
    if max(field.shape) > (_MOST_TEXT if few else _MOST_TEXT // 2):
        return
    middle = 0.5 * (finite.min() + finite.max())
    for (i, j), value in np.ndenumerate(field):
        if np.isfinite(value):
            colour = "black" if value > middle else "white"
            ax.text(j, i, f"{value:.3g}", ha="center", va="center", color=colour, fontsize=8)


def _frame_smallest(ax: "Axes", field: Array) -> None:
    from matplotlib.patches import Rectangle

    i, j = np.unravel_index(int(np.nanargmin(field)), field.shape)
    frame = Rectangle(
        (j - 0.5, i - 0.5), 1, 1, fill=False, edgecolor=style.COLOURS[1], linewidth=2, zorder=5
    )
    frame.set_clip_on(False)
    ax.add_patch(frame)


def file_name(metric: str) -> str:
    """``rms(rmse[k<=30])`` as ``sweep-rms-rmse-k-to-30``: a name that every system takes."""
    words = metric.replace("<=", " to ").replace("<", " below ").replace(">", " above ")
    words = "-".join("".join(c if c.isalnum() or c == "_" else " " for c in words).split())
    return f"sweep-{words}"
