"""Load plugins: Python files of the user with filters, scenarios, tables or figures.

A plugin travels to a worker as its source text, so that another machine needs no file. Its module is
named by its content, so that an edited plugin is another module. Modules beside it and data files do
not travel; a worker checks that they are those of the main process.
"""

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

from trackbench import registry
from trackbench.component_parts import Part
from trackbench.errors import RunError
from trackbench.folder_digests import digest_of_all
from trackbench.plugin_class_hooks import InvalidHookError
from trackbench.plugins.guarded_code import guarded, keeping_variables
from trackbench.plugins.imported_modules import (
    Finder,
    check_module_names,
    imported_modules,
    imports,
    is_rebuilt,
)
from trackbench.plugins.installed_packages import versions_of
from trackbench.plugins.loaded_and_changed_plugins import (
    is_current,
    keep_as_loaded,
    loaded_plugin,
    restore_modules,
)
from trackbench.plugins.opened_files_and_variables import recorded
from trackbench.plugins.patches import own_values, patch_message, undo_patches
from trackbench.plugins.plugin_content import (
    Digests,
    Plugin,
    with_opened,
)
from trackbench.plugins.plugin_errors import PluginError, message_of, place_within


def load_plugin(plugin: Plugin, check: Callable[[type[Part]], None] | None = None) -> Plugin:
    """Run the plugin's code once in this process, so that its kinds are registered.

    The main process passes ``check``, which checks a class of the plugin. It gets the plugin back with
    all files and variables that its code imported and read. A worker gets plugins that are checked, and
    has no ``check``. Raises PluginError for errors of the plugin's code and of ``check``.
    """
    # Step 1: a plugin whose code has run, and that has not changed since. The main process compares it
    # with the files as they are now (`as_now`), a worker with those that the main process noted.
    Finder.look_beside(plugin.path)
    loaded = loaded_plugin(plugin.module)
    if loaded is not None and is_current(loaded, plugin, as_now=check is not None):
        registry.reactivate(plugin.module)
        restore_modules([plugin])
        return loaded
    # Step 2: a worker needs the modules of the main process; compiled modules cannot be loaded again.
    modules, _ = imports(plugin.source, plugin.path)
    if check is None:
        _compare_with_main(plugin)
    check_module_names(modules)
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
        with keeping_variables(), guarded(), recorded() as opened:
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
    plugin_as_loaded = plugin if check is None else with_opened(plugin, opened)
    keep_as_loaded(plugin_as_loaded)
    return plugin_as_loaded


_working_folders: dict[str, str] = {}
"""By module: the folder that a plugin's code went to; empty if it stayed."""


def working_folder_of(plugins: Sequence[Plugin]) -> str:
    """Return the folder to which the plugins' code changed when it was loaded; empty if none did.

    Of several plugins that changed the working folder, the last one decides.
    """
    for plugin in reversed(plugins):
        folder = _working_folders.get(plugin.module)
        if folder:
            return folder
    return ""


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
