"""Table kind `tuning`: what tuning found, on the runs it saw and on those that it did not."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from trackbench.config.tuning import Objective, Score, objective_label, tuned_label
from trackbench.errors import counted
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table
from trackbench.statistics import rules
from trackbench.statistics.estimates import MISSING, RunEstimate
from trackbench.statistics.over_runs import Estimate, mean
from trackbench.tuning.search import Record

_HEADS = ["Training", "Results", "Gap", "Untuned", "Gained"]
_BESIDE = {
    "noise": " on the path of the results, with other noise",
    "noise and path": " on other paths than those of the results",
    "recordings": ", recordings that are not of the results",
}
"""What training runs are beside those of the results, by what the manifest says is held out."""


@register("tables", "tuning")
@dataclass(frozen=True, kw_only=True)
class TuningTable(TableKind):
    """A row per tuned filter: the values found, each with the range within one standard error.

    `Training` is the metric on the runs it was tuned on, `Results` on those of the results, `Gap` how
    much larger that is; `Untuned` is the filter as the config has it, on the runs of the results, and
    `Gained` how much larger that is than the tuned one, paired.
    """

    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Return the table from a results folder."""
        tuning, runs = results.config["tuning"], results.runs({})
        objective = Objective.of(tuning["metric"], results.facts({}).sizes)
        by = f"Tuned by {words_of(tuning['metric'])}, {_trained_on(results)}"
        table = Table(self.title or by, ["Filter", "Values found", "Trials"], _HEADS, self.digits)
        # Each tuned filter and the one as configured, on the runs of the results.
        scores = {
            label: tuple(_score(objective, runs, of) for of in (tuned_label(label), label))
            for label in results.tuning
        }
        gains = {label: _gained(*of) for label, of in scores.items()}
        family = rules.adjusted([g.z() if rules.is_tested(g) else nan for g in gains.values()])
        for (label, record), p in zip(results.tuning.items(), family, strict=True):
            found, given = scores[label]
            keys = [label, _found(record), str(len(record.trials))]
            table.add(keys, [*_cells(record, found, given), Cell.of(gains[label])])
            notes = [*record.remarks(tuning["runs"])]
            if found is not None and given is not None:
                notes += _on_results(found, given, gains[label], p < rules.LEVEL)
            table.notes += (f"{label}: {text}." for text in notes)
        return table


def _trained_on(results: Results) -> str:
    """Return the training runs, or the part of recorded ones, and the runs held out."""
    config = results.config
    share = (config["scenario"].get("score") or {}).get("train")
    if share is not None:
        return f"the first {100 * share:g} % of the time; results of the rest"
    runs = f"{config['tuning']['runs']} training runs"
    return runs + _BESIDE.get(results.manifest.get("training_holds_out", ""), "")


def words_of(metric: str | dict[str, float]) -> str:
    """Return the objective, written as a sum."""
    if isinstance(metric, str):
        return objective_label(metric)
    return " + ".join(f"{weight:g} {objective_label(word)}" for word, weight in metric.items())


def _score(
    objective: Objective, runs: dict[tuple[str, str], np.ndarray], label: str
) -> Score | None:
    """Return a filter's score on the runs of the results; none if it was not run, or failed."""
    mine = {metric: values for (of, metric), values in runs.items() if of == label}
    wanted = {*objective.metrics, "lost"}
    return objective.score(mine) if wanted <= mine.keys() else None


def _found(record: Record) -> str:
    parts = []
    for axis in record.axes:
        # The values within one standard error of the best: choices, or the ends of a range.
        near = [phrases.number(value) for value in record.within(axis)]
        value = phrases.number(record.best.values[axis.key])
        if axis.choices:
            also = [v for v in near if v != value]
            parts.append(f"{axis.key} = {value}" + (f" (or {', '.join(also)})" if also else ""))
        else:  # a single run has no standard error, and no range
            within = f" ({near[0]} to {near[-1]})" if isfinite(record.best.stderr) else ""
            parts.append(f"{axis.key} = {value}{within}")
    return "; ".join(parts)


def _cells(record: Record, found: Score | None, given: Score | None) -> list[Cell]:
    best = record.best
    training = Cell(Estimate(best.objective, best.stderr), 1, best.lost)
    result, untuned = _cell(found), _cell(given)
    # Gap = results - training; the standard errors add in squares.
    gap, stderr = result.estimate.value - best.objective, result.estimate.stderr
    difference = Cell(Estimate(gap, float(np.hypot(stderr, best.stderr))), result.runs, 0)
    return [training, result, difference, untuned]


def _cell(score: Score | None) -> Cell:
    if score is None:
        return Cell.missing()
    runs = len(score.influences) - score.lost
    return Cell(Estimate(score.value, score.stderr), runs, score.lost)


def _gained(found: Score | None, given: Score | None) -> RunEstimate:
    """Return the untuned less tuned, on common runs."""
    if found is None or given is None:
        return MISSING
    # Each run's influence on untuned - tuned.
    moved = given.influences - found.influences
    both = ~np.isnan(moved)
    stderr = mean(moved[both]).stderr
    return RunEstimate(given.value - found.value, stderr, moved, int(both.sum()))


def _on_results(
    found: Score, given: Score, gained: RunEstimate, significant: bool
) -> Iterator[str]:
    """Yield what tuning lost on the runs of the results, or that it gained nothing."""
    if found.lost > given.lost:
        lost = counted(found.lost, "run")
        yield f"tuned, it loses {lost} of the results, and {given.lost} as it was"
    # An insignificant gain is none, unless fewer runs are lost.
    if given.lost <= found.lost and not (significant and gained.value > 0.0):
        worse = "worse" if significant else "not significantly better"
        yield f"tuned, it is {worse} on the runs of the results than as it was"
