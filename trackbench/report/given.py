"""What the config gives a part at a point of the grid."""

from copy import deepcopy
from typing import Any

from trackbench.experiment.problems import Mark
from trackbench.experiment.reading.parts import build_kind
from trackbench.experiment.reading.points import take
from trackbench.experiment.reading.resolved import as_config
from trackbench.experiment.reading.source import Keys, Source
from trackbench.experiment.reading.validate import at
from trackbench.registry import Group
from trackbench.report.results import Results, is_same


def keys_at(results: Results, point: dict[str, Any], where: Keys) -> dict[str, Any]:
    """The keys of the scenario, or of a filter, at a point of the grid.

    With the defaults of its kind, if that is known: a plugin is not loaded for a report.
    """
    source = Source(deepcopy(results.config))
    for values in results.every_point:
        if is_same(values, point):
            take(source, values, dict.fromkeys(values, Mark("grid")))
    group: Group = "filters" if where[0] == "filters" else "scenarios"
    built = build_kind(group, source, where, [])
    keys: dict[str, Any] = at(source, where)
    return keys if built is None else as_config(built)
