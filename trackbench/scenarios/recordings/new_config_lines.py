"""Lines of a new config on its target: how the table is read, and notes for the terminal."""

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from trackbench.errors import counted, first_names
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_truth import TruthGuess
from trackbench.scenarios.recordings.new_config_filters import target_parts
from trackbench.scenarios.recordings.new_config_first_state import (
    FirstState,
    begin_in_words,
    pose_in_words,
)
from trackbench.scenarios.recordings.new_config_further_tables import FurtherTables
from trackbench.scenarios.recordings.new_config_last_step import last_line
from trackbench.scenarios.recordings.new_config_robot import input_lines, robot_parts
from trackbench.scenarios.recordings.new_config_sensors import sensor_lines
from trackbench.scenarios.recordings.new_config_tables_and_figures import table_lines
from trackbench.scenarios.recordings.new_config_unknown_places import (
    lacks_origin,
    origin_name,
)
from trackbench.scenarios.recordings.unused_columns import unused_columns, used_columns
from trackbench.scenarios.recordings.yaml_values import (
    comment_on,
    format_in_braces,
    missing_in_yaml,
    naming_in_braces,
    quoted,
)

_LABEL_COLUMNS = ("run", "sensor")
_MOST_NAMES = 7  # of further runs
_MOST_LETTERS_OF_NAME = 40
"""Letters of a name that is made of those of several files."""
FEWEST_ROWS = 3
"""rows of a run, of which one starts the filters and one is held out"""


def default_name(tables: Sequence[Path]) -> str:
    """Return the name of an experiment on files: their names, or that of the first one if too long."""
    names = [re.sub("[^A-Za-z0-9]+", "-", path.stem).strip("-") for path in tables]
    name = "-".join(names)
    if len(name) > _MOST_LETTERS_OF_NAME:
        return names[0]
    return name


def config_parts(
    guess: Guess,
    tables: FurtherTables | None = None,
    first_state: FirstState | None = None,
    states_of_runs: Sequence[FirstState | None] = (),
) -> dict[str, str]:
    """Return the parts of a config that are guessed, as lines of YAML by their mark in the template.

    A mark is a word such as @SENSOR@. ``tables`` are those beside the measurements. ``first_state`` is
    that of the filters, if a config was tried before. ``states_of_runs`` are those of all runs of a
    robot, None where a run cannot be read.
    """
    tables = tables or FurtherTables()
    truth = tables.truth
    when = begin_in_words(guess, first_state)
    parts = target_parts(guess, when)
    if guess.inputs:  # it is the log of a robot
        parts = robot_parts(guess, when, first_state)
    target_lines = [*_target_lines(guess, tables)]
    if truth is not None:
        target_lines += _truth_lines(truth, tables.truth_path)
    # Further keys of the scenario. Each line begins with its line break, and is empty if not needed.
    further_lines = _score_line(guess, truth) + _step_line(guess) + last_line(guess, truth)
    return {
        "@TARGET@": "\n".join(f"    {line}" for line in target_lines),
        "@SENSOR@": "\n".join(f"    {line}" for line in sensor_lines(guess, tables)),
        "@START@": f"  start: {parts.start}{further_lines}",
        "@ASSUME@": parts.assume,
        "@GRID@": _grid_line(guess, states_of_runs),
        "@FILTERS@": "\n".join(parts.filters),
        "@TABLES@": "\n".join(table_lines(guess, truth)),
        "@SHOWN@": parts.figure_labels,
    }


def _truth_lines(truth: TruthGuess, path: str) -> Iterator[str]:
    """Yield the lines of the target's keys of the truth, whose file is at ``path``, written as YAML."""
    yield f"truth: {path}"
    yield f"truth_naming: {naming_in_braces(truth.naming)}  # guess, from the names of its columns"
    unit = "steps" if "step" in truth.naming.columns else "s"
    yield f"truth_gap: {truth.gap:g}  # {unit}; guess: 1.5 usual intervals of its rows"


def has_grid(guess: Guess) -> bool:
    """Test whether the config gets a comment with the grid over all runs: if there are few of them."""
    # The config takes the longest run alone; the comment names at most so many others.
    return 1 < len(runs_of_grid(guess)) <= 1 + _MOST_NAMES


def runs_of_grid(guess: Guess) -> list[str]:
    """Return the names of the runs that have enough rows to be judged alone, the longest first.

    The runs of a robot have further rows, of its odometry, so that all of them count.
    """
    return [name for name, rows in guess.runs if rows >= FEWEST_ROWS or guess.inputs]


def _runs_too_short(guess: Guess) -> list[str]:
    """Return the names of the runs that have too few rows to be judged alone, as YAML."""
    judged = runs_of_grid(guess)
    return [quoted(name) for name, _ in guess.runs if name not in judged]


def _grid_line(guess: Guess, states_of_runs: Sequence[FirstState | None]) -> str:
    """Return a comment with the grid over all runs; empty for one run or very many.

    ``states_of_runs`` are the first states of a robot's runs, each of which has its own start.
    """
    if not has_grid(guess):
        return ""
    keys = "scenario.target.runs"
    values = [f"[{quoted(name)}]" for name in runs_of_grid(guess)]
    comment = "all runs, each on a clock of its own"
    short = _runs_too_short(guess)
    if short:
        names = first_names(short, _MOST_NAMES)
        comment = (
            f"runs, each on a clock of its own; without {names}: fewer than {FEWEST_ROWS} rows"
        )
    if states_of_runs:
        keys += " & scenario.start.mean"
        poses = [pose_in_words(state) for state in states_of_runs]
        times = [begin_in_words(guess, state) for state in states_of_runs]
        values = [
            f"[{value}, [{', '.join(pose)}]]" for value, pose in zip(values, poses, strict=True)
        ]
        comment += f", with its pose at {', '.join(times)}"
    return f"# grid: {{{keys}: [{', '.join(values)}]}}  # {comment}\n"


def note_on_runs(guess: Guess) -> list[str]:
    """Return a line for the terminal, in a list, if the config reads one of several runs."""
    if len(guess.runs) < 2:
        return []
    (longest, rows), *others = guess.runs
    names = first_names([quoted(name) for name, _ in others], _MOST_NAMES)
    read_rows = counted(rows, "row")
    if guess.inputs:
        read_rows += " with measurements"  # the log of a robot has further rows, of its odometry
    line = f"read run {quoted(longest)} ({read_rows}), the longest of {len(guess.runs)}"
    return [f"{line}; to read {names}, too, change `runs` in the config"]


def _score_line(guess: Guess, truth: TruthGuess | None) -> str:
    """Return the line of the key `score` if a truth has positions alone; else an empty text.

    A robot has another key `score`, which `robot_parts` writes.
    """
    if truth is None or truth.has_velocity or guess.inputs:
        return ""
    return (
        "\n  score: {marginals: [position]}  # adds anees_position, as the truth has no velocities"
    )


def _step_line(guess: Guess) -> str:
    """Return the line of the key `T`, s, if the table has numbers of steps and no times; else empty."""
    if "step" not in guess.naming.columns or "time" in guess.naming.columns:
        return ""
    return "\n  T: 1  # s from step to step: write yours; speeds and q were guessed for 1 s"


def guessed_units(guess: Guess, prefix: str = "") -> list[str]:
    """Return lines for the terminal on guesses of one file that the user should check.

    They are units of ranges and angles that stand in no name, azimuths that count from north because of
    their numbers, rows of several targets that are mixed, and velocities that are left out. Options for
    other answers set keys that begin with the ``prefix``, such as "input_naming.".
    """
    lines = []
    for name in ("range", "azimuth", "bearing", "v", "w"):
        reason = guess.reasons.get(name, "")
        # The reason for a guess is a text such as "guess: there are angles beyond 2 pi".
        if name in guess.naming.units and reason.startswith("guess"):
            column = quoted(guess.naming.columns[name])
            unit = guess.naming.units[name]
            _, _, explanation = reason.partition(": ")
            way = f"another unit: --set {prefix}units.{name}=UNIT"
            lines.append(f"read {column} in {unit} ({explanation}); {way}")
    ranges = [name for name in guess.naming.columns if name.endswith(".range")]
    if ranges:
        columns = [quoted(guess.naming.columns[name]) for name in ranges]
        way = f"to read one alone: --set '{prefix}columns.range=ITS NAME'"
        lines.append(f"read {', '.join(columns)} as ranges to {len(ranges)} places; {way}")
    if guess.reasons.get("clockwise", "").startswith("guess"):
        column = quoted(guess.naming.columns["azimuth"])
        reading = f"read {column} clockwise from north (from 0 to 360 deg, as of radars)"
        lines.append(f"{reading}; from x to y: --set '{prefix}clockwise=[]'")
    lines += [guess.reasons[key] for key in ("mixed", "velocity") if key in guess.reasons]
    return lines


def _target_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield the lines of the target's keys that say how the table is read, with reasons as comments."""
    truth = tables.truth
    naming = guess.naming
    reasons = guess.reasons
    columns = used_columns(guess)
    if guess.files:
        yield "measurement_naming:  # of each file, in their order"
        for file in guess.files:
            first_line, *further_lines = _naming_lines(file, tables)
            yield f"  - {first_line}"
            yield from (f"    {line}" for line in further_lines)
    else:
        yield from _naming_lines(guess, tables)
    if columns.get("sensor"):
        yield f"sensors: [{', '.join(quoted(sensor.name) for sensor in guess.sensors)}]"
    if naming.origin:
        yield f"origin: [{', '.join(map(repr, naming.origin))}]"
    elif lacks_origin(guess, truth):
        where = "x = y = 0 of the sensors"
        if origin_name(guess) == "the radar":
            where = "the radar, x = y = 0,"
        yield f"origin: [LATITUDE, LONGITUDE]  # write where {where} is, deg"
    elif any("latitude" in used_columns(file) for file in guess.each_file):
        yield "# x and y are meters east and north of the first position, or of `origin: [lat, lon]`"
    if "velocity" in reasons:
        yield f"# {reasons['velocity']}"
    if len(guess.runs) > 1:
        (longest, _), *others = guess.runs
        names = first_names([quoted(name) for name, _ in others], _MOST_NAMES)
        yield f"runs: [{quoted(longest)}]  # the longest of {len(guess.runs)}; there are {names}"


def _naming_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield the lines of a file's columns, units and format, with the reasons as comments."""
    naming = guess.naming
    reasons = guess.reasons
    columns = used_columns(guess)
    yield "columns:  # guess, from their names"
    for name, column in columns.items():
        if name in guess.inputs:
            continue
        line = f"  {name}: {quoted(column)}"
        # The reasons for other columns are those of their units, and stand beside these.
        if name in _LABEL_COLUMNS:
            line += comment_on(reasons, name)
        # An empty name of runs or sensors mixes their rows.
        if not column:
            line += comment_on(reasons, "mixed")
        if name == "time":
            line += comment_on(reasons, "time_column")
        if name == "latitude":
            line += comment_on(reasons, "degrees")
        # If the columns of vx and vy were exchanged, this is said once.
        if name == "vy":
            line += comment_on(reasons, "exchanged")
        yield line
    unused = unused_columns(guess)
    if unused:
        yield f"  # not used: {', '.join(unused)}"
    # Only a robot has inputs: its speed and turn rate, which move a position and a heading.
    if guess.inputs:
        yield from input_lines(guess, tables)
        yield "state: [px, py, heading]"
        yield "angles: [heading]"
    units = {name: unit for name, unit in naming.units.items() if name in columns}
    if units:
        yield "units:"
        yield from (f"  {name}: {unit}{comment_on(reasons, name)}" for name, unit in units.items())
    if naming.format is not None:
        yield f"format: {format_in_braces(naming.format)}{comment_on(reasons, 'format')}"
    if naming.time_format:
        yield f"time_format: {json.dumps(naming.time_format)}{comment_on(reasons, 'time_format')}"
    if naming.zone:
        yield f"zone: {quoted(naming.zone)}"
    if naming.missing is not None:
        yield f"missing: {missing_in_yaml(naming)}{comment_on(reasons, 'missing')}"
    if naming.clockwise and not columns.keys().isdisjoint(("azimuth", "bearing")):
        yield f"clockwise: [{', '.join(naming.clockwise)}]{comment_on(reasons, 'clockwise')}"
    elif "azimuth" in columns and "anticlockwise" in reasons:
        yield f"# {reasons['anticlockwise']}"
    if naming.same_time is not None:
        yield f"same_time: {naming.same_time}{comment_on(reasons, 'same_time')}"
