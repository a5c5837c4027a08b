"""Panels for the points of a grid: which points have one, in which order, with which headings."""

import re
from collections.abc import Sequence

from trackbench.field_types import is_number
from trackbench.report.findings import grid_phrases
from trackbench.report.plotting.panels import MOST_PANELS
from trackbench.report.tables_and_figures import Results
from trackbench.results.point_facts import GridPoint


def panel_points(results: Results) -> list[GridPoint]:
    """Return the grid points that have a panel, 12 at most; the numbers of a single path ascend."""
    points = results.points()[:MOST_PANELS]
    if len(results.grid) != 1:
        return points
    path = results.grid[0]
    if not all(is_number(point[path]) for point in points):
        return points
    return sorted(points, key=lambda point: float(point[path]))


def panel_headings(results: Results, points: Sequence[GridPoint]) -> list[str]:
    """Return the titles of the panels of grid points: the keys that differ, with values and units."""
    headings = grid_phrases.distinct_headings(points, results.grid_units)
    # The minus of a number, not the hyphen of a name.
    return [re.sub(r"(?<!\w)-(?=\d)", "\N{MINUS SIGN}", heading) for heading in headings]
