"""Load the plugins that a config names, in the order of its key `plugins`."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from trackbench.config.allow_plugins import plugin_refused
from trackbench.config.files_key import digest_declared_files, words_of_list
from trackbench.config.plugin_class_checks import check_kind
from trackbench.errors import UserError, reason
from trackbench.plugins.load import load_plugin
from trackbench.plugins.loaded_and_changed_plugins import forget_outdated
from trackbench.plugins.plugin_content import Plugin, read_plugin
from trackbench.plugins.plugin_errors import PluginError
from trackbench.registry import BLOCK_GROUPS, import_own, kinds, registered
from trackbench.yaml_source import Source


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
    files, problems = digest_declared_files(source, folder, may_run)
    environment = words_of_list(source, "environment")
    # Step 2: read all plugins before any is run, since they may share modules.
    read: dict[int, Plugin] = {}
    for i, name in enumerate(names):
        try:
            if not isinstance(name, str) or not name.endswith(".py"):
                raise PluginError(f"{name!r} is not the path of a Python file")
            if not allowed and (folder / name).resolve() not in chosen_paths:
                raise PluginError(plugin_refused(name))
            read[i] = _read_file(folder / name, files, environment)
        except PluginError as error:
            problems += [source.problem(("plugins", i), message) for message in error.args]
    # Modules and data that changed since an earlier run in this process are read again. `as_now`: what
    # the plugins' code read is compared with the files and variables as they are now.
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
    # The package's own kinds of all groups but tables and figures are imported first, so that a plugin
    # can neither take their names nor change their functions. `kinds` is called for its imports: with
    # those of the package, the filters and scenarios of installed packages.
    import_own(*BLOCK_GROUPS)
    kinds("filters")
    kinds("scenarios")
    try:
        return read_plugin(path, files, environment)
    except OSError as error:
        raise PluginError(f"{path}: {reason(error)}") from None
