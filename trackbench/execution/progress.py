"""Progress bar of the terminal or the notebook."""

import sys
from importlib.util import find_spec
from typing import Any


def progress_bar(total: int, unit: str, wanted: bool, **keys: Any) -> Any:
    """Return a progress bar of ``total`` units; ``keys`` are tqdm's."""
    if not wanted:
        hidden: bool | None = True
    else:  # None: silent when stderr is no terminal
        hidden = False if _in_notebook() else None
    return _kind()(total=total, unit=unit, disable=hidden, **keys)


def _kind() -> Any:
    """Return the bar's class: the notebook's where it can be shown."""
    import tqdm

    if not (_in_notebook() and find_spec("ipywidgets")):
        return tqdm.tqdm
    import tqdm.notebook

    return tqdm.notebook.tqdm


def _in_notebook() -> bool:
    """Return whether an IPython kernel runs this process."""
    return "ipykernel" in sys.modules and sys.modules["IPython"].get_ipython() is not None
