"""Points of a grid: every combination of its values, or the keys of one filter after the other.

Filters do not know of each other, so a filter comes out the same whatever others are given. What all
depend on, the scenario and the reference filter, is combined with everything.
"""

from ast import literal_eval
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import product
from math import prod
from typing import Any, NamedTuple, TypeAlias

from trackbench.config.chosen_filters import add_label_problem
from trackbench.config.experiment_keys import Settings
from trackbench.config.overrides import override, split_path
from trackbench.errors import Mark
from trackbench.field_types import is_number
from trackbench.yaml_source import Keys, Source, dotted

Places: TypeAlias = tuple[int, ...]
"""The index of each path's value in the grid."""


def single_paths(path: str) -> list[str]:
    """Split a grid's key at " & " into the paths that it varies together."""
    return path.split(" & ")


def values_of(path: str, value: object) -> list[object]:
    """Return the value of each path of a grid's key, such as ``filters.A.N & filters.B.N``.

    ``value`` is one of the values under that key. A list with as many values as paths has one for each
    path. Any other value is that of all paths.
    """
    paths = single_paths(path)
    if len(paths) > 1 and isinstance(value, list) and len(value) == len(paths):
        return value
    return [value] * len(paths)


def filters_of(path: str, labels: Iterable[str]) -> list[str]:
    """Find the labels of the filters that a grid's key varies.

    ``path`` is the key, such as ``filters.A.N & filters.B.N``. ``labels`` are those of all filters.
    """
    varied_labels = []
    for single_path in single_paths(path):
        matches = [label for label in labels if single_path.startswith(f"filters.{label}.")]
        if matches:
            # A label may have dots: of the labels `a` and `a.b` the longer one is meant.
            varied_labels.append(max(matches, key=len))
    return varied_labels


def is_of_scenario(path: str) -> bool:
    """Test whether a grid's key varies something of the scenario."""
    return any(single.startswith("scenario.") for single in single_paths(path))


def independent_filter_paths(
    grid: Iterable[str], labels: Collection[str], reference: str | None
) -> list[list[str]]:
    """Group the paths of a grid that vary neither the scenario nor the reference filter.

    Two paths that vary a common filter are in one group. ``labels`` are those of all filters,
    ``reference`` that of the reference filter, if there is one.
    """
    groups: list[_FilterGroup] = []
    for path in grid:
        varied_filters = set(filters_of(path, labels))
        if is_of_scenario(path) or reference in varied_filters:
            continue
        # A path of filters in several groups joins these groups.
        joined = _FilterGroup(filters=varied_filters, paths=[path])
        separate = []
        for group in groups:
            if group.filters & varied_filters:
                joined = _FilterGroup(
                    filters=joined.filters | group.filters, paths=group.paths + joined.paths
                )
            else:
                separate.append(group)
        groups = [*separate, joined]
    return [group.paths for group in groups]


class _FilterGroup(NamedTuple):
    """Filters that vary together, and the paths that vary them."""

    filters: set[str]
    paths: list[str]


def _paths_varied_together(
    grid: Mapping[str, object],
    labels: Collection[str],
    reference: str | None,
    all_combinations: bool,
) -> list[set[str]]:
    """Return the paths that vary together, a set for each group of filters.

    Paths of the scenario and of the reference are in each set, as all filters depend on them. If
    ``all_combinations`` of the values are to be points, there is one set of all paths.
    """
    if all_combinations:
        return [set(grid)]
    path_groups = independent_filter_paths(grid, labels, reference)
    if not path_groups:
        return [set(grid)]
    independent = set[str]().union(*path_groups)
    shared = grid.keys() - independent
    return [shared | set(paths) for paths in path_groups]


def combinations(
    grid: Mapping[str, Sequence[object]],
    labels: Collection[str],
    reference: str | None,
    all_combinations: bool,
) -> list[Places]:
    """List the points in order, each as the indices of its paths' values.

    ``labels`` are those of the filters, ``reference`` that of the reference filter, if there is one.
    With ``all_combinations`` each combination of the values is a point. Otherwise one filter is varied
    at a time, or one group of filters that a path joins, and the paths of the others keep their first
    values. Paths of the scenario and of the reference are varied with each group, as every filter
    depends on them. So the values 1, 2 of filter A and 3, 4 of filter B give the points (1, 3), (1, 4)
    and (2, 3).
    """
    points: set[Places] = set()
    for varied_paths in _paths_varied_together(grid, labels, reference, all_combinations):
        indices_by_path = []
        for path, values in grid.items():
            number_of_values = len(values) if path in varied_paths else 1
            indices_by_path.append(range(number_of_values))
        points |= set(product(*indices_by_path))
    return sorted(points)


def number_of_points(
    grid: Mapping[str, Sequence[object]],
    labels: Collection[str],
    reference: str | None,
    all_combinations: bool,
) -> int:
    """Count the points of `combinations` without building them."""
    groups = _paths_varied_together(grid, labels, reference, all_combinations)

    def count_combinations(paths: set[str]) -> int:
        return prod(len(grid[path]) for path in paths)

    # A path is in one group alone, or in all. So any two groups share the points at which every filter
    # has its first values, and no others: count these once.
    in_all_groups = count_combinations(set[str].intersection(*groups))
    return sum(count_combinations(paths) for paths in groups) - (len(groups) - 1) * in_all_groups


_MOST_POINTS = 10_000


def grid_points(
    source: Source, settings: Settings
) -> list[tuple[dict[str, object], dict[str, Mark]]]:
    """List the values of each grid point and their positions in the file, both by path.

    With ``product`` every combination of the values is a point. Without it one filter is varied at a
    time, while the others have their first values. Values of the scenario and of the reference filter,
    on which all filters depend, are combined with each of these. Mistakes in the grid are added to
    ``source``. There are no points if these keep the points from being listed.
    """
    grid = settings.grid
    if not _check_grid(source, settings):
        return []
    points = []
    for indices in combinations(grid, settings.filters, settings.reference, settings.product):
        index_by_path = dict(zip(grid, indices, strict=True))
        values = {path: grid[path][i] for path, i in index_by_path.items()}
        marks = {path: source.mark(("grid", path, i)) for path, i in index_by_path.items()}
        points.append((values, marks))
    return points


def points_of_resolved_config(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List the values of each grid point by path, from a resolved config as in a results folder.

    They are all points, also those where every filter failed.
    """
    grid = config["grid"]
    is_product = config.get("product", True)
    points = []
    # A point is the index of a value for each path. Without `product` one filter's paths are varied at a
    # time, and those of the reference with each: this takes the labels.
    for indices in combinations(grid, config["filters"], config.get("reference"), is_product):
        points.append({path: grid[path][i] for path, i in zip(grid, indices, strict=True)})
    return points


def apply_point(source: Source, values: dict[str, object], marks: dict[str, Mark]) -> None:
    """Set the values of one point in the config.

    ``values`` and ``marks``, their positions in the file, are by the keys of the grid. A key may join
    several paths by `` & ``.
    """
    for joint_path, joint_value in values.items():
        paths = single_paths(joint_path)
        for path, value in zip(paths, values_of(joint_path, joint_value), strict=True):
            override(source, split_path(source, path), value, marks[joint_path])


def _check_grid(source: Source, settings: Settings) -> bool:
    """Add the grid's mistakes to the source; return False if its points cannot be listed."""
    grid = settings.grid
    for path, values in grid.items():
        where = ("grid", path)
        # A key such as `filters.A.q & filters.B.q` has several paths, which vary together.
        for single_path in single_paths(path):
            keys = split_path(source, single_path)
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
    # If two paths set one value, a point has no certain one.
    has_overlaps = _has_overlaps(source, grid)
    number = number_of_points(grid, settings.filters, settings.reference, settings.product)
    if number > _MOST_POINTS:
        source.add_problem(("grid",), f"{number} points; a grid has at most {_MOST_POINTS}")
        return False
    return not has_overlaps


def _has_overlaps(source: Source, grid: dict[str, list[object]]) -> bool:
    """Add a mistake to the source for each two axes that set one value; return True if there are any."""
    has_overlaps = False
    axis_by_keys: dict[Keys, str] = {}
    for path in grid:
        for single_path in single_paths(path):
            keys = split_path(source, single_path)
            for earlier_keys, axis in axis_by_keys.items():
                # The keys agree as far as both go: the longer path leads into the shorter one's value.
                if all(a == b for a, b in zip(keys, earlier_keys, strict=False)):
                    inner_keys = max(keys, earlier_keys, key=len)
                    message = f"{dotted(inner_keys)} is varied by {axis!r}, too"
                    source.add_key_problem(("grid", path), message)
                    has_overlaps = True
            axis_by_keys[keys] = path
    return has_overlaps


def common_number(value: object) -> float | None:
    """Return a grid's value if it is a number, or the number that all items of a list are; else None.

    The value of linked paths, which vary together, is a list.
    """
    values = value if isinstance(value, list) else [value]
    if not values or not is_number(values[0]):
        return None
    first: float = values[0]
    if any(other != first for other in values):
        return None
    return first


def values_of_paths(path: str, value: Any) -> list[Any]:
    """Return the value of each of the paths that vary together, also if they are read from a text."""
    return list(values_of(path, _parse_list(value)))


def _parse_list(value: Any) -> Any:
    """Return a grid's value; parse it if it is a list written as a text, such as ``[1, 2]``.

    A list is a text if it was read from a CSV file. Any other value, and a text that cannot be parsed,
    is returned as it is.
    """
    is_list = isinstance(value, str) and value.startswith("[")
    if not is_list:
        return value
    try:
        return literal_eval(value)
    except (SyntaxError, ValueError):
        return value
