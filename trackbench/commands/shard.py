"""Option `--shard i/n`: compute a part of the blocks into the cache."""

import re
from collections.abc import Sequence
from contextlib import closing

from trackbench.commands.prepare_jobs import Job
from trackbench.commands.run_options import Options, say
from trackbench.errors import Mark, Problem, UserError
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import OpenEngine
from trackbench.execution.run_plans import execute


def run_shard(jobs: Sequence[Job], options: Options, open_engine: OpenEngine, workers: int) -> None:
    """Compute the missing blocks of one shard of every job's plan, and store them in the cache.

    A shard is a part of the blocks, so that several machines may share the work. Its number is the
    option ``shard``, such as ``1/8``. No results are written. Raises UserError for a config that tunes
    filters.
    """
    shard, number_of_shards = _parse_shard(options.shard)
    for job in jobs:
        if job.experiment.tuned:
            message = (
                "the blocks of tuned filters follow from tuning; run this config without --shard"
            )
            raise UserError(job.experiment.source.problem(("tune",), message))
    plans = [job.plan.of_shard(shard, number_of_shards) for job in jobs]
    store = BlockStore(cache_folder())
    outcomes = execute(
        plans, store, open_engine, workers, fresh=options.fresh, progress=not options.quiet
    )
    with closing(outcomes):
        for job, outcome in zip(jobs, outcomes, strict=True):
            number = f"{len(outcome.plan.unique)} of {len(job.plan.unique)} blocks"
            say(f"{outcome.plan.name}, shard {options.shard}: {number} in {store.root}/", options)
            for key, why in outcome.failures.items():
                say(f"note: {job.experiment.title_of(key)} failed: {why}", options)


def _parse_shard(text: str) -> tuple[int, int]:
    """Parse ``i/n``, the number of a shard and of all shards; raises UserError."""
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        message = f"{text!r} is no shard; allowed: 1/8 to 8/8 of eight shards"
        raise UserError(Problem(Mark("--shard"), "", message))
    return int(match[1]), int(match[2])
