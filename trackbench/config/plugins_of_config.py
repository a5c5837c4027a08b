"""Load the plugins that a config names, and check the attributes and keys of their classes."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from typing import cast

from trackbench.component_parts import Part
from trackbench.config.build import adapter
from trackbench.config.experiment import DrawnExhibit, Exhibit
from trackbench.errors import Problem, UserError, reason
from trackbench.filters.base import Filter, WrongReturnError
from trackbench.plugins.errors import PluginError, location_of
from trackbench.plugins.load import Plugin, digest_of_all, forget_outdated, load_plugin, read_plugin
from trackbench.registry import BLOCK_GROUPS, base_of, import_own, kinds, registered
from trackbench.yaml_source import Source

_FILES = {"per_step", "per_run", "summary"}
_PLAIN = (bool, int, float, str, type(None))


def load_plugins(
    source: Source, folder: Path, allowed: bool, chosen: Sequence[Path] = ()
) -> tuple[Plugin, ...]:
    """Load the config's ``plugins``, and return them; raises UserError.

    Paths count from ``folder``. A plugin is a mistake unless the code of all plugins is ``allowed`` to
    run, or its file is among those that the user has ``chosen``.
    """
    chosen_paths = {file.resolve() for file in chosen}
    names = source.data.get("plugins") or []
    if not isinstance(names, list):
        return ()  # the validation of the whole reports it
    # Step 1: the declared files, whose digests are computed only if plugins may run.
    may_run = allowed or bool(chosen)
    files, problems = _digest_declared_files(source, folder, may_run)
    environment = _words_of_list(source, "environment")
    # Step 2: read all plugins before any is run, since they may share modules.
    read: dict[int, Plugin] = {}
    for i, name in enumerate(names):
        try:
            if not isinstance(name, str) or not name.endswith(".py"):
                raise PluginError(f"{name!r} is not the path of a Python file")
            if not allowed and (folder / name).resolve() not in chosen_paths:
                raise PluginError(f"the code in {name} is run only with --allow-plugins")
            read[i] = _read_file(folder / name, files, environment)
        except PluginError as error:
            problems += [source.problem(("plugins", i), message) for message in error.args]
    # Modules and data that changed since an earlier run in this process are read again.
    forget_outdated(list(read.values()), as_now=True)
    # Step 3: run their code.
    plugins = []
    for i, plugin in read.items():
        try:
            plugins.append(load_plugin(plugin, check_kind))
        except PluginError as error:
            problems += [source.problem(("plugins", i), message) for message in error.args]
    if problems:
        raise UserError(*problems)
    _reject_repeated_kinds(plugins, source)
    return tuple(plugins)


def _words_of_list(source: Source, key: str) -> list[str]:
    """Read the words in a list of the config; the validation of the whole reports other values."""
    words = source.data.get(key) or []
    if not isinstance(words, list):
        return []
    return [word for word in words if isinstance(word, str)]


def _digest_declared_files(
    source: Source, folder: Path, may_run: bool
) -> tuple[tuple[tuple[str, str], ...], list[Problem]]:
    """Return path and digest of each declared file, and a mistake for each that cannot be read.

    Without ``may_run`` no file is read, and only missing ones are mistakes.
    """
    digests = []
    problems = []
    for i, name in enumerate(_words_of_list(source, "files")):
        file = folder / name
        try:
            file.stat()
            if may_run:
                digests.append((str(file.absolute()), digest_of_all(file)))
        except FileNotFoundError:
            message = "no such file or folder; write its path from the config's folder"
            problems.append(source.problem(("files", i), f"{file}: {message}"))
        except OSError as error:
            problems.append(source.problem(("files", i), f"{file}: {reason(error)}"))
        except PluginError as error:
            problems.append(source.problem(("files", i), str(error)))
    return tuple(digests), problems


def _reject_repeated_kinds(plugins: list[Plugin], source: Source) -> None:
    """Reject two plugins of a config that register the same kind."""
    owners: dict[tuple[str, str], Plugin] = {}
    for i, plugin in enumerate(plugins):
        for group, kind, _ in registered(plugin.module):
            owner = owners.setdefault((group, kind), plugin)
            if owner is not plugin and owner.module != plugin.module:
                message = f"{plugin.path}: the kind {kind!r} is registered by {owner.path}, too"
                raise UserError(source.problem(("plugins", i), message))


def load_file(path: Path) -> Plugin:
    """Load the plugin in a Python file, and check the classes that it registers; raises PluginError.

    Its code is run again if it, or a file or variable that it read, has changed since an earlier run in
    this process.
    """
    plugin = _read_file(path)
    # `as_now`: what the code read is digested again, and not taken as it was when the code ran.
    forget_outdated([plugin], as_now=True)
    return load_plugin(plugin, check_kind)


def _read_file(
    path: Path, files: tuple[tuple[str, str], ...] = (), environment: Iterable[str] = ()
) -> Plugin:
    """Read a plugin with the declared files and variables; raises PluginError.

    ``files`` are pairs of a file's name and the digest of its content, ``environment`` the names of
    variables.
    """
    # The package's own kinds are imported first, so that a plugin can neither take their names nor
    # change their functions. `kinds` is called for its imports.
    import_own(*BLOCK_GROUPS)
    kinds("filters")
    kinds("scenarios")
    try:
        return read_plugin(path, files, environment)
    except OSError as error:
        raise PluginError(f"{path}: {reason(error)}") from None


def check_kind(cls: type[Part]) -> None:
    """Raise PluginError, with the first mistake, for a class that no config could name."""
    mistake = next(_class_mistakes(cls), None)
    if mistake is not None:
        # An error that names no method has the location of the class.
        location = location_of(WrongReturnError("", ""), cls)
        raise PluginError(f"{location}{cls.__name__}: {mistake}")


def _class_mistakes(cls: type[Part]) -> Iterator[str]:
    """Yield the mistakes in the attributes and keys of a registered class."""
    if cls.__hash__ is None:
        yield "is not frozen: @dataclass(frozen=True, kw_only=True)"
    presets: object = cls.presets
    if not isinstance(presets, dict) or not all(isinstance(p, dict) for p in presets.values()):
        yield "presets is not a mapping of names to mappings of keys"
    if issubclass(cls, Filter):
        needs: object = cls.requires
        if not isinstance(needs, tuple) or not all(isinstance(n, str) and "." in n for n in needs):
            yield f"requires is {needs!r}, not a tuple of names such as 'motion.F'"
        if isinstance(cls.summed_diagnostics, str):
            yield "summed_diagnostics is a word, not a set of words"
    if issubclass(cls, (base_of("tables"), base_of("figures"))):
        yield from _exhibit_mistakes(cast(type[Exhibit], cls))
    # Keys: defaults and types that a YAML can hold.
    for field in fields(cls):
        default = _default_value(field)
        if field.init and not _is_plain_data(default):
            yield f"the key {field.name} is a {type(default).__name__}, which no YAML can hold"
    try:
        adapter(cls)
    except Exception as error:
        first_line = str(error).split("\n", 1)[0]
        # pydantic's advice, "Set `arbitrary_types_allowed=True` ...", does not help here.
        without_advice = first_line.split(". Set `arb", 1)[0]
        yield f"has a key of a type that no YAML can hold: {without_advice}"


def _exhibit_mistakes(cls: type[Exhibit]) -> Iterator[str]:
    """Yield the mistakes in the attributes of a table or figure class.

    ``requires`` has the metrics that it always shows, each with its file. ``label_keys`` are its keys
    with labels of filters, and ``numbers`` those that count runs and components.
    """
    needs = cls.requires
    if not isinstance(needs, dict) or not set(needs.values()) <= _FILES:
        yield f"requires is {needs!r}, not a mapping of metrics to {', '.join(sorted(_FILES))}"
    known_keys = {field.name for field in fields(cls)}
    key_lists = {"label_keys": cls.label_keys}
    if issubclass(cls, DrawnExhibit):
        key_lists["numbers"] = cls.numbers
    for name, keys in key_lists.items():
        if not isinstance(keys, tuple) or not set(keys) <= known_keys:
            yield f"{name} is {keys!r}, not a tuple of keys"


def _default_value(field: "Field[object]") -> object:
    """Return a key's default; None without one."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    if field.default is MISSING:
        return None
    return field.default


def _is_plain_data(value: object) -> bool:
    """Test whether a YAML file can have a value: it is made of scalars, lists, mappings, components."""
    if isinstance(value, list | tuple):
        return all(_is_plain_data(item) for item in value)
    if isinstance(value, dict):
        return all(_is_plain_data(item) for item in (*value, *value.values()))
    if isinstance(value, _PLAIN):
        return True
    return is_dataclass(value) and not isinstance(value, type)
