"""Experiments that run until their numbers are as precise as `until` requests."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf, isfinite

from trackbench.config.experiment import Experiment
from trackbench.evaluation.consistency import sizes
from trackbench.evaluation.stopping_rule import (
    PrecisionCheck,
    PrecisionTarget,
    check_precision,
    checkpoints,
)
from trackbench.execution.plan import Key
from trackbench.execution.runner import Outcome


def with_runs(experiment: Experiment, runs: int) -> Experiment:
    """Return the experiment with another number of runs."""
    return replace(experiment, settings=replace(experiment.settings, runs=runs))


def first_batch(experiment: Experiment) -> Experiment:
    """Return the experiment with the runs of the first checkpoint; all runs without `until`."""
    settings = experiment.settings
    if not settings.until:
        return experiment
    return with_runs(experiment, next(checkpoints(settings.min_runs, settings.runs)))


def next_batch(experiment: Experiment, most: int, outcome: Outcome) -> Experiment | None:
    """Return the experiment with the runs of the next checkpoint.

    Returns None after two good checkpoints in a row, or after the last. Writes the least precise
    number
    into the outcome, for the progress bar.
    """
    settings = experiment.settings
    stops = list(checkpoints(settings.min_runs, most))
    done = [runs for runs in stops if runs <= settings.runs]
    if len(done) == len(stops) or not settings.until:
        return None
    left, *earlier = [[*imprecise(experiment, outcome, runs)] for runs in done[:-3:-1]]
    if not left and earlier and not earlier[0]:
        return None
    worst = max((found for _, found in left), key=_finite_share, default=None)
    outcome.still = f"{worst.wanted.metric}: {worst.share:.2g} x the error wanted" if worst else ""
    return with_runs(experiment, stops[len(done)])


def _finite_share(found: PrecisionCheck) -> float:
    return found.share if isfinite(found.share) else inf


def imprecise(
    experiment: Experiment, outcome: Outcome, runs: int | None = None
) -> Iterator[tuple[Key, PrecisionCheck]]:
    """Yield the numbers that are not precise enough after ``runs`` runs, by default all."""
    asked = [PrecisionTarget.read(*item) for item in experiment.settings.until.items()]
    for key, result in outcome.results():
        scenario = experiment.points[key[0]].scenario
        for found in check_precision(asked, result, sizes(scenario), scenario.windows, runs):
            if not found.enough:
                yield key, found


def stop_reason(experiment: Experiment, most: int, outcome: Outcome) -> Iterator[str]:
    """Yield why the runs ended, if the config has `until`."""
    if not experiment.settings.until:
        return
    runs, left = experiment.settings.runs, list(imprecise(experiment, outcome))
    if not left:
        yield f"{runs} of at most {most} runs: every number is as exact as `until` asks"
    for key, found in left:
        asked = found.wanted
        error = f"{asked.error:.3g}" if not asked.relative else f"{100 * asked.error:g} %"
        yield (
            f"note: {experiment.title_of(key)}: after all {runs} runs the standard error of "
            f"{asked.metric} is {found.share:.3g} times the {error} that `until` asks"
        )
