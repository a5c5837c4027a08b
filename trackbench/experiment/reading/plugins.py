"""Python files of one's own: loaded only when allowed, the same in every worker.

A plugin travels as its source text, so that a worker on another machine needs no file, and its module
is named by its content, so that an edited plugin is another module.
"""

import hashlib
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from trackbench.experiment.problems import Problem, UserError, reason
from trackbench.experiment.reading.source import Source, dotted
from trackbench.hooks import MistakenHookError
from trackbench.keys import regular
from trackbench.registry import kinds


@dataclass(frozen=True)
class Plugin:
    """One file: its name for messages, and its content."""

    path: str
    source: bytes

    @property
    def digest(self) -> str:
        """SHA-256 of the content."""
        return hashlib.sha256(self.source).hexdigest()

    @property
    def module(self) -> str:
        """Name of its module."""
        stem = "".join(c if c.isalnum() else "_" for c in Path(self.path).stem)
        return f"trackbench_plugin_{stem}_{self.digest[:12]}"


def read_plugin(path: Path) -> Plugin:
    """The file as it is now; raises OSError."""
    return Plugin(str(path.absolute()), regular(path).read_bytes())


def load_plugins(source: Source, folder: Path, allowed: bool) -> tuple[Plugin, ...]:
    """Load the config's ``plugins``, paths counted from ``folder``; raises UserError.

    A config that names plugins is refused unless their code may be run.
    """
    names = source.data.get("plugins") or []
    if not isinstance(names, list):
        return ()  # said by the validation of the whole
    plugins, problems = [], []
    for i, name in enumerate(names):
        where = ("plugins", i)
        try:
            plugins.append(_loaded(folder, name, allowed))
        except (_RefusedError, MistakenHookError) as why:
            problems += [Problem(source.mark(where), dotted(where), what) for what in why.args]
    if problems:
        raise UserError(*problems)
    return tuple(plugins)


class _RefusedError(Exception):
    pass


def _loaded(folder: Path, name: object, allowed: bool) -> Plugin:
    if not isinstance(name, str) or not name.endswith(".py"):
        raise _RefusedError(f"{name!r} is not the path of a Python file")
    if not allowed:
        raise _RefusedError(f"the code in {name} is run only with --allow-plugins")
    for group in ("filters", "scenarios"):
        kinds(group)  # what the package has comes first, so that a plugin cannot take its names
    try:
        plugin = read_plugin(folder / name)
        load_plugin(plugin)
    except OSError as error:
        raise _RefusedError(f"{folder / name}: {reason(error)}") from None
    except MistakenHookError:
        raise
    except (Exception, SystemExit) as error:
        raise _RefusedError(f"{_last_place(error, name)}{type(error).__name__}: {error}") from None
    return plugin


def _last_place(error: BaseException, name: str) -> str:
    """``my_filter.py:12: ``, the plugin's own line at which it went wrong."""
    lines = [
        f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename.endswith(name)
    ]
    return f"{name}:{lines[-1]}: " if lines else ""


def load_plugin(plugin: Plugin) -> None:
    """Run the plugin's code once in this process, so that its kinds are registered.

    Raises whatever the code raises.
    """
    if plugin.module in sys.modules:
        return
    module = ModuleType(plugin.module)
    module.__file__ = plugin.path
    setattr(module, "__plugin_digest__", plugin.digest)  # noqa: B010 (no such field in the type)
    sys.modules[plugin.module] = module
    try:
        exec(compile(plugin.source, plugin.path, "exec"), module.__dict__)
    except BaseException:
        del sys.modules[plugin.module]
        raise
