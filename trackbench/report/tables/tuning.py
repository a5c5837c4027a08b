"""Table kind `tuning`: what tuning found, on the runs it saw and on those that it did not."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

import numpy as np

from trackbench.config.tuning import Objective, objective_label, tuned_label
from trackbench.errors import counted
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table
from trackbench.statistics.comparison import Comparison, as_family, compare_estimates
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.over_runs import Estimate
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
        """Compare each tuned filter with the one as configured, on the runs of the results."""
        tuning, runs = results.config["tuning"], results.runs({})
        objective = Objective.of(tuning["metric"], results.facts({}).sizes)
        by = f"Tuned by {words_of(tuning['metric'])}, {_trained_on(results)}"
        table = Table(self.title or by, ["Filter", "Values found", "Trials"], _HEADS, self.digits)
        # Each tuned filter and the one as configured, on the runs of the results.
        scores, gains = {}, {}
        for label in results.tuning:
            tuned = _score(objective, runs, tuned_label(label))
            untuned = _score(objective, runs, label)
            scores[label] = tuned, untuned
            if tuned is not None and untuned is not None:
                gains[label] = compare_estimates(untuned, tuned)
        family = as_family(gains)
        for label, record in results.tuning.items():
            gain = family.get(label)
            keys = [label, _values(record), str(len(record.trials))]
            gained = Cell.missing() if gain is None else Cell.of(gain.difference)
            table.add(keys, [*_cells(record, *scores[label]), gained])
            notes = [*record.remarks(tuning["runs"]), *(_on_results(gain) if gain else ())]
            table.notes += (f"{label}: {text}." for text in notes)
        return table


def _trained_on(results: Results) -> str:
    """Describe the training runs, or the part of recorded ones, and the runs held out."""
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
) -> RunEstimate | None:
    """Score a filter on the runs of the results; None if it was not run, or failed."""
    mine = {metric: values for (of, metric), values in runs.items() if of == label}
    wanted = {*objective.metrics, "lost"}
    return objective.score(mine) if wanted <= mine.keys() else None


def _values(record: Record) -> str:
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


def _cells(record: Record, tuned: RunEstimate | None, untuned: RunEstimate | None) -> list[Cell]:
    best = record.best
    training = Cell(Estimate(best.objective, best.stderr), 1, best.lost)
    result, before = (Cell.missing() if of is None else Cell.of(of) for of in (tuned, untuned))
    # Gap = results - training; the standard errors add in squares.
    gap, stderr = result.estimate.value - best.objective, result.estimate.stderr
    difference = Cell(Estimate(gap, float(np.hypot(stderr, best.stderr))), result.runs, 0)
    return [training, result, difference, before]


def _on_results(gain: Comparison) -> Iterator[str]:
    """Yield what tuning lost on the runs of the results, or that it gained nothing."""
    untuned, tuned = gain.a, gain.b
    if tuned.lost > untuned.lost:
        lost = counted(tuned.lost, "run")
        yield f"tuned, it loses {lost} of the results, and {untuned.lost} as it was"
    # An insignificant gain is none, unless fewer runs are lost.
    if untuned.lost <= tuned.lost and gain.sign <= 0:
        worse = "worse" if gain.sign else "not significantly better"
        yield f"tuned, it is {worse} on the runs of the results than as it was"
