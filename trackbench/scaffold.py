"""Starting files of components, scenarios and experiments that run as they are."""

import os
import re
import sys
from collections.abc import Mapping, Sequence
from importlib.machinery import PathFinder
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import write_text
from trackbench.config.build import build
from trackbench.config.includes import assignment, override
from trackbench.config.load import load
from trackbench.errors import Mark, Problem, UserError, in_line
from trackbench.field_types import DataError
from trackbench.registry import GROUPS, kinds
from trackbench.scenarios.recordings.column_mapping import Naming
from trackbench.scenarios.recordings.guess_config import (
    config_parts,
    left_out_filters,
    quoted,
    unknown_places,
    unused_columns,
    usable_quantities,
)
from trackbench.scenarios.recordings.guess_format import recognized
from trackbench.yaml_source import MarkedMapping, Source

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
    ``quantities`` what they may hold. ``left_out`` says which filters are comments only.
    """

    paths: list[Path]
    unknown: list[str]
    unused: list[str]
    quantities: list[str]
    left_out: list[str]


def write_config_for(
    data: Path, name: str, folder: Path, changes: Sequence[str] = ()
) -> WrittenConfig:
    """Write an experiment on recorded data with guessed columns and units; existing files stay.

    ``changes``, such as ``columns.time=Zeit``, are keys of the recording that need no guess. A config
    that would not run is not left: UserError says why.
    """
    words = _words_of_name("experiment", name)
    path = folder / f"{'_'.join(words)}.yaml"
    mark = Mark(f"new experiment {name}")
    if path.exists():
        raise UserError(Problem(mark, "", f"there is a file {path}"))
    # Read the given keys as those of a config.
    source = Source(MarkedMapping(), mark)
    for change in changes:
        override(source, *assignment(source, change))
    given = build(Naming, source, ())
    if given is None:
        raise UserError(*source.problems)
    try:
        guess = recognized(str(data), given)
    except DataError as error:
        problems = [Problem(Mark(p.file, p.line, p.column), "", p.what) for p in error.places]
        raise UserError(*problems) from None
    # The template's lines for the data's columns and units.
    relative = quoted(os.path.relpath(data, folder))
    parts = {"@FILE@": relative, "@SOURCE@": in_line(data.name), **config_parts(guess)}
    write_text(path, _filled("recording.yaml", words, parts))
    unknown = unknown_places(guess)
    if not unknown:
        try:
            load(path)
        except UserError as error:
            path.unlink()
            raise UserError(
                *(_reported(problem, path, data) for problem in error.problems)
            ) from None
    return WrittenConfig(
        paths=[path],
        unknown=unknown,
        unused=unused_columns(guess),
        quantities=usable_quantities(guess),
        left_out=left_out_filters(guess),
    )


def _reported(problem: Problem | str, path: Path, data: Path) -> Problem | str:
    """Report a mistake of a guessed config as one of the table, since the config is not there."""
    if isinstance(problem, str) or problem.mark.file != str(path):
        return problem
    mistake = problem.what
    if problem.path:
        mistake = f"{problem.path}: {problem.what}"
    return Problem(Mark(str(data)), "", f"a config for it would not run: {mistake}")


def _words_of_name(noun: str, name: str) -> list[str]:
    """Split a name at - and _ into words; raises UserError for a bad name or one that is known."""
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
