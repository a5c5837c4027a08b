"""What tables, figures and verdicts know of each point of the grid besides its numbers: ``points.json``.

A results folder holds it, so that whoever reads the folder needs no scenario, plugin or data file.
"""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from trackbench.config.dump import as_config
from trackbench.config.experiment import Point
from trackbench.evaluation.consistency import sizes

POINTS_FILE = "points.json"


@dataclass(frozen=True)
class PointFacts:
    """A point of the grid in plain data."""

    values: dict[str, Any]
    """of the grid's paths"""
    scenario: dict[str, Any]
    """keys of the scenario, with defaults"""
    filters: dict[str, dict[str, Any]]
    """keys of each filter that was run, with defaults"""
    components: list[str]
    """of the truth"""
    measured: list[str]
    """components of a measurement"""
    sizes: dict[str, int]
    """components of the state, and of the parts that have a consistency measure of their own"""
    spans: list[list[float]]
    """start and end times of what a figure over time shades, s"""


def facts_of_point(point: Point, shown: Callable[[str], str] = str) -> PointFacts:
    """What is to be known of a point; ``shown`` is how paths of data files are written."""
    scenario = point.scenario
    filters = {label: as_config(part, shown) for label, part in point.filters.items()}
    for label, assume in point.assumed.items():
        assumed = {k: v for k, v in as_config(assume, shown).items() if v is not None}
        filters[label]["assume"] = assumed
    return PointFacts(
        dict(point.values),
        as_config(scenario, shown),
        filters,
        list(scenario.components),
        list(scenario.true_sensor.components),
        dict(sizes(scenario)),
        [[float(t) for t in span] for span in scenario.spans],
    )


def points_text(points: Sequence[Point], folder: Path) -> str:
    """The file's content: a point a line, of all but the first what differs from the first.

    Paths of data files count from ``folder``.
    """
    whole = [
        asdict(facts_of_point(point, partial(os.path.relpath, start=folder))) for point in points
    ]
    lines = [json.dumps(whole[0]), *(json.dumps(_changed(whole[0], other)) for other in whole[1:])]
    return "[" + ",\n".join(lines) + "]\n"


def same_points(stored: str, made: str) -> bool:
    """Whether a file's content is what is made now, but for keys that there were not yet.

    Of a key that the config does not name there is nothing to say but its default.
    """
    try:
        return stored == made or _within(json.loads(stored), json.loads(made))
    except ValueError:
        return False


def _within(stored: Any, made: Any) -> bool:
    if isinstance(stored, dict) and isinstance(made, dict):
        return all(key in made and _within(value, made[key]) for key, value in stored.items())
    if isinstance(stored, list) and isinstance(made, list):
        return len(stored) == len(made) and all(map(_within, stored, made))
    return bool(stored == made)


def points_in(text: str) -> Iterator[PointFacts]:
    """The points of a file's content; raises ValueError, KeyError or TypeError if it is none."""
    first, *others = json.loads(text)
    yield PointFacts(**first)
    for other in others:
        filters = {**first["filters"], **other.get("filters", {})}
        yield PointFacts(**{**first, **other, "filters": filters})


def _changed(first: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """What differs; of filters, label by label."""
    filters = {b: keys for b, keys in other["filters"].items() if keys != first["filters"].get(b)}
    out = {key: value for key, value in other.items() if value != first[key]}
    return {**out, "filters": filters} if filters else out


def array_prefix(i: int, points: int) -> str:
    """What the names of the arrays of the ``i``-th of so many points of a grid start with."""
    return f"point{i}/" if points > 1 else ""
