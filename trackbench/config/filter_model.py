"""Keys of every filter's entry: the filter model, and the treatment of late measurements."""

import copy
from collections.abc import Mapping
from dataclasses import fields, replace

from trackbench.config.build_components import build
from trackbench.config.experiment import (
    Point,
)
from trackbench.config.overrides import override
from trackbench.field_types import InvalidKeyError
from trackbench.models.assume import Assume
from trackbench.models.sensors.base import SensorBase
from trackbench.plugins.plugin_errors import PluginError, plugin_code
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Keys, Source

_KEYS_WITH_TRUE_MODEL = {"faults", "delay", "late"}
"""Keys of ``assume`` that leave the true model, so that the reference filter may have them."""


def read_assumed(source: Source, label: str) -> Assume | None:
    """Read the filter model of a filter's entry, from `assume` and `late`; None without these keys."""
    entry = source.data["filters"][label]
    if not isinstance(entry, dict):
        return None
    entry_place = ("filters", label)
    # Step 1: the filter model under `assume`.
    assume = None
    if entry.get("assume") is not None:
        keys = (*entry_place, "assume")
        is_mapping = isinstance(entry["assume"], dict)
        is_true_model = is_mapping and set(entry["assume"]) <= _KEYS_WITH_TRUE_MODEL
        if label == source.data.get("reference") and not is_true_model:
            message = "the reference filter uses the true model; leave this key out"
            source.add_key_problem(keys, message)
        if not is_mapping:
            source.add_problem(keys, "is not a mapping")
            return None
        assume = build(Assume, source, keys)
    # Step 2: the treatment of late measurements, if it stands beside `assume`.
    if entry.get("late") is None:
        return assume
    with_late = build(Assume, source, entry_place, {"late": entry["late"]})
    if with_late is None or assume is None:
        return with_late
    # `assume` itself has a treatment of late measurements, or (`delay: none`) none arrives late.
    if assume.delay or assume.late:
        source.add_key_problem(
            (*entry_place, "late"), "has no effect beside `assume`; leave one out"
        )
        return assume
    return replace(assume, late=with_late.late)


def check_assumed(source: Source, point: Point, label: str) -> Scenario | None:
    """Return the scenario as the filter ``label`` models it; None if there is none.

    The reason is then added to the source.
    """
    keys = ("filters", label, "assume")
    try:
        with plugin_code(point.assumed.get(label)):
            try:
                scenario = point.assumed_scenario(label)
                # Both are computed at their first use, which may raise.
                _ = scenario.model
                _ = scenario.prior_type
            except InvalidKeyError as error:
                # The key stands in the filter's entry, or, if it has no model, in the scenario.
                owner = keys[:2] if label in point.assumed else ("scenario",)
                source.add_problem((*owner, *error.path), str(error))
                return None
    except (ValueError, PluginError) as error:
        source.add_problem(keys, str(error))
        return None
    return scenario


_TRUE_COMPONENTS: Mapping[str, Keys] = {
    "motion": ("scenario", "target", "motion"),
    "sensor": ("scenario", "sensor"),
    "start": ("scenario", "start"),
}
"""Keys of the true component that filters assume by default, by the component's key in `assume`."""


def places_of_model(label: str, component: str) -> list[Keys]:
    """Return the keys at which the model of a filter may stand, the first that is set counts.

    These are the filter's `assume`, that of the scenario, and the true component.
    """
    places: list[Keys] = [
        ("filters", label, "assume", component),
        ("scenario", "assume", component),
    ]
    if component in _TRUE_COMPONENTS:
        places.append(_TRUE_COMPONENTS[component])
    return places


def copy_model(source: Source, label: str, path: str) -> None:
    """Copy the model of a key such as ``assume.motion.q`` to the filter if it has none of its own.

    The copied model is the one that the filter assumes anyway: that of the scenario's `assume`, or the
    true one. Of other keys nothing is copied. ``path`` is that of the key in the filter's entry.
    """
    root, _, inner_path = path.partition(".")
    component, _, key = inner_path.partition(".")
    if root != "assume" or not key:
        return
    # The places in their order of precedence: the first that is set counts.
    filter_model, *places = places_of_model(label, component)
    for place in (filter_model, *places):
        if not source.is_set(place):
            continue
        model = copy.deepcopy(source.value_at(place))
        if place == filter_model or not isinstance(model, dict | list):
            return
        # No filter models keys such as `detection` and `bias`: they describe true measurements alone.
        if place == _TRUE_COMPONENTS["sensor"]:
            drop_true_keys(model)
        override(source, filter_model, model, source.mark(place))
        return


def drop_true_keys(sensors: object) -> None:
    """Drop the keys of a true sensor, or of each in a list, that no filter models, as `outliers`."""
    for sensor in sensors if isinstance(sensors, list) else [sensors]:
        if isinstance(sensor, dict):
            for key in fields(SensorBase):
                sensor.pop(key.name, None)
