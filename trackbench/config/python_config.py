"""Config that is given in Python as a mapping: its values as plain data."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from trackbench.errors import Problem
from trackbench.unsafe_characters import explain_formula, unprintable_reason
from trackbench.yaml_source import DEEPEST, Keys, Source, dotted, marked


@runtime_checkable
class _NumpyValue(Protocol):
    """An array or number of numpy, which is not imported for it."""

    def tolist(self) -> object:
        """Return the value as plain numbers and lists."""


def from_mapping(config: Mapping[str, object]) -> Source:
    """Copy a Python mapping as a source; raises UserError for what YAML cannot express."""
    source = Source(None)
    source.data = marked(_as_plain(config, (), source), source.start)
    source.check()
    return source


def _as_plain(value: object, keys: Keys, source: Source) -> Any:
    """Return a Python value as plain data: mappings, lists and scalars.

    What a config cannot express becomes None, with a problem added to the source.
    """
    mistake = _inexpressible(value, keys)
    if mistake:
        source.problems.append(Problem(source.start, dotted(keys), mistake))
        return None
    if isinstance(value, Mapping):
        return {key: _as_plain(inner, (*keys, key), source) for key, inner in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_as_plain(inner, (*keys, i), source) for i, inner in enumerate(value)]
    if isinstance(value, _NumpyValue):  # an array, or a number of numpy
        return _as_plain(value.tolist(), keys, source)
    if isinstance(value, Path):
        return str(value)
    return value


def _inexpressible(value: object, keys: Keys) -> str | None:
    """Explain why a Python value cannot be written into a config; None if it can."""
    if len(keys) > DEEPEST:
        return f"nested more than {DEEPEST} levels deep"
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            return "a key must be a word"
        # Keys may be labels, which are cells of CSV files: a spreadsheet would run `=A1` as a formula.
        reasons = (unprintable_reason(key) or explain_formula(key) for key in value)
        return next(filter(None, reasons), None)
    if isinstance(value, str):
        return unprintable_reason(value)
    expressible = (bool, int, float, Path, Sequence, _NumpyValue, type(None))
    if isinstance(value, bytes) or not isinstance(value, expressible):
        name = type(value).__name__
        return f"is of the type {name}; a config holds words, numbers, lists and mappings"
    return None
