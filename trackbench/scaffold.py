"""Starting files of components, scenarios and experiments that run as they are."""

import ast
import inspect
import json
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.machinery import PathFinder
from importlib.resources import files
from pathlib import Path
from textwrap import dedent
from types import ModuleType
from typing import NamedTuple, TypeAlias

from trackbench.atomic_files import write_text
from trackbench.config.build import build
from trackbench.config.includes import assignment, override
from trackbench.config.load import load
from trackbench.config.mistakes import unknown
from trackbench.errors import Mark, Problem, UserError
from trackbench.field_types import DataError
from trackbench.filters.base import Filter
from trackbench.registry import GROUPS, kinds
from trackbench.scenarios.recordings.column_mapping import Naming
from trackbench.scenarios.recordings.guess_config import (
    config_parts,
    unknown_places,
    unused_columns,
)
from trackbench.scenarios.recordings.guess_format import recognized
from trackbench.yaml_source import MarkedMapping, Source, parse

_FORM_OF = {"per_run": "filter", "nonlinear": "motion", "copy": "filter"}
_CLASSES = ("filter", "sensor", "motion", "start", "scenario")
WHAT = (*_CLASSES, "experiment")
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


def write_new(what: str, name: str, folder: Path, form: str = "", source: str = "") -> list[Path]:
    """Write the files of a new filter, sensor, experiment, ...; existing files stay.

    ``form`` of a filter is ``per_run``, which handles one run at a time, ``copy``, which begins as the
    shipped filter of kind ``source``, or the language of a program; of a motion ``nonlinear``.
    """
    if form and _FORM_OF[form] != what:
        option = "--language" if form in LANGUAGES else f"--{form.replace('_', '-')}"
        raise UserError(f"new {what} {name}: {option} is of a {_FORM_OF[form]}")
    words = _words(what, name)
    module = "_".join(words)
    language, templates = LANGUAGES.get(form), _TEMPLATES[form or what]
    stem = "language" if language else form or what
    # Fill every template before anything is written.
    more = language.marks if language else parts_of_copy(source) if form == "copy" else {}
    filled = {folder / t.replace(stem, module): _filled(t, words, more) for t in templates}
    mark = Mark(f"new {what} {name}")
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


def write_config_for(
    data: Path, name: str, folder: Path, changes: Sequence[str] = ()
) -> tuple[list[Path], list[str], list[str]]:
    """Write an experiment on recorded data with guessed columns and units; existing files stay.

    ``changes``, such as ``columns.time=Zeit``, are keys of the recording that need no guess. Return the
    file, the names of sensors whose place must be written into it, and the columns it does not use.
    """
    words = _words("experiment", name)
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
    text = _filled("recording.yaml", words, {})
    file = {"measurements: @FILE@": f"measurements: {json.dumps(os.path.relpath(data, folder))}"}
    for part, lines in {**file, "@FILE@": data.name, **config_parts(guess)}.items():
        text = text.replace(part, lines)
    write_text(path, text)
    return [path], unknown_places(guess), unused_columns(guess)


def _words(what: str, name: str) -> list[str]:
    mark = Mark(f"new {what} {name}")
    if len(name) > 60 or not _NAME.fullmatch(name):
        rule = "a name starts with a letter and holds letters, digits, - and _"
        raise UserError(Problem(mark, "", rule))
    words = [word.lower() for word in re.split(r"[-_ ]", name)]
    group = next((g for g in GROUPS if g == f"{what}s"), None)
    if group is not None and "-".join(words) in kinds(group):
        raise UserError(Problem(mark, "", f"there is a {what} of this kind already"))
    return words


def _filled(template: str, words: list[str], more: Mapping[str, str]) -> str:
    text = (files("trackbench") / "templates" / f"{template}.tmpl").read_text(encoding="utf-8")
    values = {
        **more,  # whose values may have the marks below
        "@KIND@": "-".join(words),
        "@MODULE@": "_".join(words),
        "@CLASS@": "".join(word.capitalize() for word in words),
        "@NAME@": "-".join(words),
    }
    for mark, value in values.items():
        text = text.replace(mark, value)
    return text


_LINE = 100
_Import: TypeAlias = tuple[str, str, str]
"""A module, a name in it and its alias; without a module the name is that of one."""
_MODELS = (
    "motions: [{kind: cv, q: 0.1}, {kind: ca, q: 0.01}], transition: [[0.95, 0.05], [0.05, 0.95]]"
)
_KEYS = {
    "adaptive-kf": "nmf: {q: 0.1}, mf: {q: 0.01}, detector: {eta: 20, window_s: 10}",
    "alpha-beta": "q: 1",
    "imm": _MODELS,
    "input-estimation": "motion: {q: 0.1}, window_s: 10, min_window_s: 4",
    "mmpf": _MODELS,
    "vdf": "nmf: {q: 0.1}, mf: {q: 0.01}, eta: 20",
}
"""Values of the keys that have no default."""
_PLANE = """\
  T: 2
  last: 50
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 3000, vx: 20, y: 2000, vy: -90}}
  sensor: @SENSOR@
  start: two-scan"""
_SCENARIOS = [
    _PLANE.replace("@SENSOR@", "{kind: position, sigma: 20}"),
    _PLANE.replace("@SENSOR@", "{kind: range-azimuth, sigma_range: 20, sigma_azimuth_mrad: 5}"),
    """\
  T: 0.5
  last: 5
  target:
    kind: driven
    motion: {kind: map, components: [a, b], next: {a: a + b*T, b: b - sin(a)*T}, Q: 0.01}
    initial: {a: 1}
  sensor: {kind: function, h: {z: a}, R: 0.1}
  start: {kind: gaussian, sigma: [0.1, 0.1]}""",
    """\
  first: 1
  last: 50
  target: {kind: driven, motion: sine-gamma, launch: {x: 1}}
  sensor: {kind: square-then-line, R: 0.1}
  start: known""",
]
"""Keys of the scenarios that are tried, one after the other."""


def parts_of_copy(kind: str) -> dict[str, str]:
    """Fill a template's marks for a filter of this kind; raises UserError."""
    known = kinds("filters")
    cls = known.get(kind)
    if cls is None:
        what = f"{kind!r} is not a kind of filter; {unknown(kind, list(known))}"
        raise UserError(Problem(Mark("--from"), "", what))
    if issubclass(cls, Filter) and cls.runs_program:
        what = f"{kind!r} is a program: `trackbench new filter NAME --language` writes one"
        raise UserError(Problem(Mark("--from"), "", what))
    owner = next(base for base in cls.__mro__ if "step" in vars(base))
    source = dedent(inspect.getsource(vars(owner)["step"]))
    module = inspect.getmodule(owner)
    assert module is not None
    imports = {
        *_imports(module, source).values(),
        ("dataclasses", "dataclass", ""),
        ("trackbench.registry", "register", ""),
        (cls.__module__, cls.__name__, ""),
    }
    methods = sorted(set(re.findall(r"\bself\.(\w+)\(", source)))
    keys = f", {_KEYS[kind]}" if kind in _KEYS else ""
    # A few particles, the default of these filters, are enough for one component.
    scenarios = _SCENARIOS[::-1] if hasattr(cls, "N") else _SCENARIOS
    scenario = _scenario(kind, keys, scenarios)
    return {
        "@IMPORTS@": _import_lines(imports),
        "@BASE@": cls.__name__,
        "@FROM@": kind,
        "@CALLS@": ", ".join(f"`{name}`" for name in methods) or "no other method",
        "@STEP@": "\n".join(f"    {line}".rstrip() for line in source.splitlines()),
        "@KEYS@": keys,
        "@ON@": " --on @MODULE@.yaml" if keys else "",
        "@ON_FILE@": ", CONFIG" if keys else "",
        "@SCENARIO@": scenario,
    }


def _scenario(kind: str, keys: str, scenarios: list[str]) -> str:
    """Find the first scenario on which the filter runs; raises UserError if it runs on none."""
    refused = UserError()
    for scenario in scenarios:
        text = f"name: a\nscenario:\n  kind: tracking\n{scenario}\nfilters:\n"
        try:
            load(parse(f"{text}  F: {{kind: {kind}{keys}}}\n", "config").data)
        except UserError as error:
            refused = error
        else:
            return scenario
    raise refused


def _imports(module: ModuleType, source: str) -> dict[str, _Import]:
    known = {name: (module.__name__, name, "") for name in vars(module)}
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.ImportFrom | ast.Import):
            of = str(node.module) if isinstance(node, ast.ImportFrom) else ""
            for item in node.names:
                known[item.asname or item.name] = (of, item.name, item.asname or "")
    names = {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)}
    names |= set(re.findall(r"\w+", " ".join(re.findall(r'cast\("([^"]*)"', source))))
    return {name: known[name] for name in names & known.keys()}


def _import_lines(imports: Iterable[_Import]) -> str:
    named: dict[str, list[str]] = {}
    for of, name, alias in sorted(imports):
        named.setdefault(of, []).append(f"{name} as {alias}" if alias else name)
    lines = [(name, f"import {name}") for name in named.pop("", [])]
    for of, names in named.items():
        line = f"from {of} import {', '.join(names)}"
        if len(line) > _LINE:
            line = f"from {of} import (\n" + "".join(f"    {name},\n" for name in names) + ")"
        lines.append((of, line))
    own = [line for of, line in lines if of.partition(".")[0] in sys.stdlib_module_names]
    return "\n".join([*own, "", *(line for _, line in lines if line not in own)])
