"""What a published number is measured by: `mean(rmse)`, `rmse@20`, `gain(rms(rmse), PF)`, evaluated.

An expression's error comes as one influence per run where it can, so that a difference between two
filters on common runs is paired and a batch of runs can be judged by itself. Times have one per block.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.evaluation.intervals import (
    FRAGILE,
    dominance,
    interval_of,
    normal_of_t,
    quantile,
    studentised,
)
from trackbench.evaluation.shares import batch_of, in_batches, statistic_of
from trackbench.evaluation.statistics import OVER_RUNS, Estimate, influence, mean, z_score
from trackbench.experiment.metric_names import COMPOSED, STATISTIC, STEP
from trackbench.report.given import keys_at
from trackbench.report.lost import in_words
from trackbench.report.results import Results


class Term(NamedTuple):
    """A number, its standard error, and each run's influence (M,) if it has one; runs and lost runs."""

    value: float
    stderr: float
    influences: Array | None
    runs: int
    lost: int = 0
    blocks: Array | None = None
    """influence (B,) of each block of runs on a time"""
    freedom: float = np.inf
    """degrees of freedom of a standard error that no influences give"""

    @property
    def estimate(self) -> Estimate:
        """Value and standard error."""
        return Estimate(self.value, self.stderr)

    @property
    def splits(self) -> bool:
        """Whether batches of runs have numbers of their own."""
        return self.influences is not None

    @property
    def losses(self) -> str:
        """How many runs were lost, in words; empty if none was."""
        return in_words(self.lost, self.runs + self.lost) if self.lost else ""

    @property
    def fragile(self) -> bool:
        """Whether one run makes a good part of the number's variance."""
        return self.influences is not None and dominance(self.influences) > FRAGILE

    def z(self, target: float = 0.0, other: float = 0.0) -> float:
        """z of the hypothesis that the number is the target, whose own standard error is ``other``."""
        with np.errstate(all="ignore"):
            if self.influences is None:
                t = z_score(Estimate(self.value - target, np.hypot(self.stderr, other)))
                return normal_of_t(t, self.freedom)
            return studentised(self.value - target, self.influences, other)

    def interval(self, level: float = 0.95, other: float = 0.0) -> tuple[float, float]:
        """Confidence interval, of all targets that `z` does not exclude; NaN of what has no error."""
        with np.errstate(all="ignore"):
            if self.influences is None:
                width = quantile(level, self.freedom) * float(np.hypot(self.stderr, other))
                return self.value - width, self.value + width
            return interval_of(self.value, self.influences, level, other)


# A filter that left the numbers has infinite statistics; they are shown, not warned about.
_quietly = np.errstate(all="ignore")
_MISSING = Term(np.nan, np.nan, None, 0)


class _OverRuns(NamedTuple):
    """A statistic over runs of a metric, and what divides it."""

    statistic: str
    metric: str
    divisor: float = 1.0


@dataclass(frozen=True)
class Expressions:
    """Expressions over one results folder at one point of its grid; over some of its runs, if told."""

    results: Results
    point: dict[str, Any]
    chosen: Mask | None = None
    """the runs (M,) that count"""
    parts: int = 1
    """the batches that the runs are split into, of which they are one"""
    whole: "Expressions | None" = None
    """all runs, of which they are a batch"""

    def batches(self, number: int) -> list["Expressions"]:
        """The same over so many batches of consecutive runs, whose streams are independent."""
        runs = max(map(len, self.runs.values()), default=0)
        batch = batch_of(runs, number)
        return [replace(self, chosen=batch == i, parts=number, whole=self) for i in range(number)]

    def term(self, label: str, expression: str, common: Mask | None = None) -> Term:
        """A filter's expression; over the ``common`` runs (M,) only, if they are given."""
        composed = COMPOSED.fullmatch(expression)
        if composed:
            kind, inner, other = composed.groups()
            if kind == "minus":
                return self.difference((label, inner), (other, inner))
            common = self._found([(label, inner), (other, inner)])
            ratio = quotient(*(self.term(b, inner, common) for b in (label, other)))
            return ratio if kind == "ratio" else _gain(ratio)
        over_runs = self._of_runs(label, expression)
        if over_runs is not None:
            return self._over_runs(label, over_runs, common)
        step = STEP.fullmatch(expression)
        if step:
            return self._at_step(label, step.group(1), step.group(2))
        return self._plain(label, expression)

    @_quietly
    def difference(
        self, left: tuple[str, str], right: tuple[str, str], factor: float = 1.0
    ) -> Term:
        """``left - factor * right`` of two (label, expression), paired on common runs."""
        common = self._found([left, right])
        a, b = (self.term(*side, common) for side in (left, right))
        return _together(a.value - factor * b.value, a, b, 1.0, -factor)

    @cached_property
    def runs(self) -> dict[tuple[str, str], Array]:
        """Values per run by (filter, metric)."""
        return self.results.runs(self.point)

    @cached_property
    def _summary(self) -> dict[tuple[str, str], Term]:
        if self.whole is not None:
            return self.whole._summary
        frame = self.results.at(self.results.summary, self.point)
        rows = frame.to_dict("records")
        found = {
            (r["filter"], r["metric"]): Term(r["value"], r["stderr"], None, r["runs"], r["lost"])
            for r in rows
        }
        for r in self.results.at(self.results.timing, self.point).to_dict("records"):
            found[r["filter"], "cpu_s_per_run"] = _time(r)
        return found

    def _of_runs(self, label: str, expression: str) -> _OverRuns | None:
        """The statistic that an expression is; None for a time, or if no run has a part in it."""
        statistic = STATISTIC.fullmatch(expression)
        if statistic:
            return _OverRuns(statistic.group(1), statistic.group(2))
        shared = statistic_of(expression)
        if shared and (label, expression) in self.runs:  # of other batches than these: none
            alone = self.parts == 1
            return _OverRuns(shared, expression if alone else in_batches(expression, self.parts))
        nees = expression.removeprefix("a")
        if expression.startswith("anees") and (label, nees) in self.runs:
            a, b = (self._summary.get((label, name)) for name in (f"mean({nees})", expression))
            if a is not None and b is not None and 0.0 < b.value < np.inf:  # else nobody's part
                return _OverRuns("mean", nees, round(a.value / b.value))
        return None

    def _found(self, sides: list[tuple[str, str]]) -> Mask | None:
        """Runs that every side's metric exists for."""
        common: Mask | None = None
        for label, expression in sides:
            composed = COMPOSED.fullmatch(expression)
            inner = composed.group(2) if composed else expression
            for name in (label, composed.group(3)) if composed else (label,):
                over_runs = self._of_runs(name, inner)
                values = self.runs.get((name, over_runs.metric)) if over_runs else None
                if values is not None:
                    there = ~np.isnan(values)
                    common = there if common is None else common & there
        return common

    def _over_runs(self, label: str, wanted: _OverRuns, common: Mask | None) -> Term:
        values = self.runs.get((label, wanted.metric))
        if values is None:
            return _MISSING
        chosen = np.ones(len(values), bool) if self.chosen is None else self.chosen
        there = ~np.isnan(values)
        codes = self.runs.get((label, "lost"))
        lost = int((chosen & (~there if codes is None else codes > 0)).sum())
        kept = chosen & there if common is None else chosen & there & common
        x = values[kept] / wanted.divisor
        if not len(x):
            return _MISSING._replace(lost=lost)
        influences = np.full(len(values), np.nan)
        influences[kept] = influence(wanted.statistic, x)
        return Term(*OVER_RUNS[wanted.statistic](x), influences, len(x), lost)

    def _at_step(self, label: str, metric: str, step: str) -> Term:
        frame = self.results.at(self.results.per_step, self.point)
        frame = frame[(frame["filter"] == label) & (frame["metric"] == metric)]
        if len(frame):
            wanted = frame["step"].max() if step == "last" else int(step)
            frame = frame[frame["step"] == wanted]
        if not len(frame):
            return _MISSING
        row = frame.iloc[0]
        return Term(float(row["value"]), float(row["stderr"]), None, int(row["runs"]))

    def _plain(self, label: str, name: str) -> Term:
        """A row of summary.csv or timing.csv, or a number that the config gives the filter."""
        if (label, name) in self._summary:
            return self._summary[label, name]
        if label not in self.results.filters:
            return _MISSING
        given = keys_at(self.results, self.point, ("filters", label)).get(name)
        if isinstance(given, int | float) and not isinstance(given, bool):
            return Term(float(given), 0.0, None, 1)
        return _MISSING


def over_runs(expressions: Expressions, label: str, expression: str) -> tuple[str, Array] | None:
    """Name of the statistic and its values per run, lost runs left out; None for anything else."""
    statistic = STATISTIC.fullmatch(expression)
    values = expressions.runs.get((label, statistic.group(2))) if statistic else None
    if statistic is None or values is None:
        return None
    return statistic.group(1), values[~np.isnan(values)]


def _time(row: dict[str, Any]) -> Term:
    """A time per run, whose error is that of its blocks of runs, if there are two."""
    each = str(row.get("blocks", "")).split(";")
    seconds = np.array([float(s) for s in each if s])
    term = Term(row["cpu_s_per_run"], row["stderr"], None, row["runs"])
    if len(seconds) < 2:
        return term
    return term._replace(blocks=seconds - mean(seconds).value, freedom=len(seconds) - 1.0)


@_quietly
def quotient(a: Term, b: Term) -> Term:
    """``a / b``; delta method, paired where it can be."""
    ratio, scale = (float(np.divide(x, b.value)) for x in (a.value, 1.0))
    return _together(ratio, a, b, scale, -scale * ratio)


@_quietly
def _gain(ratio: Term) -> Term:
    """Percent by which the ratio is below one."""
    of_runs, of_blocks = (
        None if x is None else -100.0 * x for x in (ratio.influences, ratio.blocks)
    )
    return ratio._replace(
        value=100.0 * (1.0 - ratio.value),
        stderr=100.0 * ratio.stderr,
        influences=of_runs,
        blocks=of_blocks,
    )


@_quietly
def _together(value: float, a: Term, b: Term, of_a: float, of_b: float) -> Term:
    """What moves by ``of_a`` times a's change and ``of_b`` times b's; paired by runs, or by blocks."""
    runs, of_runs = min(a.runs, b.runs), _combined(a, b, a.influences, b.influences, of_a, of_b)
    if of_runs is not None:
        there = of_runs[~np.isnan(of_runs)]
        return Term(value, mean(there).stderr, of_runs, len(there), a.lost)
    term = Term(value, np.nan, None, runs, a.lost, freedom=min(a.freedom, b.freedom))
    blocks = _combined(a, b, a.blocks, b.blocks, of_a, of_b)
    if blocks is not None and a.runs == b.runs:  # of the same runs, computed one after the other
        return term._replace(stderr=mean(blocks).stderr, blocks=blocks)
    return term._replace(stderr=float(np.hypot(of_a * a.stderr, of_b * b.stderr)))


def _combined(
    a: Term, b: Term, x: Array | None, y: Array | None, of_a: float, of_b: float
) -> Array | None:
    """``of_a x + of_b y`` of influences; None if a side has none and is no exact number either."""
    if x is None and y is not None and a.stderr == 0.0:
        return of_b * y
    if y is None and x is not None and b.stderr == 0.0:
        return of_a * x
    if x is None or y is None or len(x) != len(y):
        return None
    return of_a * x + of_b * y
