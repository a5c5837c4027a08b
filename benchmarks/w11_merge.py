"""W11: merging the blocks of a cluster: how many cores one merging process keeps busy."""

import os
import shutil
import tempfile
import time
from pathlib import Path

from benchmarks.harness import Bar, Entrant, Outcome, Workload
from trackbench.commands.prepare_jobs import Job, jobs_of
from trackbench.commands.run_options import Options
from trackbench.execution.cache import BlockStore
from trackbench.execution.engines import engine
from trackbench.execution.run_plans import Outcome as BlockOutcome
from trackbench.execution.run_plans import execute
from trackbench.results import write_npz
from trackbench.results.write_folder import write_results

CONFIG = "hdepf"
RUNS = 20_000
"""runs that are merged: 150 cores need ten times as long as the merging process's fixed costs take"""
COMPUTED_RUNS = 1000
"""runs that are computed in a round, for the rate"""
CORES = 150


def workloads() -> list[Workload]:
    """Compute all filters' blocks; merge them from the store into rows, and into arrays."""
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    job = _job(folder / "out", RUNS)
    store = BlockStore(folder / "cache")
    # The blocks that another machine of the cluster has computed.
    _execute(job, store, fresh=False)
    part = _job(folder / "part", COMPUTED_RUNS)
    entrants = {
        "blocks computed": _compute(part, BlockStore(folder / "part-cache")),
        "merged into rows": _merge(job, store, many_runs=RUNS),
        "merged into arrays": _merge(job, store, many_runs=0),
    }
    bars = [Bar("blocks computed", "merged into arrays", CORES)]
    title = f"Merging a cluster's blocks: {CONFIG}, {RUNS} runs of all filters"
    return [Workload("W11", title, "run", entrants, bars=bars)]


def _job(out: Path, runs: int) -> Job:
    os.makedirs(out)
    (job,) = jobs_of([CONFIG], Options(out=out, runs=runs, quiet=True))
    return job


def _execute(job: Job, store: BlockStore, fresh: bool) -> BlockOutcome:
    (outcome,) = execute([job.plan], store, engine("serial", 1, None), 1, fresh, progress=False)
    return outcome


def _compute(job: Job, store: BlockStore) -> Entrant:
    def entrant() -> Outcome:
        started = time.process_time()
        _execute(job, store, fresh=True)
        return Outcome(time.process_time() - started, float(COMPUTED_RUNS))

    return entrant


def _merge(job: Job, store: BlockStore, many_runs: int) -> Entrant:
    def entrant() -> Outcome:
        # A merge writes a new folder: to remove the large files of an earlier one is not part of it.
        shutil.rmtree(job.folder)
        job.folder.mkdir()
        usual = write_npz.MANY_RUNS
        write_npz.MANY_RUNS = many_runs
        try:
            started = time.process_time()
            # Find the blocks of the cluster, merge them, and write the results.
            outcome = _execute(job, store, fresh=False)
            write_results(job.folder, job.experiment, outcome, tracks=False)
            seconds = time.process_time() - started
        finally:
            write_npz.MANY_RUNS = usual
        return Outcome(seconds, float(RUNS))

    return entrant
