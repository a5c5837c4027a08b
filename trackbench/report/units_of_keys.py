"""Unit of a key of a config, such as that of a path that a grid varies."""

from collections.abc import Sequence
from typing import Any, cast

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
