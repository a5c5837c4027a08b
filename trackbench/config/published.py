"""Published numbers and claims: what a paper prints, and what measures it here.

A file of numbers has a ``value`` column, a file of claims a ``claim`` column; the columns are the fields
below. A row counts for the experiments that its ``experiment`` column names (all, if it is empty).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from trackbench.evaluation.metric_expression import Measure
from trackbench.field_types import Count, Finite, Natural, NonNegative, Positive
from trackbench.yaml_source import scalar


def split(text: str) -> list[str]:
    """Return parts between semicolons."""
    return [part.strip() for part in text.split(";") if part.strip()]


def picks(point: str, values: Mapping[str, Any]) -> bool:
    """Return whether ``path=value; path=value`` picks the point of a grid that has these values.

    Paths that vary together are one path with a list of values: ``a.N & b.N=[10, 5]``.
    """
    for part in split(point):
        path, value = (text.strip() for text in part.split("=", 1))
        if path not in values or scalar(value) not in (values[path], str(values[path])):
            return False
    return True


@dataclass(frozen=True, kw_only=True)
class PublishedNumber:
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
    value: Finite | Literal["biased", "unbiased"]
    """the number; a word where the paper prints a word"""
    digits: Natural = 0
    """decimals that are printed"""
    runs: Count | None = None
    """the paper's Monte Carlo runs"""
    variance: Positive | None = None
    """variance over the paper's runs, where it prints one; so its own standard error is known"""
    margin: NonNegative = 0.0
    """how far from zero a value may be and still count as unbiased"""
    chosen: str = ""
    """what the paper leaves out and was chosen so that this number comes out: it decides nothing"""
    experiment: str = ""
    """experiments that measure it, separated by semicolons"""
    label: str = ""
    """labels of the filter there, separated by semicolons"""
    reading: str = ""
    """how this row interprets the number, in a few words: needed where several rows measure one number,
    whose verdict is that of the best"""
    expression: Measure | None = None
    """what to measure: `mean(rmse)`, `rmse@20`, `ratio(cpu_s_per_run, PF)`, `gain(...)`, `minus(...)`,
    `win_rate(rmse, PF)`: the share of the runs in which it is less than PF's"""
    point: str = ""
    """point of the experiment's grid: `scenario.R=0.1; filters.PF.N=10`"""
    source: str = ""
    """page, table or equation"""
    note: str = ""
    """why it may differ, from the reading of the paper"""

    @property
    def printed_at(self) -> tuple[str, ...]:
        """Return where a number is printed, and its point: what readings of it share."""
        return self.paper, self.table, self.row, self.filter, self.metric, self.point

    @property
    def labels(self) -> list[str]:
        """Return labels in the experiment."""
        return split(self.label)

    @property
    def expressions(self) -> list[Measure]:
        """Return every expression of the row."""
        return [self.expression] if self.expression else []


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
    point: str = ""
    """point of the experiment's grid"""
    source: str = ""
    """page, table or equation"""
    note: str = ""
    """what else is to be known"""

    @property
    def labels(self) -> list[str]:
        """Return every label of the test."""
        return split(self.left) + self.rights

    @property
    def rights(self) -> list[str]:
        """Return labels of the right side."""
        return split(self.right)

    def sides(self, right: str) -> list[Measure]:
        """Return the compared expressions of the left side and of a label on the right, if any."""
        if self.expression is None:
            return []
        other = (self.right_expression or self.expression).of(right)
        return [self.expression.of(self.left), *([other] if right else [])]

    @property
    def expressions(self) -> list[Measure]:
        """Return every expression of the test."""
        return [e for e in (self.expression, self.right_expression) if e]


@dataclass(frozen=True)
class Published:
    """Numbers and claims that concern one experiment, and the files they come from."""

    numbers: list[PublishedNumber] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)
    """content by file name"""

    @property
    def expressions(self) -> list[Measure]:
        """Return every expression of every row."""
        rows: list[PublishedNumber | Claim] = [*self.numbers, *self.claims]
        return [e for row in rows for e in row.expressions]
