"""Errors of a table or figure: a failing one becomes a line, and the others are made."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from trackbench.component_parts import is_foreign
from trackbench.errors import RunError, UserError
from trackbench.plugins.plugin_errors import PluginError, package_line, plugin_code

T = TypeVar("T")


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


@dataclass(frozen=True, repr=False)
class NotedFailures:
    """Outputs that failed, with the reasons: a part of `Results`, which goes on without them."""

    unmade: dict[str, str] = field(default_factory=dict, init=False, compare=False)
    """tables, figures and other outputs that failed, with the reasons"""

    @property
    def unmade_lines(self) -> list[str]:
        """Failures of tables, figures and other outputs, a line each."""
        return [f"{output} failed: {reason}" for output, reason in self.unmade.items()]

    @contextmanager
    def continued_after_failure(self, output: str, exhibit: Any = None) -> Iterator[None]:
        """Catch an error within the block, and note it as the reason why the output is missing.

        ``output`` names the output in messages and in `unmade`. ``exhibit`` is the table or figure that
        the block makes, if it makes one.
        """
        try:
            with catch_errors(exhibit):
                yield
        except OutputError as error:
            self.unmade[output] = str(error)

    def attempt(self, output: str, make: Callable[[], T], default: T, exhibit: Any = None) -> T:
        """Return what ``make`` returns. If it fails, note the reason and return the default.

        ``output`` names the result in messages and in `unmade`. ``exhibit`` is the table or figure that
        ``make`` makes, if it makes one.
        """
        with self.continued_after_failure(output, exhibit):
            return make()
        return default
