"""Which combinations of a grid's values are points: all, or the keys of one filter after the other's.

Filters do not know of each other, so a filter comes out the same whatever others are given. What all
depend on, the scenario and the reference filter, is combined with everything.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import product
from math import prod
from typing import Any, TypeAlias

Places: TypeAlias = tuple[int, ...]
"""The number of each path's value."""


def single_paths(path: str) -> list[str]:
    """The paths of a grid's key, which take a value together: the same one, or each its own."""
    return path.split(" & ")


def values_of(path: str, value: Any) -> list[Any]:
    """What each of the paths takes: the value, or of a list with a value for each its own."""
    paths = single_paths(path)
    each = len(paths) > 1 and isinstance(value, list) and len(value) == len(paths)
    return value if each else [value] * len(paths)


def filters_of(path: str, labels: Iterable[str]) -> list[str]:
    """Labels of the filters of which a grid's key varies something; a label may have dots."""
    found = []
    for single in single_paths(path):
        mine = [label for label in labels if single.startswith(f"filters.{label}.")]
        found += [max(mine, key=len)] if mine else []
    return found


def is_of_scenario(path: str) -> bool:
    """Whether a grid's key varies something of the scenario."""
    return any(single.startswith("scenario.") for single in single_paths(path))


def separate(
    grid: Iterable[str], labels: Collection[str], reference: str | None
) -> list[list[str]]:
    """Paths that vary filters by themselves, together where they have a filter in common."""
    found: list[tuple[set[str], list[str]]] = []
    for path in grid:
        mine = set(filters_of(path, labels))
        if is_of_scenario(path) or reference in mine:
            continue
        joined, paths = mine, [path]
        for others, known in [item for item in found if item[0] & mine]:
            found.remove((others, known))
            joined, paths = joined | others, [*known, *paths]
        found.append((joined, paths))
    return [paths for _, paths in found]


def combinations(
    grid: Mapping[str, Sequence[Any]], labels: Collection[str], reference: str | None, every: bool
) -> list[Places]:
    """The points in the order of their values: every combination, or one group of filters at a time.

    While one group is varied, the others keep their first values.
    """
    if every:
        return list(product(*(range(len(values)) for values in grid.values())))
    apart = separate(grid, labels, reference)
    held = {path for paths in apart for path in paths}
    points: set[Places] = set()
    for paths in apart or [[]]:
        varied = {path for path in grid if path not in held or path in paths}
        points |= set(product(*(range(len(v) if p in varied else 1) for p, v in grid.items())))
    return sorted(points)


def number_of_points(
    grid: Mapping[str, Sequence[Any]], labels: Collection[str], reference: str | None, every: bool
) -> int:
    """How many `combinations` gives."""
    if every:
        return prod(len(values) for values in grid.values())
    apart = separate(grid, labels, reference)
    alone = [prod(len(grid[path]) for path in paths) for paths in apart]
    held = {path for paths in apart for path in paths}
    together = prod(len(values) for path, values in grid.items() if path not in held)
    return together * (1 + sum(n - 1 for n in alone))
