"""Questions of tables and figures about the experiment's grid."""

from collections.abc import Sequence

from trackbench.config.build import unknown
from trackbench.config.experiment import Point
from trackbench.config.grid import filters_of, is_of_scenario, single_paths, values_of
from trackbench.report.findings import phrases
from trackbench.report.results import Results
from trackbench.results.point_facts import GridPoint


def missing_paths(points: Sequence[Point], **wanted: str | None) -> dict[str, str]:
    """Return what is wrong with keys that name a path of the grid, by key."""
    grid = list(points[0].values)
    return {
        key: f"{path!r} is no path of the grid; {unknown(path, grid)}"
        if grid
        else "there is no grid"
        for key, path in wanted.items()
        if path is not None and path not in grid
    }


def scenes(results: Results) -> list[GridPoint]:
    """Return the grid's combinations of scenario values, in order; one empty one without any."""
    paths = [path for path in results.grid if is_of_scenario(path)]
    every = [{path: point[path] for path in paths} for point in results.points()]
    return [scene for i, scene in enumerate(every) if scene not in every[:i]]


def points_of(results: Results, scene: GridPoint) -> list[GridPoint]:
    """Return the points of the grid with these scenario values."""
    return [p for p in results.points() if all(p[k] == v for k, v in scene.items())]


def own_values(results: Results, point: GridPoint, label: str) -> GridPoint:
    """Return the values that a point gives a filter, by single path."""
    place = results.index_of(point)
    values = point if place is None else results.grid_points[place]  # lists, where files have words
    singles = (
        pair
        for path, value in values.items()
        for pair in zip(single_paths(path), values_of(path, value), strict=True)
    )
    every = results.config["filters"]
    return {path: value for path, value in singles if label in filters_of(path, every)}


def named_form(label: str, keys: GridPoint, others: Sequence[GridPoint]) -> str:
    """Return a filter's label with the keys that differ between its forms."""
    told = {k: v for k, v in keys.items() if any(other.get(k) != v for other in others)}
    return f"{label} ({phrases.heading(told)})" if told else label
