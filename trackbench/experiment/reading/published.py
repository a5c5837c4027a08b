"""Published numbers and claims: CSV files that say what a paper prints and what measures it here.

A file of numbers has a ``value`` column, a file of claims a ``claim`` column; the columns are the fields
below. A row counts for the experiments that its ``experiment`` column names (all, if it is empty).
"""

import csv
import io
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from trackbench.evaluation.measure import Measure
from trackbench.experiment.problems import Mark, Problem, UserError, reason
from trackbench.experiment.reading.source import Source, scalar, text_of, unseen
from trackbench.experiment.reading.validate import build, unknown
from trackbench.keys import Count, Finite, Natural, NonNegative, Positive


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
    expression: Measure | None = None
    """what to measure: `mean(rmse)`, `rmse@20`, `ratio(cpu_s_per_run, PF)`, `gain(...)`, `minus(...)`,
    `below(rmse, PF)`: the share of the runs in which it is less than PF's"""
    point: str = ""
    """point of the experiment's grid: `scenario.R=0.1; filters.PF.N=10`"""
    source: str = ""
    """page, table or equation"""
    note: str = ""
    """why it may differ, from the reading of the paper"""

    @property
    def labels(self) -> list[str]:
        """Labels in the experiment."""
        return split(self.label)

    @property
    def expressions(self) -> list[Measure]:
        """Every expression of the row."""
        return [self.expression] if self.expression else []


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What a paper says in words, as a test of ``left relation factor * right``."""

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
        """Every label of the test."""
        return split(self.left) + self.rights

    @property
    def rights(self) -> list[str]:
        """Labels of the right side."""
        return split(self.right)

    def sides(self, right: str) -> list[Measure]:
        """What is compared of the left side and of a label of the right one, if there is any."""
        if self.expression is None:
            return []
        other = (self.right_expression or self.expression).of(right)
        return [self.expression.of(self.left), *([other] if right else [])]

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


def read_published(
    folder: Path,
    paths: list[str],
    experiment: str,
    labels: list[str] | None = None,
    mark: Mark | None = None,
) -> Published:
    """The rows for one experiment; raises UserError with every mistake in the files.

    Rows may name ``labels`` only, if they are given: a run with ``--only`` leaves labels out.
    """
    found, problems = Published(), []
    for path in paths:
        try:
            text = text_of(folder / path)
        except OSError as error:
            where = mark or Mark(str(folder / "config.yaml"))
            what = f"cannot read {folder / path}: {reason(error)}"
            problems.append(Problem(where, "published", what))
            continue
        name = Path(path).name
        if name in found.files:
            problems.append(Problem(Mark(path), "", f"there are two files named {name}"))
        found.files[name] = text
        _read(str(folder / path), text, experiment, labels, found, problems)
    if problems:
        raise UserError(*problems)
    return found


def split(text: str) -> list[str]:
    """Parts between semicolons."""
    return [part.strip() for part in text.split(";") if part.strip()]


def _read(
    name: str,
    text: str,
    experiment: str,
    labels: list[str] | None,
    found: Published,
    problems: list[Problem],
) -> None:
    reader = csv.reader(io.StringIO(text))
    try:
        rows = [(reader.line_num, cells) for cells in reader]
    except csv.Error as error:
        problems.append(Problem(Mark(name, reader.line_num, 1), "", f"not a CSV: {error}"))
        return
    line, header = rows[0] if rows else (1, [])
    for key in dict.fromkeys(key for key in header if header.count(key) > 1):
        problems.append(Problem(Mark(name, line, 1), key, "there are two columns of this name"))
    cls: type[Any] = Claim if "claim" in header else PublishedNumber
    for line, cells in rows[1:]:
        if not cells:
            continue
        source = _source(name, line, cls, header, cells, problems)
        mistakes: list[Problem] = []
        row = build(cls, source, (0,), mistakes)
        problems += [Problem(p.mark, p.path.removeprefix("0."), p.what) for p in mistakes]
        wanted = split(source.data[0].get("experiment", ""))
        if row is None or (wanted and experiment not in wanted):
            continue
        _check(row, source, labels, problems)
        (found.claims if cls is Claim else found.numbers).append(row)


def _source(
    name: str,
    line: int,
    cls: type[Any],
    header: list[str],
    cells: list[str],
    problems: list[Problem],
) -> Source:
    """One row as a mapping with positions; empty cells are left out, numbers are read as in YAML."""
    start = Mark(name, line, 1)
    if len(cells) != len(header):
        what = f"{len(cells)} cells under {len(header)} headings"
        problems.append(Problem(start, "", what))
    words = {f.name for f in fields(cls) if f.type in (str, "str")}
    data: dict[str, Any] = {}
    source = Source([data], {(0,): start}, {(0,): start})
    column = 1
    for key, cell in zip(header, cells, strict=False):
        if cell != "" or (key in words and _required(cls, key)):
            data[key] = cell if key in words else _number(cell)
            source.marks[0, key] = source.key_marks[0, key] = Mark(name, line, column)
            if unseen(cell):
                problems.append(Problem(Mark(name, line, column), key, str(unseen(cell))))
        column += len(_as_written(cell)) + 1
    return source


def _number(cell: str) -> Any:
    value = scalar(cell)
    return value if type(value) in (int, float) else cell


def _required(cls: type[Any], key: str) -> bool:
    return any(f.name == key and f.default is MISSING for f in fields(cls))


def _as_written(cell: str) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="").writerow([cell])
    return out.getvalue() if cell else ""


def _check(
    row: PublishedNumber | Claim,
    source: Source,
    labels: list[str] | None,
    problems: list[Problem],
) -> None:
    """The row's labels exist in the experiment, its point and its expressions can be read."""

    def wrong(key: str, what: str) -> None:
        problems.append(Problem(source.mark((0, key)), key, what))

    def known(key: str, label: str) -> None:
        if labels is not None and label not in labels:
            wrong(key, f"{label!r} is not a filter here; {unknown(label, labels)}")

    if not all("=" in part for part in split(row.point)):
        wrong("point", f"{row.point!r} is not path=value; path=value")
    for key in ("label", "left", "right"):
        for label in split(getattr(row, key, "")):
            known(key, label)
    for key in ("expression", "right_expression"):
        expression: Measure | None = getattr(row, key, None)
        if expression and expression.other:
            known(key, expression.other)
    first, second = row.expression, getattr(row, "right_expression", None)
    if isinstance(row, PublishedNumber) and first and first.is_many:
        wrong("expression", f"{str(first)!r} is no number: name one step")
    elif second and second.is_many and not (first and first.steps == second.steps):
        wrong("right_expression", f"{str(second)!r} is not at the steps of {str(first)!r}")
