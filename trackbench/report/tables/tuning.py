"""Table kind `tuning`: what tuning found, on the runs it saw and on those that it did not."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from trackbench.config.tuning import tuned_label
from trackbench.config.tuning_objective import Objective, objective_label
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import measured
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.comparison import Comparison, Sample, compare, compare_estimates
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.holm_correction import as_family
from trackbench.statistics.sample_statistics import Estimate
from trackbench.tuning.range_of_good_values import values_within_stderr
from trackbench.tuning.record_of_trials import Record
from trackbench.tuning.remarks_on_keys import remarks_on_keys

_HEADS = ["Training", "Results", "Gap", "Untuned", "Gained"]
_TRAINING_PATHS = {
    "noise": " on the path of the results, with other noise",
    "noise and path": " on other paths than those of the results",
    "recordings": ", recordings that are not of the results",
}
"""How training runs differ from those of the results, by what the manifest says is held out."""


@register("tables", "tuning")
@dataclass(frozen=True, kw_only=True)
class TuningTable(TableKind):
    """A row per tuned filter: the values found, each with the range within one standard error.

    `Training` is the metric on the runs it was tuned on, `Results` on those of the results, `Gap` the
    difference Results - Training; `Untuned` is the filter as the config has it, on the runs of the
    results, and `Gained` the difference Untuned - Results, paired.
    """

    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Compare each tuned filter with the one as configured, on the runs of the results."""
        tuning = results.config["tuning"]
        # An experiment with a grid is not tuned: the only point is the empty one.
        runs = results.runs({})
        # The sizes are the numbers of components of each NEES, by which an ANEES divides.
        objective = Objective.of(tuning["metric"], sizes=results.facts({}).sizes)
        title = f"Tuned by {words_of(tuning['metric'])}, {_training_runs(results)}"
        heads = ["Filter", "Values found", "Trials"]
        table = Table(self.title or title, heads, _HEADS, self.digits)
        # Step 1: score each tuned filter and the one as configured, on the runs of the results.
        tuned: dict[str, RunEstimate | None] = {}
        untuned: dict[str, RunEstimate | None] = {}
        comparisons = {}
        for label in results.tuning:
            tuned_score = objective.score_on_results(runs, tuned_label(label))
            untuned_score = objective.score_on_results(runs, label)
            tuned[label] = tuned_score
            untuned[label] = untuned_score
            if tuned_score is not None and untuned_score is not None:
                comparisons[label] = compare_estimates(untuned_score, tuned_score)
        # Of a recording that is shared out in time, training and results have no standard errors.
        has_shared_time = _train_share(results) is not None
        gains = as_family(comparisons)
        gains_by_steps = as_family(_compare_by_steps(results, objective))
        # Step 2: a row per filter. Notes say if a gain is not significant on the results, and filters
        # share equal notes.
        labels_by_note: dict[str, list[str]] = {}
        for label, record in results.tuning.items():
            gain = gains.get(label)
            gained = Cell.missing()
            if gain is not None:
                gained = Cell.of(gain.difference)
            keys = [label, _values(record), str(len(record.trials))]
            cells = _cells(record, tuning["runs"], tuned[label], untuned[label])
            table.add(keys, [*cells, gained])
            notes = list(remarks_on_keys(record, tuning["runs"]))
            tuned_score = tuned[label]
            gap = nan if tuned_score is None else tuned_score.value - record.best.objective
            if has_shared_time and gap < 0.0:
                notes.append(_EASIER_RESULTS)
            if gain is not None:
                notes += _notes_on_results(gain, gains_by_steps.get(label, gain))
            for note in notes:
                labels_by_note.setdefault(note, []).append(label)
        for note, labels in labels_by_note.items():
            table.notes.append(f"{phrases.joined(map(phrases.named, labels))}: {note}.")
        return table


_EASIER_RESULTS = (
    "the gap is negative: the part of the time that is judged is easier than the part for training"
)


def _train_share(results: Results) -> float | None:
    """Return the share of a recording's time that training sees; None if training has other runs."""
    share: float | None = (results.config["scenario"].get("score") or {}).get("train")
    return share


def _training_runs(results: Results) -> str:
    """Describe the training runs, or the part of recorded ones, and how those of the results differ."""
    config = results.config
    share = _train_share(results)
    if share is not None:
        return f"the first {100 * share:g} % of the time; results of the rest"
    held_out = results.manifest.get("training_holds_out", "")
    training_runs = counted(config["tuning"]["runs"], "training run")
    return training_runs + _TRAINING_PATHS.get(held_out, "")


def words_of(metric: str | dict[str, float]) -> str:
    """Write the objective of tuning: a metric, or a weighted sum such as ``1 rmse + 0.5 anees``."""
    if isinstance(metric, str):
        return objective_label(metric)
    return " + ".join(f"{weight:g} {objective_label(word)}" for word, weight in metric.items())


def _values(record: Record) -> str:
    """Write the values that tuning found, and those within a standard error: ``q = 2 (1.5 to 3)``."""
    parts = []
    for axis in record.axes:
        best = phrases.number(record.best.values[axis.key])
        text = f"{axis.key} = {best}"
        # The values within one standard error of the best: choices, or the ends of a range.
        near = [phrases.number(value) for value in values_within_stderr(record, axis)]
        if axis.choices:
            others = [value for value in near if value != best]
            if others:
                text += f" (or {', '.join(others)})"
        elif isfinite(record.best.stderr):  # a single run has no standard error, and no range
            text += f" ({near[0]} to {near[-1]})"
        parts.append(text)
    return "; ".join(parts)


def _cells(
    record: Record, training_runs: int, tuned: RunEstimate | None, untuned: RunEstimate | None
) -> list[Cell]:
    """Fill the metric in training and on the results, their gap, and the untuned filter's metric.

    ``training_runs`` is the number of runs that each trial had. ``tuned`` and ``untuned`` are the
    objective of both filters on the runs of the results; None for a filter that failed.
    """
    best = record.best
    training = Cell.missing()
    if not best.has_failed:
        training = Cell(
            estimate=Estimate(best.objective, best.stderr),
            runs=training_runs - best.lost,
            lost=best.lost,
        )
    result = Cell.missing() if tuned is None else Cell.of(tuned)
    before = Cell.missing() if untuned is None else Cell.of(untuned)
    # Gap = results - training; the standard errors add in squares.
    gap = result.estimate.value - best.objective
    gap_stderr = float(np.hypot(result.estimate.stderr, best.stderr))
    gap_cell = Cell(Estimate(gap, gap_stderr), runs=result.runs, lost=0)
    return [training, result, gap_cell, before]


def _compare_by_steps(results: Results, objective: Objective) -> dict[str, Comparison]:
    """Compare each filter as configured, a, with the tuned one, b, over the steps of one recording.

    The mapping is empty if the results have several runs, as `judged_steps` then is. It is also empty if
    the objective is no mean or rms of one error or score.
    """
    metric = objective.only_mean
    if metric is None:
        return {}
    # Tuning minimizes: of a score, of which more is better, the negative is compared.
    sign = -1.0 if measured(metric).definition.more_is_better else 1.0
    runs = results.runs({})
    steps = results.judged_steps({})
    comparisons = {}
    for label in results.tuning:
        samples = []
        for key in ((label, metric), (tuned_label(label), metric)):
            # Over one run a mean and an rms are equal: both are the mean of what the steps add to it.
            if key in steps:
                samples.append(
                    Sample.from_values(sign * runs[key], "mean", steps=sign * steps[key])
                )
        if len(samples) == 2:
            comparison = compare(*samples)
            if comparison is not None:
                comparisons[label] = comparison
    return comparisons


def _notes_on_results(gain: Comparison, tested_gain: Comparison) -> Iterator[str]:
    """Yield notes on the runs of the results: the tuned filter loses more of them, or is no better.

    ``gain`` compares the untuned filter, a, with the tuned one, b, over the runs. ``tested_gain`` is the
    comparison whose test counts: ``gain`` itself, or the one over the steps of a single recording.
    """
    untuned = gain.a
    tuned = gain.b
    if tuned.lost > untuned.lost:
        lost = counted(tuned.lost, "run")
        yield f"the tuned filter loses {lost} of the results, and {untuned.lost} as configured"
    if not gain.is_measured:
        # If the numbers of lost runs differ, the lost runs may be the reason, and the table shows them.
        if untuned.lost == tuned.lost:
            yield "the gain is not measured: the results have no value of the metric of tuning"
        return
    # The objective is minimized: a positive sign says that the untuned filter's is larger, which is a
    # gain. An insignificant gain is none, unless fewer runs are lost.
    if untuned.lost <= tuned.lost and tested_gain.sign <= 0:
        worse = "worse" if tested_gain.sign else "not significantly better"
        yield f"on the runs of the results the tuned filter is {worse} than the one as configured"
