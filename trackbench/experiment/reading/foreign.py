"""Kinds of one's own, held to what the runner takes for granted, before anything runs.

What is asked here of a class that a plugin registers, and of a filter that a config makes of it, would
else end as a traceback, or in a number.
"""

from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, cast

from trackbench.experiment.blame import BadPluginError, blamed, place
from trackbench.experiment.interrupts import guarded
from trackbench.experiment.reading.validate import adapter
from trackbench.filters.base import AnyFilter, Filter, ReturnedError
from trackbench.hooks import Part, is_foreign
from trackbench.registry import base_of
from trackbench.scenarios.base import Scenario

_FILES = {"per_step", "per_run", "summary"}
_PLAIN = (bool, int, float, str, type(None))


def check_kind(cls: type[Part]) -> None:
    """Raise BadPluginError for a class that no config could make a part of."""
    for what in _mistakes(cls):
        raise BadPluginError(f"{place(ReturnedError('', ''), cls)}{cls.__name__}: {what}")


def _mistakes(cls: type[Part]) -> Iterator[str]:
    if cls.__hash__ is None:
        yield "is not frozen: @dataclass(frozen=True, kw_only=True)"
    if not isinstance(cls.presets, dict) or not all(
        isinstance(p, dict) for p in cls.presets.values()
    ):
        yield "presets is not a mapping of names to mappings of keys"
    if issubclass(cls, Filter):
        needs: Any = cls.needs
        if not isinstance(needs, tuple) or not all(isinstance(n, str) and "." in n for n in needs):
            yield f"needs is {needs!r}, not a tuple of names such as 'motion.F'"
        if isinstance(cls.counts, str):
            yield "counts is a word, not a set of words"
    if issubclass(cls, (base_of("tables"), base_of("figures"))):
        yield from _mistakes_of_exhibit(cls)
    for field in fields(cast(Any, cls)):
        default = _default(field)
        if field.init and not _is_plain(default):
            yield f"the key {field.name} is a {type(default).__name__}, which no YAML can hold"
    try:
        adapter(cls)
    except Exception as error:
        reason = str(error).split("\n", 1)[0].split(". Set `arb", 1)[0]
        yield f"has a key of a type that no YAML can hold: {reason}"


def _mistakes_of_exhibit(cls: type[Any]) -> Iterator[str]:
    needs = cls.needs
    if not isinstance(needs, dict) or not set(needs.values()) <= _FILES:
        yield f"needs is {needs!r}, not a mapping of metrics to {', '.join(sorted(_FILES))}"
    known = {field.name for field in fields(cls)}
    for name in ("label_keys", "numbers"):
        keys = getattr(cls, name, ())
        if not isinstance(keys, tuple) or not set(keys) <= known:
            yield f"{name} is {keys!r}, not a tuple of keys"


def _default(field: "Field[Any]") -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return None if field.default is MISSING else field.default


def _is_plain(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    if isinstance(value, dict):
        return all(map(_is_plain, (*value, *value.values())))
    return isinstance(value, _PLAIN) or (is_dataclass(value) and not isinstance(value, type))


def conflicts(tracker: AnyFilter, scenario: Scenario) -> dict[str, str]:
    """What a filter says that it cannot do here; and, of one's own, what else would stop the runner."""
    if not is_foreign(tracker):
        return tracker.conflicts(scenario)
    try:
        found: dict[str, str] = asked(tracker.conflicts, dict, scenario)
        sentences = asked(tracker.cautions, list, scenario)
        check_words(*found, *found.values(), *sentences)
        asked(tracker.held, int, scenario.model)
        for key in ("N", "particle_count", "most_particles"):
            number = getattr(tracker, key, 1)
            if not isinstance(number, int) or number < 1:
                raise ReturnedError(key, f"its {key} is {number!r}, no whole number")
        hash(tracker)
    except Exception as error:
        return {"": blamed(error, tracker)}
    return found


def check_words(*texts: object) -> None:
    """Raise ReturnedError for what is said in anything but words."""
    if not all(isinstance(text, str) for text in texts):
        raise ReturnedError("conflicts", "conflicts and cautions are words, and these are not")


def asked(hook: Callable[[Any], Any], kind: type[Any], about: Any) -> Any:
    """What a hook says. Raises what it raises, and ReturnedError for what is of another kind."""
    with guarded():
        found = hook(about)
    if not isinstance(found, (list, tuple) if kind is list else kind):
        what = f"{hook.__name__} gives a {type(found).__name__}, not a {kind.__name__}"
        raise ReturnedError(hook.__name__, what)
    return found
