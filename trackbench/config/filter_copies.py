"""Copies of filters in a config, such as tuned and smoothed ones: each stands behind its original."""

from collections.abc import Mapping

from trackbench.yaml_source import Source


def is_entry(source: Source, label: str) -> bool:
    """Test whether the config has a filter of this label, written as a mapping."""
    keys = ("filters", label)
    return source.has(keys) and isinstance(source.value_at(keys), dict)


def put_after_originals(source: Source, copies: Mapping[str, str]) -> None:
    """Move each copy of a filter behind its original; ``copies`` has the copies' labels by original."""
    filters = source.data["filters"]
    entries = {label: filters.pop(copy_label) for label, copy_label in copies.items()}
    # Each filter moves to the end of the mapping in turn, with its copy behind it.
    for label in list(filters):
        filters[label] = filters.pop(label)
        if label in entries:
            filters[copies[label]] = entries[label]
