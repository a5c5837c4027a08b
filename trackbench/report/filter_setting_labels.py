"""Labels of a filter's settings: the keys that a grid gives it, `EKF (q = 2)`."""

from collections.abc import Sequence

from trackbench.config.grid import filters_of, single_paths, values_of
from trackbench.report.findings import grid_phrases
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


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


def setting_text(values: GridPoint) -> str:
    """Return the values that the grid gives a filter, as text; several in parentheses."""
    text = grid_phrases.heading(values)
    if len(values) > 1:
        return f"({text})"
    return text


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
    return f"{label} ({grid_phrases.heading(differing)})"
