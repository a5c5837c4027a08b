"""What a published number is measured by: `mean(rmse)`, `rmse@20`, `gain(rms(rmse), PF)`, evaluated.

An expression's error comes as one influence per run where it can, so that a difference between two
filters on common runs is paired and a batch of runs can be judged by itself. Times have one per block.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.evaluation.shares import batch_of, in_batches, statistic_of
from trackbench.evaluation.statistics import OVER_RUNS, influence, mean
from trackbench.experiment.reading.grammar import (
    COMPOSED,
    STATISTIC,
    STEP,
    STEPS,
    at_each_step,
    plain,
)
from trackbench.report.given import keys_at
from trackbench.report.results import Results
from trackbench.report.terms import MISSING, Share, Term, gain, quietly, quotient, together


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
            if kind == "below":
                return self._below(label, inner, other)
            common = self._found([(label, inner), (other, inner)])
            ratio = quotient(*(self.term(b, inner, common) for b in (label, other)))
            return ratio if kind == "ratio" else gain(ratio)
        over_runs = self._of_runs(label, expression)
        if over_runs is not None:
            return self._over_runs(label, over_runs, common)
        step = STEP.fullmatch(expression)
        if step:
            return self._at_step(label, step.group(1), step.group(2))
        return self._plain(label, expression)

    def at_each_step(self, label: str, expression: str) -> list[str]:
        """An expression of many steps at each of those at which anything is known of the filter."""
        metric = STEPS.sub("", plain(expression))
        steps = self.results.at(self.results.per_step, self.point)
        mine = steps[(steps["filter"] == label) & (steps["metric"] == metric)]
        known = {int(k) for k in mine["step"]}
        for of, name in self.runs:
            step = STEP.fullmatch(name)
            if step and (of, step.group(1)) == (label, metric) and step.group(2) != "last":
                known.add(int(step.group(2)))
        return at_each_step(expression, sorted(known))

    @quietly
    def difference(
        self, left: tuple[str, str], right: tuple[str, str], factor: float = 1.0
    ) -> Term:
        """``left - factor * right`` of two (label, expression), paired on common runs."""
        common = self._found([left, right])
        a, b = (self.term(*side, common) for side in (left, right))
        return together(a.value - factor * b.value, a, b, 1.0, -factor)

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
            for name in (label, composed.group(3)) if composed else (label,):
                over_runs = self._of_runs(name, plain(expression))
                values = self.runs.get((name, over_runs.metric)) if over_runs else None
                if values is not None:
                    there = ~np.isnan(values)
                    common = there if common is None else common & there
        return common

    def _over_runs(self, label: str, wanted: _OverRuns, common: Mask | None) -> Term:
        values = self.runs.get((label, wanted.metric))
        if values is None:
            return MISSING
        return self._statistic(label, wanted.statistic, values / wanted.divisor, common)

    @quietly
    def _below(self, label: str, metric: str, other: str) -> Term:
        """The share of the common runs in which a filter's metric is below another's."""
        a, b = (self.runs.get((name, metric)) for name in (label, other))
        if a is None or b is None:
            return MISSING
        below = np.where(np.isnan(a) | np.isnan(b), np.nan, a < b)
        return Share(*self._statistic(label, "mean", below, None))

    def _statistic(self, label: str, name: str, values: Array, common: Mask | None) -> Term:
        """A statistic over the filter's runs that count, of values (M,) that are NaN where none is."""
        chosen = np.ones(len(values), bool) if self.chosen is None else self.chosen
        there = ~np.isnan(values)
        codes = self.runs.get((label, "lost"))
        lost = int((chosen & (~there if codes is None else codes > 0)).sum())
        kept = chosen & there if common is None else chosen & there & common
        x = values[kept]
        if not len(x):
            return MISSING._replace(lost=lost)
        influences = np.full(len(values), np.nan)
        influences[kept] = influence(name, x)
        return Term(*OVER_RUNS[name](x), influences, len(x), lost)

    def _at_step(self, label: str, metric: str, step: str) -> Term:
        frame = self.results.at(self.results.per_step, self.point)
        frame = frame[(frame["filter"] == label) & (frame["metric"] == metric)]
        if len(frame):
            wanted = frame["step"].max() if step == "last" else int(step)
            frame = frame[frame["step"] == wanted]
        if not len(frame):
            return MISSING
        row = frame.iloc[0]
        return Term(float(row["value"]), float(row["stderr"]), None, int(row["runs"]))

    def _plain(self, label: str, name: str) -> Term:
        """A row of summary.csv or timing.csv, or a number that the config gives the filter."""
        if (label, name) in self._summary:
            return self._summary[label, name]
        if label not in self.results.filters:
            return MISSING
        given = keys_at(self.results, self.point, ("filters", label)).get(name)
        if isinstance(given, int | float) and not isinstance(given, bool):
            return Term(float(given), 0.0, None, 1)
        return MISSING


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
