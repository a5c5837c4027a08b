"""Values of the curves in the SVG file of a figure, which the page shows where the mouse is.

The values are what matplotlib was given, as JSON in the attribute ``data-live``: wherever the file goes,
through the figure cache too, they are in it.
"""

import json
import re
from collections.abc import Iterator
from html import escape
from itertools import count
from math import ceil
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.time_axis import start_of_times

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


_POINTS_PER_IN = 72.0
"""Units of matplotlib's SVG in an inch."""
_MOST_POINTS = 600
"""Points of a curve: of a longer one every second, third, ... is stored, and its path is simplified."""
_LEAST_POINTS = 3
"""Points of a line from which on it is a curve, and no mark of one value."""
_DIGITS = 7
"""Digits of a stored value, as many as a results file has at most."""
_SCALES = ("linear", "log")
"""Scales of axes on which the page can convert between pixels and values."""
_GID = re.compile(r'id="(of|key|axes)-(\d+)(?:-\d+)?"')
"""An id that `number_shapes` gave."""
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_SHAPE = "_shape of "
"""Beginning of the label of a shape of a curve; the legend leaves out what begins with ``_``."""
_STDERRS: "WeakKeyDictionary[Axes, dict[str, Array]]" = WeakKeyDictionary()
"""Standard errors of the curves of each axes, by label."""


def label_of_shape(label: str) -> str:
    """Return the label of a shape that belongs to the curve ``label``, such as its band.

    The legend leaves it out. No curve and no other shape has such a label: matplotlib labels a shape
    like ``_child0``.
    """
    return f"{_SHAPE}{label}"


def set_stderr(ax: "Axes", label: str, stderr: Array) -> None:
    """Store the standard errors (n,) of the curve with this label and n points."""
    _STDERRS.setdefault(ax, {})[label] = stderr


def number_shapes(figure: "Figure") -> list[str]:
    """Give the shapes of each curve the number of its label.

    The number of a label is its index in the list of labels. It stands in the shapes' ids: ``of-2-17``
    is a shape of the curve with label 2, ``key-2-18`` its entry in the legend, and ``axes-0`` an axes. A
    shape that the legend leaves out, such as a curve's band, has in matplotlib the label
    `label_of_shape`.

    Parameters
    ----------
    figure
        figure with everything drawn; its shapes get ids

    Returns
    -------
    list of str
        labels of all curves
    """
    panels = _panels_with_curves(figure)
    labels: list[str] = []
    for ax in panels:
        for label, _ in _curves(ax):
            if label not in labels:
                labels.append(label)
    serial_numbers = count()
    for index, ax in enumerate(panels):
        ax.set_gid(f"axes-{index}")
        for artist, label in _shapes(ax):
            if label in labels:
                artist.set_gid(f"of-{labels.index(label)}-{next(serial_numbers)}")
        # A curve of which all values are stored has all of them in its path, too.
        for line in ax.lines:
            if np.size(line.get_xdata()) <= _MOST_POINTS:
                line.get_path().should_simplify = False
    for legend in figure.legends:
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            # The legend has the label as `wrap_label` wrote it: in lines, with a backslash before "$".
            label = text.get_text().replace("\n", " ").replace(r"\$", "$")
            if label in labels:
                for part in (handle, text):
                    if part is not None:  # matplotlib has no handle for some artists
                        part.set_gid(f"key-{labels.index(label)}-{next(serial_numbers)}")
    return labels


def add_curve_data(content: str, figure: "Figure", labels: list[str]) -> str:
    """Return the SVG of a figure with what the interactive page reads of its curves.

    The root has the attribute ``data-live``: JSON of all labels and of the axes with curves, as
    `_panel_data` describes them. Each shape of a curve has the number of its label in ``data-of``.

    Parameters
    ----------
    content
        SVG, as matplotlib wrote it
    figure
        figure of the SVG
    labels
        labels that `number_shapes` returned for the figure; without any, no values are added

    Returns
    -------
    str
        SVG with the values, and without the metadata of matplotlib
    """
    content = _METADATA.sub("", content, count=1)  # matplotlib's version and the format
    if not labels:
        return content
    panels = [_panel_data(figure, ax, labels) for ax in _panels_with_curves(figure)]
    values = {"labels": labels, "axes": panels}
    text = json.dumps(values, ensure_ascii=False, separators=(",", ":"))
    # Such as id="of-2-17", set by `number_shapes`, to data-of="2".
    content = _GID.sub(r'data-\1="\2"', content)
    quoted = escape(text, quote=False).replace('"', "&quot;")
    return content.replace("<svg ", f'<svg data-live="{quoted}" ', 1)


def _panels_with_curves(figure: "Figure") -> "list[Axes]":
    """Return the visible axes that have a curve, and whose two scales are linear or logarithmic.

    The page cannot convert between pixels and values on any other scale.
    """
    panels = []
    for ax in figure.axes:
        has_readable_scales = ax.get_xscale() in _SCALES and ax.get_yscale() in _SCALES
        if ax.axison and has_readable_scales and any(_curves(ax)):
            panels.append(ax)
    return panels


def _curves(ax: "Axes") -> "Iterator[tuple[str, Line2D]]":
    """Yield the label and line of each curve: a line of three or more points that the legend has.

    A line with error bars has the label of the container that holds line and bars. A label that begins
    with ``_`` is not in the legend.
    """
    lines: list[tuple[Any, Any]] = [(line, line) for line in ax.lines]
    for container in ax.containers:
        if hasattr(container, "has_yerr"):  # a container of error bars
            data_line, _, _ = container.lines  # type: ignore[attr-defined]
            if data_line is not None:
                lines.append((container, data_line))
    for labeled_artist, line in lines:
        label = str(labeled_artist.get_label())
        # Both x and y are in units of the data, other than in a line by `axhline`.
        in_data = all(line.get_transform().contains_branch_seperately(ax.transData))
        has_points = np.size(line.get_xdata()) >= _LEAST_POINTS
        if in_data and has_points and not label.startswith("_"):
            yield label, line


def _shapes(ax: "Axes") -> "Iterator[tuple[Artist, str]]":
    """Yield all shapes that may belong to a curve, each with the curve's label.

    A shape that is not in the legend has the label `label_of_shape`. Any other label that begins with
    ``_`` is of no curve.
    """
    for container in ax.containers:
        label = str(container.get_label()).removeprefix(_SHAPE)
        for artist in container.get_children():
            yield artist, label
    for artist in (*ax.lines, *ax.collections):
        yield artist, str(artist.get_label()).removeprefix(_SHAPE)


def _panel_data(figure: "Figure", ax: "Axes", labels: list[str]) -> dict[str, Any]:
    """Describe an axes for the script of the page.

    ``box`` has its left, top, right and bottom in SVG points. ``x`` and ``y`` are `_axis_data`, and
    ``x.zero`` is the place of the tick "0" on a logarithmic axis. ``equal`` is True if a unit is equally
    long on both axes. ``curves`` are `_curve_data`. ``labels`` are those of all curves of the figure.
    """
    # The box is in shares of the figure, with y upwards; an SVG has y downwards.
    width, height = figure.get_size_inches() * _POINTS_PER_IN
    box = ax.get_position()
    left = box.x0 * width
    top = (1 - box.y1) * height
    right = box.x1 * width
    bottom = (1 - box.y0) * height
    panel: dict[str, Any] = {"box": [round(float(x), 2) for x in (left, top, right, bottom)]}
    panel["x"] = _axis_data(figure, ax, "x")
    panel["y"] = _axis_data(figure, ax, "y")
    # A logarithmic horizontal axis may have a tick for zero, left of its least positive value. A
    # vertical one has none: there triangles below the axis mark zeros.
    if panel["x"]["log"]:
        tick_label = ax.xaxis.get_major_formatter()
        zeros = [tick for tick in ax.get_xticks() if tick_label(tick, None) == "0"]
        if zeros:
            panel["x"]["zero"] = _rounded(zeros)[0]
    panel["equal"] = ax.get_aspect() != "auto"
    panel["curves"] = list(_curve_data(ax, labels))
    return panel


def _axis_data(figure: "Figure", ax: "Axes", name: str) -> dict[str, Any]:
    """Describe the axis ``name``, x or y: its ends, its scale, and the group of axes that share it.

    The page zooms the axes of a group together. A group has the name and the index of its first axes.
    """
    if name == "x":
        axis: Any = ax.xaxis
        sharing = ax.get_shared_x_axes()
    else:
        axis = ax.yaxis
        sharing = ax.get_shared_y_axes()
    # The page counts times as the labels of the ticks do.
    start = start_of_times(ax) if name == "x" else 0.0
    first_of_group = min(figure.axes.index(other) for other in (ax, *sharing.get_siblings(ax)))
    return {
        "ends": [float(f"{end - start:.9g}") for end in axis.get_view_interval()],
        "log": axis.get_scale() == "log",
        "group": f"{name}{first_of_group}",
    }


def _curve_data(ax: "Axes", labels: list[str]) -> Iterator[dict[str, Any]]:
    """Yield each curve of an axes: ``of``, ``color``, ``x``, ``y`` and, if known, ``stderr``.

    ``of`` is the index of its label in ``labels``, those of all curves of the figure. ``x`` is left out
    if it is that of the curve before. A standard error that is not positive is None.
    """
    from matplotlib.colors import to_hex

    last_abscissas: list[float] = []
    for label, line in _curves(ax):
        if line.get_rasterized():  # a picture in the SVG, without a path
            continue
        x, y = (np.asarray(values, dtype=float) for values in line.get_data(orig=False))
        # Of a long line every second, third, ... point.
        period = ceil(len(x) / _MOST_POINTS)
        indices = np.arange(0, len(x), period)
        stored = indices[np.isfinite(x[indices]) & np.isfinite(y[indices])]
        curve: dict[str, Any] = {"of": labels.index(label), "color": to_hex(line.get_color())}
        abscissas = _rounded(x[stored] - start_of_times(ax))
        if abscissas != last_abscissas:
            curve["x"] = abscissas
            last_abscissas = abscissas
        curve["y"] = _rounded(y[stored])
        # `set_stderr` has stored the standard errors of the curve's points; there are none of a curve
        # without bars or band. Another line with this label may have other points.
        stderr = _STDERRS.get(ax, {}).get(label, np.empty(0))
        if len(stderr) == len(x):
            curve["stderr"] = [error if error > 0.0 else None for error in _rounded(stderr[stored])]
        yield curve


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]
