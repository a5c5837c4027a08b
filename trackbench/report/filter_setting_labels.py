"""Labels of a filter's settings: the keys that a grid gives it, `EKF (q = 2)`."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from trackbench.config.grid import filters_of, single_paths, values_of
from trackbench.report.findings import grid_headings
from trackbench.report.points_by_scenario import points_of
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
    text = grid_headings.heading(values)
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
    return f"{label} ({grid_headings.heading(differing)})"


class Form(NamedTuple):
    """A filter with one set of its varied keys: its name, and the first point that has them."""

    name: str
    point: GridPoint


def forms_of_filter(results: Results, scene: GridPoint, label: str) -> list[Form]:
    """List the forms of a filter in one scenario: the different sets of keys that the grid gives it.

    A form is named by the keys that differ, and has the first point of the grid with these keys.
    """
    variants: list[dict[str, Any]] = []
    points = []
    for point in points_of(results, scene):
        keys = results.facts(point).filters.get(label)
        if keys is not None and keys not in variants:
            variants.append(keys)
            points.append(point)
    forms = []
    for keys, point in zip(variants, points, strict=True):
        forms.append(Form(name=named_form(label, keys, variants), point=point))
    return forms
