"""CSV files of published numbers and claims, each mistake with its place."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, NamedTuple

from trackbench.evaluation.measure import Measure
from trackbench.experiment.problems import Mark, Problem, UserError, reason
from trackbench.experiment.reading.published import (
    Claim,
    Published,
    PublishedNumber,
    picks,
    split,
)
from trackbench.experiment.reading.source import Source, formula, scalar, text_of, unseen
from trackbench.experiment.reading.validate import build, unknown


def read_published(
    folder: Path,
    paths: list[str],
    experiment: str,
    labels: list[str] | None = None,
    mark: Mark | None = None,
    points: Sequence[Mapping[str, Any]] | None = None,
) -> Published:
    """The rows for one experiment; raises UserError with every mistake in the files.

    Rows may name ``labels`` and the grid's ``points`` only, if they are given: a run with ``--only``
    leaves labels out, one with ``--grid`` points.
    """
    found, problems, known = Published(), [], _Known(experiment, labels, points)
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
        _read(str(folder / path), text, known, found, problems)
    if problems:
        raise UserError(*problems)
    return found


class _Known(NamedTuple):
    """The experiment that rows are read for, and what they may name, if that is known."""

    experiment: str
    labels: list[str] | None
    points: Sequence[Mapping[str, Any]] | None


def _read(name: str, text: str, known: _Known, found: Published, problems: list[Problem]) -> None:
    reader = csv.reader(io.StringIO(text))
    try:
        rows = [(reader.line_num, cells) for cells in reader]
    except csv.Error as error:
        problems.append(Problem(Mark(name, reader.line_num, 1), "", f"not a CSV: {error}"))
        return
    line, header = rows[0] if rows else (1, [])
    if not header:
        problems.append(Problem(Mark(name, 1, 1), "", "there are no headings"))
        return
    for key in dict.fromkeys(key for key in header if header.count(key) > 1):
        problems.append(Problem(Mark(name, line, 1), key, "there are two columns of this name"))
    cls: type[Any] = Claim if "claim" in header else PublishedNumber
    for line, cells in rows[1:]:
        if not cells:
            continue
        source = _source(name, line, cls, header, cells)
        row = build(cls, source, ())
        wanted = split(source.data.get("experiment", ""))
        if row is not None and (not wanted or known.experiment in wanted):
            _check(row, source, known.labels)
            _check_point(row, source, known.points)
            if isinstance(row, Claim):
                _check_claim(row, source)
            (found.claims if cls is Claim else found.numbers).append(row)
        problems += source.problems


def _source(name: str, line: int, cls: type[Any], header: list[str], cells: list[str]) -> Source:
    """One row as a mapping with positions; empty cells are left out, numbers are read as in YAML."""
    start = Mark(name, line, 1)
    source = Source({}, {(): start}, {(): start})
    if len(cells) != len(header):
        source.blame((), f"{len(cells)} cells under {len(header)} headings")
    words = {f.name for f in fields(cls) if f.type in (str, "str")}
    required = {f.name for f in fields(cls) if f.default is MISSING}
    column = 1
    for key, cell in zip(header, cells, strict=False):
        if cell != "" or key in words & required:
            source.data[key] = cell if key in words else _number(cell)
            source.marks[key,] = source.key_marks[key,] = Mark(name, line, column)
            if what := unseen(cell) or (formula(cell) if key in words else None):
                source.blame((key,), what)
        column += len(_as_written(cell)) + 1
    return source


def _number(cell: str) -> Any:
    value = scalar(cell)
    return value if type(value) in (int, float) else cell


def _as_written(cell: str) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="").writerow([cell])
    return out.getvalue() if cell else ""


def _check(row: PublishedNumber | Claim, source: Source, labels: list[str] | None) -> None:
    """The row's labels exist in the experiment, its expressions can be read."""
    named = [(key, b) for key in ("label", "left", "right") for b in split(getattr(row, key, ""))]
    for key in ("expression", "right_expression"):
        expression: Measure | None = getattr(row, key, None)
        if expression and expression.other:
            named.append((key, expression.other))
    for key, label in named:
        if labels is not None and label not in labels:
            source.blame((key,), f"{label!r} is not a filter here; {unknown(label, labels)}")
    first, second = row.expression, getattr(row, "right_expression", None)
    if isinstance(row, PublishedNumber) and first and first.is_many:
        source.blame(("expression",), f"{str(first)!r} is no number: name one step")
    elif second and second.is_many and not (first and first.steps == second.steps):
        what = f"{str(second)!r} is not at the steps of {str(first)!r}"
        source.blame(("right_expression",), what)


def _check_point(
    row: PublishedNumber | Claim, source: Source, points: Sequence[Mapping[str, Any]] | None
) -> None:
    """The row's point can be read, and is one of the grid."""
    if not all("=" in part for part in split(row.point)):
        source.blame(("point",), f"{row.point!r} is not path=value; path=value")
    elif points and not any(picks(row.point, values) for values in points):
        source.blame(("point",), f"{row.point!r} is no point of the grid")


def _check_claim(row: Claim, source: Source) -> None:
    """Something is said, and if it is to be measured, of a filter and beside something."""
    if not row.claim.strip():
        source.blame(("claim",), "is empty")
    if (row.expressions or row.rights) and not row.left.strip():
        source.blame(("left",), "is empty: name the filter that is spoken of")
    if row.expressions and not row.rights and "factor" not in source.data:
        source.blame(("factor",), "is empty, as right is: there is nothing to compare with")
