"""The standard problems: a table of filters and errors, and pictures."""

import csv
import html
from collections.abc import Iterator
from functools import cache
from math import isfinite
from operator import itemgetter
from typing import NamedTuple

from docs.site import gallery
from trackbench.config.shipped_problems import ShippedProblem, problems
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import measured
from trackbench.report.findings.ranking_metrics import first_ranking_metric, sort_ranking_metrics
from trackbench.report.mean_or_rms_of_metric import compared_statistic


class Row(NamedTuple):
    """A problem's errors: the number by which its report ranks, at the first point of its grid."""

    problem: ShippedProblem
    expression: str
    values: dict[str, float]
    """by label: filters that are no smoothers, best first, and the reference"""

    @property
    def is_score(self) -> bool:
        """Return whether more is better, and a ratio means nothing."""
        return measured(self.expression).definition.is_score

    @property
    def entries(self) -> Iterator[str]:
        """Yield each filter's error, and its ratio to the reference in parentheses."""
        floor = self.values.get(self.problem.reference)
        for label, value in self.values.items():
            ratio = f" ({value / floor:.3g})" if floor is not None and not self.is_score else ""
            if label != self.problem.reference:
                yield f'<span class="entry">{html.escape(label)} {_number(value)}{ratio}</span>'


@cache
def rows() -> list[Row]:
    """Return a row for each standard problem that has results."""
    folders = {e.name: e for e in gallery.experiments()}
    return [_row(one, folders[one.name]) for one in problems() if one.name in folders]


def _row(problem: ShippedProblem, e: gallery.Experiment) -> Row:
    point = next(iter(e.grid_rows), ())
    measured_by: dict[str, dict[str, float]] = {}
    with (e.folder / "summary.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if tuple(row[p] for p in e.config["grid"]) == point:
                by_label = measured_by.setdefault(row["metric"], {})
                by_label[row["filter"]] = float(row["value"])
    expressions = _ranking_expressions(e, list(measured_by))
    # A bound has no mean error: take the rms in its place.
    with_reference = (x for x in expressions if problem.reference in measured_by.get(x, {}))
    expression = next(with_reference, expressions[0])
    values = measured_by[expression]
    filters = {b for b, keys in e.config["filters"].items() if not keys.get("smooth")}
    shown = [b for b, x in values.items() if b in {*filters, problem.reference} and isfinite(x)]
    found = Row(problem, expression, {label: values[label] for label in shown})
    ranked = sorted(found.values.items(), key=itemgetter(1), reverse=found.is_score)
    return found._replace(values=dict(ranked))


def _ranking_expressions(e: gallery.Experiment, expressions: list[str]) -> list[str]:
    """Return the number by which the report ranks the filters, and the rms of its metric.

    ``expressions`` are those of summary.csv. An experiment whose report ranks by no metric has the first
    column of its first table.
    """
    measures = [measured(expression) for expression in expressions]
    metrics = list(dict.fromkeys(m.metric for m in measures if not m.relation))
    metric = first_ranking_metric(e.config, sort_ranking_metrics(e.config, metrics))
    if not metric:
        tables = [table for table in e.config["tables"].values() if table.get("columns")]
        return [str(next(iter(tables[0]["columns"].values())))]
    return [f"{compared_statistic(e.config, metric)}({metric})", f"rms({metric})"]


def table(folder: str = "") -> str:
    """Return problems with their filters as Markdown; ``folder`` leads to the gallery."""
    lines = [
        ["Problem", "Reference", "Filters, best first: error (error / reference)"],
        ["---"] * 3,
    ]
    for row in rows():
        one, reference = row.problem, row.values.get(row.problem.reference)
        lines.append(
            [
                f"[{one.name}]({folder}{one.name}.md) v{one.version}<br>`{row.expression}`",
                f"{one.reference} {_number(reference)}" if reference is not None else "",
                " · ".join(row.entries),
            ]
        )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _number(value: float) -> str:
    return f"{value:#.4g}".rstrip(".")


NOTE = (
    "Under each problem stands the number by which trackbench ranks the filters, at the first point of "
    "a grid. A bound has no mean error. In a problem with a bound it is therefore the root mean square. "
    "The table leaves smoothers out. "
    "Problems with a reference filter or a bound have the ratio of each error to it in parentheses."
)


def pages() -> dict[str, str]:
    """Return the page of all problems by its place on the site."""
    folders = {e.name: e for e in gallery.experiments()}
    cards = "\n".join(gallery.card(folders[row.problem.name], "gallery/") for row in rows())
    first = rows()[0].problem
    runs = counted(folders[first.name].config["runs"], "run")
    parts = [
        "# Standard problems",
        "Each runs by its name (`trackbench list problems`), and is cited by name, version and number "
        f'of runs: "on trackbench/{first.name} v{first.version}, {runs}". Every change that moves a '
        "number raises the version. `trackbench run NAME --filter my_filter.py` ranks "
        "[your filter](your-filter.md#on-a-standard-problem) among the others.",
        table("gallery/"),
        NOTE,
        f'<div class="gallery" markdown="0">\n{cards}\n</div>',
    ]
    return {"problems.md": "\n\n".join(parts) + "\n"}
