"""Compute a batch of stacks of blocks in a worker process, and store the blocks."""

import pickle
import signal
import sys
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from trackbench.component_parts import foreign_parts
from trackbench.errors import WriteError
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_blocks_side_by_side import run_stack
from trackbench.execution import arithmetic_digests
from trackbench.execution.block_file import BlockFile, write_block
from trackbench.execution.code_digests import code_digest
from trackbench.execution.failed_run import describe_failed_step
from trackbench.plugins.guarded_code import guarded, working_folder
from trackbench.plugins.load import load_plugin, working_folder_of
from trackbench.plugins.loaded_and_changed_plugins import forget_outdated
from trackbench.plugins.patches import own_values, patch_message, undo_patches
from trackbench.plugins.plugin_content import Plugin
from trackbench.plugins.plugin_errors import FilterError, located_message
from trackbench.plugins.stop_signals import blocked


class Environment(NamedTuple):
    """Digests of what a block's numbers depend on."""

    code: str
    """source code and versions of libraries"""
    arithmetic: str
    """the package's own arithmetic"""
    numpy: str
    """numpy's arithmetic"""


@cache
def environment_digests() -> Environment:
    """Digest this process, to compare it with the process that sends the work."""
    return Environment(
        code=code_digest(),
        arithmetic=arithmetic_digests.own_arithmetic(),
        numpy=arithmetic_digests.numpy_arithmetic(),
    )


def compute(
    stack: bytes, plugins: tuple[Plugin, ...], expected: Environment
) -> list[dict[int, BlockResult]]:
    """Load the plugins and run a pickled stack of tasks; return each block's results.

    A stack is a list of blocks that are filtered side by side. A block has results of all its runs, and
    of its first n runs if a plan uses only these: they are by the number of runs. Raises RuntimeError if
    the numbers could differ from those of the requesting process, whose digests of code and arithmetic
    are ``expected``. Raises FilterError if the filter or scenario fails.
    """
    digests = environment_digests()
    if digests.code != expected.code:
        raise RuntimeError("this worker has another version of trackbench, numpy or Python")
    if digests.arithmetic != expected.arithmetic:
        raise RuntimeError("this worker's floating point is not that of IEEE 754")
    # A plugin that was changed since this worker loaded it is executed again. It is compared with the
    # state that the requesting process noted in ``plugins``, not with the files as they are now.
    forget_outdated(plugins, as_now=False)
    for plugin in plugins:
        load_plugin(plugin)
    blocks: list[BlockTask] = pickle.loads(stack)
    block = blocks[0]  # the others differ in their runs, or in the numbers of their filters
    if digests.numpy != expected.numpy and arithmetic_digests.uses_numpy_arithmetic(
        block.scenario, *(b.filter for b in blocks), block.reference, block.assume
    ):
        raise RuntimeError(
            "numpy computes otherwise on this worker (another processor or C library), and this "
            "filter or scenario takes its functions: use workers of one kind"
        )
    # `assume` has the parts of the filter model that differ from the scenario's.
    components = (block.scenario, block.filter, block.reference, block.assume)
    # Only a plugin may replace functions of the package; without one there is nothing to undo: no names
    # and no functions are recorded.
    before = own_values() if foreign_parts(components) else ([], {})
    try:
        # A plugin's code cannot end the process (`guarded`). It runs in the folder that it changed to
        # when it was loaded.
        with guarded(), working_folder(working_folder_of(plugins)):
            results = run_stack(blocks)
    except Exception as error:
        message = located_message(error, block.filter, block.scenario, block.reference)
        place = ""
        # The blocks of a stack that fails are run again, each alone.
        if len(blocks) == 1:
            with working_folder(working_folder_of(plugins)):
                place = describe_failed_step(block, error)
        raise FilterError(message, place) from None
    finally:
        names = undo_patches(before)
    if names:
        raise FilterError(patch_message(names))
    return results


class Work(NamedTuple):
    """A stack of tasks for a worker."""

    stack: bytes
    """the pickled tasks"""
    files: list[dict[int, BlockFile]]
    """files of each block by number of runs used"""


class Computed(NamedTuple):
    """Results of a stack, the seconds that it took, and the peak of memory.

    The results of a stored block are empty: the message stays short enough for a pipe to take it
    whole, so that a worker that is killed leaves none that others wait for in vain.
    """

    results: list[dict[int, BlockResult]] | Exception
    """results of each block by number of runs used, or the error"""
    seconds: float
    memory: int
    """largest memory of the process so far, bytes"""


def compute_batch(
    batch: Sequence[Work],
    plugins: tuple[Plugin, ...],
    expected: Environment,
    shared: Path | None = None,
) -> list[Computed]:
    """Compute the stacks of a batch one after the other; the error of one does not affect the others.

    A stack has the blocks that are filtered side by side. ``expected`` are the digests of code and
    arithmetic of the requesting process: in a worker with other ones each stack has an error. The file
    ``shared`` is in the cache folder of that process. If it exists here, too, the folder is shared and
    this worker stores the blocks there. Raises WriteError.
    """
    stores = shared is not None and shared.exists()
    return [_compute_stack(work, plugins, expected, stores) for work in batch]


def _compute_stack(
    work: Work, plugins: tuple[Plugin, ...], expected: Environment, stores: bool
) -> Computed:
    """Compute the blocks of a stack in this process; write them to their files if ``stores``.

    A block has results for several numbers of its first runs, with a file for each number. Those of
    written blocks are returned as empty, to keep the message to the requesting process short.
    ``expected`` are the digests of code and arithmetic of that process.
    """
    started = time.perf_counter()
    results: list[dict[int, BlockResult]] | Exception
    try:
        results = compute(work.stack, plugins, expected)
        if stores:
            with blocked(signal.SIGTERM):  # until the files are complete
                for files, result in zip(work.files, results, strict=True):
                    for used in result:  # the number of runs that are used
                        write_block(files[used], result[used])
            results = [{} for _ in results]
    except WriteError:  # the cache cannot be written, which ends the whole run
        raise
    except Exception as error:
        results = error
    seconds = time.perf_counter() - started
    return Computed(results=results, seconds=seconds, memory=_peak_memory())


def _peak_memory() -> int:
    """Return the largest memory of this process so far, bytes; 0 where the system does not note it."""
    if sys.platform == "win32":
        return 0
    import resource

    unit = 1 if sys.platform == "darwin" else 1024  # bytes of the number's unit
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
