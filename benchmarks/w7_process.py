"""W7: the whole of `trackbench run experiments/hdepf.yaml`, tables and figures included."""

import tempfile

from benchmarks.harness import Entrant, Workload
from benchmarks.processes import FRESH, command

EVERY_CORE = True


def workloads() -> list[Workload]:
    """One worker and two, nothing reused."""
    out = tempfile.mkdtemp(prefix="bench-")

    def run(workers: int) -> Entrant:
        where = ("--workers", str(workers), "--out", out)
        return command("run", "experiments/hdepf.yaml", *FRESH, *where)

    return [
        Workload(
            "W7",
            "`trackbench run experiments/hdepf.yaml`, 13 filters, 200 runs",
            "process",
            {"two workers": run(2), "one worker": run(1)},
        )
    ]
