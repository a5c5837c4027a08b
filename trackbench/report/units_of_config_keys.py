"""Units of keys of a config, such as those of the paths that a grid varies."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, cast

from trackbench.config.grid import single_paths
from trackbench.config.overrides import split_path
from trackbench.field_types import (
    Unit,
    UnitIf,
    annotations_of,
    dataclasses_in,
    hints_of,
    part_group,
)
from trackbench.models.assume import Assume
from trackbench.registry import Group, of_kind
from trackbench.report.findings import grid_headings
from trackbench.results.read_folder import ResultsFolder


def grid_units(results: ResultsFolder) -> dict[str, str]:
    """Return the unit of each single path of the grid that has one and whose name does not end in it.

    A key of the grid may join several paths with " & ", which then vary together; each of them is a
    single path. If no component of the state has a unit, that of the time is unknown, too.
    """
    units: dict[str, str] = {}
    for path in chain.from_iterable(map(single_paths, results.grid)):
        _, unit_in_name = grid_headings.quantity(path)
        if unit_in_name:
            continue
        keys = split_path(results.source, path)
        # A path that sets a component of the initial state, as `scenario.start.mean.px`, has the unit
        # of this component.
        unit = unit_of_key(results.config, keys) or _unit_of_component(results, path)
        is_time = path == "scenario.T"
        if unit and not (is_time and not any(_component_units(results).values())):
            units[path] = unit
    return units


def _component_units(results: ResultsFolder) -> dict[str, str]:
    """Return the unit of each component of the truth's state by name; empty if none is known."""
    facts = results.facts(results.points()[0])
    # `component` returns a name without its unit, and the unit.
    return {name: facts.component(c)[1] for c, name in enumerate(facts.components)}


def _unit_of_component(results: ResultsFolder, path: str) -> str:
    """Return the unit of a component of the initial state that a path of the grid sets.

    Such a path is ``scenario.start.mean.px``. The unit of any other path is empty.
    """
    parent, _, component = path.rpartition(".")
    if parent in ("scenario.start.mean", "scenario.start.sigma", "scenario.target.initial"):
        return _component_units(results).get(component, "")
    return ""


def unit_of_key(config: Mapping[str, Any], keys: Sequence[str | int]) -> str:
    """Return the unit of a key of the config; empty if none is known.

    The ``keys`` are its path, such as `filters`, `EKF`, `motion`, `q`, or `scenario`, `sensor`, 0,
    `sigma`.
    """
    if keys[0] == "filters":
        group = "filters"
        settings = config["filters"][keys[1]]
        inner_keys = keys[2:]
    else:
        group = "scenarios"
        settings = config[str(keys[0])]
        inner_keys = keys[1:]
    if not inner_keys:  # the path is that of a whole filter or scenario
        return ""
    # A component of a group has its class by its `kind`, so that no ``cls`` is passed.
    return unit_of_setting(settings, group=group, cls=None, keys=inner_keys)


def unit_of_setting(
    settings: Any, group: str | None, cls: type[Any] | None, keys: Sequence[str | int]
) -> str:
    """Return the unit of the key at the path ``keys`` in ``settings``.

    The settings are those of a component of ``group``, such as "filters", or of the dataclass ``cls`` if
    ``group`` is None. The unit is empty if the component is unknown or the key has no unit.
    """
    key = str(keys[0])
    inner_keys = keys[1:]
    if group is not None:
        # Only a filter may lack its kind: it is an EKF.
        cls = of_kind(cast(Group, group), settings.get("kind", "ekf"))
    hint = None
    if cls is not None:
        hint = hints_of(cls).get(key)
    if key == "assume" and hint is None and inner_keys:
        # A filter without this key takes the model of the scenario.
        return unit_of_setting(settings.get(key) or {}, group=None, cls=Assume, keys=inner_keys)
    if hint is None:
        return ""
    # A key of a component or dataclass inside this one.
    if inner_keys:
        inner_settings = settings.get(key)
        # The item of a list, such as one of several sensors.
        index = inner_keys[0]
        if isinstance(index, int) and isinstance(inner_settings, list | tuple):
            inner_settings = inner_settings[index]
            inner_keys = inner_keys[1:]
        if not inner_keys:
            return ""
        if not isinstance(inner_settings, dict):
            return ""
        inner_classes = dataclasses_in(hint)
        inner_class = inner_classes[0] if len(inner_classes) == 1 else None
        return unit_of_setting(inner_settings, part_group(hint), inner_class, inner_keys)
    # The unit that another key's value decides, else the unit of the key.
    annotations = annotations_of(hint)
    for annotation in annotations:
        if isinstance(annotation, UnitIf) and settings.get(annotation.key) == annotation.value:
            return annotation.unit
    for annotation in annotations:
        if isinstance(annotation, Unit):
            return annotation.unit
    return ""
