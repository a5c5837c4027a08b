"""Data files of components: their names, also in notes, and digests for comparison."""

import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from glob import escape, glob
from itertools import chain
from pathlib import Path
from typing import Any

from trackbench.errors import reason
from trackbench.field_types import DataError, Place
from trackbench.readable_files import require_regular_file
from trackbench.scenarios.recordings.recording_keys import RecordingKeys


def files_of(pattern: str) -> list[str]:
    """Return the paths of all files that a pattern such as data/*.csv matches, in order of their names.

    The pattern is absolute, as those of a config are when it has been read, or counts from the working
    folder. A path without a pattern, or of an existing file, is returned as it is. Raises DataError if
    no file matches a pattern.
    """
    if not any(c in pattern for c in "*?[") or os.path.lexists(pattern):
        return [pattern]
    # Brackets in the name of an existing folder are part of the name, and no pattern.
    folder = os.path.dirname(pattern)
    while folder and not os.path.isdir(folder):
        folder = os.path.dirname(folder)
    paths = sorted(glob(escape(folder) + pattern.removeprefix(folder)))
    if not paths:
        raise DataError(Place(pattern, 1, 1, "no file has such a name"))
    return paths


class FromFiles:
    """Base of the frozen dataclasses (``eq=False``) whose numbers are read from files."""

    @property
    def patterns(self) -> tuple[str, ...]:
        """Paths or patterns of all files, as the config names them."""
        raise NotImplementedError

    @property
    def contents(self) -> dict[str, str]:
        """Digest of all files together, by each of their `patterns`."""
        return dict.fromkeys(self.patterns, self.__dict__["_content"])

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Within the block read the files; at its end store a digest of their contents.

        Raises DataError if a file has changed since the beginning of the block.
        """
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
        """Return the size, and the time of the last change in ns, of every file by its path."""
        stamps = {}
        for path in chain.from_iterable(map(files_of, self.patterns)):
            try:
                status = require_regular_file(path).stat()
            except OSError as error:
                raise DataError(Place(path, 1, 1, reason(error))) from None
            stamps[path] = (status.st_size, status.st_mtime_ns)
        return stamps

    @property
    def _key(self) -> tuple[Any, ...]:
        """Type, keys of the config and contents of the files, by which two objects are compared.

        In place of the contents of all files there is their digest, which `reading` has stored. The keys
        have no paths of files, so that equal files in different folders are equal.
        """
        assert is_dataclass(self)
        keys = tuple(self._named(getattr(self, field.name)) for field in fields(self) if field.init)
        return (type(self), keys, self.__dict__["_content"])

    def _named(self, value: Any) -> str:
        """Return the value of a key of the config as a text, by which objects are compared.

        The text of every file is "file": files are compared by their contents, which `_key` adds.
        """
        if isinstance(value, tuple) and value:
            return ",".join(map(self._named, value))
        if isinstance(value, str) and value in self.patterns:
            return "file"
        return repr(value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FromFiles) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def with_file_names(target: RecordingKeys, notices: Sequence[str]) -> tuple[str, ...]:
    """Return the notices without repetitions, and with names of files in place of their full paths."""
    patterns = target.measurements
    if isinstance(patterns, str):
        patterns = (patterns,)
    named = list(notices)
    for path in [*patterns, target.truth, target.input_file]:
        if path is not None:
            folder = f"{Path(path).parent}{os.sep}"
            named = [notice.replace(folder, "") for notice in named]
    return tuple(dict.fromkeys(named))
