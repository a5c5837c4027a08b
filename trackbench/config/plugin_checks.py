"""Load the plugins that a config names, and check their classes and exhibits."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from itertools import chain
from pathlib import Path
from typing import cast

from trackbench.config.build import adapter
from trackbench.config.experiment import DrawnExhibit, Exhibit, Point
from trackbench.config.includes import override
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.extension_points import Part, is_foreign
from trackbench.filters.base import Filter, WrongReturnError
from trackbench.plugins.checks import call_hook, check_words
from trackbench.plugins.errors import PluginError, location_of, plugin_code
from trackbench.plugins.load import Plugin, digest_of_all, forget_outdated, load_plugin, read_plugin
from trackbench.registry import BLOCK_GROUPS, base_of, import_own, kinds, registered
from trackbench.yaml_source import Source, put

_FILES = {"per_step", "per_run", "summary"}
_PLAIN = (bool, int, float, str, type(None))


def add_filters(source: Source, files: Sequence[Path]) -> dict[str, Mark]:
    """Add the filters of Python files to the config, each under its kind; return labels and marks.

    The files join the config's plugins. A program becomes a filter under its name. Raises UserError.
    """
    labels: dict[str, Mark] = {}
    for file in files if isinstance(source.data.get("filters"), dict) else ():
        mark = Mark(f"--filter {file}")
        if file.suffix != ".py" and is_program(file):
            command = [str(file.absolute())]
            _add_filter(source, file.stem, {"kind": "external", "command": command}, mark)
            if source.programs is not None:
                source.programs.update(command)
            labels[file.stem] = mark
            continue
        try:
            plugin = load_file(file) if file.suffix == ".py" else None
        except PluginError as why:
            raise UserError(*(Problem(mark, "", what) for what in why.args)) from None
        groups = registered(plugin.module) if plugin else []
        kinds_in = [kind for group, kind, _ in groups if group == "filters"]
        if plugin is None or not kinds_in:
            what = "registers no filter" if plugin else NO_FILTER
            raise UserError(Problem(mark, "", f"{what}; `trackbench new filter NAME` writes one"))
        # Each kind becomes a filter of that label, and the file one of the plugins.
        for kind in kinds_in:
            _add_filter(source, kind, {"kind": kind}, mark)
            labels[kind] = mark
        if not source.data.get("plugins"):
            override(source, ("plugins",), [], mark)
        _append(source.data["plugins"], str(file.absolute()), mark)
    return labels


NO_FILTER = "is neither the path of a Python file nor of a program that can be executed"


def is_program(path: Path) -> bool:
    """Test whether a path is that of a file that can be executed."""
    return path.is_file() and os.access(path, os.X_OK)


def _add_filter(source: Source, label: str, entry: dict[str, object], mark: Mark) -> None:
    if label in source.data["filters"]:
        what = (
            f"{label!r} is already the label of a filter; give this one another kind or file name"
        )
        raise UserError(Problem(mark, "", what))
    override(source, ("filters", label), entry, mark)


def show_filters(source: Source, labels: Mapping[str, Mark]) -> None:
    """Add the labels to every list of filters to run, in tables and in figures."""
    groups = [source.data.get(group) for group in ("tables", "figures")]
    exhibits = chain.from_iterable(group.values() for group in groups if isinstance(group, dict))
    parts = [part for part in exhibits if isinstance(part, dict)]
    for shown in (source.data.get("only"), *(part.get("filters") for part in parts)):
        for label, mark in labels.items() if isinstance(shown, list) and shown else ():
            _append(shown, label, mark)


def _append(items: list[object], value: object, mark: Mark) -> None:
    items.append(None)
    put(items, len(items) - 1, value, mark)


def load_plugins(
    source: Source, folder: Path, allowed: bool, chosen: Sequence[Path] = ()
) -> tuple[Plugin, ...]:
    """Load the config's ``plugins``, paths counted from ``folder``; raises UserError.

    A config that names plugins is refused unless their code may be run, or the user chose the file.
    """
    chosen_paths = {file.resolve() for file in chosen}
    names = source.data.get("plugins") or []
    if not isinstance(names, list):
        return ()  # said by the validation of the whole
    problems: list[Problem] = []
    may_run = allowed or bool(chosen)
    files = _declared(source, folder, may_run, problems)
    environment = _texts(source, "environment")
    # Step 1: read all of them, since they may share modules.
    read: dict[int, Plugin] = {}
    for i, name in enumerate(names):
        try:
            if not isinstance(name, str) or not name.endswith(".py"):
                raise PluginError(f"{name!r} is not the path of a Python file")
            if not allowed and (folder / name).resolve() not in chosen_paths:
                raise PluginError(f"the code in {name} is run only with --allow-plugins")
            read[i] = _read_file(folder / name, files, environment)
        except PluginError as why:
            problems += [source.problem(("plugins", i), what) for what in why.args]
    forget_outdated([*read.values()], as_now=True)
    # Step 2: run their code.
    plugins = []
    for i, plugin in read.items():
        try:
            plugins.append(load_plugin(plugin, check_kind))
        except PluginError as why:
            problems += [source.problem(("plugins", i), what) for what in why.args]
    if problems:
        raise UserError(*problems)
    _check_apart(plugins, source)
    return tuple(plugins)


def _texts(source: Source, key: str) -> list[str]:
    """Read the words in a list of the config; the validation of the whole reports other values."""
    words = source.data.get(key) or []
    return [word for word in words if isinstance(word, str)] if isinstance(words, list) else []


def _declared(
    source: Source, folder: Path, may_run: bool, problems: list[Problem]
) -> tuple[tuple[str, str], ...]:
    """Digest the declared files if plugins may run; add a mistake for each that cannot be read."""
    digests = []
    for i, name in enumerate(_texts(source, "files")):
        file = folder / name
        try:
            file.stat()
            if may_run:
                digests.append((str(file.absolute()), digest_of_all(file)))
        except FileNotFoundError:
            what = "no such file or folder; write its path from the config's folder"
            problems.append(source.problem(("files", i), f"{file}: {what}"))
        except OSError as error:
            problems.append(source.problem(("files", i), f"{file}: {reason(error)}"))
        except PluginError as why:
            problems.append(source.problem(("files", i), str(why)))
    return tuple(digests)


def _check_apart(plugins: list[Plugin], source: Source) -> None:
    """Reject two plugins of a config that register the same kind."""
    owners: dict[tuple[str, str], Plugin] = {}
    for i, plugin in enumerate(plugins):
        for group, kind, _ in registered(plugin.module):
            owner = owners.setdefault((group, kind), plugin)
            if owner is not plugin and owner.module != plugin.module:
                what = f"{plugin.path}: the kind {kind!r} is registered by {owner.path}, too"
                where = ("plugins", i)
                raise UserError(source.problem(where, what))


def load_file(path: Path) -> Plugin:
    """Load a plugin and check its kinds; raises PluginError."""
    plugin = _read_file(path)
    forget_outdated([plugin], as_now=True)
    return load_plugin(plugin, check_kind)


def _read_file(
    path: Path, files: tuple[tuple[str, str], ...] = (), environment: Iterable[str] = ()
) -> Plugin:
    """Read a plugin with the declared files and variables; raises PluginError."""
    # First, so that a plugin can neither take names of the package nor change its functions.
    import_own(*BLOCK_GROUPS)
    kinds("filters"), kinds("scenarios")
    try:
        return read_plugin(path, files, environment)
    except OSError as error:
        raise PluginError(f"{path}: {reason(error)}") from None


def check_kind(cls: type[Part]) -> None:
    """Raise PluginError for a class that no config could make a part of."""
    for what in _mistakes(cls):
        raise PluginError(f"{location_of(WrongReturnError('', ''), cls)}{cls.__name__}: {what}")


def _mistakes(cls: type[Part]) -> Iterator[str]:
    if cls.__hash__ is None:
        yield "is not frozen: @dataclass(frozen=True, kw_only=True)"
    if not isinstance(cls.presets, dict) or not all(
        isinstance(p, dict) for p in cls.presets.values()
    ):
        yield "presets is not a mapping of names to mappings of keys"
    if issubclass(cls, Filter):
        needs: object = cls.requires
        if not isinstance(needs, tuple) or not all(isinstance(n, str) and "." in n for n in needs):
            yield f"requires is {needs!r}, not a tuple of names such as 'motion.F'"
        if isinstance(cls.summed_diagnostics, str):
            yield "counts is a word, not a set of words"
    if issubclass(cls, (base_of("tables"), base_of("figures"))):
        yield from _mistakes_of_exhibit(cast(type[Exhibit], cls))
    # Keys: defaults and types that a YAML can hold.
    for field in fields(cls):
        default = _default(field)
        if field.init and not _is_plain(default):
            yield f"the key {field.name} is a {type(default).__name__}, which no YAML can hold"
    try:
        adapter(cls)
    except Exception as error:
        reason = str(error).split("\n", 1)[0].split(". Set `arb", 1)[0]
        yield f"has a key of a type that no YAML can hold: {reason}"


def _mistakes_of_exhibit(cls: type[Exhibit]) -> Iterator[str]:
    needs = cls.requires
    if not isinstance(needs, dict) or not set(needs.values()) <= _FILES:
        yield f"requires is {needs!r}, not a mapping of metrics to {', '.join(sorted(_FILES))}"
    known = {field.name for field in fields(cls)}
    key_lists = {"label_keys": cls.label_keys}
    if issubclass(cls, DrawnExhibit):
        key_lists["numbers"] = cls.numbers
    for name, keys in key_lists.items():
        if not isinstance(keys, tuple) or not set(keys) <= known:
            yield f"{name} is {keys!r}, not a tuple of keys"


def _default(field: "Field[object]") -> object:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return None if field.default is MISSING else field.default


def _is_plain(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    if isinstance(value, dict):
        return all(map(_is_plain, (*value, *value.values())))
    return isinstance(value, _PLAIN) or (is_dataclass(value) and not isinstance(value, type))


def exhibit_conflicts(part: Exhibit, points: Sequence[Point]) -> dict[str, str]:
    """Collect the conflicts of a table or figure; for plugins also what would stop the runner."""
    if not is_foreign(part):
        return part.conflicts(points)
    try:
        with plugin_code(part):
            conflicts: dict[str, str] = call_hook(part.conflicts, dict, points)
            check_words(*conflicts, *conflicts.values())
            if isinstance(part, DrawnExhibit):
                _check_shown(part)
    except PluginError as error:
        return {"": str(error)}
    return conflicts


def _check_shown(part: DrawnExhibit) -> None:
    """Raise WrongReturnError unless a figure declares properly which tracks it needs."""
    runs, components = part.shown_runs, part.shown_components
    _ = part.shown_covariances, part.shown_measurements, part.shown_particles
    if not isinstance(runs, int):
        raise WrongReturnError("shown_runs", f"shown_runs is {runs!r}, no whole number")
    if components is not None and not isinstance(components, tuple):
        what = f"shown_components is {components!r}, neither a tuple of numbers nor None"
        raise WrongReturnError("shown_components", what)
