"""The digest of a block's code covers every module that a worker imports, or lists it with a reason."""

import ast
import json
import pickle
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trackbench
from tests.conftest import PLANE, forget_facts
from tests.papers import merwe
from trackbench.config.load import load
from trackbench.core import elementary, linalg, random_variates, sums
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution import arithmetic_digests, block_key, code_digests, compute_batch
from trackbench.execution.code_digests import NO_PART_OF_BLOCKS, block_sources, code_digest
from trackbench.execution.plan import make_plan
from trackbench.filters.bootstrap_pf import PF
from trackbench.models.assume import Assume
from trackbench.models.motions.merwe_sine_gamma import SineGamma

HOME = Path(trackbench.__file__).parent
DIGESTED = {path.relative_to(HOME).as_posix() for path in block_sources(HOME)}
WORKER = """
import json, pickle, sys
from trackbench.execution.compute_batch import compute, environment_digests
tasks, plugins = pickle.load(sys.stdin.buffer)
for task in tasks:
    compute(task, plugins, environment_digests())
print(json.dumps([n for n in sys.modules if n.partition(".")[0] == "trackbench"]))
"""
CONFIG = f"""name: c
runs: 2
block: 2
{PLANE}
plugins: [plain.py]
filters:
  KF: {{kind: kf}}
  PF: {{kind: pf, N: 20}}
  MMPF:
    kind: mmpf
    N: 20
    motions: [{{kind: cv, q: 1}}, {{kind: cv, q: 9}}]
    transition: [[0.9, 0.1], [0.1, 0.9]]
  Plain: {{kind: plain}}
hold_out: 3
"""
PLUGIN = """
from filterpy.kalman import KalmanFilter
from trackbench.adapters import FilterPy

class Plain(FilterPy, kind="plain"):
    def make(self, dt):
        made = KalmanFilter(dim_x=4, dim_z=2)
        made.F, made.Q = self.model.motion.F, self.model.motion.Q
        made.H, made.R = self.model.sensor.H(), self.model.sensor.R
        return made
"""


def _module_file(name: str) -> str:
    """``trackbench.a.b`` as the path of its file below the package."""
    path = HOME.joinpath(*name.split(".")[1:])
    if (source := path.with_suffix(".c")).is_file():
        return source.relative_to(HOME).as_posix()
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return file.relative_to(HOME).as_posix()


def _is_docstring(file: str) -> bool:
    """Whether a source holds nothing but its docstring."""
    body = ast.parse((HOME / file).read_text()).body
    return all(isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant) for n in body)


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """Files of the package that a fresh process imports to compute a block of each filter."""
    pytest.importorskip("filterpy")
    folder = tmp_path_factory.mktemp("worker")
    (folder / "plain.py").write_text(PLUGIN)
    (folder / "c.yaml").write_text(CONFIG)
    plan = make_plan(load(folder / "c.yaml", allow_plugins=True))
    work = pickle.dumps(([pickle.dumps([task]) for task in plan.unique], plan.plugins))
    command = [sys.executable, "-W", "error", "-c", WORKER]
    done = subprocess.run(command, input=work, capture_output=True, check=True, timeout=60)
    return {_module_file(name) for name in json.loads(done.stdout)}


def test_every_module_of_a_worker_is_digested_or_listed(imported: set[str]) -> None:
    assert {"metrics.py", "filters/jump_markov_base.py", "adapters/per_run.py"} <= imported
    left = imported - DIGESTED - NO_PART_OF_BLOCKS.keys()
    assert not {file for file in left if not _is_docstring(file)}


def test_every_listed_module_is_needed_in_the_list(imported: set[str]) -> None:
    """In a digested folder: none that a worker imports. Elsewhere: only what a worker imports."""
    folders = {Path(file).parent for file in DIGESTED} - {Path()}
    for file, reason in NO_PART_OF_BLOCKS.items():
        assert (HOME / file).is_file(), file
        assert reason, file
        assert (file in imported) != (Path(file).parent in folders - {Path("execution")})


def _imports(file: str) -> Iterator[str]:
    """Files of the package that a source imports anywhere, but for the types' sake."""
    if not file.endswith(".py"):
        return
    waiting: list[ast.AST] = [ast.parse((HOME / file).read_text())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            continue
        waiting += ast.iter_child_nodes(node)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("trackbench"):
            names = [f"{node.module}.{a.name}" for a in node.names]
            inner = [_module_file(n) for n in names if (HOME / _module_file(n)).is_file()]
            yield from inner or [_module_file(str(node.module))]
        elif isinstance(node, ast.Import):
            yield from (_module_file(a.name) for a in node.names if a.name.startswith("trackbench"))


def test_digested_code_imports_nothing_that_is_not_digested() -> None:
    """Not even later, inside a function: what changes a block's numbers is digested with it."""
    found = {(file, other) for file in DIGESTED for other in _imports(file)}
    reports = {"errors.py", "crash_signals.py"}  # of failures: a failed block is not stored
    left = {(file, other) for file, other in found if other not in DIGESTED | reports}
    # The worker's own imports are those of the process above.
    assert {file for file, _ in left} == {"execution/compute_batch.py"}


@pytest.mark.parametrize(
    "file",
    [
        *("metrics.py", "core/_compiled.c"),
        *("filters/bootstrap_pf.py", "evaluation/error_series.py"),
    ],
)
def test_the_code_digest_follows_the_source(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for source in sorted(block_sources(HOME)):
        copy = tmp_path / source.relative_to(HOME)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(source.read_bytes())
    monkeypatch.setattr(trackbench, "__file__", str(tmp_path / "__init__.py"))
    first = code_digest.__wrapped__()
    (tmp_path / "evaluation" / "summary_rows.py").write_text("# after blocks\n")
    assert code_digest.__wrapped__() == first
    with (tmp_path / file).open("a") as appended:
        appended.write("# edited\n")
    assert code_digest.__wrapped__() != first


def test_a_foreign_package_is_digested_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its files may have the names of those that the package's own digest leaves out."""
    (tmp_path / "theirs" / "evaluation").mkdir(parents=True)
    for name in ("__init__.py", "evaluation/__init__.py", "evaluation/summary_rows.py"):
        (tmp_path / "theirs" / name).write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    import theirs  # type: ignore[import-not-found]

    first = code_digests.package_digest.__wrapped__("theirs")
    (tmp_path / "theirs" / "evaluation" / "merge.py").write_text("x = 1\n")
    assert code_digests.package_digest.__wrapped__("theirs") != first
    assert theirs is sys.modules.pop("theirs")


@dataclass(frozen=True, kw_only=True)
class Mine(PF):
    """A filter of one's own."""


OWN = BlockTask(merwe(T=3), PF(N=4), seed=1, index=0, width=2, runs_used=2)
FOREIGN = BlockTask(merwe(T=3), Mine(N=4), seed=1, index=0, width=2, runs_used=2)
NUMPYS = BlockTask(merwe(T=3, gamma_shape=0.5), PF(N=4), seed=1, index=0, width=2, runs_used=2)
ASSUMED = replace(OWN, assume=Assume(motion=SineGamma(gamma_shape=0.5)))
KNOWN = replace(OWN, assume=Assume(motion=SineGamma()))


@pytest.mark.parametrize(
    ("task", "apart"),
    [(OWN, False), (FOREIGN, True), (NUMPYS, True), (ASSUMED, True), (KNOWN, False)],
)
def test_keys_follow_numpys_arithmetic_where_it_matters(
    task: BlockTask, apart: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(block_key, "as_config", lambda part, shown: repr(part))
    forget_facts()
    here = block_key.block_key(task, 2)
    monkeypatch.setattr(arithmetic_digests, "numpy_arithmetic", lambda: "of another processor")
    forget_facts()
    assert (block_key.block_key(task, 2) != here) == apart
    monkeypatch.setattr(arithmetic_digests, "own_arithmetic", lambda: "of no IEEE machine")
    forget_facts()
    assert block_key.block_key(task, 2) != here
    forget_facts()


def test_a_worker_refuses_what_may_come_out_otherwise() -> None:
    here = compute_batch.environment_digests()
    other = here._replace(numpy="of another processor")
    assert compute_batch.compute(pickle.dumps([OWN]), (), other)[0][2].width == 2
    for task in (FOREIGN, NUMPYS, ASSUMED):
        with pytest.raises(RuntimeError, match="numpy computes otherwise on this worker"):
            compute_batch.compute(pickle.dumps([task]), (), other)
    with pytest.raises(RuntimeError, match="not that of IEEE 754"):
        compute_batch.compute(pickle.dumps([OWN]), (), here._replace(arithmetic="of another"))
    with pytest.raises(RuntimeError, match="another version"):
        compute_batch.compute(pickle.dumps([OWN]), (), here._replace(code="of another"))


OWN_FUNCTIONS = [
    *[(elementary, name) for name in ("exp", "log", "cos_sin", "arctan2")],
    *[(sums, name) for name in ("total", "dot")],
    *[(linalg, name) for name in ("inverse", "matmul", "product")],
    *[(random_variates, name) for name in ("halved_normals", "exponentials")],
    *[(RunStreams, name) for name in ("standard_normal", "standard_gamma")],
]
NUMPYS_FUNCTIONS = [
    *[
        (np, name)
        for name in ("exp", "log", "log1p", "expm1", "sin", "cos", "tan", "arctan", "sqrt")
    ],
    *[(np, name) for name in ("arctan2", "hypot", "power", "vecdot", "einsum")],
    *[(np.linalg, name) for name in ("cholesky", "inv")],
]


@pytest.mark.parametrize(
    ("digested", "home", "name"),
    [
        *[(arithmetic_digests.own_arithmetic, *function) for function in OWN_FUNCTIONS],
        *[(arithmetic_digests.numpy_arithmetic, *function) for function in NUMPYS_FUNCTIONS],
    ],
)
def test_one_bit_of_any_function_is_another_arithmetic(
    digested: Any, home: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, right = digested(), getattr(home, name)

    def wrong(*given: Any, **keys: Any) -> Any:
        return one_bit_off(right(*given, **keys))

    monkeypatch.setattr(home, name, wrong)
    assert digested.__wrapped__() != here


def one_bit_off(found: Any) -> Any:
    """An array, or several, of which a number in the middle of the last is the next larger one."""
    if isinstance(found, tuple):
        return (*found[:-1], one_bit_off(found[-1]))
    other = np.array(found)
    other.flat[other.size // 2 // 97 * 97] += np.spacing(other.flat[other.size // 2 // 97 * 97])
    return other


def test_arithmetic_is_tried_on_numbers_all_over_the_unit_interval() -> None:
    for x in arithmetic_digests._inputs():
        assert 0.0 < x.min() < 0.001 < 0.999 < x.max() < 1.0
        assert np.histogram(x, 64, (0.0, 1.0))[0].min() > 64
