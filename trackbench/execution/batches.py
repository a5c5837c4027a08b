"""Batches of stacks, which a worker process computes one after the other and stores."""

import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from trackbench.errors import WriteError
from trackbench.evaluation.block import BlockResult
from trackbench.execution.block_file import BlockFile, write_block
from trackbench.execution.worker import Environment, compute

if TYPE_CHECKING:
    from trackbench.plugins.load import Plugin


class Work(NamedTuple):
    """A pickled stack of tasks, and its blocks' files by number of runs used."""

    stack: bytes
    files: list[dict[int, BlockFile]]


class Computed(NamedTuple):
    """A stack's results by number of runs used, or its error, and the seconds that it took.

    The results of a stored block are empty: the message stays short enough for a pipe to take it
    whole, so that a worker that is killed leaves none that others wait for in vain.
    """

    results: list[dict[int, BlockResult]] | Exception
    seconds: float


def compute_batch(
    batch: Sequence[Work],
    plugins: "tuple[Plugin, ...]",
    expected: Environment,
    shared: Path | None = None,
) -> list[Computed]:
    """Compute stacks one after the other; an error affects its own stack.

    The blocks are stored if this process sees the file ``shared`` in their folder. Raises WriteError.
    """
    stores = shared is not None and shared.exists()
    return [_compute(work, plugins, expected, stores) for work in batch]


def _compute(
    work: Work, plugins: "tuple[Plugin, ...]", expected: Environment, stores: bool
) -> Computed:
    started = time.perf_counter()
    try:
        results = compute(work.stack, plugins, expected)
        if stores:
            with _undisturbed():
                for files, result in zip(work.files, results, strict=True):
                    for used in result:
                        write_block(files[used], result[used])
            results = [{} for _ in results]
    except WriteError:
        raise
    except Exception as error:
        return Computed(error, time.perf_counter() - started)
    return Computed(results, time.perf_counter() - started)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let a signal that ends this process wait until its file is complete, where the system can."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
