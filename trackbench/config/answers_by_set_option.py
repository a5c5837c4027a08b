"""Answers of the user, given by `--set`, to the questions on the tables of a recording.

`trackbench new experiment --from` asks what it cannot guess. An answer is a key of the config; that of
one of several tables begins with the name of the table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal, TypeVar

from trackbench.config.build_components import build
from trackbench.config.overrides import override_all
from trackbench.errors import Mark, Problem, UserError
from trackbench.field_types import Positive
from trackbench.scenarios.recordings.guess_record import TableAnswers
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.questions_with_set_options import (
    FILES_KEY,
    prefix_of_table,
    with_prefix,
)
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.yaml_source import MarkedMapping, Source

_Answers = TypeVar("_Answers")
_TABLES_OF_PREFIXES = {
    "truth_naming.": ("truth", "--truth"),
    "input_naming.": ("file of inputs", "--input"),
    "landmarks.": ("table of landmarks", "--landmarks"),
}
"""Tables beside the measurements and their options, by the beginning of their keys."""
_OPTIONS_OF_KEYS = {
    "truth": "--truth FILE",
    "truth_gap": "--truth FILE",
    "input_file": "--input FILE",
}
"""Keys of the target that follow from the options of the command."""
_KEYS_OF_SENSOR = ("at", "sigma", "sigma_range", "sigma_azimuth_mrad", "sigma_mrad")
"""Keys of a sensor of the written config, which say nothing on how a table is read."""


@dataclass(frozen=True, kw_only=True)
class _InputKeys:
    """Keys of the target on a robot's inputs, which the user may give."""

    input_gap: Positive | None = None
    input_holds: Literal["before", "after"] | None = None


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


def answers_on_tables(
    mark: Mark, tables: Sequence[Path], changes: Sequence[str]
) -> list[TableAnswers]:
    """Read the answers on the tables of measurements, one for each sensor; return those on each table.

    ``changes`` are the user's answers, ``KEY=VALUE``. Mistakes are reported at ``mark``.
    """
    shared = _answers_on_all_files(mark, tables, changes)
    answers = []
    for number in range(len(tables)):
        prefix = prefix_of_table(number, tables)
        table_changes = list(shared)
        if prefix:
            table_changes += [c.removeprefix(prefix) for c in changes if c.startswith(prefix)]
        # A key that is set to nothing, as clockwise=[], is an answer, too.
        user_keys = {change.partition("=")[0].strip() for change in table_changes}
        naming = read_naming(mark, table_changes, prefix)
        answers.append(TableAnswers(naming=naming, user_keys=user_keys))
    return answers


def _answers_on_all_files(mark: Mark, tables: Sequence[Path], changes: Sequence[str]) -> list[str]:
    """Return the answers that count for all files of measurements, as they name none of them.

    ``changes`` are the user's answers, ``KEY=VALUE``; the key of one on a single file begins with
    ``measurement_naming`` and its number. Raises UserError for an answer that names a wrong file, or no
    file where it has to.
    """
    shared = [change for change in changes if not change.startswith(f"{FILES_KEY}.")]
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
        _check_key_of_config(mark, change.partition("=")[0].strip())
        if not change.startswith("origin="):  # all files share the origin
            options = " or ".join(
                f"--set {prefix_of_table(number, tables)}{change} for {table.name}"
                for number, table in enumerate(tables)
            )
            raise UserError(Problem(mark, change, f"which file? Say {options}"))
    prefixes = tuple(prefix_of_table(number, tables) for number in range(len(tables)))
    for change in changes:
        if change not in shared and not change.startswith(prefixes):
            message = f"files have the numbers from 0 to {len(tables) - 1}: {FILES_KEY}.0.columns"
            raise UserError(Problem(mark, change, message))


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
        key = change.partition("=")[0].strip()
        if key in _OPTIONS_OF_KEYS:
            message = f"this table has an option of its own, {_OPTIONS_OF_KEYS[key]}"
            raise UserError(Problem(mark, f"{prefix}{key}", message))
        _check_key_of_config(mark, key, prefix)
    return _build_answers(Naming, mark, changes, prefix)


def _check_key_of_config(mark: Mark, key: str, prefix: str = "") -> None:
    """Raise UserError for a key of the written config that is no answer on how a table is read.

    The user wrote the ``prefix`` before the ``key``, which may be the beginning of a path.
    """
    name = key.partition(".")[0]
    owner = ""
    if name in _KEYS_OF_SENSOR:
        owner = "a sensor"
    elif {name} <= _names_of_keys(RecordingKeys) - _names_of_keys(Naming):
        owner = "the target"
    if not owner:
        return
    message = f"is a key of {owner}: write it into the config when this command has written it"
    if name == "runs":
        message += (
            ". Guesses are those of the longest run; for those of another one give a table of it"
        )
    raise UserError(Problem(mark, f"{prefix}{key}", message))


def _names_of_keys(cls: type[Naming]) -> set[str]:
    """Return the names of a class's keys."""
    return {field.name for field in fields(cls)}


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
        raise UserError(*(with_prefix(problem, prefix) for problem in error.problems)) from None
    if answers is None:
        raise UserError(*(with_prefix(problem, prefix) for problem in source.problems))
    return answers
