"""Starting files of components, scenarios and experiments that run as they are."""

import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.machinery import PathFinder
from importlib.resources import files
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import yaml

from trackbench.atomic_files import write_text
from trackbench.config.build import build
from trackbench.config.includes import assignment, override
from trackbench.config.load import load
from trackbench.errors import Mark, Problem, UserError, in_line
from trackbench.execution.plan import cautions
from trackbench.field_types import DataError, Place, Positive
from trackbench.registry import GROUPS, kinds
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.recordings.column_mapping import Naming
from trackbench.scenarios.recordings.guess_config import (
    FirstState,
    FurtherTables,
    config_parts,
    guessed_units,
    idle_keys,
    left_out_filters,
    quoted,
    unknown_places,
    unused_columns,
    usable_quantities,
)
from trackbench.scenarios.recordings.guess_format import (
    Guess,
    RobotTables,
    recognized,
    recognized_odometry,
)
from trackbench.scenarios.recordings.guess_truth import recognized_truth, settled
from trackbench.scenarios.recordings.landmark_table import read_landmarks
from trackbench.scenarios.targets.measured import Measured
from trackbench.yaml_source import MarkedMapping, Source

_TABLES_OF_PREFIXES = {
    "truth_naming.": ("truth", "--truth"),
    "input_naming.": ("file of inputs", "--input"),
    "landmarks.": ("table of landmarks", "--landmarks"),
}
"""Tables beside the measurements and their options, by the beginning of their keys."""
_OPTION_OF_TABLE = re.compile(r"--set '?(?!'|(?:truth_naming|input_naming|landmarks)\.)")
"""Beginning of an option that answers a question on a table."""
_OPTIONS_OF_KEYS = {
    "truth": "--truth FILE",
    "truth_gap": "--truth FILE",
    "input_file": "--input FILE",
}
"""Keys of the target that follow from the options of the command."""
_FORM_OF = {
    "per_run": "filter",
    "per_run_nonlinear": "filter",
    "nonlinear": "motion",
}
_CLASSES = ("filter", "sensor", "motion", "start", "scenario")
NOUNS = (*_CLASSES, "experiment")
"""What `trackbench new` writes."""
_TEMPLATES: dict[str, tuple[str, ...]] = {
    name: (f"{name}.py", f"{name}.yaml", f"test_{name}.py") for name in (*_CLASSES, *_FORM_OF)
}
_TEMPLATES["experiment"] = ("experiment.yaml", "test_experiment.py")


class Language(NamedTuple):
    """Ending of a program's file, its ``command`` in YAML, and how it is built."""

    ending: str
    command: str
    build: str = ""

    @property
    def marks(self) -> dict[str, str]:
        """Values of the marks in a template."""
        return {"@COMMAND@": self.command, "@BUILD@": self.build}


LANGUAGES = {
    "c": Language("c", "[./@MODULE@]", "cc -O2 -o @MODULE@ @MODULE@.c"),
    "c++": Language("cpp", "[./@MODULE@]", "c++ -O2 -std=c++17 -o @MODULE@ @MODULE@.cpp"),
    "rust": Language("rs", "[./@MODULE@]", "rustc -O @MODULE@.rs"),
    # Julia compiles a function at its first call, which takes seconds.
    "julia": Language("jl", "[julia, @MODULE@.jl], timeout: 60"),
    "octave": Language("m", "[octave-cli, --quiet, @MODULE@.m]"),
    "javascript": Language("js", "[node, @MODULE@.js]"),
    "python": Language("py", "[python3, @MODULE@.py]"),
}
_FORM_OF |= dict.fromkeys(LANGUAGES, "filter")
_TEMPLATES |= {name: (f"language.{x.ending}", "language.yaml") for name, x in LANGUAGES.items()}
_MOST_NAMES = 8  # that a message shows
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(?:[-_ ][A-Za-z0-9]+)*")


def write_new(noun: str, name: str, folder: Path, form: str = "") -> list[Path]:
    """Write the files of a new component or experiment; existing files stay.

    ``noun`` is a word of `NOUNS`, such as filter. ``form`` of a filter is ``per_run``, which handles one
    run at a time, ``per_run_nonlinear``, which also takes any model as functions, or the language of a
    program; of a motion ``nonlinear``.
    """
    if form and _FORM_OF[form] != noun:
        option = "--language" if form in LANGUAGES else f"--{form.replace('_', '-')}"
        hint = ""
        if form == "nonlinear" and noun == "filter":
            hint = "; with --per-run it is of a filter that takes any model"
        raise UserError(f"new {noun} {name}: {option} is of a {_FORM_OF[form]}{hint}")
    words = _words_of_name(noun, name)
    module = "_".join(words)
    # Step 1: the values of the template's marks. They contain the marks of the name themselves.
    stem = form or noun
    values: dict[str, str] = {}
    if form in LANGUAGES:
        stem = "language"
        values = LANGUAGES[form].marks
    values = {mark: _with_marks(text, _name_marks(words)) for mark, text in values.items()}
    # Step 2: fill every template before anything is written.
    filled = {}
    for template in _TEMPLATES[form or noun]:
        filled[folder / template.replace(stem, module)] = _filled(template, words, values)
    mark = Mark(f"new {noun} {name}")
    for path in filled:
        if path.exists():
            raise UserError(Problem(mark, "", f"there is a file {path}"))
    # Python's modules; plugins are loaded apart.
    is_of_python = module in sys.builtin_module_names or PathFinder.find_spec(module) is not None
    if folder / f"{module}.py" in filled and is_of_python:
        hidden = f"{module}.py would hide the module of this name from Python"
        raise UserError(Problem(mark, "", hidden))
    for path, text in filled.items():
        write_text(path, text)
    return list(filled)


class WrittenConfig(NamedTuple):
    """Files of an experiment on recorded data, and what is left to the user.

    ``unknown`` are sensors whose place must be written, ``unused`` columns that are not read, and
    ``quantities`` what they may hold. ``left_out`` says which filters are comments only, and
    ``units`` which units were guessed. ``notes`` are those of the config, if all places of landmarks are
    known.
    """

    paths: list[Path]
    unknown: list[str]
    unused: list[str]
    quantities: list[str]
    left_out: list[str]
    units: list[str]
    notes: list[str]


@dataclass(frozen=True, kw_only=True)
class _InputKeys:
    """Keys of the target on a robot's inputs, which the user may give."""

    input_gap: Positive | None = None
    input_holds: Literal["before", "after"] | None = None


def write_config_for(
    data: Path,
    name: str,
    folder: Path,
    changes: Sequence[str] = (),
    truth: Path | None = None,
    odometry: Path | None = None,
    landmarks: Path | None = None,
) -> WrittenConfig:
    """Write an experiment on recorded data with guessed columns and units; existing files stay.

    ``changes``, such as ``columns.time=Zeit``, are keys of the recording that need no guess. Keys of the
    ``truth``, a table of the true path, begin with ``truth_naming``. Those of a robot's ``odometry``
    begin with ``input_naming``, and those of a table of ``landmarks`` with ``landmarks``. A config that
    would not run is not left: UserError says why. Places that the user must write are then any numbers.
    """
    words = _words_of_name("experiment", name)
    path = folder / f"{'_'.join(words)}.yaml"
    mark = Mark(f"new experiment {name}")
    if path.exists():
        way = f"remove it, or write another one: trackbench new experiment NAME --from {data}"
        raise UserError(Problem(mark, "", f"there is a file {path}: {way}"))
    # Step 1: read the given keys as those of a config, and guess the others.
    paths_of_tables = {"truth_naming.": truth, "input_naming.": odometry, "landmarks.": landmarks}
    namings: dict[str, Naming] = {}
    remaining = list(changes)
    for prefix, table in paths_of_tables.items():
        of_table = [change for change in remaining if change.startswith(prefix)]
        if of_table and table is None:
            noun, option = _TABLES_OF_PREFIXES[prefix]
            what = f"{of_table[0]}: there is no {noun}; name it, {option} FILE"
            raise UserError(Problem(mark, "", what))
        remaining = [change for change in remaining if change not in of_table]
        namings[prefix] = _given_naming(mark, [change.removeprefix(prefix) for change in of_table])
    of_inputs = [
        change for change in remaining if change.startswith(("input_gap=", "input_holds="))
    ]
    input_keys = _given_input_keys(mark, of_inputs)
    given = _given_naming(mark, [change for change in remaining if change not in of_inputs])
    odometry_guess = None
    places: dict[str, tuple[float, float]] = {}
    if odometry is not None:
        with _questions_on("input_naming."):
            odometry_guess = recognized_odometry(str(odometry), namings["input_naming."])
    if landmarks is not None:
        with _questions_on("landmarks."):
            places = read_landmarks(str(landmarks), namings["landmarks."]).places
    with _questions_on(""):
        robot_tables = RobotTables(
            odometry=odometry_guess,
            landmarks=tuple(places),
            names_turn_rate="w" in namings["input_naming."].columns,
        )
        # A key that is set to nothing, as clockwise=[], is an answer, too.
        said = {change.partition("=")[0].strip() for change in changes}
        guess = recognized(str(data), given, said, robot_tables)
    if input_keys and not guess.inputs:
        raise UserError(
            Problem(mark, next(iter(input_keys)), "is of a robot's inputs; leave it out")
        )
    if landmarks is not None:
        _check_landmarks(data, landmarks, guess, places)
    truth_guess = None
    if truth is not None:
        with _questions_on("truth_naming."):
            truth_guess = recognized_truth(str(truth), guess, namings["truth_naming."])
    with _questions_on(""):
        guess = settled(guess, truth_guess, said)
    idle = idle_keys(guess, given.columns)
    if idle:
        kinds_of_sensors = " and ".join(dict.fromkeys(s.kind for s in guess.sensors))
        what = f"the config would not read it, as it is one of {kinds_of_sensors}; leave it out"
        raise UserError(Problem(mark, f"columns.{idle[0]}", what))
    # Step 2: the template's lines for the data's columns and units.
    relative = quoted(os.path.relpath(data, folder))
    tables = FurtherTables(
        truth=truth_guess,
        truth_path="" if truth is None else quoted(os.path.relpath(truth, folder)),
        odometry=odometry_guess,
        odometry_path="" if odometry is None else quoted(os.path.relpath(odometry, folder)),
        places=places,
        source_of_places="" if landmarks is None else landmarks.name,
        keys=input_keys,
    )
    marks = {"@FILE@": relative, "@SOURCE@": in_line(data.name)}
    text = _filled("recording.yaml", words, {**marks, **config_parts(guess, tables)})
    # Step 3: try the config, with some numbers in place of those that the user must write.
    tried_text = text
    if unknown_places(guess, tables):
        origin = guess.origin
        if not origin and truth_guess is not None:
            origin = truth_guess.origin
        tried_text = _with_some_places(text, origin)
    write_text(path, tried_text)
    try:
        config = load(path)
    except UserError as error:
        raise UserError(*(_reported(problem, path, data) for problem in error.problems)) from None
    finally:
        path.unlink()
    # The time of the first state is known by now, and the truth there.
    first_state = _first_state(config.points[0].scenario, tables)
    parts = config_parts(guess, tables, first_state)
    write_text(path, _filled("recording.yaml", words, {**marks, **parts}))
    unknown = unknown_places(guess, tables, first_state)
    notes = []
    if places and not unknown:
        notes = cautions(config.points)
    units = guessed_units(guess)
    if odometry_guess is not None:
        units += guessed_units(odometry_guess, "input_naming.")
    return WrittenConfig(
        paths=[path],
        unknown=unknown,
        unused=unused_columns(guess),
        quantities=usable_quantities(guess),
        left_out=left_out_filters(guess),
        units=units,
        notes=notes,
    )


@contextmanager
def _questions_on(prefix: str) -> Iterator[None]:
    """Report the mistakes of a table as those of the command.

    The answers to questions on a table beside the measurements are keys that begin with the ``prefix``.
    """
    try:
        yield
    except DataError as error:
        problems = []
        for place in error.places:
            what = place.what
            if prefix:
                what = _OPTION_OF_TABLE.sub(rf"\g<0>{prefix}", what)
            problems.append(_problem_at(place._replace(what=what)))
        raise UserError(*problems) from None


def _given_input_keys(mark: Mark, changes: Sequence[str]) -> dict[str, str]:
    """Return the keys on inputs among the user's answers, as YAML."""
    source = Source(MarkedMapping(), mark)
    for change in changes:
        override(source, *assignment(source, change))
    given = build(_InputKeys, source, ())
    if given is None:
        raise UserError(*source.problems)
    keys = {}
    if given.input_gap is not None:
        keys["input_gap"] = f"{given.input_gap:g}"
    if given.input_holds is not None:
        keys["input_holds"] = given.input_holds
    return keys


def _check_landmarks(
    data: Path, landmarks: Path, guess: Guess, places: Mapping[str, tuple[float, float]]
) -> None:
    """Raise UserError if a table of landmarks has the place of none that was measured."""
    names = [sensor.name for sensor in guess.sensors]
    if any(name in places for name in names) or (names == [""] and len(places) == 1):
        return
    known = ", ".join([*places][:_MOST_NAMES])
    what = f"no column of {data} names the landmarks, which are {known}"
    way = "say which does, --set 'columns.sensor=ITS NAME'"
    if names != [""]:
        what = (
            f"has none of {', '.join(names[:_MOST_NAMES])}, which {data} names; there are {known}"
        )
        way = "write the names alike in both files"
    raise UserError(Problem(Mark(str(landmarks), 1, 1), "", f"{what}: {way}"))


def _first_state(scenario: Scenario, tables: FurtherTables) -> FirstState:
    """Return the time of the filters' first state, and the truth's pose there if the truth is a robot's.

    A pose that is later by at most the gap of the truth counts, too.
    """
    begin = float(scenario.times[0])
    target = getattr(scenario, "target", None)
    if tables.truth is None or not isinstance(target, Measured) or not target.input:
        return FirstState(begin=begin)
    poses = target.recorded_truth
    known = np.flatnonzero(np.isfinite(poses[:2]).all(axis=0))
    if not len(known):
        return FirstState(begin=begin)
    later = float(scenario.times[known[0]]) - begin
    if later > tables.truth.gap:
        return FirstState(begin=begin)
    return FirstState(begin=begin, pose=tuple(poses[:, known[0]].tolist()), later=later)


def _problem_at(place: Place) -> Problem:
    """Return the mistake of a table as a problem of the command."""
    return Problem(Mark(place.file, place.line, place.column), "", place.what)


def _given_naming(mark: Mark, changes: Sequence[str]) -> Naming:
    """Build the naming of columns and units from the user's answers."""
    source = Source(MarkedMapping(), mark)
    for change in changes:
        key = change.partition("=")[0]
        if key in _OPTIONS_OF_KEYS:
            what = f"this table has an option of its own, {_OPTIONS_OF_KEYS[key]}"
            raise UserError(Problem(mark, key, what))
        override(source, *assignment(source, change))
    given = build(Naming, source, ())
    if given is None:
        raise UserError(*source.problems)
    return given


def _with_some_places(text: str, origin: Sequence[float]) -> str:
    """Return a config's text with numbers in place of the words that the user must replace.

    ``origin`` is the latitude and longitude of some position, deg; empty if there is none.
    """
    config = yaml.safe_load(text)
    scenario = config["scenario"]
    for number, sensor in enumerate(scenario["sensor"]):
        if "at" in sensor and isinstance(sensor["at"][0], str):
            sensor["at"] = [1000.0 * number, 1000.0]
    mean = scenario["start"].get("mean")
    if mean:
        scenario["start"]["mean"] = [value if value == 0 else 1.0 for value in mean]
    target = scenario["target"]
    if target.get("origin") == ["LATITUDE", "LONGITUDE"]:
        target["origin"] = [*origin]
    return str(yaml.safe_dump(config, sort_keys=False))


def _reported(problem: Problem | str, path: Path, data: Path) -> Problem | str:
    """Report a mistake of a guessed config as one of the table, since the config is not there."""
    if isinstance(problem, str) or problem.mark.file != str(path):
        return problem
    mistake = problem.what
    if problem.path:
        mistake = f"{problem.path}: {problem.what}"
    return Problem(Mark(str(data)), "", f"a config for it would not run: {mistake}")


def _words_of_name(noun: str, name: str) -> list[str]:
    """Split a name at -, _ and spaces into words; raises UserError for a bad or a known name."""
    mark = Mark(f"new {noun} {name}")
    if len(name) > 60 or not _NAME.fullmatch(name):
        rule = "a name starts with a letter and holds letters, digits, - and _"
        raise UserError(Problem(mark, "", rule))
    words = [word.lower() for word in re.split(r"[-_ ]", name)]
    for group in GROUPS:
        if group == f"{noun}s" and "-".join(words) in kinds(group):
            raise UserError(Problem(mark, "", f"there is a {noun} of this kind already"))
    return words


def _filled(template: str, words: list[str], values: Mapping[str, str]) -> str:
    """Return a template's text with the values of its marks, and those of the name."""
    text = (files("trackbench") / "templates" / f"{template}.tmpl").read_text(encoding="utf-8")
    return _with_marks(text, {**values, **_name_marks(words)})


def _name_marks(words: list[str]) -> dict[str, str]:
    """Return the values of the marks that stand for the name."""
    return {
        "@KIND@": "-".join(words),
        "@MODULE@": "_".join(words),
        "@CLASS@": "".join(word.capitalize() for word in words),
        "@NAME@": "-".join(words),
    }


def _with_marks(text: str, values: Mapping[str, str]) -> str:
    """Replace the marks of a text in one pass; a mark within a value, a column's name, stays."""
    marks = re.compile("|".join(map(re.escape, values)))
    return marks.sub(lambda match: values[match[0]], text)
