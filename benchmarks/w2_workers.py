"""W2 with two worker processes: a banana experiment as a whole process."""

import tempfile
from pathlib import Path

from benchmarks.harness import Bar, Workload
from benchmarks.ours import scenario_file, shipped
from benchmarks.processes import FRESH, PROGRAM, command, processes

EVERY_CORE = True
RUNS = 400
CONFIG = f"""name: banana-two-workers
seed: 1
scenario: {scenario_file("banana")}
filters:
  PF: {{kind: pf, N: 10000}}
"""


def workloads() -> list[Workload]:
    """One worker against two; needs two idle cores to mean anything.

    How far two cores of this machine get at all is shown by two programs that know nothing of each
    other, with half of the runs each.
    """
    shipped("banana")
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    (folder / "config.yaml").write_text(CONFIG)

    def words(workers: int, out: str = "out", runs: int = RUNS) -> tuple[str, ...]:
        what = ("run", str(folder / "config.yaml"), "--runs", str(runs), *FRESH)
        return *what, "--workers", str(workers), "--out", str(folder / out)

    halves = [(PROGRAM, *words(1, out, RUNS // 2)) for out in ("first", "second")]
    return [
        Workload(
            "W2 workers",
            "`trackbench run` of a bootstrap filter, banana, N = 10000, 400 runs",
            "process",
            {
                "two workers": command(*words(2)),
                "one worker": command(*words(1)),
                "two programs, half of the runs each": processes(halves),
            },
            bars=[Bar("one worker", "two workers", 1.8)],
        )
    ]
