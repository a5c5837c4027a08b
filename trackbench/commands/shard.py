"""Shards of a run: each computes a part of the blocks into the shared cache and writes no results."""

import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

from trackbench.commands.prepare import Job, Options, say
from trackbench.errors import Mark, Problem, UserError
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import OpenEngine
from trackbench.execution.plan import Plan
from trackbench.execution.runner import execute


def run_shard(jobs: Sequence[Job], options: Options, open_engine: OpenEngine, workers: int) -> None:
    """Compute the missing blocks of one shard of every plan, and store them."""
    shard, shards = _read(options.shard)
    for job in jobs:
        if job.experiment.tuned:
            what = "the blocks of tuned filters follow from tuning; run this config without --shard"
            raise UserError(job.experiment.source.problem(("tune",), what))
    plans = [_part(job.plan, shard, shards) for job in jobs]
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


def _read(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        what = f"{text!r} is no shard; allowed: 1/8 to 8/8 of eight shards"
        raise UserError(Problem(Mark("--shard"), "", what))
    return int(found[1]), int(found[2])


def _part(plan: Plan, shard: int, shards: int) -> Plan:
    """Return the plan with consecutive blocks: every shard has blocks of all filters."""
    n = len(plan.unique)
    mine = set(plan.unique[n * (shard - 1) // shards : n * shard // shards])
    parts = {key: [t for t in tasks if t in mine] for key, tasks in plan.tasks.items()}
    return replace(plan, tasks={key: tasks for key, tasks in parts.items() if tasks})
