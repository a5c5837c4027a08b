"""The house: imports go down only, and nothing heavy is imported before it is needed."""

import ast
import inspect
import json
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import trackbench
from tests.conftest import ROOT
from trackbench.registry import kinds

PACKAGE = Path(trackbench.__file__).parent
LAYERS = (
    (
        "core",
        "metrics",
        "units_of_components",
        "component_parts",
        "entry_points",
        "plugin_class_hooks",
        "field_types",
        "errors",
        "crash_signals",
        "readable_files",
        "folder_digests",
        "durations",
    ),
    ("atomic_files", "progress_bar", "yaml_scalars", "registry"),
    ("csv_writer", "unsafe_characters", "yaml_mistakes"),
    ("yaml_source",),
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
    ("api", "starting_files"),
    ("new_experiment_from_tables",),
    ("verify",),
    ("cli",),
    ("__main__",),
)
"""Packages and modules from the bottom up: each imports only from layers below its own."""
FREE = {*LAYERS[0]}
"""Layer 0: its modules may import each other, without a circle."""
LAYER = {name: i for i, layer in enumerate(LAYERS) for name in layer}


@cache
def _nodes(path: Path) -> list[ast.AST]:
    """The nodes of a file that import."""
    tree = ast.parse(path.read_text())
    return [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]


def _imports(path: Path) -> set[str]:
    found = set()
    for node in _nodes(path):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relative to its folder"
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("trackbench."):
            found.add(str(node.module).split(".")[1])
        if isinstance(node, ast.ImportFrom) and node.module == "trackbench":
            found |= {a.name for a in node.names if a.name in LAYER}
        if isinstance(node, ast.Import):
            found |= {a.name.split(".")[1] for a in node.names if a.name.startswith("trackbench.")}
    return found


REPORT = (
    (
        "findings.phrases",
        "findings.metric_phrases",
        "findings.grid_headings",
        "rounded_numbers",
        "latex_table",
        "markdown_table",
        "notebook_html",
        "table",
        "primary_metrics",
        "mean_or_rms_of_metric",
        "default_error_table_and_figure",
        "pairs_of_filters",
        "contributions_of_steps",
    ),
    (
        "plotting",
        "key_figure",
        "output_errors",
        "plugin_tables_and_figures",
        "units_of_config_keys",
    ),
    ("tables_and_figures",),
    ("points_by_scenario", "filter_setting_labels"),
    ("expressions",),
    ("cost_curves", "uniformity_of_ranks", "verdicts"),
    ("findings",),
    ("best_filters_in_figures", "kinds"),
    ("tables",),
    ("figures",),
    (
        "figure_cache",
        "drawing_pool",
        "figure_drawing",
        "table_and_figure_files",
        "render",
        "drawing_preload",
        "number_of_drawers",
        "folder_check",
        "sweep_csv",
        "sweep_tables_and_figures",
        "folder_comparison",
        "suite",
    ),
    ("html",),
    ("overview",),
)
"""Inner layers of ``report/`` from the bottom up. Captions rank the filters: figures use findings."""
REPORT_LAYER = {f"trackbench.report.{m}": i for i, layer in enumerate(REPORT) for m in layer}


def _report_layer(module: str) -> int:
    """The layer of the longest name in `REPORT` that a module is or is in."""
    within = [name for name in REPORT_LAYER if f"{module}.".startswith(f"{name}.")]
    assert within, f"{module} has no layer in tests/test_layers.py"
    return REPORT_LAYER[max(within, key=len)]


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
    for node in _nodes(path):
        if isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{a.name}" for a in node.names} | {str(node.module)}
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
    return found & names


def _is_logic(node: ast.stmt) -> bool:
    """Whether a statement is none of a docstring, an import and ``__all__``."""
    if isinstance(node, ast.Assign):
        return ast.unparse(node.targets[0]) != "__all__"
    return not isinstance(node, ast.Expr | ast.Import | ast.ImportFrom)


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*/__init__.py")), ids=_name)
def test_no_init_file_has_logic(path: Path) -> None:
    """Nobody guesses that a rule stands in a file whose name says nothing; the API's file apart."""
    assert not [ast.unparse(node) for node in ast.parse(path.read_text()).body if _is_logic(node)]


def test_no_files_import_each_other_in_a_circle() -> None:
    """Nor by an import within a function; the package itself, which any import begins with, apart."""
    names = {_name(path) for path in _modules()}
    graph = {_name(path): _imported(path, names) for path in _modules()}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_imports_within_the_report_go_down_only() -> None:
    """Within a layer, too, no files import each other: that is the test above."""
    files = {_name(p): p for p in (PACKAGE / "report").rglob("*.py") if p.name != "__init__.py"}
    for name, path in files.items():
        for other in _imported(path, files.keys()):
            assert _report_layer(other) <= _report_layer(name), f"{name} imports {other}"


def test_the_design_names_every_package_and_module() -> None:
    layers = (ROOT / "docs" / "architecture.md").read_text().split("```")[3]
    for room in LAYER.keys() - {"__main__"}:
        assert re.search(rf"\b{room}(/|\.py)", layers), room


EARLY = """
-m trackbench --help: numpy scipy pandas matplotlib pydantic yaml
-m trackbench list: numpy scipy pandas matplotlib yaml tqdm
-m trackbench check hdepf: scipy pandas matplotlib.pyplot trackbench.filters.adaptive_kf
-c import trackbench.execution.compute_batch: scipy pandas pydantic yaml
-c import trackbench.execution.forkserver_preload: pandas yaml matplotlib
-c import trackbench.results.read_folder: scipy pandas matplotlib trackbench.report\
 trackbench.scenarios.tracking
-c import trackbench.commands.read_and_rewrite_stored_results: pandas matplotlib tqdm\
 trackbench.tuning.tuner trackbench.commands.run_experiment
"""
"""Commands, and modules that they do not import."""


@pytest.mark.parametrize("line", EARLY.strip().splitlines())
def test_nothing_heavy_is_imported_early(line: str) -> None:
    command, _, unwanted = line.partition(": ")
    words = command.split(maxsplit=1) if command.startswith("-c") else command.split()
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *words],
        capture_output=True,
        text=True,
        check=True,
        cwd=PACKAGE.parent,
    )
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert not imported & {*unwanted.split()}


def test_the_source_text_names_what_an_import_registers() -> None:
    """In a process that has imported nothing: every kind with its module and docstring."""
    program = "import json; from trackbench.registry import GROUPS, _homes; "
    program += "print(json.dumps({group: _homes(group) for group in GROUPS}))"
    read = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout
    for group, homes in json.loads(read).items():
        own = [(k, c) for k, c in kinds(group).items() if c.__module__.startswith("trackbench.")]
        expected = {kind: [cls.__module__, inspect.getdoc(cls)] for kind, cls in own}
        assert {
            k: [module, inspect.cleandoc(doc)] for k, (module, doc) in homes.items()
        } == expected
