"""What tables and figures ask of the experiment's grid."""

from collections.abc import Sequence

from trackbench.experiment.reading.definition import Point
from trackbench.experiment.reading.validate import unknown


def missing_paths(points: Sequence[Point], **wanted: str | None) -> dict[str, str]:
    """What is wrong with keys that name a path of the grid, by key."""
    grid = list(points[0].values)
    return {
        key: f"{path!r} is no path of the grid; {unknown(path, grid)}"
        if grid
        else "there is no grid"
        for key, path in wanted.items()
        if path is not None and path not in grid
    }
