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

from trackbench.config.component_as_config import as_config
from trackbench.config.experiment import Point
from trackbench.config.python_tables import path_from
from trackbench.config.resolved_config import entry_keys
from trackbench.evaluation.nees import sizes
from trackbench.models.angle_components import unit_of_component
from trackbench.statistics.consistency_bands import AcceptedNis
from trackbench.units_of_components import without_unit
from trackbench.unsafe_characters import printable_json

POINTS_FILE = "points.json"

GridPoint: TypeAlias = dict[str, Any]
"""Values of a point of the grid, by path; empty without a grid."""


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
        """Return the distribution of the NIS of measurements that a filter's gate accepts.

        ``label`` is that of the filter. The result is None if the filter has no gate.
        """
        keys = self.filters.get(label, {})
        # A filter that wraps another one has its keys under `filter`, the gate among them.
        if isinstance(keys.get("filter"), dict):
            keys = keys["filter"]
        # The probability of a good measurement within the gate.
        gate = keys.get("gate")
        if not isinstance(gate, float) or not 0.0 < gate < 1.0 or not self.measured:
            return None
        # Numbers of components that each sensor measures.
        sizes = [len(self.measured)]
        if isinstance(self.scenario.get("sensor"), list):
            # Components of several sensors begin with the sensor's number.
            numbers = [name.partition(".")[0] for name in self.measured]
            sizes = list(Counter(numbers).values())
        # `each`: every sensor has a gate of its own, in place of one for the whole measurement.
        return AcceptedNis(gate, tuple(sizes), each=keys.get("gate_by") == "sensor")

    def component(self, c: int) -> tuple[str, str]:
        """Return the name of component c (an index) of the truth without its unit, and the unit.

        The unit is empty if none is known.
        """
        name = self.components[c]
        plain_name, _ = without_unit(name)
        return plain_name, unit_of_component(name, self.angles or ())


def facts_of_point(point: Point, shown: Callable[[str], str] = str) -> PointFacts:
    """Collect the facts about a point; ``shown`` formats the paths of data files."""
    scenario = point.scenario
    filters = {label: as_config(part, shown) for label, part in point.filters.items()}
    for label, assume in point.assumed.items():
        filters[label] |= entry_keys(assume, shown)
    # First and last step that count, of a single recorded run.
    judged = None
    if scenario.recorded_runs == 1:
        # The nameless window is of all steps that count.
        steps = scenario.steps[scenario.windows[""]]
        judged = []
        if len(steps):
            judged = [int(steps[0]), int(steps[-1])]
    return PointFacts(
        values=dict(point.values),
        scenario=as_config(scenario, shown),
        filters=filters,
        components=list(scenario.components),
        measured=list(scenario.true_sensor.components),
        sizes=dict(sizes(scenario)),
        spans=[[float(begin), float(end)] for begin, end in scenario.spans],
        angles=list(scenario.angles) or None,
        judged=judged,
    )


def points_text(points: Sequence[Point], folder: Path) -> str:
    """Return the content of points.json: the first point's facts, then how each point differs from it.

    Paths of data files are relative to ``folder``.
    """
    first: dict[str, Any] = {}
    lines = []
    for point in points:
        facts = asdict(facts_of_point(point, partial(path_from, folder=folder)))
        # Facts that are None, the default of their fields, are not written.
        known = {key: value for key, value in facts.items() if value is not None}
        if first:
            lines.append(json.dumps(_differences(first, known)))
        else:
            first = known
            lines.append(json.dumps(known))
    return "[" + ",\n".join(lines) + "]\n"


def same_points(stored: str, computed: str) -> bool:
    """Test whether the stored content of points.json has the facts of the computed content.

    The stored content may lack keys of newer versions, which its config does not set.
    """
    try:
        return stored == computed or _is_part(json.loads(stored), json.loads(computed))
    except ValueError:
        return False


def _is_part(stored: Any, computed: Any) -> bool:
    """Test whether all keys of the stored JSON content have the computed values, at every level."""
    if isinstance(stored, dict) and isinstance(computed, dict):
        return all(k in computed and _is_part(value, computed[k]) for k, value in stored.items())
    if isinstance(stored, list) and isinstance(computed, list):
        return len(stored) == len(computed) and all(map(_is_part, stored, computed))
    return bool(stored == computed)


def points_in(text: str) -> Iterator[PointFacts]:
    """Yield the facts in the content of points.json, a point each.

    Raises ValueError, KeyError or TypeError for other content.
    """
    # A later point has only the facts in which it differs from the first.
    first, *others = printable_json(text)
    yield PointFacts(**first)
    for other in others:
        filters = {**first["filters"], **other.get("filters", {})}
        yield PointFacts(**{**first, **other, "filters": filters})


def _differences(first: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Return the facts of a point that differ from the first point's; of filters only those that differ.

    Both are fields of `PointFacts` by name. All points have filters of the same labels. A fact that only
    the first point has is None.
    """
    differences = {key: value for key, value in other.items() if value != first.get(key)}
    for key in first:
        if key not in other:
            differences[key] = None
    filters = {}
    for label, keys in other["filters"].items():
        if keys != first["filters"].get(label):
            filters[label] = keys
    if filters:
        differences["filters"] = filters
    return differences


def array_prefix(i: int, points: int) -> str:
    """Return the prefix of the names of point i's arrays in a file; empty if there is only one point.

    ``points`` is the number of points of the grid.
    """
    if points <= 1:
        return ""
    return f"point{i}/"
