"""The parts of a config that name a ``kind``: a mapping into the registered dataclass."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from trackbench.experiment.problems import Mark, Problem
from trackbench.experiment.source import Keys, Source, dotted
from trackbench.experiment.validate import at, build, file_keys, unknown
from trackbench.keys import DataError
from trackbench.registry import Group, kinds


def build_kind(group: Group, source: Source, keys: Keys, problems: list[Problem]) -> Any:
    """The registered dataclass that the mapping at ``keys`` asks for by its ``kind``."""
    data = at(source, keys)
    if not isinstance(data, dict) or "kind" not in data:
        what = "needs a kind" if isinstance(data, dict) else "is not a mapping with a kind"
        problems.append(Problem(source.mark(keys), dotted(keys), what))
        return None
    known = kinds(group)
    kind = data["kind"]
    if not isinstance(kind, str) or kind not in known:
        what = f"{kind!r} is not a kind of {group[:-1]}; {unknown(str(kind), list(known))}"
        problems.append(Problem(source.mark((*keys, "kind")), dotted((*keys, "kind")), what))
        return None
    cls = known[kind]
    own = _with_absolute_files(cls, source, keys, _with_preset(cls, source, keys, problems))
    nested = {
        key: build_kind(inner, source, (*keys, key), problems)
        for key, inner in getattr(cls, "parts", {}).items()
        if own.pop(key, None) is not None
    }
    part = Source(own, {}, {})
    for mine, marks in ((part.marks, source.marks), (part.key_marks, source.key_marks)):
        mine.update({k[len(keys) :]: m for k, m in marks.items() if k[: len(keys)] == keys})
    found: list[Problem] = []
    built = build(cls, part, (), found)
    problems += [
        Problem(p.mark, ".".join(filter(None, [dotted(keys), p.path])), p.what) for p in found
    ]
    return _assembled(cls, built, nested, source, keys, problems)


def _assembled(
    cls: type[Any],
    built: Any,
    nested: dict[str, Any],
    source: Source,
    keys: Keys,
    problems: list[Problem],
) -> Any:
    """The dataclass with the parts it is made of, such as the scenario that a recorded one is like."""
    missing = [key for key in getattr(cls, "parts", {}) if key not in nested]
    for key in missing:
        where = dotted((*keys, key))
        problems.append(Problem(source.mark(keys), where, "this key is required"))
    if built is None or missing or None in nested.values():
        return None
    try:
        return replace(built, **nested) if nested else built
    except DataError as error:
        problems += [
            Problem(Mark(where.file, where.line, where.column), dotted(keys), where.what)
            for where in error.places
        ]
    except ValueError as error:
        problems.append(Problem(source.mark(keys), dotted(keys), str(error)))
    return None


def _with_absolute_files(
    cls: type[Any], source: Source, keys: Keys, data: dict[str, Any]
) -> dict[str, Any]:
    """Paths count from the folder of the YAML file they stand in."""
    out = dict(data)
    for key in file_keys(cls):
        if isinstance(data.get(key), str):
            mark = source.mark((*keys, key))
            folder = Path(mark.file).parent if mark.line else Path()
            out[key] = str((folder / data[key]).absolute())
    return out


def _with_preset(
    cls: type[Any], source: Source, keys: Keys, problems: list[Problem]
) -> dict[str, Any]:
    data = {k: v for k, v in at(source, keys).items() if k != "kind"}
    name = data.get("preset")
    presets = getattr(cls, "presets", {})
    if presets and name is None:
        data.pop("preset", None)
    if name is None or not presets:
        return data
    del data["preset"]
    where = (*keys, "preset")
    if not isinstance(name, str) or name not in presets:
        what = f"{name!r} is not a preset of {cls.kind}; {unknown(str(name), list(presets))}"
        problems.append(Problem(source.mark(where), dotted(where), what))
        return data
    if any(presets.values()) and all(_laid_over(p, data) == data for p in presets.values()):
        what = f"no preset of {cls.kind} changes anything: all that they set is given"
        problems.append(Problem(source.mark(where), dotted(where), what))
    return _laid_over(presets[name], data)


def _laid_over(base: dict[str, Any], top: dict[str, Any]) -> dict[str, Any]:
    """``base`` with the keys of ``top``; a mapping in both is laid over in the same way."""
    both = {
        key: _laid_over(base[key], value)
        if isinstance(value, dict) and isinstance(base.get(key), dict)
        else value
        for key, value in top.items()
    }
    return {**base, **both}
