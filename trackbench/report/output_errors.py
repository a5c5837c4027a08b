"""Errors of a table or figure: a failing one becomes a line, and the others are made."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.errors import RunError, UserError
from trackbench.extension_points import is_foreign
from trackbench.plugins.errors import PluginError, package_line, plugin_code

if TYPE_CHECKING:
    pass


class OutputError(Exception):
    """Reason why an output is missing, as text: a drawing process may be unable to pickle the error."""


class PartialReportError(RunError):
    """Some tables or figures could not be made; all else is written."""

    def __init__(self, lines: Sequence[str], written: Sequence[Path]) -> None:
        super().__init__("; ".join(lines))
        self.lines = list(lines)
        self.written = list(written)


@contextmanager
def catch_errors(exhibit: Any = None) -> Iterator[None]:
    """Raise OutputError for an exception of a plugin's table or figure, and for a bug of the package.

    A finished run is worth more than any of its outputs, so a caller may note an OutputError and go on.
    An OutputError, UserError, RunError or OSError passes as it is. ``exhibit`` is the table or figure
    that the block makes, if it makes one.
    """
    try:
        with plugin_code(exhibit) if is_foreign(exhibit) else nullcontext():
            yield
    except PluginError as error:
        raise OutputError(str(error)) from None
    except (OutputError, UserError, RunError, OSError):
        raise
    except Exception as error:
        raise OutputError(package_line(error)) from error
