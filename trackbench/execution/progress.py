"""The progress bar: of a terminal or of a notebook, and none where nobody looks."""

import sys
from importlib.util import find_spec
from typing import Any


def progress_bar(total: int, unit: str, wanted: bool, **keys: Any) -> Any:
    """A bar of so many units, ``keys`` as tqdm has them."""
    if not wanted:
        hidden: bool | None = True
    else:  # None: silent when stderr is no terminal
        hidden = False if _in_notebook() else None
    return _kind()(total=total, unit=unit, disable=hidden, **keys)


def _kind() -> Any:
    """A notebook's own bar where it can show one."""
    import tqdm

    if not (_in_notebook() and find_spec("ipywidgets")):
        return tqdm.tqdm
    import tqdm.notebook

    return tqdm.notebook.tqdm


def _in_notebook() -> bool:
    """Whether a kernel runs this, whose stderr is no terminal and is looked at all the same."""
    return "ipykernel" in sys.modules and sys.modules["IPython"].get_ipython() is not None
