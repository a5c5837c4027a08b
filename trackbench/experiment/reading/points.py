"""The points of a grid, with the positions of their values."""

from typing import Any

from trackbench.experiment.problems import Mark
from trackbench.experiment.reading.checks import blame_label
from trackbench.experiment.reading.combining import (
    combinations,
    number_of_points,
    single_paths,
    values_of,
)
from trackbench.experiment.reading.compose import override, split_path
from trackbench.experiment.reading.definition import Settings
from trackbench.experiment.reading.source import Keys, Source, dotted

_MOST_POINTS = 10_000


def grid_points(source: Source, settings: Settings) -> list[tuple[dict[str, Any], dict[str, Mark]]]:
    """Of each point the value of each path, and where it is written."""
    grid = settings.grid
    if not _is_possible(source, settings):
        return []
    out = []
    for numbers in combinations(grid, settings.filters, settings.reference, settings.product):
        chosen = dict(zip(grid, numbers, strict=True))
        taken = {path: grid[path][i] for path, i in chosen.items()}
        marks = {path: source.mark(("grid", path, i)) for path, i in chosen.items()}
        out.append((taken, marks))
    return out


def take(source: Source, values: dict[str, Any], marks: dict[str, Mark]) -> None:
    """Give the config the values of one point, which stand at these marks."""
    for joint, value in values.items():
        for path, own in zip(single_paths(joint), values_of(joint, value), strict=True):
            override(source, split_path(source, path), own, marks[joint])


def _is_possible(source: Source, settings: Settings) -> bool:
    grid = settings.grid
    for path, values in grid.items():
        where = ("grid", path)
        for keys in (split_path(source, single) for single in single_paths(path)):
            if keys[:1] not in [("scenario",), ("filters",)] or len(keys) < 2:
                source.blame_key(where, "a grid varies scenario.KEY or filters.LABEL.KEY")
                return False
            if keys[0] == "filters" and keys[1] not in settings.filters:
                blame_label(source, settings, where, str(keys[1]))
                return False
        if not values:
            source.blame(where, "has no values")
        _check_repeated(source, path, values)
    overlaps = _overlapping(source, grid)
    number = number_of_points(grid, settings.filters, settings.reference, settings.product)
    if number > _MOST_POINTS:
        source.blame(("grid",), f"{number} points; a grid has at most {_MOST_POINTS}")
        return False
    return not overlaps


def _overlapping(source: Source, grid: dict[str, list[Any]]) -> bool:
    """Of two axes that set the same value, one would head rows with what the other took back."""
    varied: dict[Keys, str] = {}
    found = False
    for path in grid:
        for keys in (split_path(source, single) for single in single_paths(path)):
            for other, name in varied.items():
                if all(a == b for a, b in zip(keys, other, strict=False)):
                    what = f"{dotted(max(keys, other, key=len))} is varied by {name!r}, too"
                    source.blame_key(("grid", path), what)
                    found = True
            varied[keys] = path
    return found


def _check_repeated(source: Source, path: str, values: list[Any]) -> None:
    """Two points of the same values would be one point with every run twice."""
    for i, value in enumerate(values):
        if value in values[:i]:
            source.blame(("grid", path, i), f"{value!r} is given twice")
