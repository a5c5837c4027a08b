"""Starting files of components, scenarios and experiments that run as they are."""

import re
import sys
from collections.abc import Mapping
from importlib.machinery import PathFinder
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import write_text
from trackbench.errors import Mark, Problem, UserError
from trackbench.registry import GROUPS, kinds

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
    "c": Language("c", "[./@MODULE@]", "cc -O2 -o @MODULE@ @MODULE@.c -lm"),
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
_MOST_CHARACTERS = 60
"""Most characters of a name."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(?:[-_ ][A-Za-z0-9]+)*")


def write_new(noun: str, name: str, folder: Path, form: str = "") -> list[Path]:
    """Write the files of a new component or experiment; existing files stay.

    Parameters
    ----------
    noun
        a word of `NOUNS`, such as ``filter``
    name
        name of the component or experiment: its words make the kind, the module and the class
    folder
        folder of the written files
    form
        of a filter ``per_run``, which handles one run at a time, ``per_run_nonlinear``, which also takes
        any model as functions, or the language of a program; of a motion ``nonlinear``. Empty means the
        usual form

    Returns
    -------
    list of Path
        written files

    Raises
    ------
    UserError
        for a form of another noun, a wrong name, an existing file, and a file that would hide a module
        of Python
    """
    if form and _FORM_OF[form] != noun:
        option = "--language" if form in LANGUAGES else f"--{form.replace('_', '-')}"
        hint = ""
        if form == "nonlinear" and noun == "filter":
            hint = "; with --per-run it is of a filter that takes any model"
        raise UserError(f"new {noun} {name}: {option} is of a {_FORM_OF[form]}{hint}")
    words = words_of_name(noun, name)
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
        filled[folder / template.replace(stem, module)] = filled_template(template, words, values)
    mark = Mark(f"new {noun} {name}")
    for path in filled:
        if path.exists():
            raise UserError(Problem(mark, "", f"there is a file {path}"))
    # A Python file must not have the name of a module that Python finds elsewhere: programs that run in
    # this folder would import the file in its place. Modules of plugins have names of another form.
    is_of_python = module in sys.builtin_module_names or PathFinder.find_spec(module) is not None
    if folder / f"{module}.py" in filled and is_of_python:
        hidden = f"{module}.py would hide the module of this name from Python"
        raise UserError(Problem(mark, "", hidden))
    for path, text in filled.items():
        write_text(path, text)
    return list(filled)


def words_of_name(noun: str, name: str) -> list[str]:
    """Split a name at each -, _ or space into words, of which kind, module and class are named.

    Parameters
    ----------
    noun
        a word of `NOUNS`, such as ``filter``
    name
        name of the new component or experiment

    Returns
    -------
    list of str
        words in small letters

    Raises
    ------
    UserError
        for a name with other characters than these, letters and digits, or with too many, and for a kind
        of this ``noun`` that exists already
    """
    mark = Mark(f"new {noun} {name}")
    if len(name) > _MOST_CHARACTERS:
        message = f"a name has at most {_MOST_CHARACTERS} characters; this one has {len(name)}"
        raise UserError(Problem(mark, "", message))
    if not _NAME.fullmatch(name):
        rule = (
            "a name starts with a letter and holds letters and digits, with one -, _ or space between "
            "two words"
        )
        raise UserError(Problem(mark, "", rule))
    words = [word.lower() for word in re.split(r"[-_ ]", name)]
    for group in GROUPS:
        if group == f"{noun}s" and "-".join(words) in kinds(group):
            raise UserError(Problem(mark, "", f"there is a {noun} of this kind already"))
    return words


def filled_template(template: str, words: list[str], values: Mapping[str, str]) -> str:
    """Return a template's text with the values of its marks, and those of the name."""
    text = (files("trackbench") / "templates" / f"{template}.tmpl").read_text(encoding="utf-8")
    return _with_marks(text, {**values, **_name_marks(words)})


def _name_marks(words: list[str]) -> dict[str, str]:
    """Return the values of a template's marks that stand for the name; ``words`` are its words."""
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
