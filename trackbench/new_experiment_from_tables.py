"""Write a config for recorded data, whose columns, units and sensors are guessed from the tables."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from trackbench.atomic_files import write_text
from trackbench.config.answers_by_set_option import (
    answers_on_tables,
    read_input_keys,
    read_namings,
)
from trackbench.config.experiment import Point, cautions
from trackbench.config.load import load
from trackbench.config.resolved_config import as_yaml
from trackbench.errors import Mark, Problem, UserError, counted, first_names, in_line
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.recordings.guess_files import (
    guess_tables,
    join_tables,
    settle_tables,
)
from trackbench.scenarios.recordings.guess_record import RobotTables
from trackbench.scenarios.recordings.guess_table import recognized_odometry
from trackbench.scenarios.recordings.guess_truth import recognized_truth
from trackbench.scenarios.recordings.landmark_table import check_measured_landmarks, read_landmarks
from trackbench.scenarios.recordings.new_config_filters import left_out_filters
from trackbench.scenarios.recordings.new_config_first_state import FirstState, first_state_of_robot
from trackbench.scenarios.recordings.new_config_further_tables import FurtherTables
from trackbench.scenarios.recordings.new_config_last_step import check_late_truth
from trackbench.scenarios.recordings.new_config_lines import (
    FEWEST_ROWS,
    config_parts,
    default_name,
    guessed_units,
    has_grid,
    note_on_runs,
    runs_of_grid,
)
from trackbench.scenarios.recordings.new_config_unknown_places import (
    fill_unknown_places,
    unknown_places,
)
from trackbench.scenarios.recordings.questions_with_set_options import (
    prefix_of_table,
    reporting_questions,
    with_option,
)
from trackbench.scenarios.recordings.unused_columns import (
    unexplained_columns,
    usable_quantities,
)
from trackbench.scenarios.recordings.yaml_values import quoted
from trackbench.scenarios.targets.measured import Measured
from trackbench.starting_files import filled_template, words_of_name
from trackbench.yaml_source import parse

_MOST_NAMES = 8  # that a message shows


class WrittenConfig(NamedTuple):
    """Written files, and for an experiment on recorded data what is left to the user.

    ``unknown`` are sensors whose place must be written, ``unused`` columns that are not read, and
    ``quantities`` what they may hold. ``unused_of_truth`` are columns of the truth that are not read.
    ``left_out`` says which runs are not read and which filters are comments only, and ``units`` which
    units were guessed. Options
    that name a column begin with the ``prefix``, which several files need. ``notes`` are those of the
    config, if all places of landmarks are known.
    """

    paths: Sequence[Path]
    unknown: Sequence[str] = ()
    unused: Sequence[str] = ()
    unused_of_truth: Sequence[str] = ()
    quantities: Sequence[str] = ()
    left_out: Sequence[str] = ()
    units: Sequence[str] = ()
    notes: Sequence[str] = ()
    prefix: str = ""


def write_config_for(
    data: Path,
    name: str | None,
    folder: Path,
    changes: Sequence[str] = (),
    truth: Path | None = None,
    further: Sequence[Path] = (),
    odometry: Path | None = None,
    landmarks: Path | None = None,
) -> WrittenConfig:
    """Write an experiment on recorded data with guessed columns and units; existing files stay.

    Parameters
    ----------
    data
        table of measurements
    name
        name of the experiment; None means that of the files
    folder
        folder of the written config
    changes
        answers of the user, such as ``columns.time=Zeit``: keys of the recording that need no guess.
        Those of one of several tables begin with ``measurement_naming`` and its number from 0, those of
        ``truth`` with ``truth_naming``, those of ``odometry`` with ``input_naming``, and those of
        ``landmarks`` with ``landmarks``
    truth
        table of the true path, if there is one
    further
        tables of further sensors
    odometry
        table of a robot's speeds and turn rates, if there is one
    landmarks
        table of the places of landmarks, if there is one

    Returns
    -------
    WrittenConfig
        written files, and what is left to the user

    Raises
    ------
    UserError
        for questions that the tables leave open, or with the reason why the config would not run, which
        then is not left in the folder
    """
    tables = [data, *further]
    for table in (*tables, truth, odometry, landmarks):
        if table is not None and table.is_dir():
            raise UserError(Problem(Mark(str(table), 1, 1), "", _describe_folder(table)))
    name = name or default_name(tables)
    words = words_of_name("experiment", name)
    path = folder / f"{'_'.join(words)}.yaml"
    mark = Mark(f"new experiment {name}")
    if path.exists():
        options = " ".join(f"--from {table}" for table in tables)
        way = f"remove it, or write another one: trackbench new experiment NAME {options}"
        raise UserError(Problem(mark, "", f"there is a file {path}: {way}"))
    repeated = [table for i, table in enumerate(tables) if table in tables[:i]]
    if repeated:
        raise UserError(Problem(mark, "", f"--from {repeated[0]} is there twice: leave one out"))
    # Step 1: read the given keys as those of a config, and guess the others.
    paths_of_tables = {"truth_naming.": truth, "input_naming.": odometry, "landmarks.": landmarks}
    namings, remaining = read_namings(mark, changes, paths_of_tables)
    input_changes = [
        change for change in remaining if change.startswith(("input_gap=", "input_holds="))
    ]
    input_keys = read_input_keys(mark, input_changes)
    odometry_guess = None
    places: dict[str, tuple[float, float]] = {}
    if odometry is not None:
        with reporting_questions("input_naming."):
            odometry_guess = recognized_odometry(str(odometry), namings["input_naming."])
    if landmarks is not None:
        with reporting_questions("landmarks."):
            places = read_landmarks(str(landmarks), namings["landmarks."])
    robot_tables = RobotTables(
        odometry=odometry_guess,
        landmarks=tuple(places),
        names_turn_rate="w" in namings["input_naming."].columns,
    )
    if further and not robot_tables.is_empty:
        message = (
            "--input and --landmarks are of one table of measurements, and there are several --from"
        )
        raise UserError(Problem(mark, "", message))
    remaining = [change for change in remaining if change not in input_changes]
    answers = answers_on_tables(mark, tables, remaining)
    table_guesses = guess_tables(tables, answers, robot_tables)
    guess = join_tables(tables, [each.guess for each in table_guesses])
    if input_keys and not guess.inputs:
        raise UserError(
            Problem(mark, next(iter(input_keys)), "is of a robot's inputs; leave it out")
        )
    if landmarks is not None:
        check_measured_landmarks(data, landmarks, guess, places)
    truth_guess = None
    if truth is not None:
        with reporting_questions("truth_naming."):
            truth_guess = recognized_truth(str(truth), guess, namings["truth_naming."])
    # The truth, or another table, may answer questions on a table, such as from where azimuths count.
    guess, questions = settle_tables(mark, tables, table_guesses, truth_guess)
    with reporting_questions(""):
        check_late_truth(guess, truth_guess)
    # Without a truth the config holds measurements out, and scores their predictions.
    _, rows_of_longest_run = guess.runs[0]
    if truth is None and rows_of_longest_run < FEWEST_ROWS:
        message = f"has {counted(rows_of_longest_run, 'row')} in its longest run, which are too few"
        way = f"take a recording of {FEWEST_ROWS} or more"
        raise UserError(Problem(Mark(data.name), "", f"{message}: {way}"))
    # Step 2: the template's lines for the data's columns and units.
    relative_paths = [_path_from(folder, table) for table in tables]
    relative = relative_paths[0]
    if further:
        relative = f"[{', '.join(relative_paths)}]"
    further_tables = FurtherTables(
        truth=truth_guess,
        truth_path=_path_from(folder, truth),
        odometry=odometry_guess,
        odometry_path=_path_from(folder, odometry),
        places=places,
        source_of_places="" if landmarks is None else landmarks.name,
        keys=input_keys,
    )
    marks = {"@FILE@": relative, "@SOURCE@": in_line(_joined_names(tables))}
    text = filled_template(
        "recording.yaml", words, {**marks, **config_parts(guess, further_tables)}
    )
    # Step 3: try the config, with some numbers in place of the places that the user must write.
    tried_text = text
    if unknown_places(guess, further_tables):
        origin = guess.origin
        if not origin and truth_guess is not None:
            origin = truth_guess.origin
        config = _plain_data(text)
        fill_unknown_places(config, origin)
        tried_text = as_yaml(config)
    tried_points = _try_config(path, tried_text, tables, truth)
    # From where azimuths count is asked last: other mistakes keep the truth from showing it.
    if questions:
        raise UserError(*questions)
    # Step 4: write the config. The time of the first state is known by now, and the truth there.
    first_state = _first_state(tried_points[0].scenario, further_tables)
    states_of_runs: list[FirstState | None] = []
    if guess.inputs and has_grid(guess):
        states_of_runs.append(first_state)
        for name_of_run in runs_of_grid(guess)[1:]:
            text_of_run = _with_run(tried_text, name_of_run)
            states_of_runs.append(_first_state_of_run(path, text_of_run, further_tables))
    parts = config_parts(guess, further_tables, first_state, states_of_runs)
    write_text(path, filled_template("recording.yaml", words, {**marks, **parts}))
    unknown = unknown_places(guess, further_tables, first_state)
    # Step 5: what the command reports: guessed units, and columns that are not read.
    notes = []
    # Cautions of a config with landmarks, and of tables that may contradict each other. With unknown
    # places the config was tried with other numbers, and its cautions would be about these.
    may_contradict = bool(places or further or truth is not None)
    if may_contradict and not unknown:
        notes = cautions(tried_points)
    unused: list[str] = []
    units: list[str] = []
    prefix = ""  # of the first table with unused columns
    first_with_unused = guess.each_file[0]
    for number, (file, table) in enumerate(zip(guess.each_file, tables, strict=True)):
        prefix_of_file = prefix_of_table(number, tables)
        units += guessed_units(file, prefix_of_file)
        names = unexplained_columns(file)
        if further:
            names = [f"{column} of {in_line(table.name)}" for column in names]
        if names and not unused:
            prefix = prefix_of_file
            first_with_unused = file
        unused += names
    if odometry_guess is not None:
        units += guessed_units(odometry_guess, "input_naming.")
    return WrittenConfig(
        paths=[path],
        unknown=unknown,
        unused=unused,
        unused_of_truth=[] if truth_guess is None else truth_guess.unused_columns,
        quantities=usable_quantities(first_with_unused),
        left_out=note_on_runs(guess) + left_out_filters(guess),
        units=units,
        notes=notes,
        prefix=prefix,
    )


def _describe_folder(folder: Path) -> str:
    """Describe a folder that was named in place of a table, and list its first files."""
    names = sorted(file.name for file in folder.iterdir() if file.is_file())
    if not names:
        return "is a folder; name a file with a table"
    return f"is a folder; name one of its files: {first_names(names, _MOST_NAMES)}"


def _joined_names(tables: Sequence[Path]) -> str:
    return " and ".join(table.name for table in tables)


def _try_config(path: Path, text: str, tables: Sequence[Path], truth: Path | None) -> list[Point]:
    """Write a config, load it and remove it again; return its points.

    Raises UserError for mistakes in the config, or in the tables of measurements and of the ``truth``.
    They are reported in the words of the command, since the config is not there.
    """
    write_text(path, text)
    try:
        return load(path).points
    except UserError as error:
        problems = []
        for problem in error.problems:
            reported = _reported(problem, path, _joined_names(tables))
            problems.append(with_option(reported, tables, truth))
        raise UserError(*problems) from None
    finally:
        path.unlink()


def _path_from(folder: Path, table: Path | None) -> str:
    """Write the path of a table, relative to the folder, as YAML; empty without a table."""
    if table is None:
        return ""
    return quoted(os.path.relpath(table, folder))


def _first_state(scenario: Scenario, tables: FurtherTables) -> FirstState:
    """Return the time of the filters' first state, and the pose there by the truth of a robot."""
    target = getattr(scenario, "target", None)
    # Only the recording of a robot has inputs: speeds and turn rates.
    if tables.truth is None or not isinstance(target, Measured) or not target.input:
        return FirstState(begin=float(scenario.times[0]))
    truth = target.recorded_truth
    assert truth is not None
    return first_state_of_robot(scenario.times, truth, target.known_inputs, tables.truth.gap)


def _plain_data(text: str) -> dict[str, Any]:
    """Return the plain data of a config's text, which may be changed.

    It is read by the rules of configs: a name such as "12e4" or "yes" stays a word.
    """
    data: dict[str, Any] = json.loads(json.dumps(parse(text, "config").data))
    return data


def _with_run(text: str, name: str) -> str:
    """Return a config's text that reads another run, called ``name``."""
    config = _plain_data(text)
    config["scenario"]["target"]["runs"] = [name]
    return as_yaml(config)


def _first_state_of_run(path: Path, text: str, tables: FurtherTables) -> FirstState | None:
    """Return the first state of a config that reads one run; None if it would not run.

    The config, whose ``text`` is tried, is written to ``path`` for a moment.
    """
    try:
        (point,) = _try_config(path, text, [], None)
    except UserError:
        return None  # as a run with a gap in its odometry; the config of the first run is good
    return _first_state(point.scenario, tables)


def _reported(problem: Problem | str, path: Path, data: str) -> Problem | str:
    """Report a mistake of a guessed config as one of the table, since the config is not there.

    ``path`` is that of the config, ``data`` the names of the tables.
    """
    if isinstance(problem, str):
        return problem
    if problem.mark.file != str(path):
        return problem  # a mistake in a table
    mistake = problem.message
    if problem.path:
        mistake = f"{problem.path}: {problem.message}"
    return Problem(Mark(data), "", f"a config for it would not run: {mistake}")
