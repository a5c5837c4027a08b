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
    left = first.left - _TICKS.left if others else 0.0
    top = first.top - _TICKS.top if others else 0.0
    right_gaps = [other.left - first.right for other in others if other.left > first.right]
    is_last = not any(other.top > first.bottom for other in others)
    left = max(left, 0.0)
    top = max(top, 0.0)
    width = first.right + min([_TICKS.right, *(0.5 * gap for gap in right_gaps)]) - left
    height = first.bottom + (_TICKS.bottom if is_last else _NEXT_PANEL) - top
    shown = re.sub(r' (width|height|viewBox)="[^"]*"', "", head[0])
    size = f'width="{width:.1f}pt" height="{height:.1f}pt"'
    shown = f'{shown[:-1]} {size} viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}">'
    return text[: head.start()] + shown + text[head.end() :]


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
