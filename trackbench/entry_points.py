"""Entry points of installed packages, such as trackbench.filters, by which they offer components."""

import sys
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from typing import Any


def entries_of_group(group: str) -> EntryPoints:
    """Return the entry points of a group, such as ``trackbench.filters`` of filters."""
    return _installed_entries(tuple(sys.path)).select(group=f"trackbench.{group}")


@cache
def _installed_entries(path: tuple[str, ...]) -> Any:
    """Read the entry points of all packages on ``path``, which is `sys.path`.

    A file of every installed package is read, so it is done once for all groups.
    """
    return entry_points()
