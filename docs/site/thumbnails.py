"""Pictures of the gallery's cards: one panel of a figure, so that its letters can be read."""

import json
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


_TICKS = _Box(left=27.0, top=14.0, right=10.0, bottom=30.0)
"""Room for the ticks of a panel, and for its title."""
_NEXT_PANEL = 6.0
"""Room below a panel that has another one below it, whose title stands between them."""


_OWN_SHARE = 0.3
"""Share of the gap between two panels that has nothing of the right one."""
_LINE = 12.0
"""Distance of two lines of a title at most."""
_LETTER = 9.0
"""Height of a letter of a title above its line."""
_TEXT = re.compile(r'<text [^>]*translate\((-?[\d.]+) (-?[\d.]+)\)"')
"""Places of the texts that are not rotated."""
_LABEL = re.compile(r'<text [^>]*anchor: end" x="(-?[\d.]+)" y="(-?[\d.]+)"[^>]*>([^<]+)<')
"""Right ends and letters of the labels of vertical axes."""
_LETTER_WIDTH = 5.7


@cache
def panel(path: Path) -> str:
    """Return the SVG of a figure's first panel; the whole figure if its panels are not known."""
    text = path.read_text(encoding="utf-8")
    head = re.search(r"<svg [^>]*>", text)
    boxes = _boxes(text)
    if head is None or not boxes:
        return text
    first, *others = boxes
    # A panel alone has its labels, too; of several panels a label may belong to all of them.
    left = min(first.left - _TICKS.left, _left_of_ticks(text, first)) if others else 0.0
    top = min(first.top - _TICKS.top, _top_of_title(text, first)) if others else 0.0
    right_gaps = [other.left - first.right for other in others if other.left > first.right]
    is_last = not any(other.top > first.bottom for other in others)
    left = max(left, 0.0)
    top = max(top, 0.0)
    width = first.right + min([_TICKS.right, *(_OWN_SHARE * gap for gap in right_gaps)]) - left
    height = first.bottom + (_TICKS.bottom if is_last else _NEXT_PANEL) - top
    shown = re.sub(r' (width|height|viewBox)="[^"]*"', "", head[0])
    size = f'width="{width:.1f}pt" height="{height:.1f}pt"'
    shown = f'{shown[:-1]} {size} viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}">'
    return text[: head.start()] + shown + text[head.end() :]


def _left_of_ticks(text: str, panel: _Box) -> float:
    """Return the left of the labels of the panel's vertical axis."""
    left = panel.left
    for right, y, label in _LABEL.findall(text):
        is_beside = panel.top - _LETTER < float(y) < panel.bottom + _LETTER
        if float(right) < panel.left and is_beside:
            left = min(left, float(right) - _LETTER_WIDTH * len(label))
    return left


def _top_of_title(text: str, panel: _Box) -> float:
    """Return the top of the panel's title, which may have several lines."""
    baselines = set()
    for place in _TEXT.findall(text):
        x, y = map(float, place)
        if panel.left - _TICKS.left < x < panel.right and y < panel.top:
            baselines.add(y)
    top = panel.top
    for y in sorted(baselines, reverse=True):
        if top - y > _LINE:
            break  # the figure's title
        top = y
    return top - _LETTER


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
