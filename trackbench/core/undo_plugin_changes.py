"""Seal: finds and undoes changes of read-only memory, and of attributes, by code of plugins."""

import ctypes
from typing import Any

import numpy as np

from trackbench.core.constant_matrix_cache import results_by_identity
from trackbench.core.read_only import memory_owner, parts_of


class Seal:
    """Copies of the memory of all `fixed` arrays in some objects, to find and undo changes.

    numpy never writes there, but a library that takes the memory's address can. The attributes of the
    package's own objects are copied too: ``object.__setattr__`` can replace those of a frozen dataclass.
    """

    def __init__(self, *wholes: Any) -> None:
        """Copy the memory of all `fixed` arrays in the objects ``wholes``, and the attributes in them.

        ``wholes`` are searched to any depth, through their items and attributes (`parts_of`).
        """
        # By the id of the `bytes` object that an array shows: that object and a copy of its content.
        self._memory: dict[int, tuple[bytes, bytearray]] = {}
        # The attributes of each object of the package: the dictionary in use and a copy.
        self._attributes: list[tuple[dict[str, Any], dict[str, Any]]] = []
        waiting = [*wholes]
        visited = set[int]()
        # Walk through all parts, each of them once. They are objects that live on as items and
        # attributes, so that no other object gets the identity of one that was visited.
        while waiting:
            part = waiting.pop()
            owner = memory_owner(part)
            if isinstance(owner, bytes):
                self._memory[id(owner)] = owner, bytearray(owner)
            elif id(part) not in visited:
                visited.add(id(part))
                if type(part).__module__.startswith("trackbench.") and hasattr(part, "__dict__"):
                    self._attributes.append((vars(part), dict(vars(part))))
                waiting += [inner for _, inner in parts_of(part)]

    def mend(self) -> bool:
        """Undo all changes of the memory and attributes; return whether there was any.

        An attribute that was added, such as a cached value, is removed, but is not counted as a change.
        """
        changed = [(memory, copy) for memory, copy in self._memory.values() if memory != copy]
        if changed:
            for cache in results_by_identity:  # a result may come from the changed memory
                cache.clear()
        # Write the copy back to the address: numpy would refuse to write there.
        for memory, copy in changed:
            ctypes.memmove(np.frombuffer(memory, np.uint8).ctypes.data, bytes(copy), len(copy))
        replaced = False
        # Restore the attributes as they were.
        for attributes, old in self._attributes:
            replaced |= any(attributes.get(name) is not value for name, value in old.items())
            attributes.clear()  # drops values cached since then, whose origin is unknown
            attributes.update(old)
        return bool(changed) or replaced
