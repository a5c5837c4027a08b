"""Errors of plugin code as one line with file and line."""

import inspect
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from traceback import walk_tb
from typing import Any

from trackbench.errors import RunError
from trackbench.extension_points import is_foreign, walk_parts
from trackbench.filters.base import WrongReturnError
from trackbench.registry import registered_kinds

_EXTRAS = ("filterpy", "stonesoup")
"""Packages that trackbench's own extras bring."""


class FilterError(Exception):
    """Why a block failed, in words: the error itself may not survive the way from a worker."""


class BadPluginError(Exception):
    """Why a plugin cannot be used, in lines that name its file and line."""


def located_message(error: BaseException, *parts: Any) -> str:
    """Return ``my_filter.py:12: ValueError: ...``: the innermost line of the parts' own files.

    Where none was running, it is the line of the method that the error names, or of the first part's
    class. There is no place in the package's own code.
    """
    return location_of(error, *parts) + message_of(error)


def message_of(error: BaseException) -> str:
    """Return the kind and message of an error; of a package that is not there, how to get it."""
    if isinstance(error, ModuleNotFoundError) and error.name:
        return f"needs {missing_package_hint(error.name)}"
    text = " ".join(str(error).split())
    if isinstance(error, RunError | WrongReturnError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def missing_package_hint(module: str) -> str:
    """Return a hint for installing a missing module."""
    name = module.partition(".")[0]
    if name in _EXTRAS and find_spec(name) is None:
        return f"{name}, which is not installed: pip install 'trackbench[{name}]'"
    return f"the module {module}, which is not installed"


def location_of(error: BaseException, *parts: Any) -> str:
    """Return ``my_filter.py:12: ``, or nothing."""
    files = {_file(cls) for part in walk_parts(parts) for cls in _own(part)}
    return place_within(error, files) or _defined(getattr(error, "method", None), parts[:1])


def foreign_line(error: BaseException) -> str | None:
    """Return ``my_target.py:12: ValueError: ...`` if plugin code was running."""
    where = place_within(error, {_file(cls) for cls in registered_kinds() if is_foreign(cls)})
    return where + message_of(error) if where else None


def own_line(error: BaseException) -> str:
    """Return ``columns.py:41: KeyError: 'filter'``, the last package line that was running."""
    frames = [frame for frame, _ in walk_tb(error.__traceback__)]
    own = [
        f.f_code.co_filename
        for f in frames
        if f.f_globals.get("__name__", "").startswith("trackbench")
    ]
    return place_within(error, set(own)) + message_of(error)


def place_within(error: BaseException, files: set[str]) -> str:
    """Return ``my_filter.py:12: ``, the last line of these files at which it went wrong; or nothing."""
    for link in _chain(error):
        for frame, line in reversed(list(walk_tb(link.__traceback__))):
            if frame.f_code.co_filename in files:
                return f"{Path(frame.f_code.co_filename).name}:{line}: "
    if isinstance(error, SyntaxError) and error.filename in files:
        return f"{Path(str(error.filename)).name}:{error.lineno}: "
    return ""


def _chain(error: BaseException) -> Iterator[BaseException]:
    """Yield the error and what it was raised from or over."""
    link: BaseException | None = error
    while link is not None:
        yield link
        link = link.__cause__ or link.__context__


def _own(part: Any) -> list[type[Any]]:
    """Return the classes that a part is made of, as far as they are not the package's own."""
    cls = part if isinstance(part, type) else type(part)
    return [c for c in getattr(cls, "one", cls).__mro__ if is_foreign(c) and not _is_pythons(c)]


def _is_pythons(cls: type[Any]) -> bool:
    """Return whether a class, such as `object` or `Generic`, comes with Python."""
    return cls.__module__.partition(".")[0] in sys.stdlib_module_names


def _file(cls: type[Any]) -> str:
    return getattr(sys.modules.get(cls.__module__), "__file__", None) or ""


def _defined(method: str | None, parts: tuple[Any, ...]) -> str:
    """Return the place of a method in a component's class, or of the class."""
    for part in parts:
        for cls in _own(part):
            found = vars(cls).get(method or "")
            code = getattr(found.fget if isinstance(found, property) else found, "__code__", None)
            if code is not None:
                return f"{Path(code.co_filename).name}:{code.co_firstlineno}: "
        for cls in _own(part)[:1]:
            line = class_line(cls)
            return f"{Path(_file(cls)).name}:{line}: " if line else ""
    return ""


def class_line(cls: type[Any]) -> int | None:
    """Return the line at which a class is defined, if its source is there."""
    try:
        return inspect.getsourcelines(cls)[1]
    except (OSError, TypeError):
        return None
