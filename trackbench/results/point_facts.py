"""Facts about each point of the grid, ``points.json``.

Tables, figures and verdicts need them beside numbers. A reader of the folder needs no scenario, plugin
or data file.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from trackbench.config.dump import as_config, entry_keys
from trackbench.config.experiment import Point
from trackbench.config.python_tables import path_from
from trackbench.evaluation.consistency_and_calibration import sizes
from trackbench.metrics import unit_of, without_unit
from trackbench.statistics.intervals import AcceptedNis
from trackbench.yaml_source import unprintable_reason

POINTS_FILE = "points.json"

GridPoint: TypeAlias = dict[str, Any]
"""Values of a point of the grid, by path; empty without a grid."""


def printable_json(text: str) -> Any:
    """Parse a JSON file; raises ValueError for control characters in its texts.

    Anybody may have written it, and a terminal obeys some of these characters.
    """
    content = json.loads(text)
    for word in _texts(content):
        if what := unprintable_reason(word):
            raise ValueError(what)
    return content


def _texts(content: object) -> Iterator[str]:
    """Yield all texts in the content of a JSON file, names of keys included."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict | list):
        inner = [*content, *content.values()] if isinstance(content, dict) else content
        for value in inner:
            yield from _texts(value)


@dataclass(frozen=True)
class PointFacts:
    """A point of the grid as plain data."""

    values: dict[str, Any]
    """values of the grid's paths"""
    scenario: dict[str, Any]
    """keys of the scenario, with defaults"""
    filters: dict[str, dict[str, Any]]
    """keys of each filter that was run, with defaults"""
    components: list[str]
    """components of the truth"""
    measured: list[str]
    """components of a measurement"""
    sizes: dict[str, int]
    """dimension of the state, and of the parts that have a consistency measure"""
    spans: list[list[float]]
    """start and end times of the shaded parts of a figure over time, s"""
    angles: list[str] | None = None
    """components of the truth that are angles"""
    judged: list[int] | None = None
    """first and last step that count, of one recorded run"""

    def accepted_nis(self, label: str) -> AcceptedNis | None:
        """Return the law of the NIS of what a filter's gate accepts; None without a gate."""
        keys = self.filters.get(label, {})
        keys = keys["filter"] if isinstance(keys.get("filter"), dict) else keys
        gate = keys.get("gate")
        if not isinstance(gate, float) or not 0.0 < gate < 1.0 or not self.measured:
            return None
        sizes = [len(self.measured)]
        if isinstance(self.scenario.get("sensor"), list):
            # Components of several sensors begin with the sensor's number.
            sizes = [*Counter(name.partition(".")[0] for name in self.measured).values()]
        return AcceptedNis(gate, tuple(sizes), each=keys.get("gate_by") == "sensor")

    def component(self, c: int) -> tuple[str, str]:
        """Name component c of the truth, and its unit; empty where none is known."""
        name = self.components[c]
        is_angle = name in (self.angles or ())
        return without_unit(name)[0], unit_of(f"rmse_{name}") or "rad" * is_angle


def facts_of_point(point: Point, shown: Callable[[str], str] = str) -> PointFacts:
    """Collect the facts about a point; ``shown`` formats the paths of data files."""
    scenario = point.scenario
    filters = {label: as_config(part, shown) for label, part in point.filters.items()}
    for label, assume in point.assumed.items():
        filters[label] |= entry_keys(assume, shown)
    judged = None
    if scenario.recorded_runs == 1:
        steps = scenario.steps[scenario.windows[""]]
        judged = [int(steps[0]), int(steps[-1])] if len(steps) else []
    return PointFacts(
        dict(point.values),
        as_config(scenario, shown),
        filters,
        list(scenario.components),
        list(scenario.true_sensor.components),
        dict(sizes(scenario)),
        [[*map(float, span)] for span in scenario.spans],
        [*scenario.angles] or None,
        judged,
    )


def points_text(points: Sequence[Point], folder: Path) -> str:
    """Write the file's content: a line per point, with what differs from the first point.

    Paths of data files are relative to ``folder``.
    """
    facts = (facts_of_point(point, partial(path_from, folder=folder)) for point in points)
    first: dict[str, Any] = {}
    lines = []
    for one in facts:
        known = {key: value for key, value in asdict(one).items() if value is not None}
        lines.append(json.dumps(_changed(first, known) if first else known))
        first = first or known
    return "[" + ",\n".join(lines) + "]\n"


def same_points(stored: str, computed: str) -> bool:
    """Test whether a file's content is the computed one, but for keys of newer versions.

    The config does not name such a key, so it has its default.
    """
    try:
        return stored == computed or _is_part(json.loads(stored), json.loads(computed))
    except ValueError:
        return False


def _is_part(stored: Any, computed: Any) -> bool:
    if isinstance(stored, dict) and isinstance(computed, dict):
        return all(k in computed and _is_part(value, computed[k]) for k, value in stored.items())
    if isinstance(stored, list) and isinstance(computed, list):
        return len(stored) == len(computed) and all(map(_is_part, stored, computed))
    return bool(stored == computed)


def points_in(text: str) -> Iterator[PointFacts]:
    """Yield the points of a file; raises ValueError, KeyError or TypeError for other content."""
    first, *others = printable_json(text)
    yield PointFacts(**first)
    for other in others:
        filters = {**first["filters"], **other.get("filters", {})}
        yield PointFacts(**{**first, **other, "filters": filters})


def _changed(first: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Keep the facts that differ; of filters, label by label."""
    filters = {b: keys for b, keys in other["filters"].items() if keys != first["filters"].get(b)}
    out = {key: value for key, value in other.items() if value != first.get(key)}
    return {**out, "filters": filters} if filters else out


def array_prefix(i: int, points: int) -> str:
    """Prefix the array names of the ``i``-th of so many points of a grid."""
    return f"point{i}/" if points > 1 else ""
