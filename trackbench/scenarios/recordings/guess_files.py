"""Guess several tables, one for each sensor, and join them: open questions, noise and config."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.errors import Mark, Problem, UserError, first_names, in_line
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_azimuths import with_azimuths_by_positions
from trackbench.scenarios.recordings.guess_process_noise import joined_process_noise
from trackbench.scenarios.recordings.guess_record import Guess, RobotTables, TableAnswers, Track
from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.guess_time_format import check_order_of_days
from trackbench.scenarios.recordings.guess_truth import TruthGuess
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import joined_speed
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import COURSE
from trackbench.scenarios.recordings.questions_with_set_options import (
    as_questions,
    prefix_of_table,
    problem_at,
)
from trackbench.scenarios.recordings.rows_and_reading_context import ONE_RUN
from trackbench.scenarios.recordings.unused_columns import idle_keys, why_idle

_VELOCITIES = ("vx", "vy", *COURSE)
_MOST_NAMES = 8


class TableGuess(NamedTuple):
    """Guess at one table, and what the user said of it."""

    guess: Guess
    answers: TableAnswers


def guess_tables(
    tables: Sequence[Path], answers: Sequence[TableAnswers], robot_tables: RobotTables
) -> list[TableGuess]:
    """Guess the columns and units of the tables, one for each sensor.

    Keys that the user set in the ``answers`` on each table are not guessed. ``robot_tables`` are the
    tables of a robot's odometry and landmarks; with them the ``tables`` are recognized as a robot's
    measurements. Raises UserError with all questions.
    """
    guesses = []
    problems: list[Problem | str] = []
    for number, table in enumerate(tables):
        table_answers = answers[number]
        try:
            # Absurdly large numbers overflow; the run of the config then says so.
            with np.errstate(over="ignore", invalid="ignore"):
                guess = recognized(
                    str(table), table_answers.naming, table_answers.user_keys, robot_tables
                )
        except DataError as error:
            problems += as_questions(error, prefix_of_table(number, tables)).problems
            continue
        guesses.append(TableGuess(guess=guess, answers=table_answers))
    if problems:
        raise UserError(*problems)
    return guesses


def settle_tables(
    mark: Mark,
    tables: Sequence[Path],
    table_guesses: Sequence[TableGuess],
    truth: TruthGuess | None,
) -> tuple[Guess, list[Problem | str]]:
    """Return the guess at all tables, and the questions that neither the truth nor a table answers.

    ``table_guesses`` are those at the ``tables``, in their order. ``truth`` is the guess at the table of
    the true path, None without one. The questions are from where azimuths count. They come after all
    other mistakes, of which some, such as clocks without a common time, keep the truth from answering
    them. Raises UserError for such a mistake, and, at ``mark``, for keys that the config would not read.
    """
    settled_guesses = []
    problems: list[Problem | str] = []
    questions: list[Problem | str] = []
    for number, table_guess in enumerate(table_guesses):
        prefix = prefix_of_table(number, tables)
        others = [each.guess for i, each in enumerate(table_guesses) if i != number]
        try:
            guess = settled(table_guess.guess, truth, table_guess.answers.user_keys, others)
        except DataError as error:
            problems += as_questions(error, prefix).problems
            continue
        settled_guesses.append(guess)
        if guess.questions:
            questions += as_questions(DataError(*guess.questions), prefix).problems
        # Quantities whose columns the user names, and that the config would not read.
        idle_quantities = idle_keys(guess, table_guess.answers.naming.columns)
        if idle_quantities:
            message = why_idle(guess, idle_quantities[0])
            problems.append(Problem(mark, f"{prefix}columns.{idle_quantities[0]}", message))
    if problems:
        raise UserError(*problems, *questions)
    return join_tables(tables, settled_guesses), questions


def join_tables(tables: Sequence[Path], guesses: Sequence[Guess]) -> Guess:
    """Join the guesses at the tables, which are in the same order; raises UserError if they conflict."""
    if len(tables) == 1:
        return guesses[0]
    try:
        return _joined_guess([str(table) for table in tables], guesses)
    except DataError as error:
        raise UserError(*map(problem_at, error.places)) from None


def _joined_guess(paths: Sequence[str], guesses: Sequence[Guess]) -> Guess:
    """Return the guess at a recording whose files, one for each sensor, are at ``paths``.

    ``guesses`` are those at the single files. Raises DataError for a file of several sensors, the log of
    a robot, and files with different runs.
    """
    files = [_of_one_sensor(path, guess) for path, guess in zip(paths, guesses, strict=True)]
    # Files of one run each may give it different names.
    if all(len(file.runs) == 1 for file in files):
        files = [_without_name_of_run(file) for file in files]
    _check_runs(paths, files)
    rows: Counter[str] = Counter()
    for file in files:
        rows.update(dict(file.runs))
    first = files[0]
    # Each file's own guess has its columns; those of the clock show whether times or steps are counted.
    clock: dict[str, str] = {}
    for key in ("time", "step"):
        if key in first.naming.columns:
            clock[key] = first.naming.columns[key]
    speed = joined_speed([file.speed for file in files])
    # There may be a step at each row of any file, so that their numbers are added. The fastest sensor
    # gives the interval, and the file with most outliers decides on gates.
    return Guess(
        naming=Naming(columns=clock, origin=first.naming.origin),
        reasons={},
        runs=rows.most_common(),
        sensors=[file.sensors[0] for file in files],
        speed=speed,
        process_noise=joined_process_noise([file.process_noise for file in files], speed),
        names=first.names,
        steps=sum(file.steps for file in files),
        interval=min(file.interval for file in files),
        origin=next((file.origin for file in files if file.origin), ()),
        is_dated=first.is_dated,
        outliers=max(file.outliers for file in files),
        files=tuple(files),
    )


def _of_one_sensor(path: str, guess: Guess) -> Guess:
    """Return the guess at one of several files, whose sensor gets the name of the file.

    Velocities beside positions would be measured by a second sensor, and are left out. Raises DataError
    for the log of a robot and for a file of several sensors.
    """
    name = Path(path).stem
    if guess.inputs:
        message = "is the log of a robot, which is alone in a config that is written"
        remedy = "write the config for it, and add the further files to its `measurements`"
        raise DataError(Place(path, 1, 1, f"{message}: {remedy} (docs/your-robot.md)"))
    if len(guess.sensors) > 1:
        names = first_names([sensor.name for sensor in guess.sensors], _MOST_NAMES)
        message = f"has {len(guess.sensors)} sensors ({names}), and each of several files is of one"
        raise DataError(Place(path, 1, 1, f"{message}: write a file for each sensor"))
    columns = {key: c for key, c in guess.naming.columns.items() if key not in _VELOCITIES}
    columns.pop("sensor", None)
    sensor = guess.sensors[0]._replace(name=name)
    reasons = {key: reason for key, reason in guess.reasons.items() if key != "velocity"}
    naming = replace(guess.naming, columns=columns)
    return replace(guess, naming=naming, reasons=reasons, sensors=[sensor])


def _without_name_of_run(guess: Guess) -> Guess:
    """Return the guess at a file of one run, without the name of the run.

    The files may give their only run different names, and it is the same run.
    """
    columns = dict(guess.naming.columns)
    # An empty name says that all rows are one run. Without the key a column that is called run, or one
    # such as MMSI, would be taken for the names of runs. It is put last.
    if columns.pop("run", None) is not None:
        columns["run"] = ""
    rows = sum(number for _, number in guess.runs)
    return replace(guess, naming=replace(guess.naming, columns=columns), runs=[(ONE_RUN, rows)])


def _check_runs(paths: Sequence[str], files: Sequence[Guess]) -> None:
    """Raise DataError if no run is in all ``files``, the guesses at the files at ``paths``."""
    names = [{name for name, _ in file.runs} for file in files]
    if set.intersection(*names):
        return
    message = []
    for path, file in zip(paths, files, strict=True):
        runs = first_names([name for name, _ in file.runs], _MOST_NAMES)
        message.append(f"{Path(path).name} has {runs}")
    remedy = "no run is in all files: name each run alike in all of them"
    raise DataError(Place(paths[0], 1, 1, f"{'; '.join(message)}; {remedy}"))


def settled(
    guess: Guess,
    truth: TruthGuess | None,
    user_keys: Collection[str] = (),
    others: Sequence[Guess] = (),
) -> Guess:
    """Return the guess at measurements, with open questions answered by the truth or another file.

    A question may be from where azimuths count, which their positions can show. ``user_keys`` are the
    keys that the user set, ``others`` the guesses at further files of the recording. Raises DataError if
    two files may have the day and the month in different orders.
    """
    # Step 1: compare the order of day and month with that of the other files.
    namings = [other.naming for other in others]
    if truth is not None:
        namings.append(truth.naming)
    check_order_of_days(guess.path, guess, namings)
    # Step 2: take the positions of the truth, or of another file, that decide from where azimuths count.
    # The user's key `clockwise`, even if it is empty, says it: angles in it count from north, clockwise,
    # and others from x to y. Of the reasons for a guess those that begin with "as" are sure.
    is_known = "clockwise" in user_keys or guess.reasons.get("clockwise", "").startswith("as ")
    tracks: list[tuple[Track | None, str]] = []
    if truth is not None:
        tracks.append((truth.positions, "the truth shows"))
    for other in others:
        tracks.append((other.positions, f"the positions of {in_line(Path(other.path).name)} show"))
    for track, reason in tracks:
        if is_known or track is None:
            continue
        decided = with_azimuths_by_positions(guess, track, reason)
        if decided is not None:
            guess = decided
            break
    return guess
