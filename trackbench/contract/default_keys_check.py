"""Check that a filter has default keys, and that its instances can be compared and pickled."""

import pickle
from dataclasses import MISSING, fields, is_dataclass

from trackbench.contract.findings import ContractError
from trackbench.filters.base import AnyFilter


def keys_without_default(cls: type[AnyFilter]) -> list[str]:
    """Name the keys of the filter class that have no default, so that every config must set them."""
    if not is_dataclass(cls):
        return []  # `with_defaults` reports this
    names = []
    for field in fields(cls):
        has_default = field.default is not MISSING or field.default_factory is not MISSING
        if field.init and not has_default:
            names.append(field.name)
    return names


def with_defaults(cls: type[AnyFilter]) -> AnyFilter:
    """Return the filter with its default keys.

    Raises ContractError unless the filter can be hashed, compared and pickled.
    """
    if not is_dataclass(cls):
        raise ContractError("is not a dataclass (frozen=True, kw_only=True)")
    tracker = cls()
    equal_tracker = cls()
    try:
        if hash(tracker) != hash(equal_tracker) or tracker != equal_tracker:
            raise ContractError("two equal filters differ: make it @dataclass(frozen=True)")
    except TypeError as error:
        message = f"cannot be hashed ({error}): frozen=True, tuples and not lists"
        raise ContractError(message) from None
    if pickle.loads(pickle.dumps(tracker)) != tracker:
        raise ContractError("does not survive the way to another process")
    return tracker
