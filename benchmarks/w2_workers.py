"""W2 with two worker processes: a banana experiment as a whole process."""

import tempfile
from pathlib import Path

from benchmarks.harness import Bar, Entrant, Workload
from benchmarks.ours import make
from benchmarks.processes import FRESH, command

EVERY_CORE = True
CONFIG = """name: banana-two-workers
seed: 1
runs: 400
scenario: {kind: banana}
filters:
  PF: {kind: pf, N: 10000}
"""


def workloads() -> list[Workload]:
    """One worker against two; needs two idle cores to mean anything."""
    make("scenarios", "banana")
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    (folder / "config.yaml").write_text(CONFIG)

    def run(workers: int) -> Entrant:
        where = ("--workers", str(workers), "--out", str(folder / "out"))
        return command("run", str(folder / "config.yaml"), *FRESH, *where)

    return [
        Workload(
            "W2 workers",
            "`trackbench run` of a bootstrap filter, banana, N = 10000, 400 runs",
            "process",
            {"two workers": run(2), "one worker": run(1)},
            bars=[Bar("one worker", "two workers", 1.8)],
        )
    ]
