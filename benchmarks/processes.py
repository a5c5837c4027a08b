"""Whole processes as entrants: what a user waits for, wall time."""

import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from subprocess import DEVNULL

from benchmarks.harness import Entrant, Outcome

ROOT = Path(__file__).parent.parent
PROGRAM = str(Path(sys.executable).parent / "trackbench")
FRESH = ("--fresh",)  # compute what the store may keep


def command(*arguments: str) -> Entrant:
    """``trackbench`` with these arguments, in the repository's root."""
    return processes([(PROGRAM, *arguments)])


def processes(commands: Sequence[tuple[str, ...]]) -> Entrant:
    """Processes side by side, until the last has ended."""

    def entrant() -> Outcome:
        started = time.perf_counter()
        running = [
            subprocess.Popen(words, cwd=ROOT, stdout=DEVNULL, stderr=DEVNULL) for words in commands
        ]
        for process in running:
            if process.wait() != 0:
                raise RuntimeError(f"{process.args} ended with {process.returncode}")
        return Outcome(time.perf_counter() - started, 1.0)

    return entrant
