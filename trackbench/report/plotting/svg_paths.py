"""Paths of the SVG file of a figure in few bytes, equal on every machine."""

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass

_PATH = re.compile(r' d="([MLZz0-9eE.\s+-]+)"')
"""Data of a path that has straight lines alone."""
_COMMAND = re.compile(r"([MLZz])([^MLZz]*)")
"""A letter of such a path, and the numbers behind it."""
_CLIP = re.compile(r'(id="|url\(#)(p[0-9a-f]{10})\b')
"""Id of a clip path, where it is defined and where it is referred to."""


def compact_paths(content: str) -> str:
    """Return the SVG in half the bytes: straight lines relative, rounded to hundredths of a point.

    Clip paths are numbered, so that the file is equal on every machine: matplotlib names them by
    unrounded positions, whose last digits depend on the processor.
    """
    names = dict.fromkeys(name for _, name in _CLIP.findall(content))
    new_names = {name: f"clip{number}" for number, name in enumerate(names, start=1)}
    # A match is ``id="`` or ``url(#``, and the name behind it.
    content = _CLIP.sub(lambda match: match[1] + new_names[match[2]], content)
    return _PATH.sub(lambda match: f' d="{_relative_path(match[1])}"', content)


def _relative_path(path: str) -> str:
    """Return the path data of straight lines (M, L and z) with each line relative to the point before.

    ``M 10 20 L 10.5 19 z`` becomes ``M10 20l.5-1z``.
    """
    # Points are in hundredths: whole numbers, so that rounding errors do not add up along the path.
    pieces: list[str] = []
    point = (0, 0)
    subpath_start = (0, 0)
    for command, numbers in _COMMAND.findall(path):
        if command in "Zz":  # closes the subpath: the next line begins at its start
            pieces.append("z")
            point = subpath_start
            continue
        x, y = (round(100.0 * float(number)) for number in numbers.split())
        if command == "M":
            subpath_start = (x, y)
            pieces.append(f"M{_hundredths_text(x)} {_hundredths_text(y)}")
        else:
            dx = x - point[0]
            dy = y - point[1]
            pieces.append(f"l{_hundredths_text(dx)} {_hundredths_text(dy)}")
        point = (x, y)
    return "".join(pieces).replace(" -", "-")


def _hundredths_text(hundredths: int) -> str:
    """Write a number of hundredths as SVG allows in fewest letters: ``.5`` for 50."""
    text = f"{hundredths / 100:.2f}".rstrip("0").rstrip(".")
    if 0 < abs(hundredths) < 100:
        return text.replace("0.", ".", 1)
    return text
