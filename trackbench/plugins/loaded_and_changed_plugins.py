"""Plugins whose code has run in this process, with the modules that they brought; outdated ones go."""

import sys
from collections.abc import Iterable, Sequence
from types import ModuleType

from trackbench.plugins.imported_modules import (
    Finder,
    forget_modules,
    imported_modules,
    imports,
    is_rebuilt,
)
from trackbench.plugins.opened_files_and_variables import Opened
from trackbench.plugins.plugin_content import Plugin, with_opened

_loaded: dict[str, Plugin] = {}
"""Plugins by module, as they were when their code ran."""
_brought: dict[str, dict[str, ModuleType]] = {}
"""Modules that each plugin brought, by the name of the plugin's module."""
_files_of_executed: dict[str, set[str]] = {}
"""By path of each plugin whose code has run: files that it, or an earlier content of it, opened."""


def loaded_plugin(module: str) -> Plugin | None:
    """Return the plugin loaded as this module; None if there is none, or if Python lacks the module."""
    if module not in sys.modules:
        return None
    return _loaded.get(module)


def forget_outdated(plugins: Sequence[Plugin], as_now: bool) -> None:
    """Forget the modules that changed plugins imported, so that Python executes them again.

    A plugin has changed if its code, a file that it opened or a variable that it read has. Plugins that
    share a module with a changed one are executed again, too. If ``as_now``, the files and variables are
    compared as they are now, else as they are noted in ``plugins``: a worker gets plugins with the notes
    of the main process.

    `loaded_plugin` returns a plugin as it was when its code ran, if it is still loaded.
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
        loaded = loaded_plugin(plugin.module)
        if loaded is None or not is_current(loaded, plugin, as_now):
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


def is_current(loaded: Plugin, plugin: Plugin, as_now: bool) -> bool:
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
    return loaded.identity == with_opened(plugin, opened).identity


def keep_as_loaded(plugin: Plugin) -> None:
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
