"""Errors of plugin code: they become one line with file and line."""

import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from traceback import walk_tb

from trackbench.component_parts import foreign_parts, is_foreign, walk_parts
from trackbench.errors import Mark, Problem, RunError, UserError, linked_errors
from trackbench.field_types import InvalidKeyError
from trackbench.filters.base import WrongReturnError
from trackbench.plugins.guarded_code import guarded
from trackbench.registry import registered_kinds

_EXTRAS = ("filterpy", "stonesoup")
"""Packages that trackbench's own extras bring."""
_LONGEST_TEXT = 500
"""Characters of an error's text that a message has, as of a program's reason."""


class FilterError(Exception):
    """The reason why a block failed, as text: a worker may be unable to pickle the error itself.

    ``place`` is the run and the step in words, such as ``run 3, step 5, 10 s``; empty if it is unknown.
    """

    def __init__(self, reason: str, place: str = "") -> None:
        super().__init__(reason, place)
        self.place = place

    def __str__(self) -> str:
        return str(self.args[0])


class PluginError(Exception):
    """Mistakes of a plugin, one line each with file and line."""

    def __str__(self) -> str:
        return "; ".join(map(str, self.args))


@contextmanager
def plugin_code(*parts: object) -> Iterator[None]:
    """Run code of these components; its errors become a PluginError if a plugin is among them.

    An error of the package's own components is a bug, and stays as it is. A list among the parts may
    grow while the code runs: components are looked for only after an error.
    """
    try:
        with guarded():  # the code cannot end the program
            yield
    except PluginError:
        raise
    except Exception as error:
        foreign = foreign_parts(parts)
        if not foreign:
            raise
        # The component that defines the method with the wrong value comes first: the message names
        # its line. Other errors name no method, and the order stays.
        method = getattr(error, "method", "")

        def lacks_method(component: object) -> bool:
            return all(method not in vars(cls) for cls in _plugin_classes(component))

        foreign.sort(key=lacks_method)
        raise PluginError(located_message(error, *foreign)) from error


@contextmanager
def unexpected_errors_as_mistakes(config: str) -> Iterator[None]:
    """Run code that plugins take part in; an unexpected error of theirs becomes a mistake of the config.

    The mistake, a UserError, has the plugin's line. ``config`` is the name of the config's file.
    """
    try:
        with guarded():  # plugin code cannot end the program
            yield
    except UserError:
        raise
    except Exception as error:
        message = foreign_line(error)  # None if no plugin code was running
        if not message:
            # Without a line of a plugin only a RunError, which has its own message, is a mistake.
            if not isinstance(error, RunError):
                raise
            message = str(error)
        raise UserError(Problem(Mark(config), "", message)) from None


def located_message(error: BaseException, *parts: object) -> str:
    """Return ``my_filter.py:12: ValueError: ...``: the innermost line in the files of these components.

    If none of them was running, the line is that of the method that the error names, or of the first
    component's class. Components of the package have no line.
    """
    return location_of(error, *parts) + message_of(error)


def message_of(error: BaseException) -> str:
    """Write the type and message of an error; for a missing package, how to install it."""
    if isinstance(error, ModuleNotFoundError) and error.name:
        name = error.name.partition(".")[0]
        if name in _EXTRAS and find_spec(name) is None:
            return f"needs {name}, which is not installed: in a clone pip install '.[{name}]'"
        return f"needs the module {error.name}, which is not installed"
    type_name = type(error).__name__
    text = " ".join(str(error).split())
    if is_foreign(error) and len(text) > _LONGEST_TEXT:
        text = f"{text[: _LONGEST_TEXT - 3]}..."
    if isinstance(error, RunError | WrongReturnError):
        return text
    if isinstance(error, InvalidKeyError):
        return ": ".join([*map(str, error.path), text])
    if not text:
        return type_name
    return f"{type_name}: {text}"


def location_of(error: BaseException, *parts: object) -> str:
    """Write the place of an error in a plugin's file, ``my_filter.py:12: ``.

    ``parts`` are the components whose code may have raised it. The place is the innermost line in the
    files of their plugin classes. If no such line was running, it is the line of the method of the first
    part that the error names, or else that of its class. Components of the package have an empty text.
    """
    files: set[str] = set()
    for part in walk_parts(parts):
        files.update(_file(cls) for cls in _plugin_classes(part))
    place = place_within(error, files)
    if place or not parts:
        return place
    # A WrongReturnError is raised by the runner, and names the method that returned a wrong value.
    method = getattr(error, "method", None) or ""
    return _definition(method, parts[0])


def foreign_line(error: BaseException) -> str | None:
    """Write ``my_target.py:12: ValueError: ...``; None if no plugin code was running."""
    plugin_files = {_file(cls) for cls in registered_kinds() if is_foreign(cls)}
    place = place_within(error, plugin_files)
    if not place:
        return None
    return place + message_of(error)


def package_line(error: BaseException) -> str:
    """Write ``columns.py:41: KeyError: 'filter'``, the last package line that was running."""
    package_files = set()
    for frame, _ in walk_tb(error.__traceback__):
        module = str(frame.f_globals.get("__name__", ""))
        if module.startswith("trackbench"):
            package_files.add(frame.f_code.co_filename)
    return place_within(error, package_files) + message_of(error)


def place_within(error: BaseException, files: set[str]) -> str:
    """Find the innermost line in these files: ``my_filter.py:12: ``, or an empty text."""
    # Search the error, then its cause, and so on, in each the innermost frame first.
    for linked_error in linked_errors(error):
        for frame, line in reversed(list(walk_tb(linked_error.__traceback__))):
            if frame.f_code.co_filename in files:
                return f"{Path(frame.f_code.co_filename).name}:{line}: "
    if isinstance(error, SyntaxError) and error.filename in files:
        return f"{Path(str(error.filename)).name}:{error.lineno}: "
    return ""


def _plugin_classes(component: object) -> list[type]:
    """List the plugin classes that a component's class is or inherits from.

    ``component`` is an object or its class.
    """
    cls = component if isinstance(component, type) else type(component)
    # `LoopFilter.run_class` is the plugin's class of one run; the LoopFilter itself is trackbench's.
    plugin_cls = getattr(cls, "run_class", cls)
    plugin_classes = []
    for base_cls in plugin_cls.__mro__:
        # Python's own base classes are those such as `object` and `Generic`.
        is_of_python = base_cls.__module__.partition(".")[0] in sys.stdlib_module_names
        if is_foreign(base_cls) and not is_of_python:
            plugin_classes.append(base_cls)
    return plugin_classes


def _file(cls: type) -> str:
    """Return the file of a class's module; empty if it has none."""
    module = sys.modules.get(cls.__module__)
    if module is None:
        return ""
    return module.__file__ or ""


def _definition(method: str, component: object) -> str:
    """Write the line at which a component's plugin class defines a method: ``my_filter.py:12: ``.

    If no plugin class defines it, the line is that of the class. The text is empty without such a class.
    """
    # Step 1: the first class that defines the method.
    classes = _plugin_classes(component)
    for cls in classes:
        attribute = vars(cls).get(method)
        function = attribute.fget if isinstance(attribute, property) else attribute
        if inspect.isfunction(function):
            code = function.__code__
            return f"{Path(code.co_filename).name}:{code.co_firstlineno}: "
    # Step 2: else the line of the first class, if there is one and it has a source.
    if not classes:
        return ""
    try:
        _, line = inspect.getsourcelines(classes[0])
    except (OSError, TypeError):
        return ""
    return f"{Path(_file(classes[0])).name}:{line}: "
