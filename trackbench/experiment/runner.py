"""Run a plan: submit blocks, collect results, keep going when one filter fails."""

import time
from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, field

from trackbench.evaluation.block import BlockResult, BlockTask, run_block
from trackbench.evaluation.merge import FilterResult, merge
from trackbench.experiment.plan import Plan


@dataclass
class Outcome:
    """Results by point and filter label; what failed, with its reason; wall time."""

    results: dict[tuple[int, str], FilterResult] = field(default_factory=dict)
    failures: dict[tuple[int, str], str] = field(default_factory=dict)
    wall_s: float = 0.0


def execute(plan: Plan, executor: Executor, workers: int, progress: bool = True) -> Outcome:
    """Compute every block of the plan; a filter that raises is reported, the others go on."""
    started = time.perf_counter()
    done: dict[BlockTask, BlockResult] = {}
    errors: dict[BlockTask, str] = {}
    for task, future in _completed(plan.unique, executor, workers, progress):
        try:
            done[task] = future.result()
        except Exception as error:
            errors[task] = f"{type(error).__name__}: {error}"
    outcome = Outcome()
    for key, tasks in plan.tasks.items():
        failed = [errors[t] for t in tasks if t in errors]
        if failed:
            outcome.failures[key] = failed[0]
        else:
            outcome.results[key] = merge([done[t] for t in tasks])
    outcome.wall_s = time.perf_counter() - started
    return outcome


def _completed(
    tasks: list[BlockTask], executor: Executor, workers: int, progress: bool
) -> Iterable[tuple[BlockTask, Future[BlockResult]]]:
    """Tasks as they finish; only a few are in flight, so that Ctrl-C is felt at once."""
    from tqdm import tqdm

    queue = iter(tasks)
    running: dict[Future[BlockResult], BlockTask] = {}
    # disable=None: silent when stderr is no terminal
    with tqdm(total=len(tasks), unit="block", disable=None if progress else True) as bar:
        while True:
            for task in queue:
                running[executor.submit(run_block, task)] = task
                if len(running) >= 3 * workers:
                    break
            if not running:
                return
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                bar.update()
                yield running.pop(future), future
