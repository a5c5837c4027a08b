"""Scenarios that a grid varies, and the points of the grid that have each of them."""

from trackbench.config.grid import is_of_scenario
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


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
