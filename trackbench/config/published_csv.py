"""Published numbers and claims of papers, read from CSV files and checked against the experiment.

A file of numbers has a ``value`` column, a file of claims a ``claim`` column. Its columns are the fields
of `PublishedNumber` or `Claim`. A row counts for the experiments in its ``experiment`` column, or for
all if that is empty.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields, replace
from difflib import get_close_matches
from glob import escape, glob
from itertools import chain
from pathlib import Path
from typing import Literal, NamedTuple

from trackbench.config import shipped_experiments
from trackbench.config.build_components import build
from trackbench.config.key_mistakes import unknown
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.evaluation.metric_expression import Measure
from trackbench.field_types import FORMULA, Finite, NonNegative, Positive, decimals
from trackbench.readable_files import text_of
from trackbench.statistics.published_number_rules import Printed
from trackbench.unsafe_characters import explain_formula, unprintable_reason
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import MarkedMapping, Source


def split(text: str) -> list[str]:
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

    return all(is_met(condition) for condition in split(point))


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
        return split(self.label)

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
        return split(self.left) + self.rights

    @property
    def rights(self) -> list[str]:
        """Labels of the right side."""
        return split(self.right)

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

    @property
    def expressions(self) -> list[Measure]:
        """Metric expressions of all published numbers and claims."""
        rows: list[PublishedNumber | Claim] = [*self.numbers, *self.claims]
        return list(chain.from_iterable(row.expressions for row in rows))


_NUMBERS = re.compile("[-_.]*[0-9]+")
_QUOTED = re.compile('[",\r\n]')
"""Characters of a cell that a CSV puts between quotes, where it doubles its own."""


def read_published(
    folder: Path,
    paths: list[str],
    experiment: str,
    labels: list[str] | None = None,
    mark: Mark | None = None,
    points: Sequence[Mapping[str, object]] | None = None,
    related_experiments: Sequence[str] = (),
) -> Published:
    """Read the published rows for one experiment from CSV files.

    Parameters
    ----------
    folder, paths : files with the rows, relative to the folder
    experiment : name of the experiment
    labels : filters that rows may name; default: any, as a run with ``--only`` leaves filters out. If
        they are given, the experiment needs a row, and names of other experiments must not look misspelt
    mark : place of the config's ``published``, where a file that cannot be read is reported
    points : points of the grid that rows may name; default: any
    related_experiments : further experiments, a row for one of which is enough

    Raises
    ------
    UserError : every mistake in the files
    """
    # Step 1: the rows of every file.
    published = Published()
    problems: list[Problem] = []
    known = _Known(experiment=experiment, labels=labels, points=points, first_rows={})
    for path in paths:
        try:
            text = text_of(folder / path)
        except OSError as error:
            where = mark or Mark(str(folder / "config.yaml"))
            message = f"cannot read {folder / path}: {reason(error)}"
            problems.append(Problem(where, "published", message))
            continue
        name = Path(path).name
        if name in published.files:
            problems.append(Problem(Mark(path), "", f"there are two files named {name}"))
        published.files[name] = text
        problems += _add_rows(published, known, str(folder / path), text)
    # Step 2: names of other experiments, and a config without any row.
    # A results folder has a copy of files that were checked among their neighbors.
    is_results_folder = (folder / "manifest.json").is_file()
    if labels is not None and not is_results_folder:
        folders = [folder]
        folders += [(folder / path).parent for path in paths]
        problems += _misspelt_experiments(known, folders)
    has_rows_of_related = not known.first_rows.keys().isdisjoint(related_experiments)
    has_rows = published.numbers or published.claims or has_rows_of_related
    if paths and labels is not None and not problems and not has_rows:
        names = ", ".join(sorted(known.first_rows)) or "none"
        message = f"no row is for experiment {experiment!r}; the rows are for {names}"
        problems.append(Problem(mark or Mark("config"), "published", message))
    if problems:
        raise UserError(*problems)
    return published


class _Known(NamedTuple):
    """Experiment whose rows are read, and labels and points that they may name; None for any."""

    experiment: str
    labels: list[str] | None
    points: Sequence[Mapping[str, object]] | None
    first_rows: dict[str, Problem]
    """the first row for each other experiment, as the place of a mistake"""


def _misspelt_experiments(known: _Known, folders: list[Path]) -> Iterator[Problem]:
    """Yield a mistake for each unknown experiment whose name is near to a known one.

    Known are the shipped experiments, and the configs in ``folders`` and in their parents. Two names
    that differ only in numbers may both be right. ``known.first_rows`` has the mistakes' places, as
    mistakes without a message.
    """
    # Step 1: the known names.
    shipped_names = shipped_experiments.names()
    other_names = known.first_rows.keys() - set(shipped_names)
    if not other_names:
        return
    known_names = {known.experiment, *shipped_names}
    for folder in {*folders, *(folder.parent for folder in folders)}:
        known_names.update(_experiment_names(folder))
    # Step 2: names that are near to a known one.
    for name in sorted(other_names - known_names):
        for match in get_close_matches(name, sorted(known_names), 1, 0.75):
            if _NUMBERS.sub("", name) != _NUMBERS.sub("", match):
                message = f"there is no experiment {name!r}; did you mean {match}?"
                yield replace(known.first_rows[name], message=message)


def _experiment_names(folder: Path) -> Iterator[str]:
    """Yield the names of the experiments in a folder: the key `name` of each file, or its own name."""
    for path in glob(f"{escape(str(folder))}/*.yaml"):
        with suppress(OSError):
            name = re.search(r"^name: *[\"']?([\w.-]+)", text_of(Path(path)), re.MULTILINE)
            yield name[1] if name else Path(path).stem


def _add_rows(published: Published, known: _Known, file_name: str, text: str) -> list[Problem]:
    """Add the rows of a file, which has this text, to ``published``; return the file's mistakes.

    ``known`` has the names of the experiment, its filters and its points. It gets the place of the first
    row for each other experiment. A row that names no experiment is for this one.
    """
    # Step 1: the lines and the header.
    reader = csv.reader(io.StringIO(text))
    try:
        lines = [(reader.line_num, cells) for cells in reader]
    except csv.Error as error:
        return [Problem(Mark(file_name, reader.line_num, 1), "", f"not a CSV: {error}")]
    header: list[str] = []
    header_line = 1
    if lines:
        header_line, headings = lines[0]
        header = [heading.strip() for heading in headings]
    if not header:
        return [Problem(Mark(file_name, 1, 1), "", "there are no headings")]
    problems = []
    for key in dict.fromkeys(header):
        if header.count(key) > 1:
            message = "there are two columns of this name"
            problems.append(Problem(Mark(file_name, header_line, 1), key, message))
    # Step 2: build each row, note the first row on another experiment, check it against this one.
    cls: type[Claim | PublishedNumber] = Claim if "claim" in header else PublishedNumber
    for line, cells in lines[1:]:
        if not cells:
            continue
        source = _read_row(file_name, line, cls, header, cells)
        row = build(cls, source, ())
        experiments = split(source.data.get("experiment", ""))
        for other in set(experiments) - {known.experiment}:
            known.first_rows.setdefault(other, source.problem(("experiment",), ""))
        is_of_experiment = not experiments or known.experiment in experiments
        if row is not None and is_of_experiment:
            _check_labels(row, source, known.labels)
            _check_steps(row, source)
            _check_point(row, source, known.points)
            if isinstance(row, Claim):
                _check_claim(row, source)
                published.claims.append(row)
            else:
                # Without labels these are files of results: the rows were checked with the config.
                if known.labels is not None:
                    _check_repeated(row, source, published.numbers)
                published.numbers.append(row)
        problems += source.problems
    return problems


def _read_row(file_name: str, line: int, cls: type, header: list[str], cells: list[str]) -> Source:
    """Read one row as a mapping with positions, without the spaces around cells.

    Numbers are read as in YAML. Empty cells are left out, except those of texts that ``cls``, the class
    of the row, requires. ``line`` is the row's line in the file.
    """
    row = MarkedMapping()
    source = Source(row, Mark(file_name, line, 1))
    if len(cells) != len(header):
        source.add_problem((), f"{len(cells)} cells under {len(header)} headings")
    text_keys = {f.name for f in fields(cls) if f.type in (str, "str")}
    required_keys = {f.name for f in fields(cls) if f.default is MISSING}
    is_printable = unprintable_reason("".join(cells)) is None
    column = 1
    for key, written in zip(header, cells, strict=False):
        cell = written.strip()
        is_text = key in text_keys
        if cell != "" or (is_text and key in required_keys):
            # Step 1: the value and its position.
            value = scalar(cell)
            is_number = type(value) in (int, float)
            row[key] = value if is_number and not is_text else cell
            row.marks[key] = Mark(file_name, line, column)
            row.key_marks[key] = row.marks[key]
            # A printed 0.50 is judged by two decimals, of which the number 0.5 has lost one.
            if key == "value" and isinstance(value, float):
                row.setdefault("digits", decimals(cell))
            # Step 2: characters that a cell must not have.
            message = None if is_printable else unprintable_reason(cell)
            if not message and is_text and cell[:1] in FORMULA:
                message = explain_formula(cell)
            if message is not None:
                source.add_problem((key,), message)
        # The next cell's column: quotes around a cell, and doubled ones in it, take their place.
        quotes = 0
        if _QUOTED.search(written):
            quotes = 2 + written.count('"')
        column += len(written) + quotes + 1
    return source


def _check_labels(row: PublishedNumber | Claim, source: Source, labels: list[str] | None) -> None:
    """Check that the filters that a row names exist, if the ``labels`` of all filters are known.

    ``source`` has the cells of the row, and gets the mistakes.
    """
    if labels is None:
        return
    # The labels in each column.
    if isinstance(row, Claim):
        named_labels = {"left": split(row.left), "right": row.rights}
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


def _check_steps(row: PublishedNumber | Claim, source: Source) -> None:
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


def _check_point(
    row: PublishedNumber | Claim, source: Source, points: Sequence[Mapping[str, object]] | None
) -> None:
    """Check that a row's point, such as ``path=value; path=value``, is one of the grid.

    ``points`` are the values of each point by path. Without them any point is allowed.
    """
    if not all("=" in condition for condition in split(row.point)):
        source.add_problem(("point",), f"{row.point!r} is not path=value; path=value")
    elif points and not any(picks(row.point, values) for values in points):
        source.add_problem(("point",), f"{row.point!r} is no point of the grid")


def _check_repeated(row: PublishedNumber, source: Source, earlier: list[PublishedNumber]) -> None:
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


def _check_claim(row: Claim, source: Source) -> None:
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
