"""A config that runs, from the guess at a recording."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from trackbench.durations import time_text
from trackbench.errors import counted, in_line
from trackbench.field_types import MOST_STEPS, DataError, Place
from trackbench.scenarios.recordings.guess_process_noise import usual_process_noise
from trackbench.scenarios.recordings.guess_record import Guess, SensorGuess
from trackbench.scenarios.recordings.guess_truth import TruthGuess
from trackbench.scenarios.recordings.label_spelling import plain_label
from trackbench.scenarios.recordings.quantities import STAMP_PARTS
from trackbench.scenarios.recordings.recording_keys import Naming
from trackbench.scenarios.recordings.yaml_values import (
    comment_on,
    format_in_braces,
    missing_in_yaml,
    quoted,
)

_LOCATING = {"position", "range-azimuth"}
"""Types of sensors by which a filter can start."""
_LABEL_COLUMNS = ("run", "sensor")
_MOST_NAMES = 7  # of further runs
_MOST_LETTERS_OF_NAME = 40
"""Letters of a name that is made of those of several files."""
_LEAST_OUTLIERS = 0.005  # share of the rows from which on a filter with a gate is written
_LAST = 20_000  # step of a long recording, which all filters reach within minutes
_MOST_PARTICLE_STEPS = 20_000  # beyond which a particle filter takes longer than all other filters
_POSE = ("X", "Y", "HEADING")
"""Words for the unknown numbers of a pose, which the user must write."""
_WHY_NO_PARTICLES = "1000 particles take longer over so many steps than all other filters together"


@dataclass(frozen=True)
class FurtherTables:
    """Tables beside that of the measurements, and keys of the target that the user gave."""

    truth: TruthGuess | None = None
    """guess at the table of the true path"""
    truth_path: str = ""
    """its path from the config, as YAML"""
    odometry: Guess | None = None
    """guess at the table of a robot's inputs"""
    odometry_path: str = ""
    """its path from the config, as YAML"""
    places: dict[str, tuple[float, float]] = field(default_factory=dict)
    """places of landmarks, m, by their plain labels"""
    source_of_places: str = ""
    """name of their file"""
    keys: dict[str, str] = field(default_factory=dict)
    """keys of the target on its inputs, such as input_gap, as YAML"""

    def place_of(self, name: str) -> tuple[float, float] | None:
        """Return the place of a landmark, that of the only one if it has no name; None if unknown."""
        if not name and len(self.places) == 1:
            return next(iter(self.places.values()))
        return self.places.get(plain_label(name))


class FirstState(NamedTuple):
    """Time and pose of the first state of filters, as a tried config has them."""

    begin: float
    """its time, s or steps"""
    pose: tuple[float, ...] = ()
    """x, y and heading there by the truth, NaN where the truth lacks one; empty without a truth"""
    later: float = 0.0
    """time by which the truth's pose is later, s or steps"""


def default_name(tables: Sequence[Path]) -> str:
    """Return the name of an experiment on files: their names, or that of the first one if too long."""
    names = [re.sub("[^A-Za-z0-9]+", "-", path.stem).strip("-") for path in tables]
    name = "-".join(names)
    if len(name) > _MOST_LETTERS_OF_NAME:
        return names[0]
    return name


def config_parts(
    guess: Guess, tables: FurtherTables | None = None, first_state: FirstState | None = None
) -> dict[str, str]:
    """Return the parts of a config that are guessed, as lines of YAML by their mark in the template.

    A mark is a word such as @SENSOR@. ``tables`` are those beside the measurements. ``first_state`` is
    that of the filters, if a config was tried before.
    """
    tables = tables or FurtherTables()
    truth = tables.truth
    when = _begin_in_words(guess, first_state)
    parts = _target_parts(guess, when)
    if guess.inputs:  # it is the log of a robot
        parts = _robot_parts(guess, when, first_state)
    target_lines = [*_target_lines(guess, tables)]
    if truth is not None:
        target_lines += _truth_lines(truth, tables.truth_path)
    further_lines = _score_line(guess, truth) + _step_line(guess) + _last_line(guess, truth)
    return {
        "@TARGET@": "\n".join(f"    {line}" for line in target_lines),
        "@SENSOR@": "\n".join(f"    {line}" for line in _sensor_lines(guess, tables)),
        "@START@": f"  start: {parts.start}{further_lines}",
        "@ASSUME@": parts.assume,
        "@GRID@": _grid_line(guess),
        "@FILTERS@": "\n".join(parts.filters),
        "@TABLES@": "\n".join(_table_lines(guess, truth)),
        "@SHOWN@": parts.figure_labels,
    }


def _score_line(guess: Guess, truth: TruthGuess | None) -> str:
    """Return the line of the key `score` if a truth has positions alone; else an empty text.

    A robot has another key `score`, which `_robot_parts` writes.
    """
    if truth is None or truth.has_velocity or guess.inputs:
        return ""
    return (
        "\n  score: {marginals: [position]}  # adds anees_position, as the truth has no velocities"
    )


def _truth_lines(truth: TruthGuess, path: str) -> Iterator[str]:
    """Yield the lines of the target's keys of the truth, whose file is at ``path``, written as YAML."""
    yield f"truth: {path}"
    yield f"truth_naming: {_naming_in_braces(truth.naming)}  # guess, from the names of its columns"
    unit = "steps" if "step" in truth.naming.columns else "s"
    yield f"truth_gap: {truth.gap:g}  # {unit}; guess: 1.5 usual intervals of its rows"


def _naming_in_braces(naming: Naming) -> str:
    """Return the names and units of a file's columns, and its formats, as YAML in braces."""
    keys = []
    for name in ("columns", "units"):
        entries = getattr(naming, name)
        if entries:
            pairs = ", ".join(f"{key}: {quoted(value)}" for key, value in entries.items())
            keys.append(f"{name}: {{{pairs}}}")
    if naming.format is not None:
        keys.append(f"format: {format_in_braces(naming.format)}")
    if naming.time_format:
        keys.append(f"time_format: {json.dumps(naming.time_format)}")
    if naming.zone:
        keys.append(f"zone: {quoted(naming.zone)}")
    if naming.missing:
        keys.append(f"missing: {missing_in_yaml(naming)}")
    if naming.clockwise:
        keys.append(f"clockwise: [{', '.join(naming.clockwise)}]")
    if naming.same_time is not None:
        keys.append(f"same_time: {naming.same_time}")
    return f"{{{', '.join(keys)}}}"


def _input_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield the lines of the target's keys of a robot's inputs.

    The inputs are in the table of odometry, or in that of the measurements if there is no other.
    """
    odometry = tables.odometry
    columns = guess.naming.columns
    if odometry is not None:
        yield f"input_file: {tables.odometry_path}"
        columns = odometry.naming.columns
    inputs = ", ".join(f"{name}: {quoted(columns[name])}" for name in guess.inputs)
    yield f"input: {{{inputs}}}  # guess, from their names: speed and turn rate, anticlockwise"
    if odometry is not None:
        others = {name: column for name, column in columns.items() if name not in guess.inputs}
        naming = replace(odometry.naming, columns=others)
        yield f"input_naming: {_naming_in_braces(naming)}  # guess, from the names of its columns"
    if "input_holds" not in tables.keys:
        yield "# a row's v and w hold since the row before; of commands write `input_holds: after`"
    for key, value in tables.keys.items():
        yield f"{key}: {value}"


def _grid_line(guess: Guess) -> str:
    """Return a comment with the grid over all runs; empty for one run or very many."""
    names = [quoted(name) for name, _ in guess.runs]
    # The config takes the longest run alone; the comment names at most so many others.
    if not 1 < len(names) <= 1 + _MOST_NAMES:
        return ""
    values = ", ".join(f"[{name}]" for name in names)
    comment = "all runs, each on a clock of its own"
    return f"# grid: {{scenario.target.runs: [{values}]}}  # {comment}\n"


def _table_lines(guess: Guess, truth: TruthGuess | None) -> Iterator[str]:
    """Yield the lines of the tables: of errors if there is a truth, and of predictions.

    Without a truth the line of the key `hold_out` comes first.
    """
    if truth is None:
        # Every fifth measurement, and up to every second one of a very short run.
        _, rows_of_longest_run = guess.runs[0]
        every = max(2, min(5, rows_of_longest_run // 2))
        comment = "every n-th measurement is not given to the filters, and predicted instead"
        yield f"hold_out: {every}  # {comment}; without this key leave out the column Held out"
    yield "tables:"
    held = ""  # column of the measurements that the key `hold_out` keeps from the filters
    scores = "log score (higher is better); squared innovations (1 is right)"
    if truth is None:
        held = "Held out: mean(held_log_score), "
        scores = "log score (higher is better), of what is held out, too;"
        scores += " squared innovations (1 is right)"
    else:
        columns = "RMSE: rms(rmse_position), Largest: mean(peak_position)"
        title = "Errors of the position, m"
        if guess.inputs:  # of a robot
            columns = "Position: rms(rmse_position), Heading: rms(rmse_heading), ANEES: anees"
            title = "Errors, m and rad"
        elif truth.has_velocity:
            columns += ", ANEES: anees"
        else:
            columns += ", ANEES: anees_position"
        yield "  errors:"
        yield "    kind: metrics"
        yield f"    title: {title}"
        yield f"    columns: {{{columns}}}"
    yield "  prediction:"
    yield "    kind: metrics"
    yield f'    title: "Prediction: {scores}"'
    yield f"    columns: {{Log score: mean(log_score), {held}Innovations: mean(anis)}}"
    if guess.inputs:
        yield "  innovations: {kind: innovations}  # errors of predicted ranges and bearings"


class _ModelParts(NamedTuple):
    """Parts of a config that depend on whether a target is tracked or a robot locates itself."""

    start: str
    """value of the key `start`, with a comment; after it any further keys of the scenario"""
    assume: str
    """value of the key `assume`, the motion that the filters assume, with a comment"""
    filters: list[str]
    """a line for each filter"""
    figure_labels: str
    """labels of the filters in the figures"""


def _begin_in_words(guess: Guess, first_state: FirstState | None) -> str:
    """Return words for the time of the first state, such as "t = 3 s", which follow "at"."""
    if first_state is None:
        return "the start"
    begin = first_state.begin
    if "step" in guess.naming.columns:
        return f"step {begin:g}"
    if guess.is_dated:
        if begin == 0.0:
            return "the first row"
        return f"the first row, {begin:+.6g} s"
    return f"t = {time_text(begin)} s"


def _target_parts(guess: Guess, when: str) -> _ModelParts:
    """Return the start, model and filters of a target that is tracked.

    ``when`` has words for the time of the first state, for a comment.
    """
    kinds = {sensor.kind for sensor in guess.sensors}
    speed = guess.speed
    start = f"{{kind: one-scan, sigma_velocity: {2 * speed:g}}}  # guess"
    if not kinds & _LOCATING:
        start = (
            f"{{kind: given, mean: [X, 0, Y, 0], sigma: [100, {2 * speed:g}, 100, {2 * speed:g}]}}"
        )
        start += f"  # write x and y at {when}, m, and how well they are known"
    # Process noise of the usual speed, or the one that the rows show, if it is not 0. The IMM's motions
    # have a tenth and ten times as much.
    q = usual_process_noise(speed)
    reason = "the velocity wanders by 5 % of the usual speed in a second"
    if guess.process_noise:
        reason = (
            f"squared innovations are about 1 over the recording; for straight motion try {q:g}"
        )
        if guess.process_noise < q:
            reason = f"with {q:g} squared innovations are far below 1 over the recording"
        q = guess.process_noise
    motions = f"[{{kind: cwna, q: {q / 10:g}}}, {{kind: cwna, q: {q * 10:g}}}]"
    chances = "[[0.95, 0.05], [0.05, 0.95]]"
    assume = f" {{motion: {{kind: cwna, q: {q:g}}}{_late_key(guess)}}}"
    assume += f"  # guess: {reason}"
    filter_kinds = ["kf"] if kinds == {"position"} else ["ekf", "ukf"]
    gated_filter_lines = _gated_filter_lines(guess, filter_kinds[0])
    robust_filter_lines = _robust_filter_lines(guess, filter_kinds[0])
    return _ModelParts(
        start=start,
        assume=assume,
        filters=[
            *[f"  {kind.upper()}: {{kind: {kind}}}" for kind in filter_kinds],
            *gated_filter_lines,
            *robust_filter_lines,
            f"  IMM: {{kind: imm, motions: {motions}, transition: {chances}}}",
            _particle_filter_line(guess),
        ],
        figure_labels=", ".join(
            [
                filter_kinds[0].upper(),
                *map(_label_in_line, gated_filter_lines + robust_filter_lines),
                "IMM",
            ]
        ),
    )


def _robot_parts(guess: Guess, when: str, first_state: FirstState | None) -> _ModelParts:
    """Return the start, model and filters of a robot that locates itself by landmarks.

    It starts at the truth's pose if ``first_state`` has one. ``when`` has words for the time of the
    first state, for a comment. The start comes with the scenario's key `score`, as only a robot's
    heading is scored apart from its position.
    """
    mean = _pose_in_words(first_state)
    start = f"{{kind: given, mean: [{', '.join(mean)}], sigma: [0.1, 0.1, 0.1]}}"
    missing = _unknown_words(mean)
    if len(missing) == len(_POSE):
        start += f"  # write the pose at {when}, m and rad, and how well it is known"
    elif first_state is not None:
        pose = f"the truth's pose at {when}"
        if first_state.later > 0.0:
            pose = f"the truth's pose {first_state.later:.3g} s after {when}"
        start += f"  # {pose}, m and rad; sigma: guess"
        if missing:
            start += f"; write the {' and '.join(missing)}, which the truth lacks"
    start += "\n  score: {errors: {position: [px, py], heading: [heading]}}  # with a `truth`"
    gated_filter_lines = _gated_filter_lines(guess, "ekf")
    return _ModelParts(
        start=start,
        assume=_robot_assumption(guess.inputs, _late_key(guess)),
        filters=[
            "  EKF: {kind: ekf}",
            "  UKF: {kind: ukf}",
            *gated_filter_lines,
            _particle_filter_line(guess),
            "  Odometry: {kind: prior-mean}  # without the landmarks",
        ],
        figure_labels=", ".join(["EKF", *map(_label_in_line, gated_filter_lines), "Odometry"]),
    )


def _label_in_line(filter_line: str) -> str:
    """Return the label of the filter in a line of the config: KF of "  KF: {kind: kf}"."""
    return filter_line.partition(":")[0].strip()


def _pose_in_words(first_state: FirstState | None) -> list[str]:
    """Return x, y and heading of the first state as texts: a word such as X if one is unknown."""
    words = list(_POSE)
    pose = () if first_state is None else first_state.pose
    for i, value in enumerate(pose):
        if math.isfinite(value):
            words[i] = f"{round(value, 4):g}"
    return words


def _unknown_words(pose: list[str]) -> list[str]:
    """Return the words for unknown numbers of a ``pose``, such as HEADING, in small letters."""
    return [word.lower() for word in pose if word in _POSE]


def _gated_filter_lines(guess: Guess, kind: str) -> list[str]:
    """Return the line, in a list, of a filter with a gate, which rejects outliers.

    The list is empty if the recording seems to have none. ``kind`` is the type of the filter.
    """
    if guess.outliers < _LEAST_OUTLIERS:
        return []
    percent = float(f"{100.0 * guess.outliers:.1g}")
    reason = f"some {percent:g} % of the rows are far from the line between their neighbors"
    keys = f"kind: {kind}, gate: 0.999"
    # The sensors of several files, and landmarks, get a gate each.
    if guess.files or (guess.inputs and len(guess.sensors) > 1):
        keys += ", gate_by: sensor"
    return [f"  {kind.upper()} with gate: {{{keys}}}  # guess: {reason}"]


def _robust_filter_lines(guess: Guess, kind: str) -> list[str]:
    """Return the line, in a list, of a filter with a Student t likelihood, which weighs outliers less.

    The list is empty if the recording seems to have none. ``kind`` is the type of the filter.
    """
    if guess.outliers < _LEAST_OUTLIERS:
        return []
    robust = "{kind: student-t, df: 4}"
    reason = "weighs such rows less; a gate may also reject the target in a maneuver, and lose it"
    return [f"  {kind.upper()} with Student t: {{kind: {kind}, robust: {robust}}}  # {reason}"]


def _late_key(guess: Guess) -> str:
    """Return ", late: refilter" for the mapping `assume` if a column has the times of arrival; else "".

    With this key measurements that arrive late are filtered at their own time.
    """
    if not any("received" in file.naming.columns for file in guess.each_file):
        return ""
    return ", late: refilter"


def _robot_assumption(sigmas: Mapping[str, float], late: str) -> str:
    """Return the value of the key `assume` for a robot: its motion by the odometry, as YAML.

    ``sigmas`` are the standard deviations of the speed v and the turn rate w. ``late`` is the key from
    `_late_key`, or empty.
    """
    deviations = ", ".join(f"s{name}: {sigma:g}" for name, sigma in sigmas.items())
    late_line = ""
    if late:
        late_line = f"\n    {late.removeprefix(', ')}"
    return (
        f"""
    motion:  # a step along the heading, by the speed v and the turn rate w since the step before
      kind: map
      components: [px, py, heading]
      input: [v, w]
      parameters: {{{deviations}}}  # guess: errors of v and w, from the line between their neighbors
      where: {{c: cos(heading + w*T/2), s: sin(heading + w*T/2)}}
      next: {{px: px + v*T*c, py: py + v*T*s, heading: heading + w*T}}
      Q: [[(sv*T*c)**2, (sv*T)**2*c*s, 0], [(sv*T)**2*c*s, (sv*T*s)**2, 0], [0, 0, (sw*T)**2]]
    """.rstrip()
        + late_line
    )


def _particle_filter_kind(guess: Guess) -> str:
    """Return the type of the particle filter: that of a robot is not regularized."""
    return "pf" if guess.inputs else "rpf"


def _particle_filter_line(guess: Guess) -> str:
    """Return the line of the particle filter, which is a comment for a recording of very many steps."""
    kind = _particle_filter_kind(guess)
    particle_filter = f"{kind.upper()}: {{kind: {kind}, N: 1000}}"
    if _leaves_out_particles(guess):
        return f"  # {particle_filter}  # left out: {_WHY_NO_PARTICLES}"
    return f"  {particle_filter}"


def _leaves_out_particles(guess: Guess) -> bool:
    """Test whether a recording is so long that the particle filter is only a comment in the config.

    A recording that is longer than a scenario may be is cut, and keeps its particle filter.
    """
    runs_to_its_end = guess.steps <= MOST_STEPS
    return runs_to_its_end and guess.steps > _MOST_PARTICLE_STEPS


def left_out_filters(guess: Guess) -> list[str]:
    """Return a line on each filter that is only a comment in the config, with the reason."""
    if not _leaves_out_particles(guess):
        return []
    name = _particle_filter_kind(guess).upper()
    return [f"{name} is a comment in the config: {_WHY_NO_PARTICLES} ({guess.steps} steps)"]


def note_on_runs(guess: Guess) -> list[str]:
    """Return a line for the terminal, in a list, if the config reads one of several runs."""
    if len(guess.runs) < 2:
        return []
    (longest, rows), *others = guess.runs
    names = ", ".join(quoted(name) for name, _ in others[:_MOST_NAMES])
    if len(others) > _MOST_NAMES:
        names += f" and {len(others) - _MOST_NAMES} more"
    line = f"read run {quoted(longest)} ({counted(rows, 'row')}), the longest of {len(guess.runs)}"
    return [f"{line}; to read {names}, too, change `runs` in the config"]


def _step_line(guess: Guess) -> str:
    """Return the line of the key `T`, s, if the table has numbers of steps and no times; else empty."""
    if "step" not in guess.naming.columns or "time" in guess.naming.columns:
        return ""
    return "\n  T: 1  # s from step to step: write yours; speeds and q were guessed for 1 s"


def _last_line(guess: Guess, truth: TruthGuess | None) -> str:
    """Return the line of the key `last`, the last step, if the recording has too many; else empty.

    It is so late that a truth which begins late has many steps, too.
    """
    if guess.steps <= MOST_STEPS:
        return ""
    last = min(steps_before_truth(guess, truth) + _LAST, MOST_STEPS)
    many = f"of {guess.steps} steps, of which {MOST_STEPS} are possible; or say `resample`"
    return f"\n  last: {last}  # {many}"


def steps_before_truth(guess: Guess, truth: TruthGuess | None) -> int:
    """Return about how many steps of the longest run come before its truth; 0 without a truth.

    They are counted by the rows of the first sensor with positions or ranges and azimuths, if its times
    and those of the truth count from one moment.
    """
    track = guess.positions or guess.radar
    if truth is None or truth.positions is None or track is None:
        return 0
    if track.is_dated != truth.positions.is_dated:
        return 0
    begin = float(track.time.min())
    later = truth.positions.time[truth.positions.time >= begin]
    if not len(later):
        return 0
    share = float((track.time < later.min()).mean())
    return int(share * guess.steps)


def check_late_truth(guess: Guess, truth: TruthGuess | None) -> None:
    """Raise DataError if the truth begins after so many steps that a scenario would end before."""
    before = steps_before_truth(guess, truth)
    if guess.steps <= MOST_STEPS or before < MOST_STEPS:
        return
    message = f"the truth begins some {before} steps after these rows, and a run has at most"
    remedy = "leave out the rows before the truth, or all but every n-th row"
    raise DataError(Place(guess.path, 1, 1, f"{message} {MOST_STEPS} steps: {remedy}"))


def guessed_units(guess: Guess, prefix: str = "") -> list[str]:
    """Return lines for the terminal on guesses of one file that the user should check.

    They are units of ranges and angles that stand in no name, azimuths that count from north because of
    their numbers, and velocities that are left out. Options for other answers set keys that begin with
    the ``prefix``, such as "input_naming.".
    """
    lines = []
    for name in ("range", "azimuth", "bearing", "v", "w"):
        reason = guess.reasons.get(name, "")
        # The reason for a guess is a text such as "guess: there are angles beyond 2 pi".
        if name in guess.naming.units and reason.startswith("guess"):
            column = quoted(guess.naming.columns[name])
            unit = guess.naming.units[name]
            _, _, explanation = reason.partition(": ")
            lines.append(f"read {column} in {unit} ({explanation})")
    if lines:
        lines[-1] += f"; another unit: --set {prefix}units.NAME=UNIT"
    ranges = [name for name in guess.naming.columns if name.endswith(".range")]
    if ranges:
        columns = [quoted(guess.naming.columns[name]) for name in ranges]
        way = f"to read one alone: --set '{prefix}columns.range=ITS NAME'"
        lines.append(f"read {', '.join(columns)} as ranges to {len(ranges)} places; {way}")
    if guess.reasons.get("clockwise", "").startswith("guess"):
        column = quoted(guess.naming.columns["azimuth"])
        reading = f"read {column} clockwise from north (from 0 to 360 deg, as of radars)"
        lines.append(f"{reading}; from x to y: --set '{prefix}clockwise=[]'")
    if "velocity" in guess.reasons:
        lines.append(guess.reasons["velocity"])
    return lines


def usable_quantities(guess: Guess) -> list[str]:
    """Return quantities that an unused column may have, as the config does not read them yet.

    `Naming.columns` has all quantities that were recognized, and `_used_columns` only those that the
    config reads. So a speed may have a column and be unused.
    """
    used = _used_columns(guess)
    # A speed is read with a course alone: where one of them has a column, the other one is missing. If
    # both have one, or a velocity was left out, no further column makes a velocity that is read.
    names = [name for name in ("speed", "course") if name not in guess.naming.columns]
    if "velocity" in guess.reasons:
        names = []
    # Without a position no velocity is read, and the column may be a measurement of a radar.
    if not used.keys() & {"x", "latitude"}:
        names = ["range", "azimuth"]
    # The config of a robot reads neither a velocity nor an azimuth.
    if guess.inputs:
        names = []
    names += ["run", "sensor", "received"]
    return [name for name in names if name not in used]


def unused_columns(guess: Guess) -> list[str]:
    """Return the columns of one file that the config does not read, as YAML."""
    used = _used_columns(guess).values()
    return [quoted(" ".join(name.split())) for name in guess.names if name not in used]


def unknown_places(
    guess: Guess, tables: FurtherTables, first_state: FirstState | None = None
) -> list[str]:
    """Return words for the sensors and other places whose position the user must write into the config.

    Their places are unknown by the ``tables`` and the ``first_state`` of the filters.
    """
    # Only the log of a robot has inputs.
    unnamed = "the landmark" if guess.inputs else "the sensor"
    names = []
    for sensor in guess.sensors:
        if _lacks_place(guess, sensor) and tables.place_of(sensor.name) is None:
            names.append(sensor.name or unnamed)
    if guess.inputs:
        missing = _unknown_words(_pose_in_words(first_state))
        if len(missing) == len(_POSE):
            names.append("the start")
        else:
            names += [f"the {word} of the start" for word in missing]
    elif not {sensor.kind for sensor in guess.sensors} & _LOCATING:
        names.append("the start")
    if _lacks_origin(guess, tables.truth):
        names.append(_origin_name(guess))
    return names


def _origin_name(guess: Guess) -> str:
    """Return words for the point x = y = 0: the radar, if it alone has no latitude and longitude."""
    planar_kinds = []
    for file in guess.each_file:
        if not _has_geodetic_positions(file):
            planar_kinds += [sensor.kind for sensor in file.sensors]
    return "the radar" if planar_kinds == ["range-azimuth"] else "the origin"


def _has_geodetic_positions(guess: Guess) -> bool:
    """Test whether a file measures positions by latitude and longitude."""
    columns = guess.naming.columns
    is_geodetic = "latitude" in columns and not {"x", "y"} <= columns.keys()
    return is_geodetic and any(sensor.kind == "position" for sensor in guess.sensors)


def _lacks_place(guess: Guess, sensor: SensorGuess) -> bool:
    """Test whether the user must write a sensor's place into the config.

    A single radar needs none, as it is at the origin, nor does a sensor of positions.
    """
    if sensor.kind in ("range", "bearing") or sensor.kind.startswith("landmark"):
        return True
    radars = [other for other in guess.sensors if other.kind == "range-azimuth"]
    return sensor.kind == "range-azimuth" and len(radars) > 1


def _lacks_origin(guess: Guess, truth: TruthGuess | None) -> bool:
    """Test whether the user must write the origin: latitude and longitude of x = y = 0.

    This is so if some positions, perhaps those of the truth, are latitudes and longitudes, and other
    sensors or positions count from a point x = y = 0 that no file has.
    """
    if guess.naming.origin:
        return False
    # Geodetic positions get their x and y by the origin; planar measurements have their own x = y = 0.
    has_geodetic = False
    has_planar = False
    for file in guess.each_file:
        kinds = {sensor.kind for sensor in file.sensors}
        has_positions = _has_geodetic_positions(file)
        has_geodetic = has_geodetic or has_positions
        # Sensors of another kind beside geodetic positions are planar.
        has_planar = has_planar or len(kinds) > 1 or not has_positions
    if truth is not None:
        has_geodetic = has_geodetic or truth.is_geodetic
        has_planar = has_planar or not truth.is_geodetic
    return has_geodetic and has_planar


def idle_keys(guess: Guess, user_columns: Mapping[str, str]) -> list[str]:
    """Return the quantities for which the user named a column that the config does not read.

    ``user_columns`` are the named columns by quantity.
    """
    used = _used_columns(guess)
    return [key for key, column in user_columns.items() if column and key not in used]


def _used_columns(guess: Guess) -> dict[str, str]:
    """Return the columns of a file that the config reads, by their quantities."""
    naming = guess.naming
    # Of measured quantities only those of the guessed sensors are read.
    read = {"time", "date", "step", "received", "run", "sensor", "latitude", "longitude"}
    read |= STAMP_PARTS.keys()
    read |= {"north_south", "east_west"}
    read |= guess.inputs.keys()
    if guess.measures_velocity:
        read |= {"vx", "vy", "speed", "course"}
    for sensor in guess.sensors:
        read.update(sensor.quantities)
    # Latitude and longitude are read only for a position without columns of its own.
    if {"x", "y"} <= naming.columns.keys() or not read & {"x", "y"}:
        read -= {"latitude", "longitude", "north_south", "east_west"}
    return {name: column for name, column in naming.columns.items() if name in read}


def _target_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield the lines of the target's keys that say how the table is read, with reasons as comments."""
    truth = tables.truth
    naming = guess.naming
    reasons = guess.reasons
    columns = _used_columns(guess)
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
    elif _lacks_origin(guess, truth):
        where = "x = y = 0 of the sensors"
        if _origin_name(guess) == "the radar":
            where = "the radar, x = y = 0,"
        yield f"origin: [LATITUDE, LONGITUDE]  # write where {where} is, deg"
    elif any("latitude" in _used_columns(file) for file in guess.each_file):
        yield "# x and y are meters east and north of the first position, or of `origin: [lat, lon]`"
    if "velocity" in reasons:
        yield f"# {reasons['velocity']}"
    if len(guess.runs) > 1:
        (longest, _), *others = guess.runs
        names = ", ".join(quoted(name) for name, _ in others[:_MOST_NAMES])
        if len(others) > _MOST_NAMES:
            names += ", ..."
        yield f"runs: [{quoted(longest)}]  # the longest of {len(guess.runs)}; there are {names}"


def _naming_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield the lines of a file's columns, units and format, with the reasons as comments."""
    naming = guess.naming
    reasons = guess.reasons
    columns = _used_columns(guess)
    yield "columns:  # guess, from their names"
    for name, column in columns.items():
        if name in guess.inputs:
            continue
        line = f"  {name}: {quoted(column)}"
        # The reasons for other columns are those of their units, and stand beside these.
        if name in _LABEL_COLUMNS:
            line += comment_on(reasons, name)
        if name == "time":
            line += comment_on(reasons, "time_column")
        if name == "vy":
            line += comment_on(reasons, "exchanged")
        yield line
    unused = unused_columns(guess)
    if unused:
        yield f"  # not used: {', '.join(unused)}"
    if guess.inputs:
        yield from _input_lines(guess, tables)
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
    if naming.missing:
        yield f"missing: {missing_in_yaml(naming)}{comment_on(reasons, 'missing')}"
    if naming.clockwise and not columns.keys().isdisjoint(("azimuth", "bearing")):
        yield f"clockwise: [{', '.join(naming.clockwise)}]{comment_on(reasons, 'clockwise')}"
    elif "azimuth" in columns and "anticlockwise" in reasons:
        yield f"# {reasons['anticlockwise']}"
    if naming.same_time is not None:
        yield f"same_time: {naming.same_time}{comment_on(reasons, 'same_time')}"


def _sensor_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield a line for each sensor, with comments on what the user must write or may change.

    The ``tables`` may have the places of landmarks.
    """
    source = "guess: how far measurements are from the line between their neighbors"
    for sensor in guess.sensors:
        kind = sensor.kind
        sigmas = sensor.sigmas
        comment = f"  # {source}"
        place_comment = "  # write where it is, m"
        if sensor.name:
            name = quoted(sensor.name)
            comment = f"  # {name}: {source}"
            place_comment = f"  # write where {name} is, m"
        place = re.sub(r"\W", "_", sensor.name) or "SENSOR"
        place_key = f"at: [X_{place}, Y_{place}]"
        known_place = tables.place_of(sensor.name)
        if known_place is not None:
            x, y = known_place
            place_key = f"at: [{x:.9g}, {y:.9g}]"
            named = quoted(sensor.name) if sensor.name else "the landmark"
            place_comment = f"  # {named}: place of {in_line(tables.source_of_places)}, m"
        elif tables.places:
            source_of_places = in_line(tables.source_of_places)
            place_comment += (
                f", which {source_of_places} lacks; or leave out the line, and the name in"
            )
            place_comment += " `sensors`"
        # The kinds `position` and `range` take a state px, vx, py, vy; a robot's is px, py, heading.
        if kind == "position" and guess.inputs:
            variance = float(f"{max(sigmas) ** 2:.3g}")
            yield f"- {{kind: function, h: {{x: px, y: py}}, R: {variance:g}}}{comment}; R is a variance"
        elif kind == "range" and guess.inputs:
            sigma_key = f"sigma_range: {sigmas[0]:g}"
            yield f"- {{kind: landmark, {place_key}, {sigma_key}}}{place_comment}; sigmas: guess"
        elif kind == "position":
            yield f"- {{kind: position, sigma: {max(sigmas):g}}}{comment}"
        elif kind.startswith("landmark"):
            *sigma_range, angle = sigmas  # the first is empty for a sensor without a range
            keys = [place_key, *(f"sigma_range: {value:g}" for value in sigma_range)]
            keys.append(f"sigma_bearing_mrad: {float(f'{1000.0 * angle:.3g}'):g}")
            yield f"- {{kind: landmark, {', '.join(keys)}}}{place_comment}; sigmas: guess"
        elif kind == "range":
            yield f"- {{kind: range, {place_key}, sigma: {sigmas[0]:g}}}{place_comment}"
        else:
            *sigma_range, angle = sigmas
            keys = [f"sigma_range: {value:g}" for value in sigma_range]
            angle_key = "sigma_azimuth_mrad" if sigma_range else "sigma_mrad"
            keys.append(f"{angle_key}: {float(f'{1000.0 * angle:.3g}'):g}")
            if _lacks_place(guess, sensor):
                keys.insert(0, place_key)
                comment = place_comment
            yield f"- {{kind: {kind}, {', '.join(keys)}}}{comment}"
    has_azimuth = any("azimuth" in sensor.quantities for sensor in guess.sensors)
    if has_azimuth and not guess.files and not guess.naming.clockwise:
        yield "# azimuth counts from x to y; from north clockwise: `clockwise: [azimuth]` above"
    if guess.measures_velocity:
        velocity = float(f"{max(0.05 * guess.speed, 0.05):.1g}")
        yield f"- {{kind: velocity, sigma: {velocity:g}}}  # guess: 5 % of the usual speed"
