"""Types for config keys: a dataclass field's type says what a YAML may put there."""

import re
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass
from functools import cache
from itertools import chain
from keyword import iskeyword
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    NamedTuple,
    TypeAlias,
    TypeGuard,
    TypeVar,
    cast,
    get_args,
    get_type_hints,
)

from annotated_types import Ge, Gt, Interval

from trackbench.errors import Answer

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler
    from pydantic_core.core_schema import CoreSchema, ValidationInfo, ValidatorFunctionWrapHandler

Count = Annotated[int, Interval(ge=1, le=10**15)]
"""A number of things, at least one."""
MOST_STEPS = 100_000
Steps = Annotated[int, Interval(ge=1, le=MOST_STEPS)]
"""A number of time steps; bounded, since every series holds one value per step."""
Natural = Annotated[int, Ge(0)]
Positive = Annotated[float, Gt(0), Interval(lt=float("inf"))]
NonNegative = Annotated[float, Ge(0), Interval(lt=float("inf"))]
Finite = Annotated[float, Interval(gt=float("-inf"), lt=float("inf"))]
Share = Annotated[float, Interval(ge=0, le=1)]
"""A number in [0, 1]."""
OpenShare = Annotated[float, Interval(gt=0, lt=1)]
"""A number in (0, 1)."""
Digits = Annotated[int, Interval(ge=1, le=15)]
"""Significant digits of a number in a table or figure."""

FORMULA = "=+-@"
"""Characters at which a spreadsheet begins a formula, even in a file from elsewhere."""
_INVISIBLE = r"\x00-\x1f\x7f-\x9f\u2028\u2029"
ONE_LINE = rf"^[^{_INVISIBLE}{re.escape(FORMULA)}][^{_INVISIBLE}]*$"
"""Pattern of a name: one line of visible characters that does not begin a formula."""
LEGEND_LABEL = rf"^[^{_INVISIBLE}{re.escape(FORMULA)}_][^{_INVISIBLE}]*$"
"""Pattern of a label of a legend: such a line that does not begin with ``_`` either.

matplotlib leaves out of a legend what begins with ``_``.
"""

IS_FILE = "path of a data file"
DataFile = Annotated[str, IS_FILE]
"""A path, relative to the YAML file that names it; the dataclass gets the absolute path."""

IS_WORD = "word of a command line, or path of a file in it"
ProgramWord = Annotated[str, IS_WORD]
"""A word of a command; the dataclass gets the absolute path of one that is a file beside the YAML."""

IS_VARIABLE = "name of an environment variable"
VariableName = Annotated[str, IS_VARIABLE]
"""Name of an environment variable, on whose value cached blocks depend."""


class Unit(NamedTuple):
    """Annotation of a key that has a unit: ``sigma: Annotated[float, Unit("m")]``."""

    unit: str


class ByKind:
    """Annotation of a union of dataclasses that differ in their key ``kind``."""

    def __get_pydantic_core_schema__(
        self, source: object, handler: "GetCoreSchemaHandler"
    ) -> "CoreSchema":
        """Build the validator that chooses by the kind."""
        from pydantic import Field

        return handler.generate_schema(Annotated[source, Field(discriminator="kind")])


class UnitIf(NamedTuple):
    """Annotation of a key whose unit is ``unit`` if the key named ``key`` has the value ``value``."""

    key: str
    value: str
    unit: str


class Place(NamedTuple):
    """A mistake in a data file: line and column count from 1."""

    file: str
    line: int
    column: int
    message: str
    answer: Answer | None = None
    """key that the message proposes, for a command that has options in place of keys"""


class DataError(ValueError):
    """Mistakes in a data file, place by place."""

    def __init__(self, *places: Place) -> None:
        super().__init__("; ".join(f"{p.file}:{p.line}: {p.message}" for p in places))
        self.places = places


class InvalidKeyError(ValueError):
    """A mistake in a key, or in an item of a list, of the dataclass that is being made."""

    def __init__(self, message: str, *path: str | int) -> None:
        super().__init__(message)
        self.path = path


def check_window_name(name: str) -> None:
    """Raise InvalidKeyError for a name that metrics cannot have in brackets."""
    if "[" in name or "]" in name:
        message = f"{name!r} has a bracket, and metrics enclose the name in brackets; leave it out"
        raise InvalidKeyError(message, "name")


class FrozenDict(dict[str, Any]):
    """A mapping of a frozen dataclass, which is hashed by its items in order."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(tuple(self.items()))


def freeze_mappings(component: Any) -> None:
    """Make the mappings among a dataclass's fields hashable, for its ``__post_init__``."""
    for name, value in vars(component).items():
        if isinstance(value, dict):
            object.__setattr__(component, name, FrozenDict(value))


ByComponent: TypeAlias = dict[str, Finite] | tuple[Finite, ...]
"""A number for each component of a state: by name, or in order."""


@dataclass(frozen=True)
class Registered:
    """Mark of a key that holds components: ``Annotated[Motion, Registered("motions")]``.

    A config gives a mapping with a ``kind``, or the kind alone. The validator's context reads it: it
    looks up the kind in the registry.
    """

    group: str
    """registry group of the component"""

    def __get_pydantic_core_schema__(
        self, source: object, handler: "GetCoreSchemaHandler"
    ) -> "CoreSchema":
        """Return a schema of any value: the context of the validation builds the components.

        ``source`` is the type of the key.
        """
        from pydantic_core import core_schema

        key = handler.field_name

        def read(value: object, info: "ValidationInfo") -> object:
            # The context is the `_Reader` of trackbench/config/build_components.py.
            reader: Any = info.context
            return reader.read(self.group, key, value, source)

        return core_schema.with_info_plain_validator_function(
            read, json_schema_input_schema=core_schema.any_schema()
        )


class HoldsComponents:
    """Base of a dataclass, itself no component, whose keys hold components, as ``Assume``."""

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: object, handler: "GetCoreSchemaHandler"
    ) -> "CoreSchema":
        """Return the dataclass's schema; it adds the key that holds the dataclass to the context's path.

        The context of the validation is the `_Reader` of trackbench/config/build_components.py. It thus
        knows where the components in the dataclass stand in the config.
        """
        from pydantic_core import core_schema

        if (key := handler.field_name) is None:  # the dataclass alone
            return handler(source)

        def read(
            value: object, validate: "ValidatorFunctionWrapHandler", info: "ValidationInfo"
        ) -> object:
            """Validate the dataclass while its key is in the path of the context."""
            reader: Any = info.context
            reader.path.append(key)
            try:
                return validate(value)
            finally:
                reader.path.pop()

        return core_schema.with_info_wrap_validator_function(read, handler(source))


def is_number(value: object) -> TypeGuard[float]:
    """Test whether a value of a config is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def decimals(text: str) -> int:
    """Count the decimals of a number as it is written: 2 of 0.20, 4 of 1.5e-3."""
    mantissa, _, power = text.lower().partition("e")
    return max(0, len(mantissa.partition(".")[2]) - int(power or 0))


def annotations_of(hint: object) -> tuple[object, ...]:
    """Return what an ``Annotated`` type carries beside the type."""
    return getattr(hint, "__metadata__", ())


def dataclasses_in(hint: object) -> list[type[Any]]:
    """Find the dataclasses that a value of this type, or an item of it, may be."""
    if isinstance(hint, type) and is_dataclass(hint):
        return [hint]
    return [*chain.from_iterable(map(dataclasses_in, get_args(hint)))]


def part_group(hint: object) -> str | None:
    """Find the registry group of the components that a key of this type holds, if it holds any."""
    marks = annotations_of(hint)
    return next((mark.group for mark in marks if isinstance(mark, Registered)), None)


def key_of(field: str) -> str:
    """Name the YAML key of a dataclass's field: ``from`` of ``from_``, which Python reserves."""
    if field.endswith("_") and iskeyword(field[:-1]):
        return field[:-1]
    return field


F = TypeVar("F", bound=Callable[..., object])


def cached(function: F) -> F:
    """Cache a function of classes; mypy takes a class with type arguments for unhashable."""
    return cast(F, cache(function))


@cached
def hints_of(cls: type) -> dict[str, object]:
    """Look up the types of a dataclass's keys, with their annotations."""
    return get_type_hints(cls, include_extras=True)


def file_annotations(hint: object) -> set[object]:
    """Return which of `IS_FILE`, `IS_WORD` and `IS_VARIABLE` the type of a key has as annotations.

    They mark the path of a data file, a word of a command line, and the name of an environment variable.
    The annotation stands on the type itself, as in ``DataFile``, or on an option or item of it, as in
    ``tuple[DataFile, ...] | None``.

    Parameters
    ----------
    hint
        type of a key, with its annotations, as `hints_of` returns it

    Returns
    -------
    set
        annotations of the type and of all types in it; empty for a key that is none of the three
    """
    annotations: set[object] = {
        mark for mark in annotations_of(hint) if mark in (IS_FILE, IS_WORD, IS_VARIABLE)
    }
    for inner in get_args(hint):
        annotations |= file_annotations(inner)
    return annotations
