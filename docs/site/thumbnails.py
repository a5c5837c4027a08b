"""Pictures of the gallery's cards: one panel of a figure, so that its letters can be read."""

import html
import json
import math
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

_SVG = "{http://www.w3.org/2000/svg}"
_AXES = re.compile(r"axes_\d+")
_POINT = re.compile(r"(-?[\d.]+)[ ,](-?[\d.]+)")


class _Box(NamedTuple):
    """Rectangle of a panel, in points of the figure."""

    left: float
    top: float
    right: float
    bottom: float


class _Text(NamedTuple):
    """A text of a figure: its rectangle, and the element in the file."""

    box: _Box
    is_upright: bool
    element: str


_MARGIN = 3.0
"""Room around a panel and its texts."""
_LETTER_WIDTH = 0.63
"""Mean width of a letter of DejaVu Sans, in font sizes; labels are a little shorter."""
_LINE = 12.0
"""Distance of two lines of a title at most, and of the last line from the panel."""
_TICK_LABEL = 12.0
"""Distance of a panel from the labels of its ticks at most."""
_BELOW = 32.0
"""Room below a panel for the labels of its ticks and of its axis."""
_CENTERED = 30.0
"""Distance of the middle of a title or of a label of an axis from the middle of its panel at most."""
_TEXT = re.compile(r"<text ([^>]*)>([^<]*)</text>")
_PLACE = re.compile(r"translate\((-?[\d.]+) (-?[\d.]+)\)")
_ANCHORED_PLACE = re.compile(r' x="(-?[\d.]+)" y="(-?[\d.]+)"')


@cache
def panel(path: Path) -> str:
    """Return the SVG of a figure's first panel; the whole figure if its panels are not known.

    The picture has the panel, its title, and the labels of its axes. Other texts of the figure, such as
    the title of a neighbor, are removed where they would reach into the picture.
    """
    text = path.read_text(encoding="utf-8")
    head = re.search(r"<svg [^>]*>", text)
    boxes = _boxes(text)
    if head is None or not boxes:
        return text
    first, *others = boxes
    # Step 1: the view is the panel with its texts.
    texts = _texts(text)
    panel_texts = [one for one in texts if _belongs(one, first, others)]
    rectangles = [first, *(one.box for one in panel_texts)]
    left = max(min(box.left for box in rectangles) - _MARGIN, 0.0)
    top = max(min(box.top for box in rectangles) - _MARGIN, 0.0)
    right = max(box.right for box in rectangles) + _MARGIN
    bottom = max(box.bottom for box in rectangles) + _MARGIN
    view = _Box(left, top, right, bottom)
    # Step 2: no other text reaches into it.
    body = text[head.end() :]
    for one in texts:
        if one not in panel_texts and _overlap(one.box, view):
            body = body.replace(one.element, "")
    width = right - left
    height = bottom - top
    shown = re.sub(r' (width|height|viewBox)="[^"]*"', "", head[0])
    size = f'width="{width:.1f}pt" height="{height:.1f}pt"'
    shown = f'{shown[:-1]} {size} viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}">'
    return text[: head.start()] + shown + body


def _texts(svg: str) -> list[_Text]:
    """Find the texts of a figure; their widths are estimates."""
    found = []
    for element in _TEXT.finditer(svg):
        place = _ANCHORED_PLACE.search(element[1]) or _PLACE.search(element[1])
        size = re.search(r"font-size: ([\d.]+)px", element[1])
        if place is None or size is None:
            continue
        x, baseline = float(place[1]), float(place[2])
        height = float(size[1])
        width = _LETTER_WIDTH * height * len(html.unescape(element[2]))
        start = 0.0
        if "anchor: middle" in element[1]:
            start = -width / 2
        if "anchor: end" in element[1]:
            start = -width
        is_upright = "rotate(-90" in element[1]
        if is_upright:
            box = _Box(x - height, baseline - start - width, x + 0.3 * height, baseline - start)
        else:
            box = _Box(x + start, baseline - height, x + start + width, baseline + 0.3 * height)
        found.append(_Text(box=box, is_upright=is_upright, element=element[0]))
    return found


def _belongs(text: _Text, panel: _Box, others: list[_Box]) -> bool:
    """Return whether a text is within a panel, its title, or a label of its axes."""
    box = text.box
    middle_x = (box.left + box.right) / 2
    middle_y = (box.top + box.bottom) / 2
    is_between = panel.left - _MARGIN < middle_x < panel.right + _MARGIN
    is_beside = panel.top - _MARGIN < middle_y < panel.bottom + _MARGIN
    if is_between and is_beside:
        return True
    if text.is_upright:
        is_centered = abs(middle_y - (panel.top + panel.bottom) / 2) < _CENTERED
        return is_centered and box.right < panel.left and _is_nearest(box, panel, others)
    if is_beside:
        return box.right < panel.left < box.right + _TICK_LABEL
    if box.bottom <= panel.top + _MARGIN:
        is_centered = abs(middle_x - (panel.left + panel.right) / 2) < _CENTERED
        is_next_line = panel.top - box.bottom < 2.0 * _LINE
        return is_centered and is_next_line
    is_below = panel.bottom < box.bottom < panel.bottom + _BELOW
    return is_between and is_below and _is_nearest(box, panel, others)


def _is_nearest(text: _Box, panel: _Box, others: list[_Box]) -> bool:
    """Return whether no other panel is nearer to a text."""
    return all(_gap(text, panel) <= _gap(text, other) for other in others)


def _gap(one: _Box, other: _Box) -> float:
    """Return the distance of two rectangles."""
    across = max(one.left - other.right, other.left - one.right, 0.0)
    down = max(one.top - other.bottom, other.top - one.bottom, 0.0)
    return math.hypot(across, down)


def _overlap(one: _Box, other: _Box) -> bool:
    return _gap(one, other) == 0.0


def _boxes(text: str) -> list[_Box]:
    """Find the rectangles of the panels, in the figure's order."""
    root = ET.fromstring(text)
    live = root.get("data-live")
    if live is not None:
        return [_Box(*axes["box"]) for axes in json.loads(live)["axes"]]
    boxes = []
    for group in root.iter(f"{_SVG}g"):
        background = group.find(f"{_SVG}g/{_SVG}path")
        if _AXES.fullmatch(group.get("id", "")) and background is not None:
            points = [(float(x), float(y)) for x, y in _POINT.findall(background.get("d", ""))]
            if points:
                xs, ys = zip(*points, strict=True)
                boxes.append(_Box(min(xs), min(ys), max(xs), max(ys)))
    return boxes
