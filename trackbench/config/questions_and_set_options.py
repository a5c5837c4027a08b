"""Answers of the user, given by `--set`, to the questions on the tables of a recording.

`trackbench new experiment --from` asks what it cannot guess. An answer is a key of the config; that of
one of several tables begins with the name of the table.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

from trackbench.config.build_components import build
from trackbench.config.overrides import override_all
from trackbench.errors import Answer, Mark, Problem, UserError
from trackbench.field_types import DataError, Place, Positive
from trackbench.scenarios.recordings.recording_keys import Naming
from trackbench.yaml_source import MarkedMapping, Source

_Answers = TypeVar("_Answers")
_TABLES_OF_PREFIXES = {
    "truth_naming.": ("truth", "--truth"),
    "input_naming.": ("file of inputs", "--input"),
    "landmarks.": ("table of landmarks", "--landmarks"),
}
"""Tables beside the measurements and their options, by the beginning of their keys."""
_FILES_KEY = "measurement_naming"
_OPTION_OF_TABLE = re.compile(r"--set '?(?!'|(?:truth_naming|input_naming|landmarks)\.)")
"""Beginning of an option that answers a question on a table."""
_KEY_OF_TABLE = re.compile(r"\b(?:there is no |which )(?=(?:columns|units)\.)")
"""Words of a mistake before the key of a table's column or unit."""
_OPTION = "--set "
_OPTIONS_OF_KEYS = {
    "truth": "--truth FILE",
    "truth_gap": "--truth FILE",
    "input_file": "--input FILE",
}
"""Keys of the target that follow from the options of the command."""


@dataclass(frozen=True, kw_only=True)
class _InputKeys:
    """Keys of the target on a robot's inputs, which the user may give."""

    input_gap: Positive | None = None
    input_holds: Literal["before", "after"] | None = None


@contextmanager
def reporting_questions(prefix: str) -> Iterator[None]:
    """Report the mistakes of a table, which are questions to the user, as those of the command.

    The answers to questions on a table beside the measurements are keys that begin with the ``prefix``.
    """
    try:
        yield
    except DataError as error:
        raise as_questions(error, prefix) from None


def read_input_keys(mark: Mark, changes: Sequence[str]) -> dict[str, str]:
    """Read the user's answers on a robot's inputs; return their keys with the values as YAML.

    ``changes`` are these answers only, ``KEY=VALUE``. Mistakes are reported at ``mark``.
    """
    answers = _build_answers(_InputKeys, mark, changes)
    keys = {}
    if answers.input_gap is not None:
        keys["input_gap"] = f"{answers.input_gap:g}"
    if answers.input_holds is not None:
        keys["input_holds"] = answers.input_holds
    return keys


def prefix_of_table(number: int, tables: Sequence[Path]) -> str:
    """Return the beginning of the keys of a table's columns, which is empty for one table alone."""
    if len(tables) == 1:
        return ""
    return f"{_FILES_KEY}.{number}."


def answers_on_all_files(mark: Mark, tables: Sequence[Path], changes: Sequence[str]) -> list[str]:
    """Return the answers that count for all files of measurements, as they name none of them.

    ``changes`` are the user's answers, ``KEY=VALUE``; the key of one on a single file begins with
    ``measurement_naming`` and its number. Raises UserError for an answer that names a wrong file, or no
    file where it has to.
    """
    shared = [change for change in changes if not change.startswith(f"{_FILES_KEY}.")]
    if len(tables) == 1:
        for change in changes:
            if change not in shared:
                message = "there is one file alone: leave the words before columns or units out"
                raise UserError(Problem(mark, change, message))
    else:
        _check_file_numbers(mark, tables, changes, shared)
    return shared


def _check_file_numbers(
    mark: Mark, tables: Sequence[Path], changes: Sequence[str], shared: Sequence[str]
) -> None:
    """Raise UserError for an answer among ``changes`` that does not name one of several files.

    ``shared`` are the answers that name no file.
    """
    for change in shared:
        if not change.startswith("origin="):  # all files share the origin
            options = " or ".join(
                f"--set {prefix_of_table(number, tables)}{change} for {table.name}"
                for number, table in enumerate(tables)
            )
            raise UserError(Problem(mark, change, f"which file? Say {options}"))
    prefixes = tuple(prefix_of_table(number, tables) for number in range(len(tables)))
    for change in changes:
        if change not in shared and not change.startswith(prefixes):
            message = f"files have the numbers from 0 to {len(tables) - 1}: {_FILES_KEY}.0.columns"
            raise UserError(Problem(mark, change, message))


def as_questions(error: DataError, prefix: str) -> UserError:
    """Return the questions on a table as mistakes of the command.

    The user answers by keys that begin with the ``prefix``, such as ``truth_naming.``. It is empty for
    the only table of measurements.
    """
    problems = []
    for place in error.places:
        message = place.message
        if prefix:
            message = _OPTION_OF_TABLE.sub(rf"\g<0>{prefix}", message)
            message = _KEY_OF_TABLE.sub(rf"\g<0>{prefix}", message)
        if place.answer is not None:
            message = message.replace(place.answer.in_yaml, _option_of_answer(place.answer, prefix))
        problems.append(problem_at(place._replace(message=message)))
    return UserError(*problems)


def with_option(
    problem: Problem | str, tables: Sequence[Path], truth: Path | None
) -> Problem | str:
    """Write the key that a mistake proposes as an option of the command.

    The mistake comes from loading the config, and so proposes a key such as ``zone: UTC``. The user of
    the command writes ``--set zone=UTC``, with the prefix of the table. Other problems stay as they are.
    ``tables`` are those of the measurements.
    """
    if isinstance(problem, str) or problem.answer is None:
        return problem
    answer = problem.answer
    prefix = ""
    if answer.file:
        prefixes = {
            os.path.abspath(table): prefix_of_table(number, tables)
            for number, table in enumerate(tables)
        }
        if truth is not None:
            prefixes[os.path.abspath(truth)] = "truth_naming."
        path = os.path.abspath(answer.file)
        if path not in prefixes:
            return problem
        prefix = prefixes[path]
    option = _option_of_answer(answer, prefix)
    return replace(problem, message=problem.message.replace(answer.in_yaml, option))


def _option_of_answer(answer: Answer, prefix: str) -> str:
    """Return the option that sets the key of an answer, in quotes if a shell would change it."""
    option = f"{prefix}{answer.key}={answer.value}"
    if re.search(r"[^\w.=+:-]", option):
        return f"{_OPTION}'{option}'"
    return f"{_OPTION}{option}"


def problem_at(place: Place) -> Problem:
    """Return the mistake of a table as a problem of the command."""
    mark = Mark(place.file, place.line, place.column)
    return Problem(mark, "", place.message, place.answer)


def read_namings(
    mark: Mark, changes: Sequence[str], paths_of_tables: Mapping[str, Path | None]
) -> tuple[dict[str, Naming], list[str]]:
    """Read the answers on tables beside the measurements; return them and the ``changes`` that are left.

    The answers are the naming of columns and units of each table, by the beginning of the table's keys,
    such as ``truth_naming.``. So are the ``paths_of_tables``, with None for a table that is not given.
    Mistakes are reported at ``mark``, which stands for the command.
    """
    namings = {}
    remaining = list(changes)
    for prefix, table in paths_of_tables.items():
        table_changes = [change for change in remaining if change.startswith(prefix)]
        if table_changes and table is None:
            noun, option = _TABLES_OF_PREFIXES[prefix]
            message = f"{table_changes[0]}: there is no {noun}; name it, {option} FILE"
            raise UserError(Problem(mark, path="", message=message))  # no place in a config
        remaining = [change for change in remaining if change not in table_changes]
        keys = [change.removeprefix(prefix) for change in table_changes]
        namings[prefix] = read_naming(mark, keys, prefix)
    return namings, remaining


def read_naming(mark: Mark, changes: Sequence[str], prefix: str) -> Naming:
    """Build the naming of columns and units from the user's answers.

    The user wrote the ``prefix``, such as ``truth_naming.``, before the keys in ``changes``.
    """
    for change in changes:
        key = change.partition("=")[0]
        if key in _OPTIONS_OF_KEYS:
            message = f"this table has an option of its own, {_OPTIONS_OF_KEYS[key]}"
            raise UserError(Problem(mark, f"{prefix}{key}", message))
    return _build_answers(Naming, mark, changes, prefix)


def _build_answers(
    cls: type[_Answers], mark: Mark, changes: Sequence[str], prefix: str = ""
) -> _Answers:
    """Build an object of a class whose keys are the user's answers; raises UserError.

    Mistakes name the keys as the user wrote them, with the ``prefix``.
    """
    source = Source(MarkedMapping(), mark)
    try:
        override_all(source, changes)
        answers = build(cls, source, ())
    except UserError as error:
        raise UserError(*(_with_prefix(problem, prefix) for problem in error.problems)) from None
    if answers is None:
        raise UserError(*(_with_prefix(problem, prefix) for problem in source.problems))
    return answers


def _with_prefix(problem: Problem | str, prefix: str) -> Problem | str:
    """Put the prefix of a table's keys before the option and the key that a problem names.

    An option is ``--set KEY=VALUE``: as the mark of the problem, or in its message.
    """
    if isinstance(problem, str) or not prefix:
        return problem
    mark = problem.mark
    if mark.file.startswith(_OPTION):
        mark = replace(mark, file=f"{_OPTION}{prefix}{mark.file.removeprefix(_OPTION)}")
    message = problem.message.replace(f" {_OPTION}", f" {_OPTION}{prefix}")
    path = problem.path and f"{prefix}{problem.path}"
    return Problem(mark, path, message)
