"""Load plugins: Python files of the user with filters, scenarios, tables or figures.

A plugin travels to a worker as its source text, so that another machine needs no file. Its module is
named by its content, so that an edited plugin is another module. Modules beside it and data files do
not travel; a worker checks that they are those of the main process.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from trackbench import registry
from trackbench.component_parts import Part
from trackbench.errors import RunError
from trackbench.folder_digests import digest_of_all
from trackbench.plugin_class_hooks import InvalidHookError
from trackbench.plugins.guarded_code import guarded
from trackbench.plugins.imported_modules import (
    Finder,
    forget_modules,
    imported_modules,
    imports,
    is_rebuilt,
)
from trackbench.plugins.opened_files import Opened, read_at_import, recorded
from trackbench.plugins.patches import own_values, patch_message, undo_patches
from trackbench.plugins.plugin_content import (
    Digests,
    Plugin,
    digest_files,
    digest_variables,
    versions_of,
)
from trackbench.plugins.plugin_errors import PluginError, message_of, place_within
from trackbench.readable_files import digest_of


def load_plugin(plugin: Plugin, check: Callable[[type[Part]], None] | None = None) -> Plugin:
    """Run the plugin's code once in this process, so that its kinds are registered.

    The main process passes ``check``, which checks a class of the plugin. It gets the plugin back with
    all files and variables that its code imported and read. A worker gets plugins that are checked, and
    has no ``check``. Raises PluginError for errors of the plugin's code and of ``check``.
    """
    # Step 1: a plugin whose code has run, and that has not changed since. The main process compares it
    # with the files as they are now (`as_now`), a worker with those that the main process noted.
    Finder.look_beside(plugin.path)
    loaded = _loaded_plugin(plugin.module)
    if loaded is not None and _is_current(loaded, plugin, as_now=check is not None):
        registry.reactivate(plugin.module)
        sys.modules.update(_brought[plugin.module])
        return loaded
    # Step 2: a worker needs the modules of the main process; compiled modules cannot be loaded again.
    modules, _ = imports(plugin.source, plugin.path)
    if check is None:
        _compare_with_main(plugin)
    _check_module_names(modules)
    for name, compiled in imported_modules(modules, modules.values()).items():
        if is_rebuilt(compiled):
            raise PluginError(
                f"{compiled.__file__} was built again after this process loaded the module {name}; "
                "start Python again"
            )
    # Step 3: run its code, undo its changes of the package, and check its classes.
    package_values = own_values()
    registry.restore_normal_exit()  # Python then writes the files that the code leaves open
    module = _new_module(plugin)
    try:
        with _keeping_variables(), guarded(), recorded() as opened:
            folder_before = os.getcwd()
            exec(compile(plugin.source, plugin.path, "exec"), module.__dict__)
            folder_after = os.getcwd()
            # The code of its filters later runs in the folder that it changed to.
            _working_folders[plugin.module] = folder_after if folder_after != folder_before else ""
        replaced_names = undo_patches(package_values)
        if replaced_names:
            raise PluginError(f"{Path(plugin.path).name}: {patch_message(replaced_names)}")
        if check is not None:
            for _, _, cls in registry.registered(plugin.module):
                check(cls)
    except BaseException as error:
        # Remove all traces of a plugin that failed.
        undo_patches(package_values)
        registry.unregister(plugin.module)
        del sys.modules[plugin.module]
        if isinstance(error, PluginError) or not isinstance(error, Exception):
            raise
        if isinstance(error, InvalidHookError):
            raise PluginError(*error.args) from None
        place = place_within(error, {plugin.path}) or f"{Path(plugin.path).name}: "
        # A RunError stands for the exception by which the code tried to end the program.
        cause = error.__context__ if isinstance(error, RunError) else None
        raise PluginError(place + message_of(cause or error)) from None
    # Step 4: keep it as loaded.
    loaded_plugin = plugin if check is None else _with_opened(plugin, opened)
    _keep_as_loaded(loaded_plugin)
    return loaded_plugin


@contextmanager
def _keeping_variables() -> Iterator[None]:
    """Run a plugin's code, and give environment variables that it removed their values back.

    The code runs again in each worker, which gets the variables of this process, and other plugins read
    them, too. Variables that it sets stay: a library may read them only when it computes.
    """
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in before.keys() - os.environ.keys():
            os.environ[name] = before[name]


def _check_module_names(files: Mapping[str, str]) -> None:
    """Raise PluginError if Python already has another module under the name of one of these.

    ``files`` has the file of each module that a plugin imports, by the module's name. The other module
    is one that another plugin imported from its own folder. The plugin would get that one.
    """
    for name, loaded_module in imported_modules(names=files, files=()).items():
        loaded_file = os.path.abspath(getattr(loaded_module, "__file__", None) or "")
        if not os.path.isfile(loaded_file) or os.path.samefile(loaded_file, files[name]):
            continue
        # Two files of equal content are as good as one.
        if digest_of(loaded_file) != digest_of(files[name]):
            raise PluginError(
                f"imports {name} from {files[name]}, and another plugin has imported {loaded_file}, "
                "which has the same name; rename one of the two files"
            )


def _loaded_plugin(module: str) -> Plugin | None:
    """Return the plugin loaded as this module; None if there is none, or if Python lacks the module."""
    if module not in sys.modules:
        return None
    return _loaded.get(module)


_loaded: dict[str, Plugin] = {}
"""Plugins by module, as they were when their code ran."""
_working_folders: dict[str, str] = {}
"""By module: the folder that a plugin's code went to; empty if it stayed."""
_brought: dict[str, dict[str, ModuleType]] = {}
"""Modules that each plugin brought, by the name of the plugin's module."""
_files_of_executed: dict[str, set[str]] = {}
"""By path of each plugin whose code has run: files that it, or an earlier content of it, opened."""


def working_folder_of(plugins: Sequence[Plugin]) -> str:
    """Return the folder to which the plugins' code changed when it was loaded; empty if none did.

    Of several plugins that changed the working folder, the last one decides.
    """
    for plugin in reversed(plugins):
        folder = _working_folders.get(plugin.module)
        if folder:
            return folder
    return ""


def forget_outdated(plugins: Sequence[Plugin], as_now: bool) -> None:
    """Forget the modules that changed plugins imported, so that Python executes them again.

    A plugin has changed if its code, a file that it opened or a variable that it read has. Plugins that
    share a module with a changed one are executed again, too. If ``as_now``, the files and variables are
    compared as they are now, else as they are noted in ``plugins``: a worker gets plugins with the notes
    of the main process.

    `_loaded_plugin` returns a plugin as it was when its code ran, if it is still loaded.
    `_files_of_executed` stays when it is forgotten: it has the files that any content of it opened.
    """
    # Step 1: the modules that each plugin brings, and the plugins that have changed.
    modules: dict[str, set[str]] = {}
    changed: set[str] = set()
    for plugin in plugins:
        Finder.look_beside(plugin.path)
        names, _ = imports(plugin.source, plugin.path)
        opened_files = _files_of_executed.get(plugin.path, set())
        # Modules that it imports by name, and those whose file it opened.
        modules[plugin.module] = set(imported_modules(names, opened_files))
        loaded = _loaded_plugin(plugin.module)
        if loaded is None or not _is_current(loaded, plugin, as_now):
            _loaded.pop(plugin.module, None)
            if plugin.path in _files_of_executed:  # it has run before, perhaps with another content
                changed.add(plugin.module)
    # Step 2: plugins that share modules with a changed one count as changed, and so on.
    number_before = -1
    while len(changed) > number_before:
        number_before = len(changed)
        changed_modules: set[str] = set()
        for name in changed:
            changed_modules |= modules[name]
        changed |= {name for name, brought in modules.items() if brought & changed_modules}
    for name in changed:
        _loaded.pop(name, None)
    # Step 3: forget the modules of all plugins that are executed now, except those that others share.
    shared_modules: set[str] = set()
    for name, brought in modules.items():
        if name in _loaded:
            shared_modules |= brought
    for name, brought in modules.items():
        if name not in _loaded:
            forget_modules(brought - shared_modules)


def loaded_identities() -> list[str]:
    """Return the identities of the plugins whose code has run in this process, sorted."""
    return sorted(plugin.identity for plugin in _loaded.values())


def restore_modules(plugins: Iterable[Plugin]) -> None:
    """Put the modules back that loaded plugins imported, after another config imported its own."""
    for plugin in plugins:
        if plugin.module in _loaded:
            sys.modules.update(_brought[plugin.module])


def _is_current(loaded: Plugin, plugin: Plugin, as_now: bool) -> bool:
    """Test whether a loaded plugin was executed with the content that ``plugin`` has.

    If ``as_now``, the files that the loaded plugin opened and the variables that it read are digested
    again. Otherwise ``plugin`` has their digests, as it comes from the main process.
    """
    if not as_now:
        return loaded.identity == plugin.identity
    opened = Opened(
        read=[name for name, _ in loaded.opened],
        variables=[name for name, _ in loaded.variables],
    )
    return loaded.identity == _with_opened(plugin, opened).identity


def _new_module(plugin: Plugin) -> ModuleType:
    """Make the module in which the plugin's code is to run; Python then has it under its name.

    Kinds that an earlier run of this code registered are removed.
    """
    module = ModuleType(plugin.module)
    module.__file__ = plugin.path
    setattr(module, "__plugin_digest__", plugin.identity)  # noqa: B010 (no such field in the type)
    registry.unregister(plugin.module)
    sys.modules[plugin.module] = module
    return module


def _keep_as_loaded(plugin: Plugin) -> None:
    """Note that the plugin's code has run, and write its identity into the modules that it brought.

    Cached blocks of filters whose classes come from these modules depend on the identity. `_brought` has
    these modules, and `_files_of_executed` all files that the code and earlier contents of it used:
    modules from these files are forgotten once the plugin has changed.
    """
    _loaded[plugin.module] = plugin
    setattr(sys.modules[plugin.module], "__plugin_digest__", plugin.identity)  # noqa: B010
    names, _ = imports(plugin.source, plugin.path)
    files = {name for name, _ in (*plugin.code, *plugin.opened)}
    _files_of_executed.setdefault(plugin.path, set()).update(files)
    _brought[plugin.module] = imported_modules(names, files)
    for module in _brought[plugin.module].values():
        setattr(module, "__plugin_brought__", plugin.identity)  # noqa: B010
        is_rebuilt(module)  # called since it notes the content of a compiled module the first time


def _with_opened(plugin: Plugin, opened: Opened) -> Plugin:
    """Return the plugin with digests of the files that it opened and of the variables that it read.

    ``opened`` is the record of its own code.
    """
    # Imports are found once more, as the plugin's code may have extended Python's search path.
    modules, packages = imports(plugin.source, plugin.path)
    # Step 1: add the files and variables that its modules read when they were imported.
    all_opened = Opened()
    all_opened.add(opened)
    for file in (*modules.values(), *opened.files()):
        all_opened.add(read_at_import(file))
    # Step 2: leave out those that are declared, or known as code. Modules that were found only now stay.
    known_files = {plugin.path}
    known_files.update(name for name, _ in plugin.files)
    known_files.update(name for name, _ in plugin.code)
    declared_folders = tuple(f"{name}{os.sep}" for name, _ in plugin.files)
    other_files = set()
    for file in (*all_opened.files(), *modules.values()):
        if file not in known_files and not file.startswith(declared_folders):
            other_files.add(file)
    declared_variables = {name for name, _ in plugin.environment}
    return replace(
        plugin,
        packages=tuple(versions_of(packages)),
        opened=digest_files(other_files),
        variables=digest_variables(all_opened.variables.keys() - declared_variables),
    )


def _compare_with_main(plugin: Plugin) -> None:
    """Raise PluginError unless this worker has the packages and files of the main process."""
    installed = tuple(versions_of(name for name, _ in plugin.packages))
    if installed != plugin.packages:
        here = _list_packages(installed)
        raise PluginError(f"this worker has {here}, not {_list_packages(plugin.packages)}")
    for name, digest in (*plugin.files, *plugin.code, *plugin.opened):
        if not os.path.exists(name):
            raise PluginError(f"this worker has no {name}, which {Path(plugin.path).name} reads")
        if digest_of_all(name) != digest:
            raise PluginError(f"{name} is not as it was when the run began; start again")


def _list_packages(packages: Digests) -> str:
    return ", ".join(f"{name} {number}" for name, number in packages) or "nothing that it imports"
