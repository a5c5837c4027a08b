"""Descriptions that `trackbench describe` prints: a kind with its keys, hooks of a group."""

import dataclasses
import inspect
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import TYPE_CHECKING

from trackbench.component_parts import Part
from trackbench.config.strict_validator import adapter
from trackbench.field_types import dataclasses_in, key_of, part_group
from trackbench.help.metrics import JsonRow, columns, described, facts
from trackbench.metrics import METRICS
from trackbench.plugin_class_hooks import hooks, overridden_hooks
from trackbench.registry import GROUPS, Group, base_of, kinds
from trackbench.yaml_scalars import one_line_yaml

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def description(word: str) -> str:
    """Document a word: a kind, a metric, or a group's hooks; raises UserError for an unknown word.

    A kind is a class that a config may name, such as the filter ``kf``. A group has all kinds of one
    sort, such as ``filters``. Hooks are the methods that a class of the group may have.
    """
    if word in GROUPS:
        return _describe_hooks(word)
    # The classes of all groups that have such a kind: none for a metric; an unknown word raises.
    texts = [_describe_kind(word, group, cls) for group, cls in _classes_of(word)]
    text_of_metric = described(word)  # None if there is no such metric
    if text_of_metric:
        texts.append(text_of_metric)
    return "\n\n".join(texts)


def entries(word: str) -> Iterator[JsonRow]:
    """Yield the `description` of a word as data.

    There is an entry for each group that has such a kind, and one for a metric of this name. The entries
    of a group are its hooks.
    """
    if word in GROUPS:
        for hook in hooks(base_of(word)):
            yield {"group": word, "hook": hook.form, "needed": hook.needed, "text": hook.text}
        return
    for group, cls in _classes_of(word):
        yield {
            "group": group,
            "kind": word,
            "text": "\n\n".join(paragraphs(cls.__doc__ or "")),
            "keys": _keys_for_programs(group, cls),
            "presets": cls.presets if group == "filters" else {},
            "notes": list(_notes(group, cls)),
        }
    metric_facts = facts(word)
    if metric_facts:
        yield {**metric_facts, "keys": [], "presets": {}, "notes": []}


def _keys_for_programs(group: str, cls: type[Part]) -> list[JsonRow]:
    """Describe every key as data; the default of a key that a config must have is None."""
    keys: list[JsonRow] = []
    for key, default, text in _rows_of_keys(group, cls):
        default_of_key = None if default == "required" else default
        keys.append({"key": key, "default": default_of_key, "text": text})
    return keys


def experiment_keys() -> list[dict[str, str]]:
    """Describe the top level of an experiment file: key, default and text."""
    from trackbench.config.experiment_keys import Settings

    return _as_data(list(_key_rows(Settings, "")))


def assume_keys() -> list[dict[str, str]]:
    """Describe the keys of a filter model, which every filter has: key, default and text."""
    return _as_data(_assume_rows())


def _assume_rows() -> list[tuple[str, str, str]]:
    """Describe the keys of a filter model: key, default and text.

    The key `late` is written beside `assume`, the others in it.
    """
    from trackbench.models.assume import Assume

    rows = []
    for key, default, text in _key_rows(Assume, "assume."):
        rows.append((key.replace("assume.late", "late"), default, text))
    return rows


def _as_data(rows: list[tuple[str, str, str]]) -> list[dict[str, str]]:
    return [dict(zip(("key", "default", "text"), row, strict=True)) for row in rows]


def _classes_of(kind: str) -> list[tuple[Group, type[Part]]]:
    """Find the groups that have a kind of this name, each with the class; empty for a metric.

    Raises UserError if there is no metric of this name, either.
    """
    from trackbench.config.did_you_mean import unknown
    from trackbench.errors import Mark, Problem, UserError

    classes = [(group, kinds(group)[kind]) for group in GROUPS if kind in kinds(group)]
    if not classes and described(kind) is None:
        known_words: list[str] = [*GROUPS]
        for group in GROUPS:
            known_words += kinds(group)
        known_words += METRICS
        message = f"there is no such kind; {unknown(kind, known_words)}"
        raise UserError(Problem(Mark("describe"), kind, message))
    return classes


def _rows_of_keys(group: str, cls: type[Part]) -> list[tuple[str, str, str]]:
    """Return key, default and text of every key of a class; a filter has those of `assume`, too."""
    rows = list(_key_rows(cls, ""))
    if group == "filters":
        rows += _assume_rows()
    return rows


def _describe_hooks(group: Group) -> str:
    """List the methods that a class of the group must have, and those that it may have."""
    base = base_of(group)
    declared = list(hooks(base))
    rows = list(columns((hook.form, hook.text) for hook in declared))
    number_of_needed = sum(hook.needed for hook in declared)  # these come first
    lines = [paragraphs(base.__doc__ or "")[0], ""]
    lines += [f"a class of the group {group} has:", *rows[:number_of_needed], ""]
    lines += ["and may have:", *rows[number_of_needed:]]
    return "\n".join(lines)


def _describe_kind(kind: str, group: Group, cls: type[Part]) -> str:
    """Document a kind of a group: the docstring of its class, keys, presets, notes and explanation."""
    lines = [f"{kind} ({group[:-1]})", ""]  # without the plural's s: filter, target
    lines += [paragraph + "\n" for paragraph in paragraphs(cls.__doc__ or "")]
    lines += columns(_rows_of_keys(group, cls))
    for name, keys in cls.presets.items():
        lines.append(f"\n  preset {name}: {preset_text(keys)}")
    lines += [f"\n  {note}" for note in _notes(group, cls)]
    if cls.explain():
        lines.append("\n" + cls.explain())
    return "\n".join(lines)


def preset_text(keys: Mapping[str, object]) -> str:
    """Write the keys of a preset as YAML in one line; "the defaults" if there are none."""
    if not keys:
        return "the defaults"
    return ", ".join(f"{key}: {one_line_yaml(value)}" for key, value in keys.items())


def _notes(group: Group, cls: type[Part]) -> Iterator[str]:
    """Yield further facts about a kind, a line each."""
    from trackbench.models.sensors.base import SensorBase
    from trackbench.scenarios.base import Scenario
    from trackbench.scenarios.targets.base import Target

    if issubclass(cls, Scenario):
        defaults = [_default_text(field) for field in dataclasses.fields(cls)]
        if "required" not in defaults:
            model = cls().model
            yield f"components of the state: {','.join(model.motion.components)}"
            yield f"components of the measurement: {','.join(model.sensor.components)}"
    if issubclass(cls, Target) and "windows" in vars(cls):
        text = " ".join(paragraphs(cls.windows.__doc__ or "")).replace("``", "")
        yield f"windows of metrics: {text.removeprefix('Select ')}"
    if issubclass(cls, SensorBase):
        yield f"components of the measurement: {','.join(cls.components)}"
    names = overridden_hooks(cls, base_of(group))
    if names:
        yield f"hooks (see `trackbench describe {group}`): {', '.join(names)}"


def _key_rows(cls: "type[DataclassInstance]", prefix: str) -> Iterator[tuple[str, str, str]]:
    """Yield key, default and text of each field of a dataclass, and of the dataclasses in it.

    The fields are keys of a config. ``prefix`` is put before each key, as ``assume.``.
    """
    from trackbench.config.strict_validator import adapter
    from trackbench.field_types import hints_of

    schema = adapter(cls).json_schema()
    texts = help_texts(cls)
    hints = hints_of(cls)
    for field in dataclasses.fields(cls):
        # Step 1: the key itself.
        key = key_of(field.name)
        text = texts.get(key, "")
        choices = schema["properties"][key].get("enum")
        if choices:
            text += f" ({' | '.join(map(str, choices))})"
        group = part_group(hints[field.name])
        if group is not None:  # the key holds a component, such as a sensor
            yield prefix + key, _default_text(field), f"{text} (see `trackbench list {group}`)"
            continue
        yield prefix + key, _default_text(field), text
        # Step 2: the keys of each dataclass that the key may hold. A row that all of these dataclasses
        # have comes once. Other rows name the kind of their dataclass: ``key[kind].name``.
        nested_classes = dataclasses_in(hints[field.name])
        rows_by_class = [list(_key_rows(nested, "")) for nested in nested_classes]
        for i, nested in enumerate(nested_classes):
            for row in rows_by_class[i]:
                is_shared = all(row in rows for rows in rows_by_class)
                if is_shared and i > 0:
                    continue
                name, default, nested_text = row
                kind = "" if is_shared else f"[{nested.kind}]"
                yield f"{prefix}{key}{kind}.{name}", default, nested_text


def _default_text(field: "dataclasses.Field[object]") -> str:
    """Write the default of a key as YAML, or in words.

    A key without a default is ``required``, ``none`` stands for null, and ``empty`` for an empty list or
    mapping. ``as below`` stands for a dataclass, whose own keys are listed below this key.
    """
    if field.default is dataclasses.MISSING:
        if field.default_factory is dataclasses.MISSING:
            return "required"
        return "empty"
    if dataclasses.is_dataclass(field.default):
        return "as below"
    if field.default is None:
        return "none"
    return one_line_yaml(field.default)


def paragraphs(doc: str) -> list[str]:
    """Split a docstring into paragraphs, each on one line."""
    raw_paragraphs = inspect.cleandoc(doc).split("\n\n")
    return [" ".join(paragraph.split()) for paragraph in raw_paragraphs]


def help_texts(cls: type) -> dict[str, str]:
    """Look up the meaning of each key: the docstring under the field, in the class or a base."""
    texts: dict[str, str] = {}
    # Bases come first, so that the class's own docstrings replace theirs.
    for base in reversed(cls.__mro__):
        if not is_dataclass(base):
            continue
        properties = adapter(base, documented=True).json_schema().get("properties", {})
        for key, schema in properties.items():
            if "description" in schema:
                texts[key] = schema["description"]
    return texts
