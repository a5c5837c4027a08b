"""Whole processes as entrants: what a user waits for, wall time."""

import subprocess
import sys
import time
from pathlib import Path

from benchmarks.harness import Entrant, Outcome

ROOT = Path(__file__).parent.parent
FRESH = ("--fresh",)  # compute what the store may keep


def command(*arguments: str) -> Entrant:
    """``trackbench`` with these arguments, in the repository's root."""

    def entrant() -> Outcome:
        started = time.perf_counter()
        subprocess.run(
            [Path(sys.executable).parent / "trackbench", *arguments],
            cwd=ROOT,
            check=True,
            capture_output=True,
        )
        return Outcome(time.perf_counter() - started, 1.0)

    return entrant
