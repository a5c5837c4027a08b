"""W8: start-up: how long the small commands take."""

import sys
import tempfile
from pathlib import Path

from benchmarks.harness import Limit, Workload
from benchmarks.processes import FRESH, command, processes

EVERY_CORE = True
TINY = """name: tiny
seed: 1
runs: 10
scenario:
  {kind: tracking, first: 1, last: 50, target: {kind: driven, motion: sine-gamma},
   sensor: square-then-line, start: known}
filters:
  PF: {kind: pf, N: 10}
"""


def workloads() -> list[Workload]:
    """Help, list, check, and a run of ten runs of one filter.

    The limits are seconds of a machine on which Python imports numpy in 0.09 s: the last row says how
    much slower this one is at the moment.
    """
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    (folder / "tiny.yaml").write_text(TINY)
    tiny = ("run", str(folder / "tiny.yaml"), "--out", str(folder / "out"), *FRESH)
    return [
        Workload(
            "W8",
            "Start-up",
            "process",
            {
                "--help": command("--help"),
                "list": command("list"),
                "check": command("check", "hdepf"),
                "run of a tiny experiment": command(*tiny),
                "python that imports numpy": processes([(sys.executable, "-c", "import numpy")]),
            },
            limits=[
                Limit("--help", 0.25),
                Limit("list", 0.25),
                Limit("check", 0.6),
                Limit("run of a tiny experiment", 1.5),
            ],
        )
    ]
