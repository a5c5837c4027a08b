"""The parts of a config that name a ``kind``: a mapping into the registered dataclass."""

from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast, get_args, get_origin

from trackbench.config.build_dataclass import build, file_keys, hints_of, unknown
from trackbench.config.includes import deep_merge
from trackbench.config.plugin_checks import check_sensors
from trackbench.extension_points import Part
from trackbench.field_types import part_group
from trackbench.models.assumed_sensor import Assume
from trackbench.plugins.errors import PluginError, plugin_code
from trackbench.registry import Group, kinds, of_kind
from trackbench.yaml_source import Keys, Source, dotted, marked, put

T = TypeVar("T")

_GONE = {
    ("scenarios", "recorded"): "recorded data are a target now: {kind: tracking, target: {kind: "
    "measured, measurements: m.csv, truth: t.csv}, sensor: ..., start: one-scan, assume: {motion: "
    "...}}; prior_mean and prior_sigma are the start {kind: given, mean: [...], sigma: [...]}"
}
"""What to say of kinds that there were."""


def build_kind(group: Group, source: Source, keys: Keys) -> Any:
    """Return the registered dataclass that the mapping at ``keys`` asks for by its ``kind``."""
    data = source.at(keys)
    if not isinstance(data, dict) or "kind" not in data:
        needs = "needs a kind" if isinstance(data, dict) else "is not a mapping with a kind"
        if not any(p.path == dotted(keys) for p in source.problems):  # else it has been said
            source.add_problem(keys, needs)
        return None
    kind = data["kind"]
    cls = of_kind(group, kind) if isinstance(kind, str) else None
    if cls is None:
        what = f"{kind!r} is not a kind of {group[:-1]}; {unknown(str(kind), list(kinds(group)))}"
        what = _GONE.get((group, kind), what) if isinstance(kind, str) else what
        source.add_problem((*keys, "kind"), what)
        return None
    own = _with_absolute_files(cls, source, keys, _with_preset(cls, source, keys))
    also = ["preset"] if cls.presets else []
    if group == "filters":  # a key of every filter: see `read_assumed`
        own.pop("assume", None)
        also.append("assume")
    return _built(cls, own, source, keys, also)


def build_plain(cls: type[T], source: Source, keys: Keys) -> T | None:
    """Return a dataclass without a kind from the mapping at ``keys``, with the parts it has."""
    data = source.at(keys)
    if not isinstance(data, dict):
        source.add_problem(keys, "is not a mapping")
        return None
    return _built(cls, data, source, keys)


def read_assumed(source: Source, label: str) -> Assume | None:
    """Return the filter model that the key ``assume`` of a filter's entry gives, if it has one."""
    entry = source.data["filters"][label]
    if not isinstance(entry, dict) or entry.get("assume") is None:
        return None
    keys = ("filters", label, "assume")
    if label == source.data.get("reference"):
        source.add_key_problem(keys, "the reference filter uses the true model; leave this key out")
    return build_plain(Assume, source, keys)


def _built(
    cls: type[T], data: dict[str, object], source: Source, keys: Keys, also: Sequence[str] = ()
) -> T | None:
    inner = _InnerParts(source, [])
    numbered = inner.numbered(cls, data, keys)
    try:
        check_sensors(inner.parts)
        with plugin_code(cls, *inner.parts):
            built = build(cls, source, keys, numbered, inner.parts, also)
    except PluginError as error:
        source.add_problem(keys, str(error))
        return None
    return None if None in inner.parts else built


class _InnerParts(NamedTuple):
    """The components within a component, in the order of the numbers that stand for them."""

    source: Source
    parts: list[object]

    def numbered(self, cls: type, data: dict[str, object], keys: Keys) -> dict[str, object]:
        """Build the components in the mapping of a dataclass; return it with their numbers."""
        hints, out = hints_of(cls), dict(data)
        for key in hints.keys() & data.keys():
            out[key] = self._value(hints[key], data[key], (*keys, key))
        return out

    def _value(self, hint: object, value: object, keys: Keys) -> Any:
        group = part_group(hint)
        if group is not None and not (value is None and _may_be(hint, type(None))):
            return self._number(cast(Group, group), hint, value, keys)
        inner = [h for h in (hint, *get_args(hint)) if isinstance(h, type) and is_dataclass(h)]
        if len(inner) == 1 and isinstance(value, dict):
            return self.numbered(inner[0], value, keys)
        return value

    def _number(self, group: Group, hint: object, value: object, keys: Keys) -> int:
        if isinstance(value, list) and _may_be(hint, tuple):
            if not value:
                self.source.add_problem(keys, f"is empty: name at least one of {group}")
            items = [self._part(group, (*keys, i)) for i in range(len(value))]
            self.parts.append(None if None in items or not items else tuple(items))
        else:
            self.parts.append(self._part(group, keys))
        return len(self.parts) - 1

    def _part(self, group: Group, keys: Keys) -> Any:
        """Return the part at ``keys``; a word is a kind without keys of its own."""
        value = self.source.at(keys)
        if isinstance(value, str):
            mark = self.source.mark(keys)
            put(self.source.at(keys[:-1]), keys[-1], marked({"kind": value}, mark), mark)
        return build_kind(group, self.source, keys)


def _may_be(hint: object, cls: type) -> bool:
    """Return whether a key of this type may hold an instance of the class."""
    options = (hint, *get_args(hint), *(o for inner in get_args(hint) for o in get_args(inner)))
    return any(cls in (option, get_origin(option)) for option in options)


def _with_absolute_files(
    cls: type, source: Source, keys: Keys, data: dict[str, object]
) -> dict[str, object]:
    """Return the paths count from the folder of the YAML file they stand in."""
    out = dict(data)
    for key in file_keys(cls):
        mark = source.mark((*keys, key))
        folder = Path(mark.file).parent if mark.line else Path()
        given = data.get(key)
        if isinstance(given, str):
            out[key] = str((folder / given).absolute())
        elif isinstance(given, list):
            out[key] = [str((folder / g).absolute()) if isinstance(g, str) else g for g in given]
    return out


def _with_preset(cls: type[Part], source: Source, keys: Keys) -> dict[str, object]:
    presets, data = cls.presets, {k: v for k, v in source.at(keys).items() if k != "kind"}
    name = data.pop("preset", None) if presets else None
    if name is None:
        return data
    where = (*keys, "preset")
    if not isinstance(name, str) or name not in presets:
        other = unknown(str(name), list(presets))
        source.add_problem(where, f"{name!r} is not a preset of {cls.kind}; {other}")
        return data
    if any(presets.values()) and all(deep_merge(p, data) == data for p in presets.values()):
        what = f"no preset of {cls.kind} changes anything: all that they set is given"
        source.add_problem(where, what)
    return deep_merge(presets[name], data)
