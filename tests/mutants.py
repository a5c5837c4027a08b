"""Which tests notice a wrong sign, factor, index or comparison? One change of one line at a time.

``python -m tests.mutants --per-file 3 trackbench/core trackbench/filters trackbench/evaluation``. Each
mutant is made in a copy of the package, and the tests that know the changed module run on it, nearest
first, until one fails. Digests that are pinned notice anything, so they are left out.
"""

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent.parent
PINNED = ("test_machines", "test_pinned", "test_matrix")
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
}


class Mutant(NamedTuple):
    """Text of a file that is put in the place of another, from offset to offset."""

    file: Path
    line: int
    start: int
    end: int
    new: str

    def shown(self, text: str) -> str:
        """The line before and after."""
        first = text.rfind("\n", 0, self.start) + 1
        last = text.find("\n", self.end)
        line, changed = text[first:last], text[first : self.start] + self.new
        return f"{line.strip()}  ->  {(changed + text[self.end : last]).strip()}"


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
        if inside and isinstance(node, ast.BinOp | ast.Compare | ast.Constant | ast.UnaryOp):
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
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        other = {0: "1", 1: "2"}.get(node.value) if type(node.value) is int else None
        yield begin, end, other or f"{node.value * 2 + (node.value == 0)!r}"


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


def nearest(file: Path) -> list[str]:
    """Test files in the order in which they are likely to notice: by what they import and are called."""
    module = ".".join(file.with_suffix("").parts)
    tests = [t for t in sorted(Path("tests").rglob("test_*.py")) if t.stem not in PINNED]

    def distance(test: Path) -> tuple[bool, bool, bool, int]:
        text = test.read_text()
        same_name = file.stem not in test.stem
        return same_name, module not in text, file.parent.name != test.parent.name, len(text)

    near = [t for t in sorted(tests, key=distance) if any(not far for far in distance(t)[:3])]
    reference = [t for t in tests if t.parent.name == "reference"]
    return list(dict.fromkeys(str(t) for t in near + reference))


def noticed(mutant: Mutant, copy: Path, limit: float) -> str:
    """The first test that fails on the mutant, else "" or that it took too long."""
    text = (HERE / mutant.file).read_text()
    target = copy / mutant.file
    target.write_text(text[: mutant.start] + mutant.new + text[mutant.end :])
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-rfE",
        "--no-header",
        "-p",
        "no:cacheprovider",
    ]
    env = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [*command, *nearest(mutant.file)],
            cwd=copy,
            env=env,
            capture_output=True,
            text=True,
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        return f"none in {limit:g} s"
    finally:
        target.write_text(text)
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    return "" if done.returncode == 0 else failed[1] if failed else "not even imported"


def main() -> None:
    """Print every mutant with the test that notices it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="+")
    parser.add_argument("--per-file", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=600.0, help="seconds for a mutant's tests")
    given = parser.parse_args()
    os.chdir(HERE)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in ("trackbench", "tests", "experiments", "docs", "pyproject.toml"):
            source = HERE / name
            if source.is_dir():
                shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, copy / name)
        (copy / "results").symlink_to(HERE / "results")
        for mutant in chosen(given.paths, given.per_file, given.seed):
            who = noticed(mutant, copy, given.limit)
            shown = mutant.shown((HERE / mutant.file).read_text())
            print(f"{mutant.file}:{mutant.line}\t{who or 'SURVIVES'}\t{shown}", flush=True)


if __name__ == "__main__":
    main()
