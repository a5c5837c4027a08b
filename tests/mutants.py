"""Report which tests notice a wrong sign, factor, index, comparison or omission: one change at a time.

``python -m tests.mutants --per-file 2 trackbench/core trackbench/filters trackbench/evaluation``. Each
mutant is made in a copy of the package, and the tests that call the changed function run on it, those of
its module first, then the fastest, until one fails. One run of the tests finds who calls what, and how
long it takes; it is kept in ``build/mutants.json``. Digests that are pinned notice anything, so they are
left out. ``mutants.md`` says what was found, and of each mutant that survived why it may.
"""

import argparse
import ast
import compileall
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from py_compile import PycInvalidationMode
from types import CodeType, FrameType
from typing import Any, NamedTuple

import pytest

HERE = Path(__file__).resolve().parent.parent
PINNED = ("test_machines", "test_pinned", "test_matrix")
CALLS = HERE / "build" / "mutants.json"
REASONS = HERE / "tests" / "mutants.md"
PYTEST = (sys.executable, "-m", "pytest", "-q", "-rfE", "--no-header", "-p", "no:cacheprovider")
_OPERATORS: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", ">"),
    ast.LtE: ("<=", ">"),
    ast.Gt: (">", "<"),
    ast.GtE: (">=", "<"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
}
_JOINS = {"and": "or", "or": "and"}
_CALLS = {"all": "any", "any": "all", "min": "max", "max": "min"}


class Mutant(NamedTuple):
    """Text of a file that is put in the place of another, from offset to offset."""

    file: Path
    line: int
    start: int
    end: int
    new: str

    def shown(self, text: str) -> str:
        """Return the line, or the lines of a list or call, before and after."""
        first = text.rfind("\n", 0, self.start) + 1
        last = text.find("\n", self.end)
        line, changed = text[first:last], text[first : self.start] + self.new
        lines = line, changed + text[self.end : last]
        return "  ->  ".join(re.sub(r"\s*\n\s*", " ", each.strip()) for each in lines)


def mutants(file: Path) -> list[Mutant]:
    """Every mutant of a file's functions: what is computed, no texts, types or defaults."""
    text = file.read_text()
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node in _computed(ast.parse(text)):
        for left, right, new in _changes(node, text, starts):
            found.append(Mutant(file, node.lineno, left, right, new))
    return sorted(set(found), key=lambda mutant: mutant.start)


def _computed(tree: ast.AST) -> Iterator[ast.expr]:
    """Expressions in bodies of functions; not those of errors that are raised."""
    functions = (ast.FunctionDef, ast.Lambda)
    stack: list[tuple[ast.AST, bool]] = [(tree, False)]
    while stack:
        node, inside = stack.pop()
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.arguments):
            continue
        if inside and isinstance(node, ast.expr):
            yield node
        body = node.body if isinstance(node, ast.FunctionDef) else list(ast.iter_child_nodes(node))
        stack += [(child, inside or isinstance(node, functions)) for child in body]


def _changes(node: ast.expr, text: str, starts: Sequence[int]) -> Iterator[tuple[int, int, str]]:
    def offset(line: int, column: int) -> int:
        return len(text.encode()[: starts[line - 1] + column].decode())

    begin = offset(node.lineno, node.col_offset)
    end = offset(node.end_lineno or 0, node.end_col_offset or 0)
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        yield from _between(node.left, node.right, _OPERATORS[type(node.op)], text, offset)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARISONS:
        pair = _COMPARISONS[type(node.ops[0])]
        yield from _between(node.left, node.comparators[0], pair, text, offset)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield begin, begin + 1, "+"
    elif isinstance(node, ast.BoolOp):
        join = "and" if isinstance(node.op, ast.And) else "or"
        for left, right in pairwise(node.values):
            yield from _between(left, right, (join, _JOINS[join]), text, offset)
    elif isinstance(node, ast.List | ast.Call):
        yield from _omissions(node, offset)
        name = (
            node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
        )
        if name in _CALLS:
            yield begin, begin + len(name), _CALLS[name]
    elif isinstance(node, ast.Constant) and type(node.value) is int:
        yield begin, end, str({0: 1, 1: 2}.get(node.value, node.value - 1))
    elif isinstance(node, ast.Constant) and type(node.value) is float:
        yield begin, end, repr(2.0 * node.value or 1.0)


def _omissions(node, offset):  # type: ignore[no-untyped-def]
    """Leave out one item of a list, or one keyword of a call."""
    items = node.elts if isinstance(node, ast.List) else [*node.args, *node.keywords]
    left_out = node.elts if isinstance(node, ast.List) else node.keywords
    ends = [(offset(i.lineno, i.col_offset), offset(i.end_lineno, i.end_col_offset)) for i in items]
    for i, item in enumerate(items):
        if len(items) > 1 and item in left_out:
            yield (ends[i - 1][1], ends[i][1], "") if i else (ends[0][0], ends[1][0], "")


def _between(left, right, pair, text, offset):  # type: ignore[no-untyped-def]
    low = offset(left.end_lineno, left.end_col_offset)
    high = offset(right.lineno, right.col_offset)
    found = re.search(r"(?<![*/<>=])" + re.escape(pair[0]) + r"(?![*/=])", text[low:high])
    if found:
        yield low + found.start(), low + found.end(), pair[1]


def chosen(paths: Sequence[str], per_file: int, seed: int) -> list[Mutant]:
    """So many mutants of each file, at random."""
    files = [file for path in paths for file in sorted(Path(path).rglob("*.py")) or [Path(path)]]
    picked = []
    for file in files:
        found = mutants(file)
        rng = random.Random(f"{seed} {file}")
        picked += rng.sample(found, min(per_file, len(found)))
    return picked


class Calls:
    """A plugin of pytest: of each test its CPU seconds, and what functions of the package it calls."""

    def __init__(self) -> None:
        self.found: dict[str, tuple[float, list[str]]] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Trace one test with its fixtures."""
        seen: set[CodeType] = set()

        def called(frame: FrameType, event: str, arg: object) -> None:
            seen.add(frame.f_code)

        began = time.process_time()
        sys.settrace(called)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            places = {f"{code.co_filename}:{code.co_firstlineno}" for code in seen}
            inside = f"{os.getcwd()}/trackbench/"
            names = sorted(
                place[len(os.getcwd()) + 1 :] for place in places if place.startswith(inside)
            )
            self.found[item.nodeid] = time.process_time() - began, names

    def pytest_sessionfinish(self) -> None:
        """Write it all."""
        CALLS.parent.mkdir(exist_ok=True)
        CALLS.write_text(json.dumps(self.found, indent=0))


def pytest_configure(config: pytest.Config) -> None:
    """With ``-p tests.mutants``."""
    config.pluginmanager.register(Calls())


def function(file: Path, line: int) -> str:
    """Where the innermost function around a line begins, with its decorators."""
    tree = ast.parse((HERE / file).read_text())
    around = [
        min(part.lineno for part in (node, *node.decorator_list))
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.lineno <= line <= (node.end_lineno or 0)
    ]
    return f"{file}:{max(around, default=0)}"


def nearest(
    file: Path, line: int, calls: dict[str, tuple[float, list[str]]], limit: float
) -> list[str]:
    """Tests that call the function of a line, in the order in which they are likely to notice."""
    place = function(file, line)
    callers = {test for test, (_, places) in calls.items() if place in places}
    homes = {test.split("::")[0] for test in callers}
    if not homes:  # what is called where a module is imported
        homes = {test.split("::")[0] for test in calls if f"/{file.parent.name}/" in test}

    def order(test: str) -> tuple[bool, bool, float]:
        home = test.split("::")[0]
        return test not in callers, file.stem not in Path(home).stem, calls[test][0]

    found, seconds = [], 0.0
    # A remembered function (core/arrays.py) is not called again, so neighbors may know it, too.
    for test in sorted((test for test in calls if test.split("::")[0] in homes), key=order):
        seconds += calls[test][0]
        if seconds > limit:
            break
        found.append(test)
    return found


def noticed(mutant: Mutant, copy: Path, tests: Sequence[str]) -> str:
    """The first test that fails on the mutant, else ""; two files' tests are tried before the rest."""
    text = (HERE / mutant.file).read_text()
    target = copy / mutant.file
    target.write_text(text[: mutant.start] + mutant.new + text[mutant.end :])
    homes = list(dict.fromkeys(test.split("::")[0] for test in tests))[:2]
    first = [test for test in tests if test.split("::")[0] in homes][:30]
    try:
        return _failing(copy, first) or _failing(copy, [t for t in tests if t not in first])
    finally:
        target.write_text(text)


def _failing(copy: Path, tests: Sequence[str]) -> str:
    if not tests:
        return ""
    try:
        done = _run(copy, ["-x", *tests], timeout=1200)
    except subprocess.TimeoutExpired:
        return "never ends"
    failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", done.stdout, re.MULTILINE)
    return "" if done.returncode == 0 else failed[1] if failed else "not even imported"


def _run(folder: Path, more: Sequence[str], **keys: Any) -> subprocess.CompletedProcess[str]:
    alone = {"PYTHONPATH": str(folder), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    env = {**os.environ, **alone}
    return subprocess.run(
        [*PYTEST, *more], cwd=folder, env=env, capture_output=True, text=True, **keys
    )


def calls_of(tests: Sequence[str]) -> dict[str, tuple[float, list[str]]]:
    """Of each test its seconds and the functions that it calls; of an earlier run if there was one."""
    if not CALLS.exists():
        left_out = [f"--ignore-glob=*{name}.py" for name in PINNED]
        done = _run(HERE, ["-p", "tests.mutants", *left_out, *tests])
        if done.returncode:  # a test that fails without a mutant notices nothing
            CALLS.unlink(missing_ok=True)
            sys.exit(done.stdout[-2000:] + done.stderr[-2000:])
    found: dict[str, tuple[float, list[str]]] = json.loads(CALLS.read_text())
    return found


def copied(folder: str) -> Path:
    """The repository without results, with bytecode that knows its source by digest."""
    copy = Path(folder) / "copy"
    out = shutil.ignore_patterns(".*", "build", "__pycache__", "*.egg-info")
    at_the_top = {str(HERE): {"results"}}  # trackbench/results is a package
    shutil.copytree(HERE, copy, ignore=lambda at, names: out(at, names) | at_the_top.get(at, set()))
    (copy / "results").symlink_to(HERE / "results")
    mode = PycInvalidationMode.CHECKED_HASH
    compileall.compile_dir(copy / "trackbench", quiet=1, invalidation_mode=mode)
    return copy


def main() -> int:
    """Print every mutant with the test that notices it; 1 if one survives without a reason."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="+")
    parser.add_argument("--per-file", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--tests", nargs="*", default=["tests"], help="of which the calls are found"
    )
    parser.add_argument(
        "--limit", type=float, default=60.0, help="CPU seconds for a mutant's tests"
    )
    given = parser.parse_args()
    os.chdir(HERE)
    calls, reasons = calls_of(given.tests), REASONS.read_text()
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        copy = copied(folder)
        for mutant in chosen(given.paths, given.per_file, given.seed):
            shown = mutant.shown((HERE / mutant.file).read_text())
            who = noticed(mutant, copy, nearest(mutant.file, mutant.line, calls, given.limit))
            row = f"| {mutant.file.relative_to('trackbench')} | `{shown}` |"
            who = who or ("survives, as it may" if row in reasons else "SURVIVES")
            found[who] += 1
            print(f"{mutant.file}:{mutant.line}\t{who}\t{shown}", flush=True)
        wrong = _failing(copy, [who for who in found if who in calls])
    print(f"{found.total()} mutants, {found['SURVIVES']} survive without a reason")
    if wrong:
        print(f"{wrong} fails without any mutant: {found[wrong]} were not noticed by it")
    return bool(found["SURVIVES"] or wrong)


if __name__ == "__main__":
    sys.exit(main())
