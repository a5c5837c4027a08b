"""Filters that the option `--filter FILE` adds to a config: those of a Python file, or a program."""

import inspect
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from shutil import which

from trackbench.config.overrides import override
from trackbench.config.plugins_of_config import load_file
from trackbench.errors import Mark, Problem, UserError
from trackbench.filters.base import AnyFilter
from trackbench.filters.external import External
from trackbench.plugins.plugin_errors import PluginError
from trackbench.registry import registered
from trackbench.yaml_source import Source, put


def add_filters(source: Source, files: Sequence[Path]) -> dict[str, Mark]:
    """Add the filters of Python files to the config, each under its kind; return labels and marks.

    Python files join the config's plugins. A program becomes a filter under the name of its file. A mark
    is the option ``--filter FILE``, where messages report mistakes. Raises UserError.
    """
    labels: dict[str, Mark] = {}
    if not isinstance(source.data.get("filters"), dict):
        return labels  # the validation of the whole reports it
    for file in files:
        mark = Mark(f"--filter {file}")
        # A file without the ending .py counts as a program. If it cannot be executed, `_add_plugin`
        # reports that it is neither.
        if runs_as_program(file) and is_program(file):
            _add_program(source, file, mark)
            labels[file.stem] = mark
        else:
            for kind in _add_plugin(source, file, mark):
                labels[kind] = mark
    return labels


def _add_program(source: Source, file: Path, mark: Mark) -> None:
    """Add a program as a filter under the name of its file, and allow it to run.

    If ``source.programs`` is None, every program may run.
    """
    path = str(file.absolute())
    _add_filter(source, file.stem, {"kind": "external", "command": [path]}, mark)
    if source.programs is not None:
        source.programs.add(path)


def _add_plugin(source: Source, file: Path, mark: Mark) -> list[str]:
    """Add each filter kind of a Python file as a filter, and the file to the plugins.

    Returns the kinds, which are the labels; raises UserError.
    """
    advice = "`trackbench new filter NAME` writes one"
    if file.suffix != ".py":
        raise UserError(Problem(mark, "", f"{NO_FILTER}; {advice}"))
    try:
        plugin = load_file(file)
    except PluginError as error:
        raise UserError(*(Problem(mark, "", message) for message in error.args)) from None
    filter_kinds = [kind for group, kind, _ in registered(plugin.module) if group == "filters"]
    if not filter_kinds:
        raise UserError(Problem(mark, "", f"registers no filter; {advice}"))
    for kind in filter_kinds:
        _add_filter(source, kind, {"kind": kind}, mark)
    if not source.data.get("plugins"):
        override(source, ("plugins",), [], mark)
    _append(source.data["plugins"], str(file.absolute()), mark)
    return filter_kinds


NO_FILTER = "is neither the path of a Python file nor of a program that can be executed"
"""Mistake in the path of a filter's file."""


_IMPORT = re.compile(r"^\s*(?:from|import)\s+trackbench\b", re.MULTILINE)


def runs_as_program(path: Path) -> bool:
    """Test whether a filter's file is a program of its own, and no Python file with filter classes.

    A Python file that can be executed, begins with ``#!`` and imports nothing of trackbench registers no
    filter: it speaks the protocol of programs.
    """
    if path.suffix != ".py":
        return True
    if not is_program(path):
        return False
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return text.startswith("#!") and _IMPORT.search(text) is None


def is_program(path: Path) -> bool:
    """Test whether a path is that of a file that can be executed."""
    return path.is_file() and os.access(path, os.X_OK)


def _add_filter(source: Source, label: str, entry: dict[str, object], mark: Mark) -> None:
    """Add a filter's entry to the config; raises UserError if the label is taken."""
    if label in source.data["filters"]:
        message = (
            f"{label!r} is already the label of a filter; give this one another kind or file name"
        )
        raise UserError(Problem(mark, "", message))
    override(source, ("filters", label), entry, mark)


def show_filters(source: Source, labels: Mapping[str, Mark]) -> None:
    """Add the labels to the lists of filters in `only`, in tables and in figures.

    ``labels`` are those of added filters, with their positions.
    """
    label_lists = [source.data.get("only")]
    for group in ("tables", "figures"):
        entries = source.data.get(group)
        if not isinstance(entries, dict):
            continue
        for entry in entries.values():
            if isinstance(entry, dict):
                label_lists.append(entry.get("filters"))
    for label_list in label_lists:
        # An empty list, as none, means all filters.
        if isinstance(label_list, list) and label_list:
            for label, mark in labels.items():
                _append(label_list, label, mark)


def _append(items: list[object], value: object, mark: Mark) -> None:
    """Append a value, with its position, to a list of a config."""
    items.append(None)
    put(items, len(items) - 1, value, mark)


def typed_file_of(tracker: AnyFilter) -> str:
    """Return the file of a filter as a command names it: a program, or the Python file of a class.

    The path is relative to the working folder if the file is within it.
    """
    if isinstance(tracker, External):
        # In `python my_filter.py` the program is the last file. A command without a file begins with the
        # name of an installed program, which is found on the PATH.
        files = [word for word in tracker.command if Path(word).is_file()]
        program = tracker.command[0]
        path = files[-1] if files else which(program) or program
    else:
        path = inspect.getfile(type(tracker))
    relative = os.path.relpath(path)
    if relative.startswith(".."):
        return path
    # As shells need it to run a program of the working folder.
    if isinstance(tracker, External):
        return f"./{relative}"
    return relative
