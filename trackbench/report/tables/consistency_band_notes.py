"""Notes with the 95 % bands of a consistent filter: of ANEES, of ANIS and of the autocorrelation."""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.report.findings import grid_headings, phrases
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.consistency_bands import (
    AcceptedNis,
    anis_band,
    autocorrelation_band,
    nis_band,
)

DegreesOfFreedom: TypeAlias = dict[tuple[int, AcceptedNis | None], set[float]]
"""Degrees of freedom of the steps, by number of components and law of what a gate accepts."""


def notes_on_innovation_bands(results: Results, labels: list[str]) -> list[str]:
    """Write sentences with the bands of a consistent filter.

    Filters and grid points with equal bands share a sentence.

    Parameters
    ----------
    results
        results folder
    labels
        filters of the table

    Returns
    -------
    list of str
        sentences; empty if no filter has predictions
    """
    places_by_sentence: dict[str, list[str]] = {}
    for point in results.points():
        labels_by_sentence: dict[str, list[str]] = {}
        for label in labels:
            # Distribution of the NIS of measurements that the filter's gate accepts; None without gate.
            accepted = results.facts(point).accepted_nis(label)
            sentence = _band_note(results.runs(point), label, accepted)
            if sentence:
                labels_by_sentence.setdefault(sentence, []).append(phrases.named(label))
        # Filters are named only if their bands differ.
        for sentence, names in labels_by_sentence.items():
            place = []
            if len(labels_by_sentence) > 1:
                place.append(phrases.listed(names))
            if point:
                place.append(grid_headings.heading(point))
            places_by_sentence.setdefault(sentence, []).append(", ".join(place))
    if len(places_by_sentence) == 1:
        return list(places_by_sentence)
    return [f"{'; '.join(places)}: {text}" for text, places in places_by_sentence.items()]


def _why_no_band(
    runs: dict[tuple[str, str], Array], label: str, accepted: AcceptedNis | None
) -> str:
    """Write why no measured component of the filter ``label`` counts.

    ``runs`` has the values (M,) of the runs by filter and metric. ``accepted`` is the distribution of
    the NIS of measurements that the filter's gate accepts, None for a filter without a gate.
    """
    # Each run's RMSE (M,) of predicting a measured component, NaN if it was not measured. Without any
    # such values nothing was measured, either.
    prediction_errors = [
        values
        for (name, metric), values in runs.items()
        if name == label and metric.startswith("rmse_predicted_")
    ]
    if all(np.isnan(values).all() for values in prediction_errors):
        return "Nothing was measured after the start: nothing can be said of a filter."
    if accepted is not None:
        return "The gate rejected every measurement, so there is no ANIS and no autocorrelation."
    return "Without a covariance there is no ANIS and no autocorrelation."


def _band_note(runs: dict[tuple[str, str], Array], label: str, accepted: AcceptedNis | None) -> str:
    """Write the sentence on the bands of a consistent filter, for the filter ``label``.

    It is empty if the filter has no predictions. ``runs`` has the values (M,) of the runs by filter and
    metric. ``accepted`` is the distribution of the NIS that the filter's gate accepts, None without one.
    """
    # The number of measured components of each run, on which the width of a band depends.
    numbers = runs.get((label, "innovations"), np.empty(0))
    finite = ~np.isnan(numbers)
    if not finite.any():
        return ""
    total_number = round(float(numbers[finite].sum()))
    if not total_number:
        return _why_no_band(runs, label, accepted)
    low, high = anis_band(numbers[finite], accepted)
    bands = [f"ANIS {low:.3f} to {high:.3f}"]
    # The band of the autocorrelation is that of the runs that have one.
    autocorrelations = runs.get((label, "autocorrelation_1"), np.full(len(numbers), np.nan))
    has_autocorrelation = ~np.isnan(autocorrelations)
    if has_autocorrelation.any():
        half_width = autocorrelation_band(numbers[has_autocorrelation])
        bands.append(f"autocorrelation within {half_width:.3f}")
    gate = "" if accepted is None else f" with gate {accepted.gate:g}"
    text = f"95 % bands of a consistent filter{gate} over {total_number} measured components"
    return f"{text}: {', '.join(bands)}."


def notes_on_bands_of_steps(degrees: dict[str, DegreesOfFreedom], runs: int) -> Iterator[str]:
    """Yield a sentence with the 95 % band for each number of components, and for each gate.

    If some steps use fewer components, it also has the band of the step with the fewest.

    Parameters
    ----------
    degrees
        degrees of freedom of the steps, by ``ANEES`` and ``ANIS`` and then by number of components and
        law
    runs
        number of runs

    Yields
    ------
    str
        sentence for a note below the table
    """
    for name, degrees_by_law in degrees.items():
        several = len({n for n, _ in degrees_by_law}) > 1
        # n is the number of components, and ``accepted`` the distribution of what a gate accepts. The
        # numbers are the degrees of freedom of the steps, n times the runs if all components are used.
        for (n, accepted), numbers in degrees_by_law.items():
            which = ""
            if several:
                which = f" of {counted(n, 'component')}"
            if accepted is not None:
                which += f" with gate {accepted.gate:g}"
            low, high = nis_band(n * runs, accepted)
            text = (
                f"95 % band of {name}{which} over {counted(runs, 'run')}: {low:.3f} to {high:.3f}"
            )
            fewest = min(numbers, default=n * runs)
            if fewest < n * runs:
                low, high = nis_band(fewest, accepted)
                components = counted(int(fewest), "component")
                text += f"; {low:.3f} to {high:.3f} at a step of {components} in all runs"
            yield f"{text}."
