"""Numbers and claims that papers print: rows of published files, and the checks of these rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Literal

from trackbench.config.did_you_mean import unknown
from trackbench.errors import Mark
from trackbench.evaluation.metric_expression import Measure
from trackbench.field_types import Finite, NonNegative, Positive
from trackbench.statistics.published_number_rules import Printed
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import Source


def split_cell(text: str) -> list[str]:
    """Split the text of a cell at its semicolons, without empty words."""
    return [part.strip() for part in text.split(";") if part.strip()]


def picks(point: str, values: Mapping[str, object]) -> bool:
    """Test whether ``path=value; path=value`` picks the point of a grid that has these values.

    Paths that vary together are one path with a list of values: ``a.N & b.N=[10, 5]``.
    """

    def is_met(condition: str) -> bool:
        """Test whether ``path=value`` is true of one of the values."""
        # A label in the path may contain "=".
        for path, value in values.items():
            rest = condition.removeprefix(path).lstrip()
            names_path = condition.startswith(path) and rest.startswith("=")
            # A list of values is compared as a text.
            if names_path and scalar(rest[1:].strip()) in (value, str(value)):
                return True
        return False

    return all(is_met(condition) for condition in split_cell(point))


@dataclass(frozen=True, kw_only=True)
class PublishedNumber(Printed):
    """One number that a paper prints."""

    paper: str
    """short name of the paper"""
    table: str
    """where it stands: `Table 1`, or `text`"""
    row: str = ""
    """row or period inside the table, as printed"""
    filter: str
    """the filter's name, as printed"""
    metric: str
    """what the number is, as printed"""
    experiment: str = ""
    """experiments that measure it, separated by semicolons"""
    label: str = ""
    """labels of the filter there, separated by semicolons"""
    reading: str = ""
    """interpretation, in a few words: needed where several rows measure one number; the best counts"""
    expression: Measure | None = None
    """what to measure: `mean(rmse)`, `rmse@20`, `ratio(cpu_s_per_run, PF)`, `gain(...)`, `minus(...)`,
    `win_rate(rmse, PF)`: the share of the runs in which it is better than PF's; `controlled(...)`"""
    factor: Positive = 1.0
    """the measured number is multiplied by it: 0.5 where the paper prints the mean over two axes"""
    point: str = ""
    """point of the experiment's grid: `scenario.R=0.1; filters.PF.N=10`"""
    source: str = ""
    """page, table or equation"""
    note: str = ""
    """why it may differ, from the reading of the paper"""

    @property
    def printed_at(self) -> tuple[str, ...]:
        """Place where a number is printed, and its point, which its readings share."""
        return self.paper, self.table, self.row, self.filter, self.metric, self.point

    @property
    def labels(self) -> list[str]:
        """Labels of the filters that measure this number, as a list."""
        return split_cell(self.label)

    @property
    def expressions(self) -> list[Measure]:
        """Expression of the row, in a list as a `Claim` has them; empty if it has none."""
        if not self.expression:
            return []
        return [self.expression]


@dataclass(frozen=True, kw_only=True)
class Claim:
    """Statement of a paper, as a test of ``left relation factor * right``."""

    paper: str
    """short name of the paper"""
    claim: str
    """the claim in words"""
    experiment: str = ""
    """experiments that decide it, separated by semicolons"""
    left: str = ""
    """label of the filter that is spoken of"""
    expression: Measure | None = None
    """what is compared: as for a published number; `rmse@3..last` is compared at each of the steps"""
    relation: Literal["<", ">", "~"] = "<"
    """smaller, larger, or equal within the tolerance"""
    factor: Finite = 1.0
    """the right side is multiplied by it; without a right side it is the right side"""
    right: str = ""
    """labels compared with, separated by semicolons: the claim must hold against each"""
    right_expression: Measure | None = None
    """what is taken of the right side; default: the same expression"""
    tolerance: NonNegative = 0.0
    """share of the right side that `~` allows"""
    printed: Finite | None = None
    """percent by which the left side is below the right one"""
    point: str = ""
    """point of the experiment's grid"""
    source: str = ""
    """page, table or equation"""
    note: str = ""
    """what else is to be known"""

    @property
    def labels(self) -> list[str]:
        """Every label of the test."""
        return split_cell(self.left) + self.rights

    @property
    def rights(self) -> list[str]:
        """Labels of the right side."""
        return split_cell(self.right)

    def sides(self, right: str) -> list[Measure]:
        """Return the expression of the left side, and that of the filter ``right`` on the right side.

        Without a filter (an empty ``right``) the left side is compared with the number ``factor``. The
        list is empty for a claim that is text alone: it compares nothing.
        """
        if self.expression is None:
            return []
        compared = [self.expression.of(self.left)]
        if right:
            right_expression = self.right_expression or self.expression
            compared.append(right_expression.of(right))
        return compared

    @property
    def expressions(self) -> list[Measure]:
        """Every expression of the test."""
        return [e for e in (self.expression, self.right_expression) if e]


@dataclass(frozen=True)
class Published:
    """Numbers and claims that concern one experiment, and the files they come from."""

    numbers: list[PublishedNumber] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)
    """content by file name"""
    marked_expressions: list[tuple[Measure, Mark, str]] = field(default_factory=list, compare=False)
    """each metric expression with the position of its cell and the name of its column"""

    @property
    def expressions(self) -> list[Measure]:
        """Metric expressions of all published numbers and claims."""
        rows: list[PublishedNumber | Claim] = [*self.numbers, *self.claims]
        return list(chain.from_iterable(row.expressions for row in rows))


def check_labels(row: PublishedNumber | Claim, source: Source, labels: list[str] | None) -> None:
    """Check that the filters that a row names exist, if the ``labels`` of all filters are known.

    ``source`` has the cells of the row, and gets the mistakes.
    """
    if labels is None:
        return
    # The labels in each column.
    if isinstance(row, Claim):
        named_labels = {"left": split_cell(row.left), "right": row.rights}
        expressions = {"expression": row.expression, "right_expression": row.right_expression}
    else:
        named_labels = {"label": row.labels}
        expressions = {"expression": row.expression}
    for key, expression in expressions.items():
        if expression and expression.other:
            named_labels[key] = [expression.other]
    for key, column_labels in named_labels.items():
        for label in column_labels:
            if label not in labels:
                message = f"{label!r} is not a filter here; {unknown(label, labels)}"
                source.add_problem((key,), message)


def check_steps(row: PublishedNumber | Claim, source: Source) -> None:
    """Check that a number is of one step, and that both sides of a claim are of equal steps.

    A right side that names no range of steps is compared with each step of the left side. ``source`` has
    the cells of the row, and gets the mistakes.
    """
    left = row.expression
    if isinstance(row, PublishedNumber):
        if left and left.is_many:  # a range of steps
            source.add_problem(("expression",), f"{str(left)!r} is no number: name one step")
        return
    right = row.right_expression
    if right and right.is_many and not (left and left.steps == right.steps):
        message = f"{str(right)!r} is not at the steps of {str(left)!r}"
        source.add_problem(("right_expression",), message)


def check_point(
    row: PublishedNumber | Claim, source: Source, points: Sequence[Mapping[str, object]] | None
) -> None:
    """Check that a row's point, such as ``path=value; path=value``, is one of the grid.

    ``points`` are the values of each point by path. Without them any point is allowed.
    """
    if not all("=" in condition for condition in split_cell(row.point)):
        source.add_problem(("point",), f"{row.point!r} is not path=value; path=value")
    elif points and not any(picks(row.point, values) for values in points):
        source.add_problem(("point",), f"{row.point!r} is no point of the grid")


def check_repeated(row: PublishedNumber, source: Source, earlier: list[PublishedNumber]) -> None:
    """Check a row against the rows of the same printed number among the ``earlier`` rows.

    They must have the same value, and each an interpretation of its own in ``reading``.
    """
    for other in earlier:
        if other.printed_at != row.printed_at:
            continue
        repeated = "an earlier row has this paper, table, row, filter, metric and point, too"
        if other.value != row.value:
            message = f"is {row.value} here and {other.value} there: {repeated}"
            source.add_problem(("value",), message)
            return
        have_readings = row.reading and other.reading
        if not have_readings or row.reading == other.reading:
            message = f"{repeated}: give each a `reading` of its own, or leave one out"
            source.add_problem(("reading",), message)
            return


def check_claim(row: Claim, source: Source) -> None:
    """Check a claim's text, filter and comparison, which is ``left relation factor * right``.

    Both sides are metric expressions of filters; a claim without any is text alone, and is not tested.
    Without labels on the right side the left one is compared with the number ``factor``. ``source`` has
    the cells of the row, and gets the mistakes.
    """
    if not row.claim.strip():
        source.add_problem(("claim",), "is empty")
    if (row.expressions or row.rights) and not row.left.strip():
        source.add_problem(("left",), "is empty: name the filter that is spoken of")
    if row.expressions and not row.rights and "factor" not in source.data:
        source.add_problem(("factor",), "is empty, as right is: there is nothing to compare with")
    if row.rights and row.factor <= 0.0:
        message = (
            f"{row.factor:g} times the right side means nothing; a factor of `right` is above 0"
        )
        source.add_problem(("factor",), message)
    elif row.expressions and row.relation == "~" and not (row.factor and row.tolerance):
        key = "factor" if row.factor == 0.0 else "tolerance"
        message = "is 0, and `~` allows `tolerance` times it: nothing measured can be equal"
        source.add_problem((key,), message)
