"""Base of components that read data files; their equality includes the files' content."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.field_types import DataError, Place, require_regular_file
from trackbench.scenarios.recordings.rows import files_of


class FromFiles:
    """Base of the frozen dataclasses (``eq=False``) whose numbers are read from files."""

    @property
    def patterns(self) -> tuple[str, ...]:
        """Return all files, as the config names them."""
        raise NotImplementedError

    @property
    def contents(self) -> dict[str, str]:
        """Digest of all files, by each of their names."""
        return dict.fromkeys(self.patterns, self.__dict__["_content"])

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Note what the files hold that are read within. Raises DataError if they change meanwhile."""
        before = self._stamps()
        yield
        # Digest the files, then check that none has changed since before the reading.
        digest = hashlib.sha256()
        for path in before:
            with require_regular_file(path).open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        if self._stamps() != before:
            raise DataError(Place(self.patterns[0], 1, 1, "was changed while it was read"))
        object.__setattr__(self, "_content", digest.hexdigest())

    def _stamps(self) -> dict[str, tuple[int, int]]:
        """Return the size and time of every file."""
        out = {}
        for path in (path for pattern in self.patterns for path in files_of(pattern)):
            try:
                found = require_regular_file(path).stat()
            except OSError as error:
                raise DataError(Place(path, 1, 1, (error.strerror or str(error)).lower())) from None
            out[path] = found.st_size, found.st_mtime_ns
        return out

    @property
    def _key(self) -> tuple[Any, ...]:
        assert is_dataclass(self)
        keys = tuple(self._named(getattr(self, field.name)) for field in fields(self) if field.init)
        return (type(self), keys, self.__dict__["_content"])

    def _named(self, value: Any) -> str:
        """Return a key as a word; a file is what it holds, wherever it lies."""
        if isinstance(value, tuple) and value:
            return ",".join(map(self._named, value))
        return "file" if isinstance(value, str) and value in self.patterns else repr(value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FromFiles) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def recorded_columns(values: Array, rng: Streams) -> Array:
    """Return the columns (..., M) of these streams' runs, NaN for runs without a recording.

    Training runs, -1 and so on, are the last ones: run -1 is the last of all.
    """
    assert isinstance(rng, RunStreams)
    out = np.full((*values.shape[:-1], len(rng.runs)), np.nan)
    # Recordings with these numbers; a negative number counts from the last.
    there = [m for m in rng.runs if -values.shape[-1] <= m < values.shape[-1]]
    out[..., : len(there)] = values[..., there]
    return out
