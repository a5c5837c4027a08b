"""The standard problems: a table of filters and errors, and pictures."""

import csv
from collections import Counter
from functools import cache
from math import isfinite, nan
from typing import NamedTuple

from docs.site import gallery
from trackbench.config.shipped_experiments import ShippedProblem, problems
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import measured

_COLUMNS = 7
"""Kinds with a column of their own: those that most problems have."""


class Row(NamedTuple):
    """A problem's errors: the first column of its first table, at the first point of its grid."""

    problem: ShippedProblem
    expression: str
    values: dict[str, float]
    """by label; of filters, and of the reference"""
    kinds: dict[str, str]
    """kinds of its filters by label, without smoothers"""

    @property
    def is_score(self) -> bool:
        """Return whether more is better, and a ratio means nothing."""
        return measured(self.expression).family[0].is_score

    def best(self, kind: str) -> str:
        """Return the label of the best filter of a kind; empty if there is none."""
        sign = -1.0 if self.is_score else 1.0
        labels = [label for label in self.values if self.kinds.get(label) == kind]
        return min(labels, key=lambda label: sign * self.values[label], default="")

    def cell(self, kind: str) -> str:
        """Return the smallest error of a kind, and its ratio to the reference in parentheses."""
        label = self.best(kind)
        if not label:
            return ""
        value, floor = self.values[label], self.values.get(self.problem.reference, nan)
        ratio = f" ({value / floor:.3g})" if isfinite(floor) and not self.is_score else ""
        return f'<span title="{label}">{_number(value)}</span>{ratio}'


@cache
def rows() -> list[Row]:
    """Return a row for each standard problem that has results."""
    folders = {e.name: e for e in gallery.experiments()}
    return [_row(one, folders[one.name]) for one in problems() if one.name in folders]


def _row(problem: ShippedProblem, e: gallery.Experiment) -> Row:
    tables = [table for table in e.config["tables"].values() if table.get("columns")]
    expression = str(next(iter(tables[0]["columns"].values())))
    point = next(iter(e.grid_rows), ())
    with (e.folder / "summary.csv").open(encoding="utf-8", newline="") as file:
        values = {
            row["filter"]: float(row["value"])
            for row in csv.DictReader(file)
            if row["metric"] == expression
            and tuple(row[path] for path in e.config["grid"]) == point
        }
    filters = e.config["filters"]
    kinds = {b: keys["kind"] for b, keys in filters.items() if not keys.get("smooth")}
    finite = {label: value for label, value in values.items() if isfinite(value)}
    return Row(problem, expression, finite, kinds)


def table(folder: str = "") -> str:
    """Return problems by filters as Markdown; ``folder`` leads to the gallery."""
    counts = Counter(kind for row in rows() for kind in {*row.kinds.values()} if row.best(kind))
    kinds = [kind for kind, _ in counts.most_common(_COLUMNS)]
    lines = [["Problem", "Error", "Reference", *(f"`{kind}`" for kind in kinds), "Others"]]
    lines += [["---"] * len(lines[0])]
    for row in rows():
        one = row.problem
        others = [kind for kind in counts if kind not in kinds and row.best(kind)]
        reference = row.values.get(one.reference)
        lines.append(
            [
                f"[{one.name}]({folder}{one.name}.md) v{one.version}",
                f"`{row.expression}`",
                f"{one.reference} {_number(reference)}" if reference is not None else "",
                *map(row.cell, kinds),
                ", ".join(f"`{kind}` {row.cell(kind)}" for kind in others),
            ]
        )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _number(value: float) -> str:
    return f"{value:#.4g}".rstrip(".")


NOTE = (
    "Each error is that of the best filter of its kind, smoothers aside, at the first point of a grid. "
    "Its label shows at the pointer. Parentheses hold its ratio to the error of the reference or bound."
)


def section() -> str:
    """Return the section on the site's front page."""
    link = "[Pictures, verdicts and citations](problems.md)."
    return "\n\n".join(["## Standard problems", link, table("gallery/"), NOTE, ""])


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
