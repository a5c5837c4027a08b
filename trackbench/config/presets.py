"""Presets of a kind: named sets of keys, chosen by the key `preset`."""

from collections.abc import Mapping

from trackbench.component_parts import Part
from trackbench.config.did_you_mean import unknown
from trackbench.config.includes import deep_merge
from trackbench.yaml_source import Keys, Source


def with_preset(
    cls: type[Part], entry: Mapping[str, object], source: Source, keys: Keys
) -> dict[str, object]:
    """Return the values of a component's keys: those of its preset, replaced by those of ``entry``."""
    presets = cls.presets
    values = {key: value for key, value in entry.items() if key != "kind"}
    # A class without presets may have a key of this name.
    name = values.pop("preset", None) if presets else None
    if name is None:
        return values
    where = (*keys, "preset")
    if not isinstance(name, str) or name not in presets:
        hint = unknown(str(name), list(presets))
        source.add_problem(where, f"{name!r} is not a preset of {cls.kind}; {hint}")
        return values
    # A preset is a mistake if all keys that any preset sets are given beside it.
    if any(presets.values()) and all(deep_merge(p, values) == values for p in presets.values()):
        message = f"no preset of {cls.kind} changes anything: all that they set is given"
        source.add_problem(where, message)
    return deep_merge(presets[name], values)
