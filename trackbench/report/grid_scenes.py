"""Points of the grid in groups: the scenarios that a grid varies, and the forms of a filter."""

from collections.abc import Sequence

from trackbench.config.experiment import Point
from trackbench.config.grid import filters_of, is_of_scenario, single_paths, values_of
from trackbench.config.key_mistakes import unknown
from trackbench.report.findings import phrases
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


def missing_paths(points: Sequence[Point], **paths: str | None) -> dict[str, str]:
    """Return the mistakes of keys that name no path of the grid, by key; empty if there are none.

    ``paths`` are the keys with their values; None stands for a key that is not set.
    """
    grid = list(points[0].values)
    problems = {}
    for key, path in paths.items():
        if path is None or path in grid:
            continue
        if grid:
            problems[key] = f"{path!r} is no path of the grid; {unknown(path, grid)}"
        else:
            problems[key] = "there is no grid"
    return problems


def scenes(results: Results) -> list[GridPoint]:
    """List the combinations of the values that the grid gives the scenario, in order.

    If the grid does not vary the scenario, the list has one empty combination.
    """
    paths = [path for path in results.grid if is_of_scenario(path)]
    combinations: list[GridPoint] = []
    for point in results.points():
        scene = {path: point[path] for path in paths}
        if scene not in combinations:
            combinations.append(scene)
    return combinations


def points_of(results: Results, scene: GridPoint) -> list[GridPoint]:
    """Select the points of the grid with these scenario values, one of `scenes`."""
    return [point for point in results.points() if scene.items() <= point.items()]


def own_values(results: Results, point: GridPoint, label: str) -> GridPoint:
    """Return the values that a point of the grid gives the filter ``label``, by path.

    Each of several paths that vary together has its own value.
    """
    # Paths that vary together have a list of values. It is a text in a point that is read from a file,
    # so take the point of the config.
    values = point
    index = results.index_of(point)
    if index is not None:
        values = results.grid_points[index]
    value_by_path: GridPoint = {}
    for path, value in values.items():
        value_by_path |= zip(single_paths(path), values_of(path, value), strict=True)
    labels = results.config["filters"]
    filter_values = {}
    for path, value in value_by_path.items():
        if label in filters_of(path, labels):
            filter_values[path] = value
    return filter_values


def named_form(label: str, keys: GridPoint, variants: Sequence[GridPoint]) -> str:
    """Name a form of a filter by its label and the keys that differ between its forms: ``EKF (q = 2)``.

    ``keys`` are those of this form with their values, ``variants`` those of every form of the filter.
    """
    differing = {}
    for key, value in keys.items():
        if any(variant.get(key) != value for variant in variants):
            differing[key] = value
    if not differing:
        return label
    return f"{label} ({phrases.heading(differing)})"
