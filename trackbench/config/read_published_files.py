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
from dataclasses import MISSING, fields, replace
from difflib import get_close_matches
from glob import escape, glob
from pathlib import Path
from typing import NamedTuple

from trackbench.config import shipped_experiments
from trackbench.config.build_components import build
from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.published_numbers_and_claims import (
    Claim,
    Published,
    PublishedNumber,
    check_claim,
    check_labels,
    check_point,
    check_repeated,
    check_steps,
    split_cell,
)
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.field_types import FORMULA, decimals
from trackbench.readable_files import text_of
from trackbench.unsafe_characters import explain_formula, unprintable_reason
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import MarkedMapping, Source

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
    folder, paths
        files with the rows, relative to the folder
    experiment
        name of the experiment
    labels
        filters that rows may name; default: any, as a run with ``--only`` leaves filters out. If they
        are given, the experiment needs a row, and names of other experiments must not look misspelt
    mark
        place of the config's ``published``, where a file that cannot be read is reported
    points
        points of the grid that rows may name; default: any
    related_experiments
        further experiments, a row for one of which is enough

    Raises
    ------
    UserError
        every mistake in the files
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
        experiments = split_cell(source.data.get("experiment", ""))
        for other in set(experiments) - {known.experiment}:
            known.first_rows.setdefault(other, source.problem(("experiment",), ""))
        is_of_experiment = not experiments or known.experiment in experiments
        if row is not None and is_of_experiment:
            check_labels(row, source, known.labels)
            check_steps(row, source)
            check_point(row, source, known.points)
            for key in ("expression", "right_expression"):
                expression = getattr(row, key, None)
                if expression is not None:
                    marked = (expression, source.mark((key,)), key)
                    published.marked_expressions.append(marked)
            if isinstance(row, Claim):
                check_claim(row, source)
                published.claims.append(row)
            else:
                # Without labels these are files of results: the rows were checked with the config.
                if known.labels is not None:
                    check_repeated(row, source, published.numbers)
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


def read_published_of_config(
    source: Source, settings: Settings, folder: Path, points: list[Point]
) -> Published:
    """Read the published files of the config; their mistakes are added to the source.

    Paths count from ``folder``. ``points`` are those of the grid.
    """
    labels = list(settings.filters)
    if settings.bound:
        labels.append(settings.bound)
    # A grid from the command line leaves out points that rows may name: points are then not checked.
    grid_places = [("grid",), *(("grid", path) for path in settings.grid)]
    grid_files = {source.mark(keys).file for keys in grid_places}
    point_values = None
    if grid_files == {source.mark(()).file}:
        point_values = [point.values for point in points]
    try:
        return read_published(
            folder,
            settings.published,
            settings.name,
            labels,
            mark=source.mark(("published",)),
            points=point_values,
            # A table with the key `of` may show the rows of another experiment.
            related_experiments=[str(table.get("of")) for table in settings.tables.values()],
        )
    except UserError as error:
        source.problems += [p for p in error.problems if isinstance(p, Problem)]
        return Published()
