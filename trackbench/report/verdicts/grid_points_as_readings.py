"""Points of the grid as readings of a paper: those that differ for certain filters, and their names."""

from typing import Any

from trackbench.config.grid import single_paths
from trackbench.config.overrides import split_path
from trackbench.report.findings import phrases
from trackbench.report.tables_and_figures import Results


def searched_points(
    results: Results, labels: list[str]
) -> tuple[list[str], list[tuple[list[str], dict[str, Any]]]]:
    """List the combinations of those values of the grid that concern the filters ``labels``.

    Each combination is a reading of a paper, an interpretation of what the paper leaves open.

    Returns
    -------
    tuple[list[str], list[tuple[list[str], dict[str, Any]]]]
        headings of the paths that vary these filters or the scenario, and the combinations of their
        values. A combination is the values as texts, and the first point of the grid that has them.
    """
    paths = [path for path in results.grid if _varies_scenario_or_filters(results, path, labels)]
    # Points that differ in other paths only are one reading: the first stands for it.
    points_by_values: dict[tuple[str, ...], dict[str, Any]] = {}
    for point in results.points():
        values = tuple(phrases.number(point[path]) for path in paths)
        points_by_values.setdefault(values, point)
    # A column is called by the last word of its key, by two words if that is ambiguous. Of paths that
    # vary together, which have one column, the first is taken.
    keys_of_paths = [split_path(results.source, single_paths(path)[0]) for path in paths]
    last_words = [keys[-1] for keys in keys_of_paths]
    heads = []
    for keys in keys_of_paths:
        words = keys[-1:] if last_words.count(keys[-1]) == 1 else keys[-2:]
        heads.append(".".join(map(str, words)))
    return heads, [(list(values), point) for values, point in points_by_values.items()]


def _varies_scenario_or_filters(results: Results, path: str, labels: list[str]) -> bool:
    """Test whether a path of the grid varies the scenario, or one of the filters ``labels``."""
    for single_path in single_paths(path):
        # Such as `scenario`, `sensor`, `sigma`, or `filters`, `EKF`, `motion`, `q`.
        keys = split_path(results.source, single_path)
        if keys[0] == "scenario" or keys[1] in labels:
            return True
    return False


def reading_name(heads: list[str], values: list[str]) -> str:
    """Name a reading by its values, each behind its heading."""
    return ", ".join(f"{head} {value}" for head, value in zip(heads, values, strict=True))
