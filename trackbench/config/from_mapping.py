"""A config that Python gives as a mapping, as if it had been read from a file."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from trackbench.errors import Mark, UserError
from trackbench.yaml_source import DEEPEST, Keys, Source, formula, unprintable_reason

Config: TypeAlias = Path | str | Mapping[str, Any]
"""A file, the name of a shipped experiment, or what a file would say as a mapping."""
_MARK = Mark("config")


def source_of(config: Mapping[str, Any]) -> Source:
    """Return a copy of the mapping as plain data; raises UserError for what YAML cannot express."""
    source = Source(None)
    source.data = _plain(config, (), source)
    if source.problems:
        raise UserError(*source.problems)
    source.key_marks = dict(source.marks)
    return source


def _plain(value: Any, keys: Keys, source: Source) -> Any:
    source.marks[keys] = _MARK
    for what in _mistakes(value, keys):
        source.add_problem(keys, what)
        return None
    if isinstance(value, Mapping):
        return {key: _plain(inner, (*keys, key), source) for key, inner in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(inner, (*keys, i), source) for i, inner in enumerate(value)]
    if hasattr(value, "tolist"):  # of numpy
        return _plain(value.tolist(), keys, source)
    return str(value) if isinstance(value, Path) else value


def _mistakes(value: Any, keys: Keys) -> Iterator[str]:
    if len(keys) > DEEPEST:
        yield f"nested more than {DEEPEST} levels deep"
    elif isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            yield "a key must be a word"
        yield from filter(
            None, (unprintable_reason(key) or formula(key) for key in value if isinstance(key, str))
        )
    elif isinstance(value, str) and unprintable_reason(value):
        yield str(unprintable_reason(value))
    elif isinstance(value, bytes) or not (
        value is None
        or isinstance(value, str | bool | int | float | Path | Sequence)
        or hasattr(value, "tolist")
    ):
        name = type(value).__name__
        yield f"is of the type {name}; a config holds words, numbers, lists and mappings"
