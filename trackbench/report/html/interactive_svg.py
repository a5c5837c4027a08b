"""Metadata for the page's script: where a figure's axes are, and which shapes belong to which filter."""

import json
import re
from collections.abc import Iterator
from html import escape
from itertools import count
from typing import Any

import numpy as np

from trackbench.report.plotting.artist_types import Artist, Axes, Figure

_POINTS = 72.0  # to the inch, which is the unit of an SVG of matplotlib
_FEW = 600
"""Lines of no more points are written with all of them, so that each can be read off."""
_CURVE = 3  # points that make a line more than a mark of one value
_SCALES = ("linear", "log")
_MARK = re.compile(r'id="(of|key|axes)-(\d+)(?:-\d+)?"')
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)


def mark(figure: Figure) -> list[str]:
    """Give the shapes of each labelled curve its number; returns the labels, none of a figure without.

    A shape of a curve without a line in the legend, such as its band, has its label behind a ``_``.
    """
    panels = _panels(figure)
    labels = list(dict.fromkeys(label for ax in panels for label in _curves(ax)))
    serial = count()
    for i, ax in enumerate(panels):
        ax.set_gid(f"axes-{i}")
        for artist, label in _shapes(ax):
            if label in labels:
                artist.set_gid(f"of-{labels.index(label)}-{next(serial)}")
        for line in ax.lines:
            if np.size(line.get_xdata()) <= _FEW:
                line.get_path().should_simplify = False
    for legend in figure.legends:
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            label = text.get_text().replace("\n", " ").replace(r"\$", "$")
            if label in labels:
                for part in filter(None, (handle, text)):
                    part.set_gid(f"key-{labels.index(label)}-{next(serial)}")
    return labels


def marked(content: str, figure: Figure, labels: list[str]) -> str:
    """Return the SVG of a figure that `mark` saw, with what was marked as data attributes."""
    content = _METADATA.sub("", content, count=1)
    if not labels:
        return content
    told = json.dumps(
        {"labels": labels, "axes": [_axes_metadata(figure, ax, labels) for ax in _panels(figure)]},
        ensure_ascii=False,
    )
    content = _MARK.sub(r'data-\1="\2"', content)
    quoted = escape(told, quote=False).replace('"', "&quot;")
    return content.replace("<svg ", f'<svg data-live="{quoted}" ', 1)


def _panels(figure: Figure) -> list[Axes]:
    """Return the axes with curves over numbers."""
    return [
        ax
        for ax in figure.axes
        if ax.axison and {ax.get_xscale(), ax.get_yscale()} <= set(_SCALES) and any(_curves(ax))
    ]


def _curves(ax: Axes) -> Iterator[str]:
    for line in ax.lines:
        label = str(line.get_label())
        if not label.startswith("_") and np.size(line.get_xdata()) >= _CURVE:
            yield label


def _shapes(ax: Axes) -> Iterator[tuple[Artist, str]]:
    for container in ax.containers:
        for part in container.get_children():
            yield part, str(container.get_label()).removeprefix("_")
    for artist in (*ax.lines, *ax.collections):
        yield artist, str(artist.get_label()).removeprefix("_")


def _is_called_zero(ax: Axes, tick: float) -> bool:
    """Return whether a logarithmic axis labels this place as zero."""
    return ax.xaxis.get_major_formatter()(tick, None) == "0"


def _axes_metadata(figure: Figure, ax: Axes, labels: list[str]) -> dict[str, Any]:
    """Return an axes' box in SVG points, limits, scales, shared axes, and error shapes."""
    width, height = figure.get_size_inches() * _POINTS
    box = ax.get_position()
    corners = (box.x0 * width, (1 - box.y1) * height, box.x1 * width, (1 - box.y0) * height)
    every = figure.axes
    told: dict[str, Any] = {"box": [round(float(x), 2) for x in corners]}
    for name, ends, scale, alike in (
        ("x", ax.get_xlim(), ax.get_xscale(), ax.get_shared_x_axes()),
        ("y", ax.get_ylim(), ax.get_yscale(), ax.get_shared_y_axes()),
    ):
        first = min(every.index(other) for other in (ax, *alike.get_siblings(ax)))
        axis = [float(f"{end:.9g}") for end in ends]
        told[name] = {"ends": axis, "log": scale == "log", "group": f"{name}{first}"}
    zeros = [float(t) for t in ax.get_xticks() if told["x"]["log"] and _is_called_zero(ax, t)]
    if zeros:
        told["x"]["zero"] = zeros[0]
    told["equal"] = ax.get_aspect() != "auto"
    told["errors"] = dict(_errors(figure, ax, labels))
    return told


def _errors(figure: Figure, ax: Axes, labels: list[str]) -> Iterator[tuple[int, list[list[float]]]]:
    """Yield abscissas and standard errors there of the curves, by number, as far as they are known."""
    from trackbench.report.plotting.canvas import Canvas

    known = figure.errors if isinstance(figure, Canvas) else {}
    for (where, label), (x, stderr) in known.items():
        if where is ax and label in labels:
            there = np.isfinite(stderr) & (stderr > 0)
            columns = ((x, "{:.9g}"), (stderr, "{:.2g}"))
            yield (
                labels.index(label),
                [[float(form.format(v)) for v in c[there]] for c, form in columns],
            )
