"""What a published number is measured by: `mean(rmse)`, `rmse@20`, `gain(rms(rmse), PF)`, evaluated.

An expression's error comes as one influence per run where it can, so that a difference between two
filters on common runs is paired; times and steps have a standard error only.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.evaluation.statistics import STATISTICS, Estimate, influence, mean
from trackbench.experiment.metric_names import COMPOSED, STATISTIC, STEP
from trackbench.report.given import keys_at
from trackbench.report.results import Results


class Term(NamedTuple):
    """A number, its standard error, and each run's influence (M,) if it has one; runs and lost runs."""

    value: float
    stderr: float
    influences: Array | None
    runs: int
    lost: int = 0

    @property
    def estimate(self) -> Estimate:
        """Value and standard error."""
        return Estimate(self.value, self.stderr)


# A filter that left the numbers has infinite statistics; they are shown, not warned about.
_quietly = np.errstate(all="ignore")
_MISSING = Term(np.nan, np.nan, None, 0)


@dataclass(frozen=True)
class Expressions:
    """Expressions over one results folder at one point of its grid."""

    results: Results
    point: dict[str, Any]

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
        statistic = STATISTIC.fullmatch(expression)
        if statistic:
            return self._over_runs(label, statistic.group(1), statistic.group(2), common)
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
        value = a.value - factor * b.value
        stderr = float(np.hypot(a.stderr, factor * b.stderr))
        if a.influences is None or b.influences is None:
            return Term(value, stderr, None, min(a.runs, b.runs))
        influences = a.influences - factor * b.influences
        return _term(value, influences)

    @cached_property
    def runs(self) -> dict[tuple[str, str], Array]:
        """Values per run by (filter, metric)."""
        return self.results.runs(self.point)

    @cached_property
    def _summary(self) -> dict[tuple[str, str], Term]:
        frame = self.results.at(self.results.summary, self.point)
        rows = frame.to_dict("records")
        found = {
            (r["filter"], r["metric"]): Term(r["value"], r["stderr"], None, r["runs"], r["lost"])
            for r in rows
        }
        for r in self.results.at(self.results.timing, self.point).to_dict("records"):
            found[r["filter"], "cpu_s_per_run"] = Term(
                r["cpu_s_per_run"], r["stderr"], None, r["runs"]
            )
        return found

    def _found(self, sides: list[tuple[str, str]]) -> Mask | None:
        """Runs that every side's metric exists for."""
        common: Mask | None = None
        for label, expression in sides:
            composed = COMPOSED.fullmatch(expression)
            statistic = STATISTIC.fullmatch(composed.group(2) if composed else expression)
            for name in (label, composed.group(3)) if composed else (label,):
                values = self.runs.get((name, statistic.group(2))) if statistic else None
                if values is not None:
                    there = ~np.isnan(values)
                    common = there if common is None else common & there
        return common

    def _over_runs(self, label: str, name: str, metric: str, common: Mask | None) -> Term:
        values = self.runs.get((label, metric))
        if values is None:
            return _MISSING
        there = ~np.isnan(values)
        kept = there if common is None else there & common
        x = values[kept]
        if not len(x):
            return _MISSING._replace(lost=len(values))
        influences = np.full(len(values), np.nan)
        influences[kept] = influence(name, x)
        lost = int((~there).sum())
        return Term(*STATISTICS[name](x), influences, len(x), lost)

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


@_quietly
def quotient(a: Term, b: Term) -> Term:
    """``a / b``; delta method, paired where both have influences."""
    ratio, scale = (float(np.divide(x, b.value)) for x in (a.value, 1.0))
    if a.influences is not None and b.influences is not None:
        return _term(ratio, scale * (a.influences - ratio * b.influences))._replace(lost=a.lost)
    stderr = abs(scale) * float(np.hypot(a.stderr, ratio * b.stderr))
    return Term(ratio, stderr, None, min(a.runs, b.runs), a.lost)


@_quietly
def _gain(ratio: Term) -> Term:
    """Percent by which the ratio is below one."""
    influences = None if ratio.influences is None else -100.0 * ratio.influences
    return ratio._replace(
        value=100.0 * (1.0 - ratio.value), stderr=100.0 * ratio.stderr, influences=influences
    )


@_quietly
def _term(value: float, influences: Array) -> Term:
    there = influences[~np.isnan(influences)]
    return Term(value, mean(there).stderr, influences, len(there))
