"""Parts of captions: what is drawn, of which filters, over how many runs, at which grid point."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import joined, listed, named
from trackbench.report.plotting.style import MOST_PANELS
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


def runs(results: Results) -> str:
    """Return the number of runs in words."""
    return counted(results.config["runs"], "run")


def filters(labels: Sequence[str]) -> str:
    """Return the labels in words; of many the first, and how many more.

    With the option ``--only`` of a run there may be none.
    """
    if not labels:
        return "no filter"
    return listed([named(label) for label in labels])


def measured_labels(results: Results, labels: Sequence[str], metric: Measure) -> list[str]:
    """Return the labels, without the bound's if summary.csv has no number of it in this metric."""
    bound = results.config.get("bound")  # label of the lower bound of the errors
    has_bound = len(results.columns("summary").where(filter=bound, metric=str(metric))) > 0
    return [label for label in labels if has_bound or label != bound]


def quantity(metric: Measure) -> str:
    """Return the metric as the axis names it, without its unit: ``position RMSE``, ``ANEES``."""
    words = phrases.axis_of(metric).partition(" (")[0]
    # A capital before a small letter begins words; abbreviations and expressions stay as they are.
    is_sentence_case = words[:1].isupper() and words[1:2].islower()
    if is_sentence_case:
        return f"{words[0].lower()}{words[1:]}"
    return words


def heading(results: Results, point: GridPoint) -> str:
    """Return a grid point with the units of its paths: ``sigma = 10 m, q = 2``."""
    return phrases.heading(point, results.grid_units)


def panel_headings(results: Results, points: Sequence[GridPoint]) -> list[str]:
    """Return the titles of the panels of grid points: the keys that differ, with values and units."""
    headings = phrases.distinct_headings(points, results.grid_units)
    # The minus of a number, not the hyphen of a name.
    return [re.sub(r"(?<!\w)-(?=\d)", "\N{MINUS SIGN}", heading) for heading in headings]


def panels(results: Results) -> str:
    """Return such as ``, a panel for each value of q`` to end a sentence; empty for one grid point."""
    if len(results.points()) < 2:
        return ""
    paths = [phrases.axis(path) for path in results.grid]
    words = f", a panel for each value of {listed(paths)}"
    if len(results.points()) > MOST_PANELS:
        words += f" (the first {MOST_PANELS} of {len(results.points())} points)"
    return words


def sentence(words: str) -> str:
    """Return words as a sentence, with a capital letter and a full stop."""
    return f"{words[:1].upper()}{words[1:]}."


def of_curves(results: Results, words: str, labels: Sequence[str]) -> str:
    """Return a sentence such as ``Position RMSE over time of KF and EKF, 400 runs.``"""
    return sentence(f"{words} of {filters(labels)}, {runs(results)}{panels(results)}")


_WIDTH_OF_LINE = 0.006
"""Width of a line, as a share of the height of a panel."""


def coinciding_lines(panels: Sequence[Mapping[str, Array]], log: bool) -> str:
    """Return sentences that name lines of which one hides the other; empty if there are none.

    ``panels`` have the values (n,) of each line by its label. Two lines coincide if their distance is
    below the width of a line throughout all panels. ``log`` is true if the vertical axis is logarithmic.
    """
    panels_of_axis = []  # the values as places on the axis
    for panel in panels:
        with np.errstate(divide="ignore", invalid="ignore"):
            places = {label: np.log10(y) if log else y for label, y in panel.items()}
        panels_of_axis.append({label: y for label, y in places.items() if np.isfinite(y).any()})
    labels = list(dict.fromkeys(label for panel in panels_of_axis for label in panel))
    text = ""
    grouped: set[str] = set()
    for i, label in enumerate(labels):
        if label in grouped:
            continue
        others = [b for b in labels[i + 1 :] if _have_one_place(panels_of_axis, label, b)]
        if others:
            grouped.update(others)
            text += f" The lines of {joined([named(name) for name in [label, *others]])} coincide."
    return text


def _have_one_place(panels: Sequence[Mapping[str, Array]], first: str, second: str) -> bool:
    """Test whether two lines lie on each other in all panels; ``panels`` have places on the axis."""
    for panel in panels:
        if (first in panel) != (second in panel):
            return False
        if first not in panel:
            continue
        a = panel[first]
        b = panel[second]
        is_known = np.isfinite(a)
        if len(a) != len(b) or (is_known != np.isfinite(b)).any():
            return False
        every_place = np.concatenate(list(panel.values()))
        height = np.ptp(every_place[np.isfinite(every_place)])
        if np.abs(a - b)[is_known].max() > _WIDTH_OF_LINE * height:
            return False
    return True


def bound(results: Results, labels: Sequence[str]) -> str:
    """Return a sentence that says which filters the lower bound of the errors is valid for.

    It is empty if the bound is not among the ``labels`` of the figure.
    """
    name = results.config.get("bound")
    if name not in labels:
        return ""
    words = (
        f" {named(str(name))} bounds filters whose first errors have the covariance of the start"
    )
    settings = results.config["filters"]
    if any((settings.get(label) or {}).get("smooth") for label in labels):
        words += "; smoothers may lie below it"
    return f"{words}."
