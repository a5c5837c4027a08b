"""Parts of captions: what is drawn, of which filters, over how many runs, at which grid point."""

from collections.abc import Sequence

from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.findings import grid_headings, metric_phrases
from trackbench.report.findings.phrases import listed, named
from trackbench.report.plotting.panels import MOST_PANELS
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
    """Return the metric as the axis names it, without its unit: ``position RMSE``, ``ANEES``.

    Parameters
    ----------
    metric
        metric of a figure

    Returns
    -------
    str
        words for the middle of a sentence
    """
    words = metric_phrases.axis_of(metric).partition(" (")[0]
    # A capital before a small letter begins words; abbreviations and expressions stay as they are.
    is_sentence_case = words[:1].isupper() and words[1:2].islower()
    if is_sentence_case:
        return f"{words[0].lower()}{words[1:]}"
    return words


def heading(results: Results, point: GridPoint) -> str:
    """Return a grid point with the units of its paths: ``sigma = 10 m, q = 2``."""
    return grid_headings.heading(point, results.grid_units)


def panels(results: Results) -> str:
    """Return such as ``, a panel for each value of q`` to end a sentence.

    Parameters
    ----------
    results
        results folder

    Returns
    -------
    str
        words that begin with a comma; empty for one grid point
    """
    if len(results.points()) < 2:
        return ""
    paths = [grid_headings.axis(path) for path in results.grid]
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


def bound(results: Results, labels: Sequence[str]) -> str:
    """Return a sentence that says for which filters the lower bound of the errors is valid.

    A smoother uses later measurements, too, and may have smaller errors than the bound.

    Parameters
    ----------
    results
        results folder
    labels
        labels that the figure draws

    Returns
    -------
    str
        sentence that begins with a space; empty if the bound is not among the ``labels``
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
