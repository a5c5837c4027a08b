"""The house: imports go down only, and nothing heavy is imported before it is needed."""

import ast
import inspect
import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import trackbench
from tests.conftest import ROOT
from trackbench.registry import GROUPS, Group, _homes, kinds

PACKAGE = Path(trackbench.__file__).parent
LAYERS = (
    ("core", "metrics", "extension_points", "field_types", "errors"),
    ("atomic_files", "yaml_source", "registry"),
    ("models", "statistics"),
    ("scenarios", "filters"),
    ("adapters", "evaluation"),
    ("plugins",),
    ("config",),
    ("execution", "help"),
    ("tuning", "contract"),
    ("results",),
    ("report",),
    ("commands",),
    ("api", "scaffold"),
    ("verify_differences",),
    ("verify",),
    ("cli",),
    ("__main__",),
)
"""Packages and modules from the bottom up: each imports only from layers below its own."""
FREE = {"core", "metrics", "extension_points", "field_types", "errors"}
"""Layer 0: its modules may import each other, without a circle."""
LAYER = {name: i for i, layer in enumerate(LAYERS) for name in layer}


def _imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("trackbench."):
            found.add(str(node.module).split(".")[1])
        if isinstance(node, ast.Import):
            found |= {a.name.split(".")[1] for a in node.names if a.name.startswith("trackbench.")}
    return found


def _modules() -> list[Path]:
    return [p for p in PACKAGE.rglob("*.py") if p.name != "__init__.py" or p.parent != PACKAGE]


@pytest.mark.parametrize("path", _modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_down_only(path: Path) -> None:
    own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    for other in _imports(path) - {own}:
        assert LAYER[other] < LAYER[own] or {own, other} <= FREE, f"{path} imports {other}"


def _name(path: Path) -> str:
    """The module's full name."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(path: Path, names: set[str]) -> set[str]:
    """The modules among these that a file imports, at its top or within a function."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{a.name}" for a in node.names} | {str(node.module)}
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
    return found & names


def test_no_files_import_each_other_in_a_circle() -> None:
    """Nor by an import within a function; the package itself, which any import begins with, apart."""
    names = {_name(path) for path in _modules()}
    graph = {_name(path): _imported(path, names) for path in _modules()}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_the_design_names_every_package_and_module() -> None:
    layers = (ROOT / "docs" / "architecture.md").read_text().split("```")[3]
    for room in LAYER.keys() - {"__main__"}:
        assert re.search(rf"\b{room}(/|\.py)", layers), room


@pytest.mark.parametrize(
    ("command", "unwanted"),
    [
        (
            ["-m", "trackbench", "--help"],
            {"numpy", "scipy", "pandas", "matplotlib", "pydantic", "yaml"},
        ),
        (["-m", "trackbench", "list"], {"numpy", "scipy", "pandas", "matplotlib", "yaml", "tqdm"}),
        (
            ["-m", "trackbench", "check", "experiments/hdepf.yaml"],
            {"scipy", "pandas", "matplotlib.pyplot", "trackbench.filters.adaptive_kf"},
        ),
        (
            ["-c", "import trackbench.execution.worker"],
            {"scipy", "pandas", "pydantic", "yaml"},
        ),
        (
            ["-c", "import trackbench.execution.forkserver_preload"],
            {"pandas", "yaml", "matplotlib"},
        ),
        (
            ["-c", "import trackbench.commands.stored_results"],
            {
                "pandas",
                "matplotlib",
                "tqdm",
                "trackbench.commands.run_experiment",
                "trackbench.tuning.tuner",
            },
        ),
    ],
)
def test_nothing_heavy_is_imported_early(command: list[str], unwanted: set[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *command],
        capture_output=True,
        text=True,
        check=True,
        cwd=PACKAGE.parent,
    )
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert not imported & unwanted


@pytest.mark.parametrize("group", ["filters", "scenarios", "tables", "figures"])
def test_a_listing_reads_what_an_import_finds(group: Group) -> None:
    """In a process that has imported nothing, every kind and docstring that importing registers."""
    read = subprocess.run(
        [
            sys.executable,
            "-c",
            f"from trackbench.registry import *; print(documentation({group!r}))",
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    found = {kind: inspect.cleandoc(doc) for kind, doc in ast.literal_eval(read).items()}
    own = {k: c for k, c in kinds(group).items() if c.__module__.startswith("trackbench.")}
    assert found == {kind: inspect.getdoc(cls) for kind, cls in own.items()}


@pytest.mark.parametrize("group", GROUPS)
def test_the_home_of_every_kind_is_known_without_importing_it(group: Group) -> None:
    own = {k: c.__module__ for k, c in kinds(group).items() if c.__module__[:11] == "trackbench."}
    assert _homes(group) == own
