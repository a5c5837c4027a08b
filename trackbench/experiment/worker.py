"""What runs in a worker process: one block, from bytes to its results."""

import multiprocessing
import os
import pickle
import signal
import threading
from typing import TYPE_CHECKING

from trackbench.evaluation.block import BlockResult, BlockTask, run_whole_block
from trackbench.experiment.code import code_digest
from trackbench.experiment.interrupts import guarded

if TYPE_CHECKING:
    from trackbench.experiment.plugins import Plugin


def compute(task: bytes, plugins: "tuple[Plugin, ...]", code: str) -> dict[int, BlockResult]:
    """Run the pickled block task, its plugins loaded first; results by number of runs used."""
    if code != code_digest():
        raise RuntimeError("this worker has another version of trackbench, numpy or Python")
    for plugin in plugins:
        from trackbench.experiment.plugins import load_plugin  # brings the config's reader along

        load_plugin(plugin)
    block: BlockTask = pickle.loads(task)
    with guarded():
        return run_whole_block(block)


def start_local_worker() -> None:
    """Leave Ctrl-C to the parent, and end when the parent is gone, even by kill -9."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()


def _follow(parent: "multiprocessing.process.BaseProcess") -> None:
    # The pool's pipes do not tell: every worker holds both of their ends.
    parent.join()
    os._exit(1)
