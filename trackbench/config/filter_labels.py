"""Labels of filters in messages: unknown labels, and the name of a filter at a grid point."""

from collections.abc import Mapping

from trackbench.config.experiment_keys import Settings
from trackbench.config.key_mistakes import unknown
from trackbench.yaml_source import Keys, Source


def add_label_problem(source: Source, settings: Settings, where: Keys, label: str) -> None:
    """Add the problem of a label that no filter has."""
    hint = unknown(label, list(settings.filters))
    parts = [part.strip() for part in label.split(",")]
    if len(parts) > 1 and all(part in settings.filters for part in parts):
        hint = "write several as a list, [A, B], or as several options: --only A --only B"
    source.add_problem(where, f"{label!r} is not a filter here; {hint}")


def filter_at_point(label: str, values: Mapping[str, object]) -> str:
    """Name a filter at a grid point, for people: ``PF at scenario.R = 0.1``.

    ``values`` are those of the grid's paths at the point, none without a grid.
    """
    if not values:
        return label
    point = ", ".join(f"{path} = {value}" for path, value in values.items())
    return f"{label} at {point}"
