"""Mistakes of tables as questions to the user of a command, who answers by its option `--set`."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from trackbench.errors import Answer, Mark, Problem, UserError
from trackbench.field_types import DataError, Place

FILES_KEY = "measurement_naming"
"""Key of a config that has the naming of columns and units of each of several files."""
_OPTION_OF_TABLE = re.compile(r"--set '?(?!'|(?:truth_naming|input_naming|landmarks)\.)")
"""Beginning of an option that answers a question on a table."""
_KEY_OF_TABLE = re.compile(r"\b(?:there is no |which )(?=(?:columns|units)\.)")
"""Words of a mistake before the key of a table's column or unit."""
_OPTION = "--set "


@contextmanager
def reporting_questions(prefix: str) -> Iterator[None]:
    """Report the mistakes of a table, which are questions to the user, as those of the command.

    The answers to questions on a table beside the measurements are keys that begin with the ``prefix``.
    """
    try:
        yield
    except DataError as error:
        raise as_questions(error, prefix) from None


def prefix_of_table(number: int, tables: Sequence[Path]) -> str:
    """Return the beginning of the keys of a table's columns, which is empty for one table alone."""
    if len(tables) == 1:
        return ""
    return f"{FILES_KEY}.{number}."


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


def with_prefix(problem: Problem | str, prefix: str) -> Problem | str:
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
