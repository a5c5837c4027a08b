"""Arrays that all filters of a block share: find writes to them by code of plugins."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from trackbench.component_parts import foreign_parts
from trackbench.core import constant_matrix_cache
from trackbench.core.undo_plugin_changes import Seal
from trackbench.evaluation.block_task import BlockTask
from trackbench.filters.base import WrongReturnError


@contextmanager
def sealed(task: BlockTask, *shared: Any) -> Iterator[None]:
    """Restore shared arrays if code of a plugin writes to them within the block.

    The arrays are read-only for numpy. A library that takes the address of an array can still write to
    it.

    Parameters
    ----------
    task
        task of a filter; only code of a plugin is watched
    *shared
        objects with arrays, such as the data and the model

    Raises
    ------
    WrongReturnError
        at the end of the block, if something was changed, and is now restored
    """
    # Only code of a plugin is watched.
    if not foreign_parts((task.filter, task.scenario, task.assume)):
        yield
        return
    # The seal copies the shared arrays and all cached results of the package's functions.
    seal = Seal(shared, constant_matrix_cache.cached_results())
    try:
        yield
    finally:
        if seal.mend():  # something was changed, and is now restored
            message = (
                "writes to measurements, a prior or matrices that all filters of the block share"
            )
            raise WrongReturnError("step", f"{message}: copy an array before you write to it")
