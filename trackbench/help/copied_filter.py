"""Parts of a plugin that begins as a shipped filter: the copy of its `step`, and a config it runs on."""

import ast
import inspect
import re
import sys
from collections.abc import Iterable
from textwrap import dedent
from types import ModuleType
from typing import TypeAlias

from trackbench.config.load import load
from trackbench.config.mistakes import unknown
from trackbench.errors import Mark, Problem, UserError
from trackbench.filters.base import Filter
from trackbench.registry import kinds
from trackbench.yaml_source import parse

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
    """Return the text for each mark of the template of a filter that copies the kind's `step`.

    Raises UserError for an unknown kind and for a program.
    """
    known = kinds("filters")
    cls = known.get(kind)
    if cls is None:
        what = f"{kind!r} is not a kind of filter; {unknown(kind, list(known))}"
        raise UserError(Problem(Mark("--from"), "", what))
    if issubclass(cls, Filter) and cls.runs_program:
        what = f"{kind!r} is a program: `trackbench new filter NAME --language` writes one"
        raise UserError(Problem(Mark("--from"), "", what))
    # Step 1: the source of `step`, with the imports that it needs.
    owner = next(base for base in cls.__mro__ if "step" in vars(base))
    source = dedent(inspect.getsource(vars(owner)["step"]))
    module = inspect.getmodule(owner)
    assert module is not None
    imports = set(_needed_imports(module, source))
    imports.add(("dataclasses", "dataclass", ""))
    imports.add(("trackbench.registry", "register", ""))
    imports.add((cls.__module__, cls.__name__, ""))
    methods = sorted(set(re.findall(r"\bself\.(\w+)\(", source)))
    # Step 2: a scenario on which the filter runs. The last scenario has one component, for which the few
    # particles of a particle filter's default are enough: particle filters try it first.
    keys = ""
    on = ""
    on_file = ""
    if kind in _KEYS:
        keys = f", {_KEYS[kind]}"
        on = " --on @MODULE@.yaml"
        on_file = ", CONFIG"
    scenarios = list(_SCENARIOS)
    if hasattr(cls, "N"):
        scenarios.reverse()
    scenario = _find_scenario(kind, keys, scenarios)
    return {
        "@IMPORTS@": _import_lines(imports),
        "@BASE@": cls.__name__,
        "@FROM@": kind,
        "@CALLS@": ", ".join(f"`{name}`" for name in methods) or "no other method",
        "@STEP@": "\n".join(f"    {line}".rstrip() for line in source.splitlines()),
        "@KEYS@": keys,
        "@ON@": on,
        "@ON_FILE@": on_file,
        "@SCENARIO@": scenario,
    }


def _find_scenario(kind: str, keys: str, scenarios: list[str]) -> str:
    """Return the first of the scenarios on which a filter of this kind runs.

    ``keys`` are further keys of the filter, ``, q: 1``. Raises UserError if it runs on none.
    """
    last_error = UserError()
    for scenario in scenarios:
        text = f"name: a\nscenario:\n  kind: tracking\n{scenario}\nfilters:\n"
        try:
            load(parse(f"{text}  F: {{kind: {kind}{keys}}}\n", "config").data)
        except UserError as error:
            last_error = error
        else:
            return scenario
    raise last_error


def _needed_imports(module: ModuleType, source: str) -> list[_Import]:
    """Find the imports that a piece of a module's source needs."""
    # Step 1: the names that the module defines or imports.
    imports_by_name = {name: (module.__name__, name, "") for name in vars(module)}
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.ImportFrom | ast.Import):
            imported_module = ""
            if isinstance(node, ast.ImportFrom):
                imported_module = str(node.module)
            for alias in node.names:
                name_here = alias.asname or alias.name
                imports_by_name[name_here] = (imported_module, alias.name, alias.asname or "")
    # Step 2: the names in the source, also those in the types of casts.
    names = {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)}
    for type_text in re.findall(r'cast\("([^"]*)"', source):
        names |= set(re.findall(r"\w+", type_text))
    return [imports_by_name[name] for name in names & imports_by_name.keys()]


def _import_lines(imports: Iterable[_Import]) -> str:
    """Write imports, Python's own first."""
    # Step 1: the names of each module, with their aliases.
    names_by_module: dict[str, list[str]] = {}
    for module, name, alias in sorted(imports):
        text = f"{name} as {alias}" if alias else name
        names_by_module.setdefault(module, []).append(text)
    # Step 2: a line for each module; without a module, the name is that of one.
    lines = [(name, f"import {name}") for name in names_by_module.pop("", [])]
    for module, names in names_by_module.items():
        line = f"from {module} import {', '.join(names)}"
        if len(line) > _LINE:
            items = "".join(f"    {name},\n" for name in names)
            line = f"from {module} import (\n{items})"
        lines.append((module, line))
    # Step 3: two groups.
    standard_library = []
    other_packages = []
    for module, line in lines:
        if module.partition(".")[0] in sys.stdlib_module_names:
            standard_library.append(line)
        else:
            other_packages.append(line)
    return "\n".join([*standard_library, "", *other_packages])
