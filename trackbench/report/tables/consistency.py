"""Table kinds `consistency` and `innovations`: do errors and innovations fit their covariances?"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import total
from trackbench.errors import counted, sensor_name
from trackbench.evaluation.metric_expression import measured
from trackbench.field_types import Digits
from trackbench.filters.base import Filter
from trackbench.registry import of_kind, register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.results.read_csv import Columns
from trackbench.statistics.estimates import MISSING
from trackbench.statistics.intervals import AcceptedNis, nis_band
from trackbench.statistics.sample_statistics import Estimate

_DegreesOfFreedom: TypeAlias = dict[tuple[int, AcceptedNis | None], set[float]]
"""Degrees of freedom of the steps, by number of components and law of what a gate accepts."""


@register("tables", "consistency")
@dataclass(frozen=True, kw_only=True)
class Consistency(TableKind):
    """Normalized errors and innovations over the runs at each step, and their chi-square bands.

    ANEES and ANIS are NEES and NIS over the number n of components: 1 if consistent. Components that are
    known exactly, not measured, or refused by a gate do not count. Averaged over M runs at one step they
    are chi-square of M n degrees of freedom over M n; a consistent filter stays in the 95 % band in 95 %
    of the steps (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.3). What a gate accepts has a smaller
    ANIS, and a filter with a gate has the band of that.
    """

    requires: ClassVar[dict[str, str]] = {"anees": "per_step", "nis": "per_step"}

    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: Digits = 3
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Count the steps at which each filter stays in its bands."""
        evaluators = {tuple(point.items()): Evaluator(results, point) for point in results.points()}
        refused = _refused_column(evaluators.values())
        # The space makes the two headings of bands different.
        heads = ["ANEES, median step", "steps in its band"]
        heads += ["ANIS, median step", "steps in its band ", *refused]
        table = Table(self.title, [*results.grid_heads, "Filter"], heads, self.digits)
        degrees: dict[str, _DegreesOfFreedom] = {"ANEES": {}, "ANIS": {}}
        for point, evaluator in evaluators.items():
            facts = results.facts(dict(point))
            per_step = results.columns("per_step", dict(point))
            for label in results.chosen(self.filters):
                rows = per_step.where(filter=label)
                # ANEES is stored per component.
                anees = rows.where(metric="anees")
                states = len(facts.components)
                degrees_of_anees = degrees_of(rows, "anees", states)
                degrees["ANEES"].setdefault((states, None), set()).update(degrees_of_anees.tolist())
                cells = _cells(anees["value"], degrees_of_anees, None)
                # NIS is stored as it is: ANIS = NIS / n, where n is the mean over the runs.
                nis = rows.where(metric="nis")
                measured_components = len(facts.measured)
                degrees_of_nis = degrees_of(rows, "nis", measured_components)
                accepted = facts.accepted_nis(label)
                law = (measured_components, accepted)
                degrees["ANIS"].setdefault(law, set()).update(degrees_of_nis.tolist())
                anis = nis["value"] / (degrees_of_nis / nis["runs"])
                cells += _cells(anis, degrees_of_nis, accepted)
                cells += [_innovation_cell(evaluator, label, m) for m in refused.values()]
                table.add([*(str(value) for _, value in point), label], cells)
        table.notes += _consistency_bands(degrees, int(results.config["runs"]))
        return table


def degrees_of(rows: Columns, metric: str, n: int) -> Array:
    """Count the degrees of freedom (K,) of a metric's sum over the runs, at the K steps that have it.

    Each run has n, the number of components, less those that are not measured or are known exactly.
    ``rows`` are those of one filter in per_step.csv.
    """
    chosen = rows.where(metric=metric)
    # The mean number of components that a run lacks is stored as unused_nees, unused_nees_position, ...
    series = metric.replace("anees", "nees", 1)
    unused = rows.where(metric=f"unused_{series}")
    unused_at_step = dict(zip(unused["step"].tolist(), unused["value"].tolist(), strict=True))
    used = np.array([n - unused_at_step.get(step, 0.0) for step in chosen["step"].tolist()])
    return np.asarray(chosen["runs"] * used)


def _cells(values: Array, degrees: Array, accepted: AcceptedNis | None) -> list[Cell]:
    """Return a cell with the median of the values over the steps, and one with the share in their bands.

    ``values`` (K,) are normalized squares per component, and ``degrees`` (K,) their degrees of freedom.
    ``accepted`` is the distribution of what a filter's gate accepts; None without a gate.
    """
    if not len(values):
        return [Cell.missing(), Cell.missing()]
    # A band for each number of degrees of freedom that a step has.
    bands = {number: nis_band(number, accepted) for number in set(degrees.tolist())}
    low, high = np.array([bands[number] for number in degrees.tolist()]).T
    median = float(np.median(values))
    inside = float(((values >= low) & (values <= high)).mean())
    # Steps depend on each other, so no standard error is claimed. ``runs`` is the number of steps here.
    return [Cell(Estimate(x, np.nan), runs=len(values), lost=0) for x in (median, inside)]


def _consistency_bands(degrees: dict[str, _DegreesOfFreedom], runs: int) -> Iterator[str]:
    """Yield a sentence with the 95 % band for each number of components.

    If some steps use fewer components, it also has the band of the step with the fewest. ``degrees`` has
    the degrees of freedom of the steps for ANEES and for ANIS.
    """
    for name, degrees_by_law in degrees.items():
        several = len({n for n, _ in degrees_by_law}) > 1
        # n is the number of components, and the numbers are the degrees of freedom of the steps.
        for (n, accepted), numbers in degrees_by_law.items():
            which = ""
            if several:
                which = f" of {n} components"
            if accepted is not None:
                which += f" with gate {accepted.gate:g}"
            low, high = nis_band(n * runs, accepted)
            text = (
                f"95 % band of {name}{which} over {counted(runs, 'run')}: {low:.3f} to {high:.3f}"
            )
            fewest = min(numbers, default=n * runs)
            if fewest < n * runs:
                low, high = nis_band(fewest, accepted)
                text += f"; {low:.3f} to {high:.3f} at a step of {fewest:g} components in all runs"
            yield f"{text}."


def components(numbers: Array) -> float:
    """Return the number N of components of which one average varies as much as the mean over runs.

    Run i averages n_i components (``numbers``, (M,)): chi2(n_i) / n_i, of variance 2 / n_i. The mean
    over runs has the variance sum(2 / n_i) / M^2, and so has chi2(N) / N with N = M^2 / sum(1 / n_i)
    (Satterthwaite 1946, Biometrics Bull. 2, 110). N is M n for equal n_i, and 0 without any component.
    """
    positive = numbers[numbers > 0]
    if not len(positive):
        return 0.0
    least = positive.min()  # divided out, so that equal numbers give M n without rounding
    # N = M^2 / sum(1 / n_i)
    return float(len(positive) * least * (len(positive) / total(least / positive)))


def anis_band(numbers: Array, accepted: AcceptedNis | None = None) -> tuple[float, float]:
    """Return the 95 % band of the mean ANIS over runs; wide for few measurements.

    ``numbers`` (M,) are those of the measured components of each run. ``accepted`` is the distribution
    of what a filter's gate accepts; None without a gate.
    """
    return nis_band(components(numbers), accepted)


def autocorrelation_band(numbers: Array) -> float:
    """Return the 95 % half-width of the mean autocorrelation over runs; infinite without measurements.

    ``numbers`` (M,) are those of the measured components of each run.
    """
    number = components(numbers)
    if not number:
        return np.inf
    return 1.96 / float(np.sqrt(number))


_COLUMNS = {
    "ANIS": "mean(anis)",
    "Autocorrelation": "mean(autocorrelation_1)",
    "Log score": "mean(log_score)",
    "Held-out log score": "mean(held_log_score)",
}
_ERRORS = {"Prediction": "predicted", "Held-out": "held"}


@register("tables", "innovations")
@dataclass(frozen=True, kw_only=True)
class Innovations(TableKind):
    """Consistency, whiteness, log score and one-step prediction errors; of recordings, all there is.

    ANIS is the normalized innovation squared over the number of measured components, 1 if consistent;
    of N components it is chi-square of N degrees of freedom over N. The autocorrelation of successive
    whitened innovations is 0 within 1.96 / sqrt(N) (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2).
    Where runs measure different numbers, N is that of which means over runs vary as much. What a gate
    accepts has a smaller ANIS, and a filter with a gate has the band of that.
    The log score is the mean log p(z_k | z_1..k-1): higher is better. What is held out (`hold_out`) is
    predicted and not filtered. A prediction error is the measurement minus the mean of h over the
    predicted Gaussian, or minus h of the predicted mean for a filter that never updates (`prior-mean`).
    """

    requires: ClassVar[dict[str, str]] = {
        "anis": "per_run",
        "innovations": "per_run",
        "autocorrelation_1": "per_run",
        "log_score": "per_run",
    }

    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Return the table from a results folder; columns that no filter has are left out."""
        evaluators = {tuple(point.items()): Evaluator(results, point) for point in results.points()}
        metrics = _stored_metrics(evaluators.values())
        columns = {head: metric for head, metric in _COLUMNS.items() if metric in metrics}
        error_columns = _error_columns(results)
        columns |= error_columns
        columns |= _refused_column(evaluators.values())
        table = Table(self.title, [*results.grid_heads, "Filter"], list(columns), self.digits)
        labels = results.chosen(self.filters)
        for point, evaluator in evaluators.items():
            for label in labels:
                cells = [_innovation_cell(evaluator, label, metric) for metric in columns.values()]
                table.add([*(str(value) for _, value in point), label], cells)
        table.notes += _band_notes(results, labels)
        if error_columns:
            table.notes += _path_note(results, labels)
        return table


def _path_note(results: Results, labels: list[str]) -> list[str]:
    """Write how prediction errors of filters that never update are computed, if there are any."""
    names = []
    for label in labels:
        for point in results.points():
            kind = results.facts(point).filters.get(label, {}).get("kind", "")
            cls = of_kind("filters", kind)
            if cls is not None and issubclass(cls, Filter) and not cls.uses_measurements:
                names.append(label)
                break
    if not names:
        return []
    never = "never updates: its" if len(names) == 1 else "never update: their"
    text = f"{phrases.listed(names)} {never} prediction errors are those of the path, z - h(mean)"
    return [f"{text}; ANIS and autocorrelation are of the Gaussian around it."]


def _refused_column(evaluators: Iterable[Evaluator]) -> dict[str, str]:
    """Return heading and metric of the column of refused measurements; empty if no filter has a gate."""
    if "mean(gated)" not in _stored_metrics(evaluators):
        return {}
    return {"Refused a run": "mean(gated)"}


def _stored_metrics(evaluators: Iterable[Evaluator]) -> set[str]:
    """Collect the metrics that any filter has at any point of the grid."""
    metrics = set()
    for evaluator in evaluators:
        metrics |= {metric for _, metric in evaluator.stored}
    return metrics


def _innovation_cell(evaluator: Evaluator, label: str, metric: str) -> Cell:
    words = evaluator.collapse_words(measured(metric).of(label))
    return Cell.of(evaluator.stored.get((label, metric), MISSING), words)


def _error_columns(results: Results) -> dict[str, str]:
    """Return heading and metric of the columns of prediction errors, one for each component measured."""
    columns = {}
    target = results.facts(results.points()[0]).scenario.get("target") or {}
    names = target.get("sensors") or ()
    for head, kind in _ERRORS.items():
        # Such as rms(rmse_predicted_px); errors in a window, rms(rmse_predicted_px[late]), are left out.
        for name in dict.fromkeys(results.columns("summary")["metric"]):
            component = name.removeprefix(f"rms(rmse_{kind}_").removesuffix(")")
            if name == f"rms(rmse_{kind}_{component})" and "[" not in component:
                columns[f"{head} error, {_component_title(component, names)}"] = name
    return columns


def _component_title(component: str, names: Sequence[str]) -> str:
    """Write a measured component with the recorded name of its sensor: ``sensor 3 (4).range``."""
    number, _, quantity = component.rpartition(".")
    if not names or not number.isdigit():
        return component
    return f"{sensor_name(int(number) - 1, names)}.{quantity}"


def _band_notes(results: Results, labels: list[str]) -> list[str]:
    """Write sentences with the bands of a consistent filter.

    The filters ``labels`` and the grid points with equal bands share a sentence.
    """
    places_by_sentence: dict[str, list[str]] = {}
    for point in results.points():
        labels_by_sentence: dict[str, list[str]] = {}
        for label in labels:
            accepted = results.facts(point).accepted_nis(label)
            sentence = _band_note(results.runs(point), label, accepted)
            if sentence:
                labels_by_sentence.setdefault(sentence, []).append(label)
        # Filters are named only if their bands differ.
        for sentence, names in labels_by_sentence.items():
            place = []
            if len(labels_by_sentence) > 1:
                place.append(phrases.listed(names))
            if point:
                place.append(phrases.heading(point))
            places_by_sentence.setdefault(sentence, []).append(", ".join(place))
    if len(places_by_sentence) == 1:
        return list(places_by_sentence)
    return [f"{'; '.join(places)}: {text}" for text, places in places_by_sentence.items()]


def _band_note(runs: dict[tuple[str, str], Array], label: str, accepted: AcceptedNis | None) -> str:
    """Write the sentence on a filter's bands; empty for a filter without predictions.

    ``runs`` has the values (M,) of the runs; ``accepted`` is the law of what the filter's gate accepts.
    """
    # The number of measured components of each run.
    numbers = runs.get((label, "innovations"), np.empty(0))
    finite = ~np.isnan(numbers)
    if not finite.any():
        return ""
    number = round(float(numbers[finite].sum()))
    if not number:
        return "Nothing was measured after the start: nothing can be said of a filter."
    low, high = anis_band(numbers[finite], accepted)
    bands = [f"ANIS {low:.3f} to {high:.3f}"]
    # The band of the autocorrelation is that of the runs that have one.
    autocorrelations = runs.get((label, "autocorrelation_1"), np.full(len(numbers), np.nan))
    has_autocorrelation = ~np.isnan(autocorrelations)
    if has_autocorrelation.any():
        half_width = autocorrelation_band(numbers[has_autocorrelation])
        bands.append(f"autocorrelation within {half_width:.3f}")
    gate = "" if accepted is None else f" with gate {accepted.gate:g}"
    text = f"95 % bands of a consistent filter{gate} over {number} measured components"
    return f"{text}: {', '.join(bands)}."
