"""Points of a grid: every combination of its values, or the keys of one filter after the other.

Filters do not know of each other, so a filter comes out the same whatever others are given. What all
depend on, the scenario and the reference filter, is combined with everything.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import product
from math import prod
from typing import TypeAlias

from trackbench.config.checks import add_label_problem
from trackbench.config.experiment import Settings
from trackbench.config.includes import override, split_assignment, split_path
from trackbench.config.tuning import RANGE
from trackbench.errors import Mark, Problem, UserError
from trackbench.yaml_source import Keys, Source, dotted, scalar

Places: TypeAlias = tuple[int, ...]
"""The number of each path's value."""


def single_paths(path: str) -> list[str]:
    """Split a grid's key into paths that take a value together: the same one, or each its own."""
    return path.split(" & ")


def values_of(path: str, value: object) -> list[object]:
    """Split a value between the paths: a common value, or each its own from a list."""
    paths = single_paths(path)
    if len(paths) > 1 and isinstance(value, list) and len(value) == len(paths):
        return value
    return [value] * len(paths)


def filters_of(path: str, labels: Iterable[str]) -> list[str]:
    """Find the filters of which a grid's key varies something; a label may have dots."""
    varied = []
    for single in single_paths(path):
        matches = [label for label in labels if single.startswith(f"filters.{label}.")]
        varied += [max(matches, key=len)] if matches else []
    return varied


def is_of_scenario(path: str) -> bool:
    """Test whether a grid's key varies something of the scenario."""
    return any(single.startswith("scenario.") for single in single_paths(path))


def independent_filter_paths(
    grid: Iterable[str], labels: Collection[str], reference: str | None
) -> list[list[str]]:
    """Group paths that vary filters by themselves, together where they have a filter in common."""
    # Each group: its filters, and the paths that vary them.
    groups: list[tuple[set[str], list[str]]] = []
    for path in grid:
        varied = set(filters_of(path, labels))
        if is_of_scenario(path) or reference in varied:
            continue
        # A path of filters in several groups joins these groups.
        joined, paths = varied, [path]
        for group in [group for group in groups if group[0] & varied]:
            groups.remove(group)
            joined, paths = joined | group[0], [*group[1], *paths]
        groups.append((joined, paths))
    return [paths for _, paths in groups]


def _varied_together(
    grid: Mapping[str, object], labels: Collection[str], reference: str | None, every: bool
) -> list[set[str]]:
    """Return the paths varied by each filter group; those that all filters depend on are in each."""
    apart = [] if every else independent_filter_paths(grid, labels, reference)
    independent = set[str]().union(*apart)
    return [(grid.keys() - independent) | {*paths} for paths in apart or [[]]]


def combinations(
    grid: Mapping[str, Sequence[object]],
    labels: Collection[str],
    reference: str | None,
    every: bool,
) -> list[Places]:
    """Order the points by their values: every combination, or one filter group at a time.

    While one group is varied, the others keep their first values.
    """
    points: set[Places] = set()
    for varied in _varied_together(grid, labels, reference, every):
        points |= set(product(*(range(len(v) if p in varied else 1) for p, v in grid.items())))
    return sorted(points)


def number_of_points(
    grid: Mapping[str, Sequence[object]],
    labels: Collection[str],
    reference: str | None,
    every: bool,
) -> int:
    """Count the points of `combinations` without building them."""
    groups = _varied_together(grid, labels, reference, every)
    lengths = {path: len(values) for path, values in grid.items()}
    in_all = set[str].intersection(*groups)
    *sizes, shared = (prod(map(lengths.__getitem__, paths)) for paths in (*groups, in_all))
    # Points at which every filter has its first values are in all groups, and count once.
    return sum(sizes) - (len(groups) - 1) * shared


_MOST_POINTS = 10_000


def grid_points(
    source: Source, settings: Settings
) -> list[tuple[dict[str, object], dict[str, Mark]]]:
    """List each point's values by path, with their positions."""
    grid = settings.grid
    if not _is_possible(source, settings):
        return []
    points = []
    for numbers in combinations(grid, settings.filters, settings.reference, settings.product):
        places = dict(zip(grid, numbers, strict=True))
        values = {path: grid[path][i] for path, i in places.items()}
        marks = {path: source.mark(("grid", path, i)) for path, i in places.items()}
        points.append((values, marks))
    return points


def apply_point(source: Source, values: dict[str, object], marks: dict[str, Mark]) -> None:
    """Give the config the values of one point, which stand at these marks."""
    for joint, value in values.items():
        for path, single in zip(single_paths(joint), values_of(joint, value), strict=True):
            override(source, split_path(source, path), single, marks[joint])


def _is_possible(source: Source, settings: Settings) -> bool:
    grid = settings.grid
    for path, values in grid.items():
        where = ("grid", path)
        for keys in (split_path(source, single) for single in single_paths(path)):
            if keys[:1] not in [("scenario",), ("filters",)] or len(keys) < 2:
                source.add_key_problem(where, "a grid varies scenario.KEY or filters.LABEL.KEY")
                return False
            if keys[0] == "filters" and keys[1] not in settings.filters:
                add_label_problem(source, settings, where, str(keys[1]))
                return False
        if not values:
            source.add_problem(where, "has no values")
        for i, value in enumerate(values):
            if value in values[:i]:  # two equal points would count every run twice
                source.add_problem(("grid", path, i), f"{value!r} is given twice")
    has_overlaps = _has_overlaps(source, grid)
    number = number_of_points(grid, settings.filters, settings.reference, settings.product)
    if number > _MOST_POINTS:
        source.add_problem(("grid",), f"{number} points; a grid has at most {_MOST_POINTS}")
        return False
    return not has_overlaps


def _has_overlaps(source: Source, grid: dict[str, list[object]]) -> bool:
    """Reject two axes that set the same value, as one would overwrite the other."""
    before, axis_of = len(source.problems), dict[Keys, str]()
    for path in grid:
        for keys in (split_path(source, single) for single in single_paths(path)):
            for other, axis in axis_of.items():
                if all(a == b for a, b in zip(keys, other, strict=False)):
                    what = f"{dotted(max(keys, other, key=len))} is varied by {axis!r}, too"
                    source.add_key_problem(("grid", path), what)
            axis_of[keys] = path
    return len(source.problems) > before


_RANGE = re.compile(rf"{RANGE}:([0-9]{{1,9}})")
_MOST_VALUES = 1000


def add_axis(source: Source, text: str) -> None:
    """Add one ``--grid`` option to the config's grid; raises UserError."""
    keys, values, mark = split_assignment(source, text, "--grid")
    path = dotted(keys)
    if not isinstance(source.data.get("grid"), dict):
        override(source, ("grid",), {}, mark)
    if path in source.data["grid"] and not source.mark(("grid", path)).line:
        raise UserError(Problem(mark, dotted(("grid", path)), "is given twice"))
    override(source, ("grid", path), axis_values(values, mark), mark)


def axis_values(text: str, mark: Mark) -> Sequence[object]:
    """Read the values of one axis: a list, or a range that is linear or logarithmic."""
    match = _RANGE.fullmatch(text)
    if match is None:
        if ".." in text:
            what = f"{text!r}: a range is a..b:n or log:a..b:n"
            raise UserError(Problem(mark, "", what))
        return [scalar(part.strip()) for part in text.split(",")]
    # a..b:n, or log:a..b:n
    log, first, last, number = match.groups()
    if not 1 <= int(number) <= _MOST_VALUES:
        raise UserError(Problem(mark, "", f"{number} values: write 1 to {_MOST_VALUES}"))
    if log and not (float(first) > 0 and float(last) > 0):
        raise UserError(Problem(mark, "", "a logarithmic range has ends above zero"))
    shares = [i / (int(number) - 1) if int(number) > 1 else 0.0 for i in range(int(number))]
    low, high = float(first), float(last)
    spaced = [low * (high / low) ** s if log else low + (high - low) * s for s in shares]
    values = [float(f"{value:.12g}") for value in spaced]  # 0.3, not 0.30000000000000004
    # Between whole ends, values that are whole but for rounding are whole numbers.
    if isinstance(scalar(first), int) and isinstance(scalar(last), int):
        whole = [round(v) for v in values]
        if all(abs(v - w) < 1e-9 * max(1.0, abs(v)) for v, w in zip(values, whole, strict=True)):
            return whole
    return values
