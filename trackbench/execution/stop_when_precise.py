"""Stopping rule of the key `until`: standard errors that it requests, and the runs at which it stops.

The rule is sequential with a fixed width (Chow & Robbins 1965; Law 2015, section 9.4.1): it depends on
the standard error of a number, never on its value. Before the first rare, very large error is drawn, a
standard error is too small, and nothing in the runs shows it. So the first check is late, and two checks
in a row have to succeed (docs/statistics.md has bias and coverage).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import NamedTuple

from trackbench.config.experiment import Experiment
from trackbench.core.arrays import Array, Mask
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.nees import sizes as sizes_of_nees
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.summary_rows import SummaryRow, summary_rows
from trackbench.execution.plan import Key, Plan, make_plan
from trackbench.execution.run_plans import Outcome
from trackbench.statistics.share_of_runs import share_stderr

_GROWTH = 1.5  # from one number of runs at which the errors are checked to the next


class PrecisionTarget(NamedTuple):
    """Target of the standard error of a number of the summary, in its unit or as a share of it."""

    metric: str
    error: float
    relative: bool

    @classmethod
    def read(cls, metric: str, error: float | str) -> "PrecisionTarget":
        """Read the standard error that a config requests: ``1%``, or a number in the metric's unit."""
        if isinstance(error, str):
            return cls(metric, float(error.removesuffix("%")) / 100.0, relative=True)
        return cls(metric, float(error), relative=False)

    def ratio(self, row: SummaryRow) -> float:
        """Return the standard error of a summary row divided by its target; above 1 it is too large.

        The result is NaN if the target is zero, as is 1 % of a value that is zero.
        """
        target = self.error
        if self.relative:
            target = self.error * abs(row.value)
        stderr = row.stderr
        if stderr == 0.0 and measured(row.metric).is_share:
            # All runs agree on an event: take the standard error of its exact interval.
            stderr = share_stderr(round(row.value * row.runs), row.runs)
        if target > 0.0:
            return stderr / target
        return float("nan")


class PrecisionCheck(NamedTuple):
    """A number of the summary, and the ratio of its standard error to the target."""

    target: PrecisionTarget
    row: SummaryRow
    ratio: float
    """standard error divided by the target: above 1 it is too large"""

    @property
    def enough(self) -> bool:
        """True if the target is met, or every run is lost."""
        return self.ratio <= 1.0 or self.row.runs == 0

    @property
    def progress_text(self) -> str:
        """Text for the progress bar: ``position: 1.3 x the error wanted``."""
        return f"{self.target.metric}: {self.ratio:.2g} x the error wanted"

    def text_of_failure(self, runs: int) -> str:
        """Describe by how much the target is missed after all ``runs`` runs."""
        error = f"{self.target.error:.3g}"
        if self.target.relative:
            error = f"{100 * self.target.error:g} %"
        return (
            f"after all {runs} runs the standard error of {self.target.metric} is "
            f"{self.ratio:.3g} times the {error} that `until` asks"
        )


def text_of_success(runs: int, most: int) -> str:
    """Describe that all targets are met after ``runs`` of at most ``most`` runs."""
    return f"{runs} of at most {most} runs: every number is as exact as `until` asks"


def check_precision(
    targets: Sequence[PrecisionTarget],
    result: FilterResult,
    sizes: Mapping[str, int],
    windows: Mapping[str, Mask],
    runs: int | None = None,
) -> list[PrecisionCheck]:
    """Compare the standard errors of one filter after its first ``runs`` runs with the targets.

    Without ``runs`` all runs count. ``result`` has the filter's values per run, and ``windows`` the
    masks (T + 1,) of the steps by name. ``sizes`` has the number of components of each NEES by its
    marginal, a part of the state such as "position", or "" for the whole state. A target is left out if
    the filter's summary has no row of its metric.
    """
    # Summarize only the values that the targets are computed from; a summary also counts lost runs.
    names = {target.metric for target in targets}
    needed = {_per_run_values(name) for name in names}
    needed.add(_per_run_values("lost"))
    per_run: dict[str, Array] = {
        metric: values[:runs]
        for metric, values in result.per_run.items()
        if _per_run_values(metric) in needed
    }
    # Summarize them as summary.csv does. The sums per step are over all runs and are left out: a time
    # mean then has a row only if the contribution of each run to it is stored.
    rows = summary_rows(result._replace(per_run=per_run, steps={}), sizes, windows)
    by_metric = {row.metric: row for row in rows if row.metric in names}
    checks = []
    for target in targets:
        if target.metric in by_metric:
            row = by_metric[target.metric]
            checks.append(PrecisionCheck(target=target, row=row, ratio=target.ratio(row)))
    return checks


def _per_run_values(metric: str) -> tuple[str, str]:
    """Return which values per run a number of the summary is computed from: their metric and window.

    ``mean(rmse[turns])`` is computed from those of ``rmse`` over the window ``turns``; a window of all
    steps is "".
    """
    m = measured(metric)
    return m.base, m.window


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
