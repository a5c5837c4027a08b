"""Names that a config may use: kinds, their keys, defaults and sources.

A listing reads docstrings without importing what it lists.
"""

import dataclasses
import inspect
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, cast

from trackbench.extension_points import Part, hooks, key_of, overridden_hooks
from trackbench.field_types import dataclasses_in, part_group
from trackbench.help.metrics import (
    JsonRow,
    columns,
    common_metrics,
    described,
    facts,
    statistics_known,
)
from trackbench.metrics import METRICS
from trackbench.registry import GROUPS, Group, base_of, documentation, kinds

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def listing(group: str) -> str:
    """List the kinds of a group with the first line of their documentation."""
    docs = documentation(cast(Group, group))
    rows = columns((kind, _paragraphs(doc)[0]) for kind, doc in docs.items())
    return "\n".join([f"{group}:", *rows])


def groups_with_counts() -> str:
    """List the groups, with their numbers of kinds and the first ones."""
    from trackbench.config.shipped_experiments import names

    known: dict[str, list[str]] = {group: [*documentation(group)] for group in GROUPS}
    known |= {"metrics": common_metrics(), "experiments": names()}
    sizes = {group: len(kinds) for group, kinds in known.items()} | {"metrics": len(METRICS)}
    rows = ((g, f"{sizes[g]:>3}", ", ".join([*k[:5], "..."][: sizes[g]])) for g, k in known.items())
    return "\n".join(["groups (trackbench list GROUP):", *columns(rows)])


def experiments() -> str:
    """List the shipped experiments grouped by paper, with their run times."""
    from itertools import groupby

    from trackbench.config.shipped_experiments import listed

    shipped = sorted(listed(), key=lambda one: (not one.paper, one.paper, one.name))
    width = max(len(one.name) for one in shipped)
    parts = ["experiments (trackbench run NAME; time on one processor):"]
    for paper, several in groupby(shipped, key=lambda one: one.paper):
        parts.append(f"\n  {paper or 'Beyond the papers'}")
        parts += [f"    {s.name:<{width}}  {_time(s.cpu_s):>6}  {s.title}" for s in several]
    return "\n".join(parts)


def problems() -> str:
    """List the standard problems with their versions, published numbers, references and times."""
    from trackbench.config.shipped_experiments import problems

    heads = ("name", "version", "numbers", "time", "reference", "title")
    rows = [heads]
    for p in problems():
        rows.append((p.name, f"v{p.version}", str(p.numbers), _time(p.cpu_s), p.reference, p.title))
    head = "standard problems (trackbench run NAME; cited as trackbench/NAME vVERSION, N runs;"
    return "\n".join([f"{head} time on one processor):", "", *columns(rows)])


def rows(groups: Sequence[str]) -> Iterator[JsonRow]:
    """Yield a row per kind, per shipped experiment and per standard problem."""
    from trackbench.config.shipped_experiments import listed, problems

    for group in groups:
        if group in ("metrics", "statistics"):
            known = METRICS if group == "metrics" else statistics_known()
            yield from filter(None, map(facts, known))
            continue
        if group in ("experiments", "problems"):
            shipped = listed() if group == "experiments" else problems()
            yield from ({"group": group, **one._asdict()} for one in shipped)
            continue
        for kind, doc in documentation(cast(Group, group)).items():
            yield {"group": group, "kind": kind, "text": _paragraphs(doc)[0]}


def _time(seconds: float | None) -> str:
    if seconds is None:
        return ""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def description(kind: str) -> str:
    """Document a kind, a metric, or a group's hooks; raises UserError."""
    if kind in GROUPS:
        return _hooks_of(kind)
    texts = [_described(kind, group, cls) for group, cls in _classes_of(kind)]
    return "\n\n".join([*texts, *filter(None, [described(kind)])])


def entries(kind: str) -> Iterator[JsonRow]:
    """Yield the description as data: one per group with such a kind, or one per hook of a group."""
    if kind in GROUPS:
        for hook in hooks(base_of(kind)):
            yield {"group": kind, "hook": hook.form, "needed": hook.needed, "text": hook.text}
        return
    for group, cls in _classes_of(kind):
        yield {
            "group": group,
            "kind": kind,
            "text": "\n\n".join(_paragraphs(cls.__doc__ or "")),
            "keys": _as_data(_rows(group, cls)),
            "presets": cls.presets if group == "filters" else {},
            "notes": [*_notes(group, cls)],
        }
    if metric := facts(kind):
        yield {**metric, "keys": [], "presets": {}, "notes": []}


def experiment_keys() -> list[dict[str, str]]:
    """Describe the top level of an experiment file: key, default and text."""
    from trackbench.config.experiment import Settings

    return _as_data(list(_key_rows(Settings, "")))


def assume_keys() -> list[dict[str, str]]:
    """Describe what every filter may assume: key, default and text."""
    return _as_data(_assume_rows())


def _assume_rows() -> list[tuple[str, str, str]]:
    from trackbench.models.sensors.base import Assume

    rows = [*_key_rows(Assume, "assume.")]
    return [(key.replace("assume.late", "late"), default, text) for key, default, text in rows]


def _as_data(rows: list[tuple[str, str, str]]) -> list[dict[str, str]]:
    return [dict(zip(("key", "default", "text"), row, strict=True)) for row in rows]


def _classes_of(kind: str) -> list[tuple[Group, type[Part]]]:
    """Find the groups with a kind of this name, each with its class; none for a metric."""
    from trackbench.config.mistakes import unknown
    from trackbench.errors import Mark, Problem, UserError

    classes = [(g, kinds(g)[kind]) for g in GROUPS if kind in kinds(g)]
    if not classes and described(kind) is None:
        known = [*GROUPS, *chain.from_iterable(map(kinds, GROUPS)), *METRICS]
        what = f"there is no such kind; {unknown(kind, known)}"
        raise UserError(Problem(Mark("describe"), kind, what))
    return classes


def _rows(group: str, cls: type[Part]) -> list[tuple[str, str, str]]:
    """Describe every key, including `assume`: key, default and text."""
    rows = list(_key_rows(cls, ""))
    if group == "filters":
        rows += _assume_rows()
    return rows


def _hooks_of(group: Group) -> str:
    base = base_of(group)
    declared = list(hooks(base))
    rows = list(columns((hook.form, hook.text) for hook in declared))
    needed = sum(hook.needed for hook in declared)  # which come first
    must = [f"a class of the group {group} has:", *rows[:needed]]
    may = ["and may have:", *rows[needed:]]
    return "\n".join([_paragraphs(base.__doc__ or "")[0], "", *must, "", *may])


def _described(kind: str, group: Group, cls: type[Part]) -> str:
    lines = [f"{kind} ({group[:-1]})", ""]
    lines += [paragraph + "\n" for paragraph in _paragraphs(cls.__doc__ or "")]
    lines += columns(_rows(group, cls))
    for name, keys in cls.presets.items():
        values = ", ".join(f"{k}: {v}" for k, v in keys.items()) or "the defaults"
        lines.append(f"\n  preset {name}: {values}")
    lines += [f"\n  {note}" for note in _notes(group, cls)]
    if cls.explain():
        lines.append("\n" + cls.explain())
    return "\n".join(lines)


def _notes(group: Group, cls: type[Part]) -> Iterator[str]:
    """Yield further facts about a kind, a line each."""
    from trackbench.models.sensors.base import SensorBase
    from trackbench.scenarios.base import Scenario
    from trackbench.scenarios.targets.base import Target

    if issubclass(cls, Scenario) and "required" not in map(_default, dataclasses.fields(cls)):
        model = cls().model
        yield f"components of the state: {','.join(model.motion.components)}"
        yield f"components of the measurement: {','.join(model.sensor.components)}"
    if issubclass(cls, Target) and "windows" in vars(cls):
        words = " ".join(_paragraphs(cls.windows.__doc__ or "")).replace("``", "")
        yield f"windows of metrics: {words.removeprefix('Select ')}"
    if issubclass(cls, SensorBase):
        yield f"components of the measurement: {','.join(cls.components)}"
    names = overridden_hooks(cls, base_of(group))
    if names:
        yield f"hooks (see `trackbench describe {group}`): {', '.join(names)}"


def _key_rows(cls: "type[DataclassInstance]", prefix: str) -> Iterator[tuple[str, str, str]]:
    """Yield key, default and text of each field; nested fields follow with their path."""
    from trackbench.config.build import adapter, help_texts, hints_of

    schema, texts = adapter(cls).json_schema(), help_texts(cls)
    hints = hints_of(cls)
    for field in dataclasses.fields(cls):
        key = key_of(field.name)
        choices = schema["properties"][key].get("enum")
        text = texts.get(key, "")
        text = f"{text} ({' | '.join(map(str, choices))})" if choices else text
        group = part_group(hints[field.name])
        if group is not None:
            yield prefix + key, _default(field), f"{text} (see `trackbench list {group}`)"
            continue
        yield prefix + key, _default(field), text
        # The keys of a dataclass within, or of each that the key may hold.
        nested = dataclasses_in(hints[field.name])
        every = [list(_key_rows(one, "")) for one in nested]
        for i, (one, rows) in enumerate(zip(nested, every, strict=True)):
            for name, default, text in rows:
                shared = all((name, default, text) in others for others in every)
                of_kind = "" if shared else f"[{one.kind}]"
                if not shared or i == 0:
                    yield f"{prefix}{key}{of_kind}.{name}", default, text


def _default(field: "dataclasses.Field[object]") -> str:
    if field.default is dataclasses.MISSING:
        return "required" if field.default_factory is dataclasses.MISSING else "empty"
    if dataclasses.is_dataclass(field.default):
        return "as below"
    return "none" if field.default is None else str(field.default)


def _paragraphs(doc: str) -> list[str]:
    return [" ".join(p.split()) for p in inspect.cleandoc(doc).split("\n\n")]
