"""Progress bar of a terminal or a notebook; lines of progress where stderr is a file."""

import sys
import time
from importlib.util import find_spec
from math import inf
from typing import Any

from trackbench.errors import counted

_LONG_S = 10.0
"""Seconds from which progress is printed where stderr is no terminal."""


def progress_bar(total: int, unit: str, wanted: bool, **keys: Any) -> Any:
    """Return a progress bar of ``total`` units, or an object that prints lines outside of terminals.

    ``wanted`` is False for no bar, and ``keys`` are arguments of tqdm.
    """
    if wanted and not sys.stderr.isatty() and not _in_notebook():
        return _ProgressLines(total, unit, **keys)
    bar_class = _bar_class()
    return bar_class(total=total, unit=unit, disable=not wanted, **keys)


class _ProgressLines:
    """Progress into a file: a line after each tenth of the units, if they take long.

    Short bars that follow each other print a line, too, if there was none for as long.
    """

    _last_line_s = -inf
    """time of the last line of any bar, or of the first bar's begin"""

    def __init__(self, total: int, unit: str, initial: int = 0, desc: str = "") -> None:
        """Begin with ``initial`` of ``total`` units done. The arguments are those of tqdm.

        ``unit`` is the word for one of them, and ``desc`` begins each line.
        """
        self.total = total
        self._unit = unit
        self._done = initial
        self._name = desc
        self._began = time.monotonic()
        if _ProgressLines._last_line_s == -inf:  # this is the first bar of the program
            _ProgressLines._last_line_s = self._began
        self._tenths = 10 * initial // max(total, 1)
        """tenths that are done as of the last line"""

    def __enter__(self) -> "_ProgressLines":
        return self

    def __exit__(self, *_: object) -> None:
        return

    def update(self, n: int = 1) -> None:
        """Count ``n`` further units as done. Print a line after a further tenth if they take long.

        They do if this bar began `_LONG_S` seconds ago, or if no bar printed a line for so long.
        """
        self._done += n
        tenths = 10 * self._done // max(self.total, 1)
        now = time.monotonic()
        seconds = now - self._began
        is_long = seconds >= _LONG_S or now - _ProgressLines._last_line_s >= _LONG_S
        if tenths > self._tenths and is_long:
            self._tenths = tenths
            _ProgressLines._last_line_s = now
            units = f"{self._done} of {counted(self.total, self._unit)}"
            print(f"{self._name}: {units}, {seconds:.0f} s", file=sys.stderr, flush=True)

    def set_postfix_str(self, text: str) -> None:
        """Ignore the text that a bar shows after the count."""


def _bar_class() -> Any:
    """Return tqdm's class of a bar: that for notebooks if this is one and it can show the bar."""
    import tqdm

    if not (_in_notebook() and find_spec("ipywidgets")):
        return tqdm.tqdm
    import tqdm.notebook

    return tqdm.notebook.tqdm


def _in_notebook() -> bool:
    """Test whether an IPython kernel runs this process."""
    return "ipykernel" in sys.modules and sys.modules["IPython"].get_ipython() is not None
