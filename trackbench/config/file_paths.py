"""Paths of files in a config: relative to the YAML file that names them, and made absolute."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from trackbench.errors import Mark, Problem
from trackbench.field_types import (
    IS_VARIABLE,
    IS_WORD,
    cached,
    file_annotations,
    hints_of,
)
from trackbench.yaml_source import Keys, Source


@cached
def file_keys(cls: type) -> frozenset[str]:
    """Return the keys of a dataclass that may hold paths of files or names of environment variables."""
    return frozenset(name for name, hint in hints_of(cls).items() if file_annotations(hint))


def folder_of(mark: Mark) -> Path:
    """Return the folder of the YAML file of a mark; for an option, the working folder."""
    if mark.line:  # the mark of an option has none
        return Path(mark.file).parent
    return Path()


def make_paths_absolute(cls: type, source: Source, keys: Keys, values: dict[str, object]) -> None:
    """Make the paths of files in ``values`` absolute, in place.

    A relative path counts from the folder of the YAML file that names it. ``cls`` is the dataclass that
    is built from the values. The config has them at ``keys``. The source notes each folder as the user
    wrote it, since messages show it in this form.
    """
    for key in file_keys(cls) & values.keys():
        annotations = file_annotations(hints_of(cls)[key])
        if IS_VARIABLE in annotations:  # names of environment variables are no paths
            continue
        folder = folder_of(source.mark((*keys, key)))
        may_be_word = IS_WORD in annotations  # of a command line, such as an option
        paths = values[key]
        if isinstance(paths, list):
            values[key] = [_absolute_path(path, folder, may_be_word) for path in paths]
        else:
            values[key] = _absolute_path(paths, folder, may_be_word)
        if may_be_word:
            continue
        for path in paths if isinstance(paths, list) else [paths]:
            if isinstance(path, str):
                typed_folder = (folder / path).parent
                source.typed_folders[str(typed_folder.absolute())] = str(typed_folder)


def _absolute_path(path: object, folder: Path, may_be_word: bool) -> object:
    """Return a path counted from the folder.

    If it ``may_be_word`` of a command line, a word that names no file there stays as it is.
    """
    if not isinstance(path, str):
        return path
    if not may_be_word or os.path.isfile(folder / path):
        return str((folder / path).absolute())
    # A word as --table=file.csv
    option, equals, value = path.partition("=")
    if value and os.path.isfile(folder / value):
        return f"{option}{equals}{(folder / value).absolute()}"
    return path


def with_parts(file: Path, files: frozenset[Path] = frozenset()) -> frozenset[Path]:
    """Return a YAML file, every file that it names directly or through another, and ``files``.

    Files that are already in ``files`` are not read. A named file may be missing. Raises UserError if a
    YAML file cannot be read.
    """
    from trackbench.yaml_source import read

    files |= {file}
    if file.suffix in (".yaml", ".yml") and file.is_file():
        # Every word with an ending may be the path of a file.
        parts = {file.parent / word for word in _walk_words(read(file).data)}
        for part in sorted(part for part in parts - files if part.suffix):
            files = with_parts(part, files)
    return files


def _walk_words(data: object) -> Iterator[str]:
    """Yield every word within a mapping or list."""
    values: Iterable[object] = ()
    if isinstance(data, dict):
        values = data.values()
    elif isinstance(data, list):
        values = data
    for value in values:
        if isinstance(value, str):
            yield value
        else:
            yield from _walk_words(value)


def with_typed_paths(problem: Problem, typed_folders: Mapping[str, str]) -> Problem:
    """Write the paths of data files in a problem as the user wrote them.

    ``typed_folders`` has the folders as the user wrote them, by their absolute paths.
    """
    file = problem.mark.file
    message = problem.message
    for folder, typed_folder in typed_folders.items():
        # The folder and a slash, unless the folder is the end of a longer path.
        beginning = re.compile(rf"(?<![\w/.-]){re.escape(folder)}/+(?=[^/])")
        typed_beginning = "" if typed_folder == "." else f"{typed_folder.rstrip('/')}/"
        typed_beginning = typed_beginning.replace("\\", r"\\")  # a backslash would be an escape
        file = beginning.sub(typed_beginning, file)
        message = beginning.sub(typed_beginning, message)
    return replace(problem, mark=replace(problem.mark, file=file), message=message)
