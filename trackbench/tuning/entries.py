"""Tuned filters in a config: each an entry beside the one it is tuned from."""

import copy
from collections.abc import Iterable, Mapping
from typing import Any

from trackbench.experiment.files import free_name
from trackbench.experiment.problems import Mark
from trackbench.experiment.reading.compose import override, split_path
from trackbench.experiment.reading.source import Keys, Source
from trackbench.experiment.reading.validate import at
from trackbench.tuning.settings import tuned

Chosen = Mapping[str, Any]
"""Values of a filter's keys by their path within its entry: ``{assume.motion.q: 0.3}``."""


def add_tuned(source: Source, found: Mapping[str, Chosen]) -> None:
    """Beside each filter that is tuned one with what was ``found``, or before that with its own keys.

    An entry that stands there already, as in the config of a results folder, stays unless something
    is found. A table and a figure per filter say what tuning did.
    """
    wanted = [label for label in _mapping(source, ("tune",)) if _is_entry(source, label)]
    if not wanted:
        return
    for label in wanted:
        _check_own(source, label)
        if label in found or not _is_entry(source, tuned(label)):
            _copy(source, ("filters", label), ("filters", tuned(label)))
        _set(source, tuned(label), label, found.get(label, {}))
    _order(source, wanted)
    run = _with_tuned_of_only(source, wanted)
    _add_part(source, "tables", "tuning", {"kind": "tuning"})
    for label in run:
        _add_part(source, "figures", _file_name(label), {"kind": "tuning", "filter": label})


def _check_own(source: Source, label: str) -> None:
    """Blame an entry that has the tuned filter's label, but is not this filter with other values."""
    keys = _mapping(source, ("tune",))[label]
    if not isinstance(keys, dict) or not _is_entry(source, tuned(label)):
        return
    both = [label, tuned(label)]
    one, other = (with_values(source, of, dict.fromkeys(keys)).data["filters"][of] for of in both)
    if one != other:
        what = f"tuning gives this label to the tuned {label}: give this filter another label"
        source.blame_key(("filters", tuned(label)), what)


def with_values(source: Source, label: str, values: Chosen) -> Source:
    """A config of which this filter has other values; the rest is shared."""
    data = {**source.data, "filters": {**source.data["filters"]}}
    data["filters"][label] = copy.deepcopy(data["filters"][label])
    own = Source(data, dict(source.marks), dict(source.key_marks))
    _set(own, label, label, values)
    return own


def _set(source: Source, label: str, tuned_as: str, values: Chosen) -> None:
    for path, value in values.items():
        mark = source.mark(("tune", tuned_as, path))
        override(source, split_path(source, f"filters.{label}.{path}"), value, mark)


def _mapping(source: Source, keys: Keys) -> dict[str, Any]:
    value = source.data.get(keys[0])
    return value if isinstance(value, dict) else {}


def _is_entry(source: Source, label: str) -> bool:
    return isinstance(_mapping(source, ("filters",)).get(label), dict)


def _copy(source: Source, keys: Keys, to: Keys) -> None:
    """The value with the positions of all that is in it."""
    at(source, to[:-1])[to[-1]] = copied = copy.deepcopy(at(source, keys))
    source.graft(to, source.part(keys, copied))


def _order(source: Source, labels: Iterable[str]) -> None:
    """Each tuned filter behind its own."""
    filters = source.data["filters"]
    mine = {tuned(label): filters.pop(tuned(label)) for label in labels}
    out: dict[str, Any] = {}
    for label, entry in filters.items():
        out[label] = entry
        if tuned(label) in mine:
            out[tuned(label)] = mine[tuned(label)]
    source.data["filters"] = out


def _with_tuned_of_only(source: Source, labels: list[str]) -> list[str]:
    """Let ``only: [KF]`` run the tuned one, too; returns the labels that are tuned."""
    only = source.data.get("only")
    if not isinstance(only, list) or not only:
        return labels
    for label in labels:
        if label in only and tuned(label) not in only:
            mark = source.mark(("only", only.index(label)))
            only.append(tuned(label))
            source.marks["only", len(only) - 1] = mark
    return [label for label in labels if tuned(label) in only]


def _add_part(source: Source, group: str, name: str, part: dict[str, Any]) -> None:
    """A table or figure of tuning, unless the config has it."""
    parts = source.data.setdefault(group, {})
    if not isinstance(parts, dict) or part in parts.values():
        return
    if any(isinstance(p, dict) and part.items() <= p.items() for p in parts.values()):
        return
    mark = source.key_mark(("tune",))
    override(source, (group, free_name(name, parts)), part, mark if mark.line else Mark("tune"))


def _file_name(label: str) -> str:
    words = "".join(c if c.isascii() and c.isalnum() else " " for c in label).split()
    return "-".join(["tuning", *words])[:80]
