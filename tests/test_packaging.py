"""The wheel stands alone, and what pyproject.toml and the lock files say of it is true."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from email import message_from_string
from importlib.metadata import packages_distributions, version
from pathlib import Path
from zipfile import ZipFile

import pytest
import yaml

import trackbench
from tests.commands import trackbench as command
from tests.conftest import EXPERIMENTS, ROOT
from trackbench.results.versions_and_commit import compare_lock, lock_file

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
PIN = re.compile(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)", re.MULTILINE)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("hatchling", reason="builds the wheel; `make test` installs it")
    out = tmp_path_factory.mktemp("dist")
    words = ("wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(out), str(ROOT))
    subprocess.run([sys.executable, "-m", "pip", *words], check=True, capture_output=True)
    (found,) = out.glob("*.whl")
    return found


def test_the_wheel_holds_code_experiments_and_lock(wheel: Path) -> None:
    with ZipFile(wheel) as archive:
        there = {name for name in archive.namelist() if ".dist-info/" not in name}
        (name,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        about = message_from_string(archive.read(name).decode())
    tracked = [p for p in (ROOT / "trackbench").rglob("*") if p.is_file()]
    wanted = {p.relative_to(ROOT).as_posix() for p in tracked if p.suffix != ".pyc"}
    shipped = [p for p in EXPERIMENTS.rglob("*") if p.is_file()]
    wanted |= {f"trackbench/{p.relative_to(ROOT).as_posix()}" for p in shipped}
    assert there == wanted | {"trackbench/requirements.txt"}
    assert about["License-Expression"] == "MIT"
    assert about["Version"] == trackbench.__version__


def test_the_wheel_runs_in_an_empty_folder(wheel: Path, tmp_path: Path) -> None:
    target, here = tmp_path / "site", tmp_path / "here"
    here.mkdir()
    words = ("install", "--no-deps", "--no-index", "--target", str(target), str(wheel))
    subprocess.run([sys.executable, "-m", "pip", *words], check=True, capture_output=True)

    def run(*words: str) -> str:
        found = {**os.environ, "PYTHONPATH": str(target)}
        options = {"capture_output": True, "text": True, "cwd": here, "env": found}
        done = subprocess.run([sys.executable, *words], timeout=120, **options)
        assert done.returncode == 0, done.stderr
        return str(done.stdout)

    where = run("-c", "import trackbench; print(trackbench.__file__)")
    assert where.strip() == str(target / "trackbench" / "__init__.py")
    assert "merwe2000" in run("-m", "trackbench", "list", "experiments")
    listed = run("-m", "trackbench", "list", "problems").splitlines()
    assert ["bearings-two", "v1"] in [line.split()[:2] for line in listed]
    run("-m", "trackbench", "run", "hdepf", "--quick", "--only", "PF", "--format", "svg")
    results = here / "results" / "hdepf"
    assert (results / "report.html").is_file()
    assert str(target) not in (results / "config.yaml").read_text()
    written = yaml.safe_load((results / "run" / "machine.json").read_text())
    assert written["lock"] == compare_lock()
    run("-m", "trackbench", "verify", "results/hdepf")


def test_version_is_said_once() -> None:
    said = f"trackbench {trackbench.__version__}"
    assert command("--version").stdout in (f"{said}, compiled kernels\n", f"{said}, numpy alone\n")


@pytest.mark.parametrize("name", ["run", "dev"])
def test_the_lock_names_one_version_of_all_that_is_needed(name: str) -> None:
    text = (ROOT / "requirements" / f"{name}.txt").read_text()
    pins = PIN.findall(text)
    assert len(dict(pins)) == len(pins), "one version for every Python and system"
    extra = PROJECT["optional-dependencies"]["dev"] if name == "dev" else []
    for needed in (*PROJECT["dependencies"], *extra):
        assert _name(needed) in dict(pins), needed
    for part in re.split(r"\n(?=\S)", text.strip()):
        assert part.startswith("#") or "--hash=sha256:" in part, part
    assert "://" not in text


def test_the_two_locks_agree() -> None:
    run, dev = (
        dict(PIN.findall((ROOT / "requirements" / f"{n}.txt").read_text())) for n in ("run", "dev")
    )
    assert run.items() <= dev.items()


def test_the_lowest_versions_are_the_projects_bounds() -> None:
    pins = dict(PIN.findall((ROOT / "requirements" / "lowest.txt").read_text()))
    for needed in PROJECT["dependencies"]:
        bound = needed.partition(">=")[2]
        found = pins[_name(needed)]
        assert found.removesuffix(".0").removesuffix(".0") == bound.removesuffix(".0"), needed


def test_the_lock_is_held_against_what_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = compare_lock()
    assert found["file"] == lock_file().relative_to(ROOT).as_posix()
    assert "numpy" not in found["other"] or found["other"]["numpy"] == version("numpy")
    other = tmp_path / "run.txt"
    other.write_text(
        "numpy==0.1 \\\n    --hash=sha256:00\npywin32==0.1 ; sys_platform == 'win32'\n"
    )
    monkeypatch.setattr("trackbench.results.versions_and_commit.lock_file", lambda: other)
    assert compare_lock()["other"] == {"numpy": version("numpy")}


def test_types_are_shipped() -> None:
    assert (ROOT / "trackbench" / "py.typed").read_text() == ""


def _name(requirement: str) -> str:
    return re.split(r"[\[><=]", requirement)[0].lower().replace("_", "-")


def _imported(tree: ast.AST) -> Iterator[str]:
    """Top-level names that a module imports, but for type checkers or where it may be missing."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module).partition(".")[0]
        elif isinstance(node, ast.Try) and "ImportError" in map(ast.unparse, _caught(node)):
            continue
        elif not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            yield from _imported(node)


def _caught(node: ast.Try) -> list[ast.expr]:
    return [handler.type for handler in node.handlers if handler.type is not None]


def test_every_import_is_a_named_dependency() -> None:
    extras = PROJECT["optional-dependencies"]
    named = [*PROJECT["dependencies"], *PYPROJECT["build-system"]["requires"]]
    named += [*extras["dask"], *extras["filterpy"], *extras["stonesoup"]]
    known = {_name(requirement) for requirement in named}
    distributions = packages_distributions()
    for path in (ROOT / "trackbench").rglob("*.py"):
        for module in _imported(ast.parse(path.read_text(encoding="utf-8"))):
            if module not in (*sys.stdlib_module_names, "trackbench"):
                owners = {_name(owner) for owner in distributions.get(module, [module])}
                assert owners & known, f"{path} imports {module}"


CONFIGS = (".ci/run", ".github/workflows/ci.yml", ".pre-commit-config.yaml", "Makefile")
REPOSITORY_PATH = re.compile(
    r"(?<![\w/.$)-])(?:benchmarks|docs|experiments|paper|requirements|results|tests|trackbench)"
    r"/[\w./*-]*(?![\w./*-]*[$%])"
)


@pytest.mark.parametrize("name", [*CONFIGS, "pyproject.toml"])
def test_paths_in_the_repositorys_own_configs_exist(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    in_the_wheel = PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    paths = set(REPOSITORY_PATH.findall(text)) - {*in_the_wheel.values()}
    missing = [path for path in paths if not [*ROOT.glob(path.rstrip("."))]]
    assert not missing
