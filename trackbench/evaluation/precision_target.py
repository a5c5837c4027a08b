"""Standard errors that the key `until` requests, and how far those of the runs are from them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from trackbench.core.arrays import Array, Mask
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.summary_rows import SummaryRow, summary_rows
from trackbench.statistics.share_of_runs import share_stderr


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
