"""Recompute the first runs of an experiment, for a comparison with its stored results."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

from trackbench.config.computed_on_request import shown_runs
from trackbench.config.experiment import Experiment
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import cpu_count, engine
from trackbench.execution.memory import check_memory
from trackbench.execution.plan import make_plan
from trackbench.execution.run_plans import execute
from trackbench.report.tables_and_figures import Results
from trackbench.results.write_folder import write_results


def recompute(experiment: Experiment, folder: Path, runs: int, tracks: bool) -> Results:
    """Compute the first ``runs`` runs again, write their results to a folder and return them.

    ``tracks`` stores the tracks of all of these runs. Nothing is read from the cache. A block has as
    many runs as in the whole experiment, since `block: fit` depends on the number of runs.
    """
    # Figures may show more runs than are computed; then there are none.
    if min(shown_runs(experiment), experiment.settings.runs) > runs:
        experiment = replace(experiment, figures={})
    plan = make_plan(experiment, tracks).first(runs)
    workers = min(cpu_count(), len(plan.unique))
    check_memory(experiment, tracks)
    fewer = replace(experiment, settings=replace(experiment.settings, runs=runs))
    store = BlockStore(cache_folder())
    open_engine = engine("processes", workers)
    outcomes = execute([plan], store, open_engine, workers, fresh=True, progress=False)
    with closing(outcomes):
        facts = write_results(folder, fewer, next(outcomes), tracks).facts
    return Results(folder, facts)
