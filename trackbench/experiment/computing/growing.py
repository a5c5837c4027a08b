"""Experiments that run until their numbers are as exact as asked (`until`)."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf, isfinite

from trackbench.evaluation.derived import sizes
from trackbench.evaluation.precision import Looked, Wanted, looked, looks
from trackbench.experiment.computing.runner import Outcome
from trackbench.experiment.planning.plan import Key
from trackbench.experiment.reading.definition import Experiment


def with_runs(experiment: Experiment, runs: int) -> Experiment:
    """The same with so many runs."""
    return replace(experiment, settings=replace(experiment.settings, runs=runs))


def begun(experiment: Experiment) -> Experiment:
    """With as many runs as there are at the first look; all of them if nothing is asked for."""
    settings = experiment.settings
    if not settings.until:
        return experiment
    return with_runs(experiment, next(looks(settings.min_runs, settings.runs)))


def grown(experiment: Experiment, most: int, outcome: Outcome) -> Experiment | None:
    """With the runs of the next look, if a number is not yet exact enough and there may be more.

    How far the number is that is farthest from it, the outcome says.
    """
    settings = experiment.settings
    after = [runs for runs in looks(settings.min_runs, most) if runs > settings.runs]
    if not after or not settings.until:
        return None
    left = [found for _, found in short(experiment, outcome)]
    if not left:
        return None
    worst = max(left, key=lambda found: found.share if isfinite(found.share) else inf)
    outcome.still = f"{worst.wanted.metric}: {worst.share:.2g} x the error wanted"
    return with_runs(experiment, after[0])


def short(experiment: Experiment, outcome: Outcome) -> Iterator[tuple[Key, Looked]]:
    """The numbers that are not yet exact enough."""
    asked = [Wanted.read(*item) for item in experiment.settings.until.items()]
    for key, result in outcome.results():
        scenario = experiment.points[key[0]].scenario
        for found in looked(asked, result, sizes(scenario), scenario.windows):
            if not found.enough:
                yield key, found


def why_ended(experiment: Experiment, most: int, outcome: Outcome) -> Iterator[str]:
    """Why the runs ended, if anything was asked of them."""
    if not experiment.settings.until:
        return
    runs, left = experiment.settings.runs, list(short(experiment, outcome))
    if not left:
        yield f"{runs} of at most {most} runs: every number is as exact as `until` asks"
    for key, found in left:
        asked = found.wanted
        error = f"{asked.error:.3g}" if not asked.relative else f"{100 * asked.error:g} %"
        yield (
            f"note: {experiment.title_of(key)}: after all {runs} runs the standard error of "
            f"{asked.metric} is {found.share:.3g} times the {error} that `until` asks"
        )
