"""Code that runs in a worker process: compute a stack of blocks from its pickled tasks."""

import pickle
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from trackbench.evaluation.block import BlockResult, BlockTask
from trackbench.evaluation.run_block import run_stack
from trackbench.execution import fingerprints
from trackbench.execution.fingerprints import code_digest
from trackbench.plugins.errors import FilterError, guarded, located_message

if TYPE_CHECKING:
    from trackbench.plugins.load import Plugin


class Environment(NamedTuple):
    """Digests of what a block's numbers depend on: code, own arithmetic, numpy's arithmetic."""

    code: str
    own: str
    numpy: str


@cache
def environment_digests() -> Environment:
    """Return the digests of this process."""
    return Environment(
        code_digest(), fingerprints.own_arithmetic(), fingerprints.numpy_arithmetic()
    )


def compute(
    stack: bytes, plugins: "tuple[Plugin, ...]", expected: Environment
) -> list[dict[int, BlockResult]]:
    """Load the plugins, run the pickled block tasks, return each one's results by number of runs used.

    Raises RuntimeError if its numbers could differ from those of the requesting process.
    """
    here = environment_digests()
    if here.code != expected.code:
        raise RuntimeError("this worker has another version of trackbench, numpy or Python")
    if here.own != expected.own:
        raise RuntimeError("this worker's floating point is not that of IEEE 754")
    for plugin in plugins:
        # Here, since it brings the config's reader along.
        from trackbench.plugins.load import load_plugin

        load_plugin(plugin)
    blocks: list[BlockTask] = pickle.loads(stack)
    block = blocks[0]
    if here.numpy != expected.numpy and fingerprints.uses_numpy_arithmetic(
        block.scenario, block.filter, block.reference, block.assume
    ):
        raise RuntimeError(
            "numpy computes otherwise on this worker (another processor or C library), and this "
            "filter or scenario takes its functions: use workers of one kind"
        )
    try:
        with guarded():
            return run_stack(blocks)
    except Exception as error:
        raise FilterError(
            located_message(error, block.filter, block.scenario, block.reference)
        ) from None
