"""Paths of the SVG file of a figure: written in few bytes, read, and thinned for a thumbnail."""

import re
from collections.abc import Iterator

_PATH = re.compile(r' d="([MLZz0-9eE.\s+-]+)"')
"""Data of a path that has straight lines alone."""
_COMMAND = re.compile(r"([MLZz])([^MLZz]*)")
"""A letter of such a path, and the numbers behind it."""
_CLIP = re.compile(r'(id="|url\(#)(p[0-9a-f]{10})\b')
"""Id of a clip path, where it is defined and where it is referred to."""
_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?")
_LEAST_DISTANCE = 2.0
"""Points of a line that are nearer to each other than this, in the SVG's, are one."""


def compact_paths(content: str) -> str:
    """Return the SVG in half the bytes: straight lines relative, rounded to hundredths of a point.

    Clip paths are numbered, so that the file is equal on every machine: matplotlib names them by
    unrounded positions, whose last digits depend on the processor.

    Parameters
    ----------
    content
        SVG, as matplotlib wrote it

    Returns
    -------
    str
        SVG that draws the same lines
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


def outline(path: str) -> Iterator[tuple[list[tuple[float, float]], bool]]:
    """Yield the points of each stroke of a path, and whether the stroke is closed.

    Parameters
    ----------
    path
        attribute ``d`` of an SVG's path, with points that are absolute or relative: ``M10 20l.5-1z``.
        Each letter has one point, as in the figures of this package; further ones are ignored

    Yields
    ------
    points : list of (x, y)
        absolute points of the stroke. Nothing is yielded for a path with curves
    closed : bool
        True if the stroke ends at its first point
    """
    if not re.fullmatch(r"[MlLz0-9e.\s+-]*", path):
        return
    x = 0.0
    y = 0.0
    for stroke in filter(None, path.split("M")):
        points = []
        for letter, numbers in re.findall(r"([lL]?)([^lLz]+)", stroke):
            coordinates = _NUMBER.findall(numbers)
            if len(coordinates) < 2:  # no path that matplotlib writes
                return
            a, b = map(float, coordinates[:2])
            if letter == "l":  # relative to the point before
                x += a
                y += b
            else:
                x = a
                y = b
            points.append((x, y))
        yield points, "z" in stroke


def coarse_path(path: str) -> str:
    """Return a path of straight lines, rounded to whole points, without corners that are very near.

    Parameters
    ----------
    path
        attribute ``d`` of an SVG's path

    Returns
    -------
    str
        attribute ``d`` of the coarse path; empty for curves, of which `outline` yields nothing
    """
    parts = []
    for points, closed in outline(path):
        corners = [points[0]]
        for x, y in points[1:]:
            last_x, last_y = corners[-1]
            if max(abs(x - last_x), abs(y - last_y)) >= _LEAST_DISTANCE:
                corners.append((x, y))
        if len(corners) > 1:
            text = " ".join(f"{x:.0f},{y:.0f}" for x, y in corners)
            parts.append(f"M{text}{'z' if closed else ''}")
    return "".join(parts)
