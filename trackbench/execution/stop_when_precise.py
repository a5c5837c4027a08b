"""Stopping rule of the key `until`: numbers of runs at which standard errors are checked, and the end.

The rule is sequential with a fixed width (Chow & Robbins 1965; Law 2015, section 9.4.1): it depends on
the standard error of a number, never on its value. Before the first rare, very large error is drawn, a
standard error is too small, and nothing in the runs shows it. So the first check is late, and two checks
in a row have to succeed (docs/statistics.md has bias and coverage).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import NamedTuple

from trackbench.config.experiment import Experiment
from trackbench.evaluation.nees import sizes as sizes_of_nees
from trackbench.evaluation.precision_target import (
    PrecisionCheck,
    PrecisionTarget,
    check_precision,
    text_of_success,
)
from trackbench.execution.plan import Key, Plan, make_plan
from trackbench.execution.runner import Outcome

_GROWTH = 1.5  # from one number of runs at which the errors are checked to the next


def checkpoints(least: int, most: int) -> Iterator[int]:
    """Yield the numbers of runs after which errors are checked, from ``least`` to ``most``.

    Each number is half as large again as the one before.
    """
    runs = min(least, most)
    # n, 1.5 n, 2.25 n, ..., and the largest number last.
    while runs < most:
        yield runs
        runs = min(most, max(runs + 1, int(runs * _GROWTH)))
    yield most


def precise_after(stops: Sequence[int], precise: Sequence[bool]) -> int | None:
    """Return the number of runs at which the stopping rule stops; None if it never does.

    ``stops`` are the numbers of runs at which the rule may stop. ``precise`` has for each of them, as
    far as they were checked, whether the standard errors are small enough after so many runs. They must
    be small enough at two stops in a row; at the last stop, once is enough.
    """
    was_precise = False
    for runs, is_precise in zip(stops, precise, strict=False):
        if is_precise and was_precise:
            return runs
        was_precise = is_precise
    if len(precise) == len(stops) and precise[-1]:
        return stops[-1]
    return None


def with_runs(experiment: Experiment, runs: int) -> Experiment:
    """Return the experiment with another number of runs."""
    return replace(experiment, settings=replace(experiment.settings, runs=runs))


def first_batch(experiment: Experiment) -> Experiment:
    """Return the experiment with the runs of the first checkpoint; itself without the key `until`.

    A checkpoint is a number of runs after which the standard errors are checked.
    """
    settings = experiment.settings
    if not settings.until:
        return experiment
    return with_runs(experiment, next(checkpoints(settings.min_runs, settings.runs)))


class NextBatch(NamedTuple):
    """Experiment with the runs of the next checkpoint."""

    experiment: Experiment
    least_precise: str
    """the number that is farthest from its requested error, for the progress bar"""


def next_batch(experiment: Experiment, most: int, outcome: Outcome) -> NextBatch | None:
    """Return the experiment with the runs of the next checkpoint; None if the runs end.

    A checkpoint is a number of runs after which the standard errors are checked. The runs end without
    the key `until`, after the last checkpoint, or after two checkpoints in a row at which all standard
    errors are small enough. ``experiment`` has the runs made so far, which are at least those of the
    first checkpoint. ``most`` is the largest number of runs.
    """
    settings = experiment.settings
    if not settings.until:
        return None
    # Numbers of runs at all checkpoints, and at those up to now.
    stops = list(checkpoints(settings.min_runs, most))
    passed = [runs for runs in stops if runs <= settings.runs]
    if len(passed) == len(stops):
        return None
    # Stop if no number was imprecise at the last checkpoint, nor at the one before.
    # `imprecise` yields a check of each such number, after the grid point and the filter's label.
    last = [check for _, check in imprecise(experiment, outcome, passed[-1])]
    if not last and len(passed) > 1:
        before_last = list(imprecise(experiment, outcome, passed[-2]))
        if not before_last:
            return None
    least_precise = ""
    if last:
        # The ratio is a standard error divided by its target. One that is not finite, as of a target of
        # zero, counts as the worst.
        worst = max(last, key=lambda check: check.ratio if isfinite(check.ratio) else inf)
        least_precise = worst.progress_text
    bigger = with_runs(experiment, stops[len(passed)])
    return NextBatch(experiment=bigger, least_precise=least_precise)


def imprecise(
    experiment: Experiment, outcome: Outcome, runs: int | None = None
) -> Iterator[tuple[Key, PrecisionCheck]]:
    """Yield the numbers whose standard error is larger than the config's key `until` allows.

    The errors are those after the first ``runs`` runs; default: all. Before each check stand the grid
    point and the label of the filter.
    """
    targets = []
    for metric, error in experiment.settings.until.items():
        targets.append(PrecisionTarget.read(metric, error))
    for key, result in outcome.results():
        point, _ = key
        scenario = experiment.points[point].scenario
        # The number of the state's components in each NEES gives the ANEES.
        sizes = sizes_of_nees(scenario)
        for check in check_precision(targets, result, sizes, scenario.windows, runs):
            if not check.enough:
                yield key, check


def stop_reason(experiment: Experiment, most: int, outcome: Outcome) -> Iterator[str]:
    """Yield lines on why the runs ended, if the config has `until`.

    Either all standard errors are small enough, or a line names each that is not. ``experiment`` has the
    runs made, and ``most`` is the largest number of runs.
    """
    if not experiment.settings.until:
        return
    runs = experiment.settings.runs
    checks = list(imprecise(experiment, outcome))
    if not checks:
        yield text_of_success(runs, most)
    for key, check in checks:
        yield f"note: {experiment.title_of(key)}: {check.text_of_failure(runs)}"


def plan_of(experiment: Experiment, most: int, save_tracks: bool) -> Plan:
    """Split the runs of an experiment into blocks.

    The experiment may go on up to ``most`` runs. With the config's key `until` it ends earlier, once all
    numbers are precise enough. Results are then needed after each number of runs that is checked. With
    ``save_tracks`` the tracks of all runs are recorded.
    """
    settings = experiment.settings
    stops = []
    if settings.until:
        stops = list(checkpoints(settings.min_runs, most))
    return make_plan(experiment, save_tracks, stops)
