"""SVG of a figure for a page: clean it, make its ids unique, add what a reader points at."""

import json
import re
from collections.abc import Iterator
from functools import cache
from html import escape
from itertools import count
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from xml.etree import ElementTree as ET

import numpy as np

from trackbench.errors import UserError

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_ELEMENTS = {
    f"{{{_SVG}}}{name}"
    for name in (
        *("svg", "title", "defs", "g", "a", "path", "use", "rect", "image", "text", "tspan"),
        *(
            "clipPath",
            "pattern",
            "linearGradient",
            "stop",
            "filter",
            "feColorMatrix",
            "feComposite",
        ),
    )
}
"""Elements that matplotlib draws with; any other element is dropped with all that is in it."""
_LOOKS = re.compile(
    "fill|fill-(opacity|rule)|stroke|stroke-[a-z]+|opacity|font|font-[a-z]+|text-anchor|clip-path"
    "|clip-rule|shape-rendering|image-rendering|stop-color|stop-opacity|filter"
)
"""Properties of a style, and attributes of the same names."""
_PLACES = {
    *(
        "x",
        "y",
        "x1",
        "y1",
        "x2",
        "y2",
        "width",
        "height",
        "viewBox",
        "version",
        "transform",
        "offset",
    ),
    *("preserveAspectRatio", "patternUnits", "gradientUnits", "gradientTransform", "dx", "dy"),
    *(
        "in",
        "in2",
        "operator",
        "result",
        "type",
        "values",
        "k1",
        "k2",
        "k3",
        "k4",
        "color-interpolation",
    ),
}
_FREE = {"d", "id", "data-live", "data-axes", "data-of", "data-key"}
"""Attributes of any content: the page's script and its style sheet run none of it."""
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_HARMLESS = re.compile(r"(?!.*url\()[-\w\s#.,;%'\"()+]*", re.IGNORECASE | re.DOTALL)
_PATH = re.compile(r' d="([MLZz0-9eE.\s+-]+)"')
_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?")
_POINT = re.compile(r"([MLZz])([^MLZz]*)")
_CLIP = re.compile(r'(id="|url\(#)(p[0-9a-f]{10})\b')


def compact(content: str) -> str:
    """Return the SVG in half the bytes: straight lines relative, rounded to hundredths of a point.

    Clip paths are numbered, so that the file is equal on every machine: matplotlib names them by
    unrounded positions, whose last digits depend on the processor.
    """
    clips = dict.fromkeys(name for _, name in _CLIP.findall(content))
    numbers = {name: f"clip{i}" for i, name in enumerate(clips, start=1)}
    content = _CLIP.sub(lambda found: found[1] + numbers[found[2]], content)
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


def outline(d: str) -> Iterator[tuple[list[tuple[float, float]], bool]]:
    """Yield the points of each stroke of a `compact` path, and whether it is closed; none of curves."""
    if not re.fullmatch(r"[MlLz0-9e.\s+-]*", d):
        return
    x = y = 0.0
    for stroke in filter(None, d.split("M")):
        points = []
        for letter, numbers in re.findall(r"([lL]?)([^lLz]+)", stroke):
            a, b = map(float, _NUMBER.findall(numbers)[:2])
            x, y = (x + a, y + b) if letter == "l" else (a, b)
            points.append((x, y))
        yield points, "z" in stroke


def cleaned(content: bytes, name: str) -> ET.Element:
    """Return the SVG with the elements and attributes that draw; raises UserError if it is none."""
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    try:
        root = ET.fromstring(content)
    except ET.ParseError as error:
        raise UserError(f"figures/{name}.svg: is not an SVG file: {error}") from None
    if root.tag != f"{{{_SVG}}}svg":
        raise UserError(f"figures/{name}.svg: is not an SVG file: it begins with {root.tag}")
    _clean(root)
    return root


def inline(content: bytes, name: str, title: str) -> str:
    """Return the SVG as an element; ids start with ``name``, ``title`` is for screen readers."""
    root = cleaned(content, name)
    for element in root.iter():
        for key, value in element.attrib.items():
            element.set(key, _renamed(key, value, name))
    width = root.attrib.pop("width", "")
    root.attrib.pop("height", None)
    # What matplotlib says in a style sheet, which would reach the whole page.
    look = "stroke-linejoin: round; stroke-linecap: butt"
    points = re.fullmatch(r"([0-9.]+)pt", width)
    if points:  # so that letters are of one size in narrow figures and in wide ones
        look += f"; --natural: {float(points.group(1)) / 9.7:.1f}rem"
    root.set("style", look)
    root.set("role", "img")
    root.set("aria-labelledby", f"{name}-title")
    label = ET.Element(f"{{{_SVG}}}title", {"id": f"{name}-title"})
    label.text = title
    root.insert(0, label)
    return ET.tostring(root, encoding="unicode")


def _clean(element: ET.Element) -> None:
    for key, value in list(element.attrib.items()):
        if key == "style":
            element.set(key, _style(value))
        elif not _may_stay(element.tag, key, value):
            del element.attrib[key]
    for child in list(element):
        if child.tag in _ELEMENTS:
            _clean(child)
        else:
            element.remove(child)


def _may_stay(tag: str, key: str, value: str) -> bool:
    if key in ("href", f"{{{_XLINK}}}href"):
        is_picture = tag == f"{{{_SVG}}}image" and value.startswith("data:image/png;base64,")
        return is_picture or value.startswith("#")
    known = key in _PLACES or _LOOKS.fullmatch(key) is not None
    return key in _FREE or (known and _is_harmless(value))


def _is_harmless(value: str) -> bool:
    """Return whether a value refers to nothing but ids of its own file."""
    return _HARMLESS.fullmatch(_REFERENCE.sub("", value)) is not None


@cache
def _style(text: str) -> str:
    """Return a style without properties that do not draw; any other style is left as it is."""
    properties = [part.partition(":") for part in text.split(";") if part.strip()]
    good = [p for p in properties if _LOOKS.fullmatch(p[0].strip()) and _is_harmless(p[2])]
    return text if good == properties else ";".join(map("".join, good))


def _renamed(key: str, value: str, name: str) -> str:
    """Return an attribute's value with the ids in it renamed."""
    if key == "id":
        return f"{name}-{value}"
    if key.rpartition("}")[2] == "href":
        return f"#{name}-{value[1:]}" if value.startswith("#") else value
    return _REFERENCE.sub(rf"url(#{name}-\1)", value)


_POINTS = 72.0  # to the inch, which is the unit of an SVG of matplotlib
_FEW = 600
"""Lines of no more points are written with all of them, so that each can be read off."""
_CURVE = 3  # points that make a line more than a mark of one value
_SCALES = ("linear", "log")
_MARK = re.compile(r'id="(of|key|axes)-(\d+)(?:-\d+)?"')
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)


def mark(figure: "Figure") -> list[str]:
    """Give the shapes of each labeled curve its number; returns the labels, none of a figure without.

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


def marked(content: str, figure: "Figure", labels: list[str]) -> str:
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


def _panels(figure: "Figure") -> "list[Axes]":
    """Return the axes with curves over numbers."""
    return [
        ax
        for ax in figure.axes
        if ax.axison and {ax.get_xscale(), ax.get_yscale()} <= set(_SCALES) and any(_curves(ax))
    ]


def _curves(ax: "Axes") -> Iterator[str]:
    for line in ax.lines:
        label = str(line.get_label())
        if not label.startswith("_") and np.size(line.get_xdata()) >= _CURVE:
            yield label


def _shapes(ax: "Axes") -> "Iterator[tuple[Artist, str]]":
    for container in ax.containers:
        for part in container.get_children():
            yield part, str(container.get_label()).removeprefix("_")
    for artist in (*ax.lines, *ax.collections):
        yield artist, str(artist.get_label()).removeprefix("_")


def _is_called_zero(ax: "Axes", tick: float) -> bool:
    """Return whether a logarithmic axis labels this place as zero."""
    return ax.xaxis.get_major_formatter()(tick, None) == "0"


def _axes_metadata(figure: "Figure", ax: "Axes", labels: list[str]) -> dict[str, Any]:
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


def _errors(
    figure: "Figure", ax: "Axes", labels: list[str]
) -> Iterator[tuple[int, list[list[float]]]]:
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
