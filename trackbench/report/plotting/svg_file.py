"""SVG file of a figure: paths in few bytes, and the values of its curves for the page.

The values are what matplotlib was given, as JSON in the attribute ``data-live``: wherever the file goes,
through the figure cache too, they are in it.
"""

import json
import re
from collections.abc import Iterator
from html import escape
from itertools import chain, count
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from trackbench.core.arrays import Array

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_POINTS = 72.0  # to the inch, which is the unit of an SVG of matplotlib
_MOST = 600
"""Points of a curve: of a longer one every second, third, ... is stored, and its path is simplified."""
_CURVE = 3  # points that make a line more than a mark of one value
_DIGITS = 7  # of a value, as many as a results file has at most
_SCALES = ("linear", "log")
_PATH = re.compile(r' d="([MLZz0-9eE.\s+-]+)"')
_POINT = re.compile(r"([MLZz])([^MLZz]*)")
_CLIP = re.compile(r'(id="|url\(#)(p[0-9a-f]{10})\b')
_MARK = re.compile(r'id="(of|key|axes)-(\d+)(?:-\d+)?"')
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_STDERRS: "WeakKeyDictionary[Axes, dict[str, Array]]" = WeakKeyDictionary()


def compact(content: str) -> str:
    """Return the SVG in half the bytes: straight lines relative, rounded to hundredths of a point.

    Clip paths are numbered, so that the file is equal on every machine: matplotlib names them by
    unrounded positions, whose last digits depend on the processor.
    """
    clips = dict.fromkeys(name for _, name in _CLIP.findall(content))
    numbers = {name: f"clip{i}" for i, name in enumerate(clips, start=1)}
    content = _CLIP.sub(lambda match: match[1] + numbers[match[2]], content)
    return _PATH.sub(lambda path: f' d="{_relative(path.group(1))}"', content)


def _relative(path: str) -> str:
    out, at, start = [], (0, 0), (0, 0)
    for command, numbers in _POINT.findall(path):
        if command in "Zz":
            out.append("z")
            at = start
            continue
        x, y = (round(100.0 * float(number)) for number in numbers.split())
        if command == "M":
            start = (x, y)
            out.append(f"M{_hundredths(x)} {_hundredths(y)}")
        else:
            out.append(f"l{_hundredths(x - at[0])} {_hundredths(y - at[1])}")
        at = (x, y)
    return "".join(out).replace(" -", "-")


def _hundredths(number: int) -> str:
    text = f"{number / 100:.2f}".rstrip("0").rstrip(".")
    return text.replace("0.", ".", 1) if abs(number) < 100 and number else text


def set_stderr(ax: "Axes", label: str, stderr: Array) -> None:
    """Store the standard errors (n,) of the curve with this label and n points."""
    _STDERRS.setdefault(ax, {})[label] = stderr


def mark(figure: "Figure") -> list[str]:
    """Give the shapes of each labeled curve its number; returns the labels, none of a figure without.

    A shape of a curve without a line in the legend, such as its band, has its label behind a ``_``.
    """
    panels = _panels(figure)
    labels = list(dict(chain.from_iterable(map(_curves, panels))))
    serial = count()
    for i, ax in enumerate(panels):
        ax.set_gid(f"axes-{i}")
        for artist, label in _shapes(ax):
            if label in labels:
                artist.set_gid(f"of-{labels.index(label)}-{next(serial)}")
        for line in ax.lines:
            if np.size(line.get_xdata()) <= _MOST:
                line.get_path().should_simplify = False
    for legend in figure.legends:
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            label = text.get_text().replace("\n", " ").replace(r"\$", "$")
            if label in labels:
                for part in filter(None, (handle, text)):
                    part.set_gid(f"key-{labels.index(label)}-{next(serial)}")
    return labels


def marked(content: str, figure: "Figure", labels: list[str]) -> str:
    """Return the SVG of a figure that `mark` numbered, with numbers and values as data attributes."""
    content = _METADATA.sub("", content, count=1)
    if not labels:
        return content
    values = {"labels": labels, "axes": [_panel(figure, ax, labels) for ax in _panels(figure)]}
    text = json.dumps(values, ensure_ascii=False, separators=(",", ":"))
    content = _MARK.sub(r'data-\1="\2"', content)
    quoted = escape(text, quote=False).replace('"', "&quot;")
    return content.replace("<svg ", f'<svg data-live="{quoted}" ', 1)


def _panels(figure: "Figure") -> "list[Axes]":
    """Find the axes with curves over numbers."""
    visible = [ax for ax in figure.axes if ax.axison and any(_curves(ax))]
    return [ax for ax in visible if {ax.get_xscale(), ax.get_yscale()} <= set(_SCALES)]


def _curves(ax: "Axes") -> "Iterator[tuple[str, Line2D]]":
    """Yield lines of several values with their labels; a line with error bars has its container's."""
    lines: list[tuple[Any, Any]] = [(line, line) for line in ax.lines]
    bars: list[Any] = [b for b in ax.containers if hasattr(b, "has_yerr")]
    for artist, line in lines + [(bar, bar.lines[0]) for bar in bars if bar.lines[0]]:
        label = str(artist.get_label())
        in_data = all(line.get_transform().contains_branch_seperately(ax.transData))
        if in_data and not label.startswith("_") and np.size(line.get_xdata()) >= _CURVE:
            yield label, line


def _shapes(ax: "Axes") -> "Iterator[tuple[Artist, str]]":
    for container in ax.containers:
        for part in container.get_children():
            yield part, str(container.get_label()).removeprefix("_")
    for artist in (*ax.lines, *ax.collections):
        yield artist, str(artist.get_label()).removeprefix("_")


def _panel(figure: "Figure", ax: "Axes", labels: list[str]) -> dict[str, Any]:
    """Describe an axes: its box in SVG points, its two axes, and its curves."""
    width, height = figure.get_size_inches() * _POINTS
    box = ax.get_position()
    corners = (box.x0 * width, (1 - box.y1) * height, box.x1 * width, (1 - box.y0) * height)
    panel: dict[str, Any] = {"box": [round(float(x), 2) for x in corners]}
    shared = {"x": ax.get_shared_x_axes(), "y": ax.get_shared_y_axes()}
    for (name, alike), axis in zip(shared.items(), (ax.xaxis, ax.yaxis), strict=True):
        first = min(figure.axes.index(other) for other in (ax, *alike.get_siblings(ax)))
        ends = [float(f"{end:.9g}") for end in axis.get_view_interval()]
        panel[name] = {"ends": ends, "log": axis.get_scale() == "log", "group": f"{name}{first}"}
    # A logarithmic axis may have a tick for zero, left of its least value.
    ticks = ax.get_xticks() if panel["x"]["log"] else ()
    zeros = [tick for tick in ticks if ax.xaxis.get_major_formatter()(tick, None) == "0"]
    if zeros:
        panel["x"]["zero"] = _rounded(zeros)[0]
    panel["equal"] = ax.get_aspect() != "auto"
    panel["curves"] = list(_values(ax, labels))
    return panel


def _values(ax: "Axes", labels: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the curves' numbers, colors and values; one with the abscissas of the last has no others."""
    from matplotlib.colors import to_hex

    last: list[float] = []
    for label, line in _curves(ax):
        if line.get_rasterized():
            continue
        x, y = (np.asarray(values, dtype=float) for values in line.get_data(orig=False))
        places = np.arange(0, len(x), -(-len(x) // _MOST))
        stored = places[np.isfinite(x[places]) & np.isfinite(y[places])]
        abscissas = _rounded(x[stored])
        curve: dict[str, Any] = {"of": labels.index(label), "color": to_hex(line.get_color())}
        if abscissas != last:
            curve["x"] = last = abscissas
        curve["y"] = _rounded(y[stored])
        stderr = _STDERRS.get(ax, {}).get(label, np.empty(0))
        if len(stderr) == len(x):
            curve["stderr"] = [e if e > 0.0 else None for e in _rounded(stderr[stored])]
        yield curve


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]
