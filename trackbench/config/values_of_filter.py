"""Values of all keys of a filter and of its filter model, by path, as tuning and lists need them."""

from collections.abc import Iterator
from typing import Any

from trackbench.config.component_as_config import as_config
from trackbench.config.experiment import Experiment
from trackbench.config.filter_model import places_of_model
from trackbench.yaml_source import Keys


def configured_values(experiment: Experiment, label: str) -> dict[str, Any]:
    """Return the values of the keys of a filter, and of its filter model, by path: ``assume.motion.q``.

    Presets and defaults are included, and the model that the filter takes from the scenario.
    """
    point = experiment.points[0]
    filters = point.filters | experiment.left_out
    config = as_config(filters[label])
    assumed = {}
    if label in point.assumed:
        assumed = as_config(point.assumed[label])
        # The treatment of late measurements is a key of the filter's entry, beside `assume`.
        config["late"] = assumed.pop("late", None)
    # A component that the filter does not set is that of the scenario.
    scenario = {"scenario": as_config(point.scenario)}
    for component in ("motion", "sensor", "start"):
        # The first place is the filter's own `assume`, which is in ``assumed`` already.
        for place in places_of_model(label, component)[1:]:
            if assumed.get(component) is None:
                assumed[component] = _value_at(scenario, place)
    config["assume"] = assumed
    return dict(_walk_values(config))


def _value_at(data: Any, keys: Keys) -> Any:
    """Return the value at this path of keys in nested mappings; None if there is none."""
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data


def _walk_values(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and value of every scalar in nested mappings and lists: ``motions.1.q``, 0.3.

    ``path`` is that of ``data`` itself.
    """
    if isinstance(data, list):
        data = dict(enumerate(data))
    if not isinstance(data, dict):
        yield path, data
        return
    for key, value in data.items():
        inner_path = f"{path}.{key}" if path else str(key)
        yield from _walk_values(value, inner_path)
