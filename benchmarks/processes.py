"""Whole processes as entrants: what a user waits for, wall time."""

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from subprocess import DEVNULL
from types import MappingProxyType

from benchmarks.harness import Entrant, Outcome

ROOT = Path(__file__).parent.parent
PROGRAM = str(Path(sys.executable).parent / "trackbench")
FRESH = ("--fresh",)  # compute what the store may keep
# An installed package has its modules compiled; a shell that forbids it would time the compiler.
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def command(*arguments: str, cache: str | None = None) -> Entrant:
    """``trackbench`` with these arguments, in the repository's root; blocks are kept in ``cache``."""
    return processes([(PROGRAM, *arguments)], {"TRACKBENCH_CACHE": cache} if cache else {})


def processes(
    commands: Sequence[tuple[str, ...]], also: Mapping[str, str] = MappingProxyType({})
) -> Entrant:
    """Processes side by side, until the last has ended, with these in their environment."""

    def entrant() -> Outcome:
        started = time.perf_counter()
        running = [
            subprocess.Popen(
                words, cwd=ROOT, env={**ENVIRONMENT, **also}, stdout=DEVNULL, stderr=DEVNULL
            )
            for words in commands
        ]
        for process in running:
            if process.wait() != 0:
                raise RuntimeError(f"{process.args} ended with {process.returncode}")
        return Outcome(time.perf_counter() - started, 1.0)

    return entrant
