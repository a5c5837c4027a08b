"""Panels of the points of a grid, or of the filters at one point: their order, headings and axes."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from trackbench.field_types import is_number
from trackbench.report.findings import grid_headings
from trackbench.report.plotting import style
from trackbench.report.plotting.panels import MOST_PANELS, make_panels, wrap_headings
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


class Panel(NamedTuple):
    """Axes below each other that show one grid point, or one filter at the first grid point."""

    axes: list[Axes]
    point: GridPoint
    label: str
    """label of the filter that has the panel to itself; empty if all filters share the panel"""


def make_panels_of_points(
    results: Results, x_label: str, y_label: str, rows: int = 1, **layout: Any
) -> tuple[Figure, list[Panel]]:
    """Return a figure with an empty panel per grid point, of 12 points at most.

    Parameters
    ----------
    results
        results folder
    x_label
        label below each panel
    y_label
        label at the left of each row of panels; empty for none
    rows
        number of axes below each other in each panel. A single row shares its vertical axis. Several
        rows share their horizontal axis with the panels above and below
    **layout
        further arguments of matplotlib's ``Figure.subplots``

    Returns
    -------
    figure : matplotlib.figure.Figure
        figure without a title
    panels : list of Panel
        panels, whose labels are empty, as all filters share a panel
    """
    points = panel_points(results)
    height = 3.2 if rows == 1 else 2.4 * rows  # of a panel, inches
    if len(points) > 4:  # a page has at most 4 panels side by side: these stand in several rows
        height *= 0.75
    figure, axes = make_panels(
        len(points),
        rows,
        height,
        sharex="col" if rows > 1 else False,
        sharey=rows == 1,
        **layout,
    )
    headings = wrap_headings(panel_headings(results, points))
    panels = []
    for column, point, heading in zip(axes, points, headings, strict=True):
        column[0].set_title(heading)
        column[-1].set_xlabel(x_label)
        column[-1].tick_params(labelbottom=True)  # also above another panel
        panels.append(Panel(axes=list(column), point=point, label=""))
    if y_label:
        for panel in leftmost_panels(panels):
            panel.axes[0].set_ylabel(y_label)
    return figure, panels


def make_panels_of_filters(
    labels: Sequence[str], point: GridPoint, x_label: str, y_label: str
) -> tuple[Figure, list[Panel]]:
    """Return a figure with an empty panel for each of several filters at one grid point.

    Parameters
    ----------
    labels
        labels of the filters, the titles of the panels
    point
        grid point that all panels show
    x_label
        label below the lowest panels
    y_label
        label once at the left

    Returns
    -------
    figure : matplotlib.figure.Figure
        figure without a title
    panels : list of Panel
        panels of one axes each, in the order of ``labels``
    """
    # With ``balanced`` 6 panels stand as 3 and 3, not 4 and 2.
    figure, axes = make_panels(
        number=len(labels),
        rows=1,
        height_in=1.9,
        balanced=True,
        sharex=True,
        sharey=True,
    )
    across = axes[0][0].get_gridspec().ncols  # panels in a row
    panels = []
    for index, ((ax,), label) in enumerate(zip(axes, labels, strict=True)):
        ax.set_title(style.wrapped(label, across))
        is_lowest = index + across >= len(labels)  # no panel is below it
        if is_lowest:
            ax.set_xlabel(x_label)
            ax.tick_params(labelbottom=True)
        panels.append(Panel(axes=[ax], point=point, label=label))
    figure.supylabel(y_label)
    return figure, panels


def panel_points(results: Results) -> list[GridPoint]:
    """Return the grid points that have a panel, 12 at most.

    Parameters
    ----------
    results
        results folder

    Returns
    -------
    list of GridPoint
        points in the order of the grid; those of a single path with numbers in ascending order
    """
    points = results.points()[:MOST_PANELS]
    if len(results.grid) != 1:
        return points
    path = results.grid[0]
    if not all(is_number(point[path]) for point in points):
        return points
    return sorted(points, key=lambda point: float(point[path]))


def panel_headings(results: Results, points: Sequence[GridPoint]) -> list[str]:
    """Return the titles of the panels of grid points: the keys that differ, with values and units."""
    headings = grid_headings.distinct_headings(points, results.grid_units)
    # The minus of a number, not the hyphen of a name.
    return [re.sub(r"(?<!\w)-(?=\d)", "\N{MINUS SIGN}", heading) for heading in headings]


def leftmost_panels(panels: Sequence[Panel]) -> Sequence[Panel]:
    """Return the first panel of each row of panels."""
    gridspec = panels[0].axes[0].get_gridspec()
    across = gridspec.ncols if gridspec is not None else len(panels)  # panels in a row
    return panels[::across]
