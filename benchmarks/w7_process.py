"""W7: edit, run, look: all of `trackbench run hdepf`, tables and figures included."""

import os
import tempfile

from benchmarks.harness import Entrant, Limit, Workload
from benchmarks.processes import FRESH, command

EVERY_CORE = True
CONFIG = "hdepf"
RUNS = 200


def workloads() -> list[Workload]:
    """With its blocks computed and with them and the figures kept; with 20 runs; one figure again.

    200 runs are what the experiment had when its bars were set, of 1.8 s with its blocks kept and 3.5 s
    with them computed. Without what the filters take (some seven seconds on one core, which is W1's to
    W6's), the second is held by the 20 runs of ``--quick``, which is how one looks at an edit.
    """
    home = tempfile.mkdtemp(prefix="bench-")
    cache, out = os.path.join(home, "cache"), os.path.join(home, "out")
    few = ("--runs", str(RUNS))

    def run(*words: str) -> Entrant:
        return command("run", CONFIG, *words, "--out", out, cache=cache)

    fill_cache = run(*few)
    fill_cache()

    def computed(*words: str) -> Entrant:  # with other times, of which figures would be drawn again
        elsewhere = os.path.join(home, "computed")
        return command("run", CONFIG, *words, *FRESH, "--out", f"{out}-computed", cache=elsewhere)

    entrants = {
        "blocks kept": run(*few),
        "blocks kept, one worker": run(*few, "--workers", "1"),
        "20 runs, computed": computed("--quick"),
        f"{RUNS} runs, computed": computed(*few),
        "one figure again": command("plot", out, "--only", "figure2"),
    }
    limits = [
        Limit("blocks kept", 1.8),
        Limit("20 runs, computed", 3.5),
        Limit("one figure again", 1.0),
    ]
    title = f"Edit, run, look: `trackbench run {CONFIG}`, 13 filters, seven figures"
    return [Workload("W7", title, "process", entrants, limits=limits)]
