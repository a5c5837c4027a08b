"""The parts of a config that name a ``kind``: a mapping into the registered dataclass."""

from collections.abc import Sequence
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast, get_args, get_origin

from trackbench.config.build_dataclass import at, build, file_keys, hints_of, unknown
from trackbench.config.includes import deep_merge
from trackbench.config.plugin_checks import mistaken_sensor
from trackbench.extension_points import foreign_parts
from trackbench.field_types import part_group
from trackbench.plugins.errors import located_message
from trackbench.plugins.interrupts import guarded
from trackbench.registry import Group, kinds, of_kind
from trackbench.yaml_source import Keys, Source, dotted

T = TypeVar("T")

_GONE = {
    ("scenarios", "recorded"): "recorded data are a target now: {kind: tracking, target: {kind: "
    "measured, measurements: m.csv, truth: t.csv}, sensor: ..., start: one-scan, assume: {motion: "
    "...}}; prior_mean and prior_sigma are the start {kind: given, mean: [...], sigma: [...]}"
}
"""What to say of kinds that there were."""


def build_kind(group: Group, source: Source, keys: Keys) -> Any:
    """Return the registered dataclass that the mapping at ``keys`` asks for by its ``kind``."""
    data = at(source, keys)
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
    if group == "filters":  # of every filter: see `trackbench.config.assumed_model`
        own.pop("assume", None)
        also.append("assume")
    return _built(cls, own, source, keys, also)


def build_plain(cls: type[T], source: Source, keys: Keys) -> T | None:
    """Return a dataclass without a kind from the mapping at ``keys``, with the parts it has."""
    data = at(source, keys)
    if not isinstance(data, dict):
        source.add_problem(keys, "is not a mapping")
        return None
    return _built(cls, data, source, keys)


def _built(
    cls: type[T], own: dict[str, Any], source: Source, keys: Keys, also: Sequence[str] = ()
) -> T | None:
    inner = _Inner(source, [])
    part = source.subtree(keys, inner.numbered(cls, own, keys))
    what, built = mistaken_sensor(inner.made), None
    if what is not None:
        source.add_problem(keys, what)
        return None
    try:
        with guarded():
            built = build(cls, part, (), inner.made, also)
    except Exception as error:
        foreign = foreign_parts((cls, *inner.made))
        if not foreign:
            raise
        part.add_problem((), located_message(error, *foreign))
    source.problems += [
        replace(p, path=".".join(filter(None, [dotted(keys), p.path]))) for p in part.problems
    ]
    return None if None in inner.made else built


class _Inner(NamedTuple):
    """The parts within a part, made one after another; a number stands for each in the mapping."""

    source: Source
    made: list[Any]

    def numbered(self, cls: type[Any], data: dict[str, Any], keys: Keys) -> dict[str, Any]:
        """Return the mapping of a dataclass with its parts, and those of mappings in it, made."""
        hints, out = hints_of(cls), dict(data)
        for key in hints.keys() & data.keys():
            out[key] = self._made(hints[key], data[key], (*keys, key))
        return out

    def _made(self, hint: Any, value: Any, keys: Keys) -> Any:
        group = part_group(hint)
        if group is not None and not (value is None and _may_be(hint, type(None))):
            return self._number(cast(Group, group), hint, value, keys)
        inner = [h for h in (hint, *get_args(hint)) if isinstance(h, type) and is_dataclass(h)]
        if len(inner) == 1 and isinstance(value, dict):
            return self.numbered(inner[0], value, keys)
        return value

    def _number(self, group: Group, hint: Any, value: Any, keys: Keys) -> int:
        if isinstance(value, list) and _may_be(hint, tuple):
            if not value:
                self.source.add_problem(keys, f"is empty: name at least one of {group}")
            parts = [self._part(group, (*keys, i)) for i in range(len(value))]
            self.made.append(None if None in parts or not parts else tuple(parts))
        else:
            self.made.append(self._part(group, keys))
        return len(self.made) - 1

    def _part(self, group: Group, keys: Keys) -> Any:
        """Return the part at ``keys``; a word is a kind without keys of its own."""
        value = at(self.source, keys)
        if not isinstance(value, str):
            return build_kind(group, self.source, keys)
        mark, parent = self.source.mark(keys), at(self.source, keys[:-1])
        parent[keys[-1]] = {"kind": value}
        self.source.marks[(*keys, "kind")] = mark
        return build_kind(group, self.source, keys)


def _may_be(hint: Any, cls: type[Any]) -> bool:
    """Return whether a key of this type may hold an instance of the class."""
    options = (hint, *get_args(hint), *(o for inner in get_args(hint) for o in get_args(inner)))
    return any(cls in (option, get_origin(option)) for option in options)


def _with_absolute_files(
    cls: type[Any], source: Source, keys: Keys, data: dict[str, Any]
) -> dict[str, Any]:
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


def _with_preset(cls: type[Any], source: Source, keys: Keys) -> dict[str, Any]:
    presets, data = cls.presets, {k: v for k, v in at(source, keys).items() if k != "kind"}
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
