"""Rank of each plugin's filter, its paired difference from the best, and its ratio to the reference."""

from collections.abc import Iterator

from trackbench.evaluation.metric_expression import measured
from trackbench.registry import is_builtin
from trackbench.report.findings.phrases import (
    heading,
    metric_words,
    named,
    percent,
    statistic_words,
    two_digits,
    with_unit,
)
from trackbench.report.findings.ranking import Candidate, Ranking, ranking_metrics, rankings
from trackbench.report.results import Results
from trackbench.report.table import rounded


def plugin_ranks(results: Results) -> Iterator[str]:
    """Yield a sentence for each filter of a plugin, in each scenario of the grid."""
    filters = results.config["filters"]
    for label in results.filters:
        if is_builtin("filters", filters[label].get("kind", "ekf")):
            continue
        # A smoother uses later measurements, so filters and smoothers are ranked apart.
        smooths = bool(filters[label].get("smooth"))
        rivals = [b for b in results.filters if bool(filters[b].get("smooth")) == smooths]
        for found in rankings(results, _headline(results), rivals):
            lines = [_sentence(results, c, found) for c in found.order if c.label == label]
            lines += [
                f"{c.name} is unranked: it loses {c.losses} of {len(c.lost)} runs."
                for c in found.losing
                if c.label == label
            ]
            yield from lines


def _headline(results: Results) -> str:
    """Return the metric of the first table's first column, if filters can be ranked by it."""
    tables = results.config["tables"].values()
    columns = [text for table in tables for text in (table.get("columns") or {}).values()]
    metric = measured(str(columns[0])).metric if columns else ""
    return metric if metric in ranking_metrics(results) else ""


def _sentence(results: Results, mine: Candidate, found: Ranking) -> str:
    """Return rank and mean, the paired difference from the best, the ratio to the reference."""
    better = [c.overall.value for c in found.order].index(mine.overall.value)
    at = [f"On {results.citation}"] * bool(results.citation)
    at += [f"at {heading(found.scene)}"] * bool(found.scene)
    place = f"{', '.join(at)}, {mine.name}"
    text = (
        f"{place.removeprefix(', ')} ranks {1 + better} of {len(found.order)} by "
        f"{statistic_words(mine.statistic, found.metric)}: "
        f"{with_unit(rounded(*mine.overall, 4), found.metric)}"
    )
    differences = {other.name: difference for other, difference in (*found.ties, *found.worse)}
    if found.best is not None and mine.name in differences and differences[mine.name].stderr:
        difference, best = differences[mine.name].estimate, found.best
        apart = with_unit(rounded(*difference, 3), found.metric)
        if not found.metric.family[0].is_score:
            apart += f", {percent(difference.value / best.overall.value)}"
        text += f"; its difference from {best.name}, the best, is {apart}"
        text += ", which is not significant" if mine in found.among_the_best else ""
    return f"{text}{''.join(_ratios(results, mine, found))}."


def _ratios(results: Results, mine: Candidate, found: Ranking) -> Iterator[str]:
    """Yield the ratios of the error to those of the reference and of the bound."""
    config, metric = results.config, found.metric
    labels = [(config.get("problem") or {}).get("reference"), config.get("reference")]
    if metric.family[0].is_score:
        return
    for label in dict.fromkeys([*labels, config.get("bound")]):
        for statistic in ("mean", "rms"):  # bounds have no mean
            rows = results.columns("summary", mine.point).where(
                metric=f"{statistic}({metric.metric})"
            )
            values = [rows.where(filter=name)["value"].tolist() for name in (mine.label, label)]
            if all(values) and label != mine.label:
                ratio = two_digits(values[0][0] / values[1][0])
                words = f"{statistic} {metric_words(metric)}"
                yield f"; its {words} is {ratio} times that of {named(str(label))}"
                break
