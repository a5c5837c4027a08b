"""Points, paths and values of a grid in words: ``sigma azimuth = 2 mrad``."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from trackbench.config.grid import single_paths, values_of_paths
from trackbench.report.findings.metric_phrases import in_unit, with_raised_powers
from trackbench.report.findings.phrases import number
from trackbench.report.table import LinkedTexts
from trackbench.results.points_json import GridPoint
from trackbench.units_of_components import without_unit


def join_heading(name: str, heading_of_point: str) -> str:
    """Write a filter's name with the heading of a grid point, if there is a grid: ``EKF, R = 0.1``."""
    return ", ".join(filter(None, [name, heading_of_point]))


def heading(point: GridPoint, units: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return a grid point as the title of its panel: ``R = 0.1``, ``sigma azimuth = 2 mrad``.

    Each of several paths that vary together has its own value: ``q = 1469.1, R = 15099``. ``units`` are
    the units, by single path, of paths whose names end in none.
    """
    parts: list[str] = []
    for path, value in point.items():
        values = values_of_paths(path, value)
        for single_path, single_value in zip(single_paths(path), values, strict=True):
            words, unit_in_name = quantity(single_path)
            unit = with_raised_powers(unit_in_name or units.get(single_path, ""))
            part = f"{words} = {_value_words(single_value)} {unit}".rstrip()
            if part not in parts:  # the same key of several filters
                parts.append(part)
    return ", ".join(parts)


def distinct_headings(
    points: Sequence[GridPoint], units: Mapping[str, str] = MappingProxyType({})
) -> list[str]:
    """Return the titles of grid points, as `heading` writes them, with no more keys than they need.

    Of paths that vary together a title has the first ones: as many as make the titles differ.
    """
    shortened, _ = distinct_points(points)
    return [heading(point, units) for point in shortened]


def distinct_points(points: Sequence[GridPoint]) -> tuple[list[GridPoint], int]:
    """Shorten grid points for headings: of paths that vary together to the first ones.

    A key of the grid may join several paths with " & ", whose values then vary together. The point
    ``{"a.q & b.q": [1, 2]}`` becomes ``{"a.q": 1}``, if the first path alone makes the points differ.

    Returns
    -------
    points : list
        Points by single path, such as ``a.q``.
    number : int
        Number of paths that are left of each key: the smallest that makes the points differ.
    """
    most = max((len(single_paths(path)) for point in points for path in point), default=1)
    shortened: list[GridPoint] = []
    number = 0
    while number < most:
        number += 1
        shortened = [_first_paths(point, number) for point in points]
        if len({heading(point) for point in shortened}) == len(points):
            break
    return shortened, number


def texts_of_linked_paths(
    path: str, values: Sequence[str], units: Mapping[str, str]
) -> LinkedTexts:
    """Return how a table shows the values of paths that vary together: by the keys that differ.

    ``path`` is the key of the grid that joins these paths with " & ", and ``values`` are the texts of
    its different values. ``units`` are those of `heading`.
    """
    # Step 1: each value of the grid, with as many of the paths as make the values differ.
    points, number = distinct_points([{path: value} for value in values])
    # Step 2: one path is enough. Its value is the text. With an empty head the table keeps the key
    # header, which is the name of this path.
    if number == 1:
        texts = [str(*point.values()) for point in points]
        return LinkedTexts(head="", texts=dict(zip(values, texts, strict=True)))
    # Step 3: of several paths each text names the keys: "q = 1469.1, R = 15099" under "q, R".
    # `quantity` returns a path in words, and its unit.
    names = dict.fromkeys(quantity(shown_path)[0] for shown_path in points[0])
    texts = [heading(point, units) for point in points]
    return LinkedTexts(head=", ".join(names), texts=dict(zip(values, texts, strict=True)))


def _first_paths(point: GridPoint, number: int) -> GridPoint:
    """Return a grid point with the first ``number`` of paths that vary together, each by itself."""
    first: GridPoint = {}
    for path, value in point.items():
        values = values_of_paths(path, value)
        first |= dict(list(zip(single_paths(path), values, strict=True))[:number])
    return first


def _value_words(value: Any) -> str:
    """Return a grid's value for a title: ``2``; ``b2`` for ``[b2]``; ``[0, 1]`` as it is."""
    if isinstance(value, list):
        if len(value) == 1:
            return _value_words(value[0])
        if all(isinstance(item, str) for item in value):
            return ", ".join(value)
    return number(value)


def at_point(point: GridPoint) -> str:
    """Return where a sentence's numbers are from: `` at R = 0.1``; empty without a grid."""
    if not point:
        return ""
    return f" at {heading(point)}"


def axis(path: str, units: Mapping[str, str] = MappingProxyType({})) -> str:
    """Label an axis with a grid's path: ``sigma azimuth (mrad)``; ``units`` as `heading` has them."""
    words, unit = quantity(path)
    return in_unit(words, unit or units.get(single_paths(path)[0], ""))


def quantity(path: str) -> tuple[str, str]:
    """Return a grid's path as words, and the unit that its name ends in; empty if in none.

    They are ``sigma azimuth`` and ``mrad`` of ``scenario.sensor.sigma_azimuth_mrad``.
    """
    # The last word of the path, of the first of several that vary together.
    key, unit = without_unit(single_paths(path)[0].rpartition(".")[2])
    return key.replace("_", " "), unit
