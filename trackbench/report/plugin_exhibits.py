"""Tables and figures of one's own: what goes wrong in one costs that one, and is a line."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.errors import RunError
from trackbench.extension_points import is_foreign
from trackbench.plugins.errors import PluginError, message_of, plugin_code
from trackbench.report.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class OutputError(Exception):
    """Why a table or figure is not there, in words: the error may not survive the way from a drawer."""


class PartialReportError(RunError):
    """Some tables or figures could not be made; all else is written."""

    def __init__(self, lines: Sequence[str], written: Sequence[Path]) -> None:
        super().__init__("; ".join(lines))
        self.lines, self.written = list(lines), list(written)


class WrongOutputError(RunError):
    """Wrong return value of a ``method`` of a table or figure."""

    def __init__(self, method: str, what: str) -> None:
        super().__init__(what)
        self.method = method


@contextmanager
def catch_plugin_errors(part: Any) -> Iterator[None]:
    """Raise OutputError for an exception of a plugin; one of the package itself is a bug."""
    if not is_foreign(part):
        yield
        return
    try:
        with plugin_code(part):
            yield
    except PluginError as error:
        raise OutputError(str(error)) from None


def as_table(found: object, part: Any) -> Table:
    """Return a plugin's table; raises WrongOutputError if it is none, or cannot be written."""
    if not isinstance(found, Table):
        raise WrongOutputError("table", f"table gives a {type(found).__name__}, not a Table")
    if is_foreign(part):
        try:
            found.csv_rows(), found.markdown(), found.texts().tex("")
        except Exception as error:
            raise WrongOutputError(
                "table", f"the table cannot be written: {message_of(error)}"
            ) from None
    return found


def as_figure(found: object) -> "Figure":
    """Return a plugin's figure; raises WrongOutputError if it is none."""
    from matplotlib.figure import Figure

    if not isinstance(found, Figure):
        raise WrongOutputError("draw", f"draw gives a {type(found).__name__}, not a Figure")
    return found
