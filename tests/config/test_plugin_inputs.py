"""What a plugin imports and reads is part of its blocks' keys; it changes nothing of the package."""

import os
import site
import sqlite3
import subprocess
import sys
import zipfile
from collections.abc import Callable
from importlib import invalidate_caches
from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.conftest import plugins_forgotten
from tests.papers import merwe_text
from trackbench import api
from trackbench.errors import UserError
from trackbench.execution.block_key import block_key
from trackbench.execution.plan import make_plan
from trackbench.plugins.load import load_plugin
from trackbench.plugins.plugin_errors import PluginError, message_of

pytestmark = pytest.mark.usefixtures("no_report")

PLUGIN = '''
IMPORTS

from dataclasses import dataclass

import numpy as np

from trackbench.core.distributions import Gaussian
from trackbench.registry import register


@register("filters", "half")
@dataclass(frozen=True, kw_only=True)
class Half:
    """A factor of the prior."""

    def init(self, model, prior, rng):
        n, runs = prior.mean.shape
        return Gaussian(float(FACTOR) + 0.0 * prior.mean, np.ones((n, n, runs)))

    def step(self, model, state, z, k, rng):
        return state

    def estimate(self, state):
        return state
'''
CONFIG = """
name: own
runs: 4
block: 2
scenario: MERWE
plugins: [half.py]
DECLARED
filters:
  Half: {kind: half}
  UKF: {kind: ukf}
""".replace("MERWE", merwe_text(T=4))
RUN = ("run", "own.yaml", "--allow-plugins", "--workers", "1")
EDITS: dict[str, tuple[str, str, str, str]] = {
    "a module beside it": ("import helper", "helper.FACTOR", "helper.py", "FACTOR = {}"),
    "a module that this imports": (
        "import outer",
        "outer.helper.FACTOR",
        "helper.py",
        "FACTOR = {}",
    ),
    "a module on the path": ("import helper", "helper.FACTOR", "lib/helper.py", "FACTOR = {}"),
    "a module of a name in a text": (
        "import importlib\nhelper = importlib.import_module('hel' + 'per')",
        "helper.FACTOR",
        "helper.py",
        "FACTOR = {}",
    ),
    "an editable package": ("from theirs.inner import FACTOR", "FACTOR", "theirs", "FACTOR = {}"),
    "a file that importlib runs": (
        "from importlib.util import module_from_spec, spec_from_file_location\n"
        "from pathlib import Path\n"
        "spec = spec_from_file_location('x', Path(__file__).parent / 'parts' / 'x.py')\n"
        "x = module_from_spec(spec); spec.loader.exec_module(x)",
        "x.FACTOR",
        "parts/x.py",
        "FACTOR = {}",
    ),
    "a file that runpy runs": (
        "import runpy\nfrom pathlib import Path\n"
        "x = runpy.run_path(str(Path(__file__).parent / 'x.py'))",
        "x['FACTOR']",
        "x.py",
        "FACTOR = {}",
    ),
    "an import within a method": (
        "def late():\n    from helper import FACTOR\n    return FACTOR\n",
        "late()",
        "helper.py",
        "FACTOR = {}",
    ),
    "a module of a text within a method": (
        "import importlib\ndef late():\n    return importlib.import_module('helper').FACTOR\n",
        "late()",
        "helper.py",
        "FACTOR = {}",
    ),
    "a module of a text that counts from its package": (
        "import inner.late",
        "inner.late.late().FACTOR",
        "inner/helper.py",
        "FACTOR = {}",
    ),
    "weights": (
        "from pathlib import Path\nW = (Path(__file__).parent / 'w.txt').read_text()",
        "W",
        "w.txt",
        "{}",
    ),
}


def _run(folder: Path, **options: object) -> tuple[dict[str, int], float]:
    """The blocks of a run, and the first estimate's error of the plugin's filter."""
    report = api.run(
        folder / "own.yaml",
        out=folder / "out",
        allow_plugins=True,
        quiet=True,
        formats=(),
        **{"engine": "serial", **options},  # type: ignore[arg-type]
    )
    assert not report.failed, report.failed
    frame = report.per_run
    of_filter = frame[(frame["filter"] == "Half") & (frame["metric"] == "rmse")]
    return report.results.manifest["blocks"], float(of_filter["value"].mean())


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Writes the config and the plugin."""
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    before = {*sys.modules}

    def write(imports: str, factor: str, declared: str = "", folder: Path = tmp_path) -> None:
        plugin = PLUGIN.replace("IMPORTS", imports).replace("FACTOR)", f"{factor})")
        (folder / "half.py").write_text(plugin)
        (folder / "own.yaml").write_text(CONFIG.replace("DECLARED", declared))

    yield write
    for name in {*sys.modules} - before:
        if name.partition(".")[0] in ("helper", "outer", "inner", "theirs"):
            del sys.modules[name]


def _editable(folder: Path) -> Path:
    """Install a package of constant version as `pip install --editable` does; return its source."""
    home = folder / "checkout" / "theirs"
    home.mkdir(parents=True)
    (home / "__init__.py").write_text("")
    facts = folder / "site" / "theirs-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (facts / "RECORD").write_text(
        "__editable__.theirs-1.0.pth,,\ntheirs-1.0.dist-info/METADATA,,\n"
    )
    (folder / "site" / "__editable__.theirs-1.0.pth").write_text(f"{home.parent}\n")
    return home / "inner.py"


@pytest.mark.parametrize("case", EDITS)
def test_an_edit_of_what_a_plugin_brings_in_meets_no_old_block(
    case: str,
    tmp_path: Path,
    written: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also if the edit has the length and the second of what it replaces, as in a script."""
    imports, factor, name, text = EDITS[case]
    written(imports, factor)
    (tmp_path / "outer.py").write_text("import helper\n")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "late.py").write_text(
        "import importlib\n"
        "def late():\n    return importlib.import_module('.helper', __package__)\n"
    )
    monkeypatch.setattr(sys, "path", [*sys.path])
    edited = tmp_path / name
    if name == "theirs":
        edited = _editable(tmp_path)
        site.addsitedir(str(tmp_path / "site"))
    edited.parent.mkdir(exist_ok=True)
    if edited.parent.name == "lib":
        sys.path.insert(0, str(edited.parent))
    seen = []
    for value in ("2.5", "7.5"):
        edited.write_text(text.format(value))
        os.utime(edited, (1e9, 1e9))
        seen += [_run(tmp_path), _run(tmp_path)]
    assert [blocks["computed"] for blocks, _ in seen] == [4, 0, 2, 0]  # of Half alone
    engine = (
        "processes" if case in ("a module beside it", "a file that importlib runs") else "serial"
    )
    fresh = _run(tmp_path, fresh=True, workers=2, engine=engine)[1]
    assert seen[0][1] == seen[1][1] != seen[2][1] == seen[3][1] == fresh


def test_declared_files_and_variables_are_part_of_the_keys(
    tmp_path: Path, written: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They may be read as late as in a run."""
    late = (
        "import os\nfrom pathlib import Path\n"
        "def late():\n"
        "    inner = (Path(__file__).parent / 'weights' / 'w.txt').read_text()\n"
        "    return float(inner) * float(os.environ['GAIN'])\n"
    )
    written(late, "late()", "files: [weights]\nenvironment: [GAIN]\n")
    (tmp_path / "weights").mkdir()
    found = []
    for weight, gain in (("1.5", "1"), ("1.5", "3"), ("2.5", "3"), ("1.5", "1")):
        (tmp_path / "weights" / "w.txt").write_text(weight)
        monkeypatch.setenv("GAIN", gain)
        found.append(_run(tmp_path))
    assert [blocks["computed"] for blocks, _ in found] == [4, 2, 2, 0]
    assert len({error for _, error in found}) == 3
    again = api.run(
        tmp_path / "out" / "config.yaml", out=tmp_path / "b", allow_plugins=True, quiet=True
    )
    assert again.results.manifest["blocks"]["computed"] == 0
    (tmp_path / "own.yaml").write_text((tmp_path / "own.yaml").read_text().replace("hts]", "s]"))
    with pytest.raises(UserError, match=r"own\.yaml:7:9: files\.0: .*no such file or folder"):
        _run(tmp_path)


def test_what_a_plugin_reads_undeclared_is_named_in_a_note(
    tmp_path: Path, written: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the value of a variable that it read is part of the key."""
    reads = (
        "import os\nfrom pathlib import Path\n"
        "W = float((Path(__file__).parent / 'w.txt').read_text()) * float(os.environ['GAIN'])\n"
        "open(Path(__file__).parent / 'log.txt', 'w').close()"
    )
    written(reads, "W")
    (tmp_path / "w.txt").write_text("2")
    found = []
    for gain in ("1", "3"):
        monkeypatch.setenv("GAIN", gain)
        done = trackbench(*RUN, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        notes = [line for line in done.stderr.splitlines() if line.startswith("note: half.py")]
        assert [note.split(" while ")[0] for note in notes] == [
            f"note: half.py read {tmp_path / 'w.txt'}",
            "note: half.py read GAIN",
        ]
        found.append((tmp_path / "results" / "own" / "per_run.csv").read_bytes())
    assert found[0] != found[1]
    written(reads, "W", "files: [w.txt]\nenvironment: [GAIN]\n")
    done = trackbench(*RUN, cwd=tmp_path)
    assert "note: half.py read" not in done.stderr


def test_a_filter_of_a_helper_has_the_key_of_all_that_the_plugin_imports(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    """The helper registers the filter; a further module, which the helper imports, is edited."""
    written("import helper", "helper.FACTOR")
    # A name of its own: other tests have registered theirs.
    text = (tmp_path / "half.py").read_text().replace('"filters", "half"', '"filters", "aided"')
    (tmp_path / "outer.py").write_text(text)
    (tmp_path / "half.py").write_text("import outer\n")
    config = (tmp_path / "own.yaml").read_text().replace("{kind: half}", "{kind: aided}")
    (tmp_path / "own.yaml").write_text(config)
    for name in ("outer", "helper"):
        sys.modules.pop(name, None)
    keys = []
    for value in ("2.5", "7.5"):
        (tmp_path / "helper.py").write_text(f"FACTOR = {value}\n")
        with plugins_forgotten():
            experiment = api.prepare(tmp_path / "own.yaml", api.Options(allow_plugins=True))
            (first, *_) = make_plan(experiment).tasks[0, "Half"]
            assert type(first.filter).__module__ == "outer"
            keys.append(block_key(first, 2))
            for name in ("outer", "helper"):
                sys.modules.pop(name, None)
    assert keys[0] != keys[1]


def test_a_worker_refuses_other_files_than_those_of_the_key(
    tmp_path: Path, written: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    written("import helper", "helper.FACTOR", "files: [w.txt]\n")
    helper, weights = tmp_path / "helper.py", tmp_path / "w.txt"
    helper.write_text("FACTOR = 1\n")
    weights.write_text("1")
    options = api.Options(allow_plugins=True)
    (plugin,) = api.prepare(tmp_path / "own.yaml", options).plugins
    for file in (helper, weights):
        before = file.read_text()
        file.write_text("FACTOR = 2\n")
        monkeypatch.delitem(sys.modules, plugin.module)
        with pytest.raises(PluginError, match=f"{file.name} is not as it was when the run began"):
            load_plugin(plugin)
        file.write_text(before)
        load_plugin(plugin)
    weights.unlink()
    monkeypatch.delitem(sys.modules, plugin.module)
    with pytest.raises(PluginError, match=r"this worker has no .*w\.txt, which half\.py reads"):
        load_plugin(plugin)


def test_modules_of_one_name_beside_two_plugins_are_two(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    written("import helper", "helper.FACTOR")
    (tmp_path / "helper.py").write_text("FACTOR = 2.5\n")
    other = tmp_path / "other"
    other.mkdir()
    for name in ("half.py", "own.yaml"):
        (other / name).write_bytes((tmp_path / name).read_bytes())
    (other / "helper.py").write_text("FACTOR = 7.5\n")
    seen = [_run(folder)[1] for folder in (tmp_path, other, tmp_path, other)]
    assert seen[:2] == seen[2:]
    assert seen[0] != seen[1]


PATCHES = {
    "trackbench.core.kalman.condition": (
        "from trackbench.core import kalman\nbefore = kalman.condition\n"
        "kalman.condition = lambda *a, **k: before(*a, **k)"
    ),
    "trackbench.filters.unscented.UKF.step": (
        "from trackbench.registry import of_kind\nof_kind('filters', 'ukf').step = None"
    ),
    "trackbench.core.elementary.exp": (
        "from trackbench.core import elementary\nelementary.exp.__defaults__ = (1, 2)"
    ),
    "numpy.sqrt": "import numpy\nnumpy.sqrt = lambda x: x",
    "numpy.linalg.cholesky": "import numpy\nnumpy.linalg.cholesky = lambda x: x",
}


@pytest.mark.parametrize("name", PATCHES)
def test_a_plugin_that_changes_the_package_is_refused_and_undone(
    name: str, tmp_path: Path, written: Callable[..., None]
) -> None:
    written("", "1")
    _, good = _run(tmp_path)
    sound = (tmp_path / "half.py").read_text()
    (tmp_path / "half.py").write_text(f"{sound}\n{PATCHES[name]}\n")
    with pytest.raises(UserError) as caught:
        _run(tmp_path)
    assert "plugins.0: half.py: replaces " in str(caught.value)
    assert name.rpartition(".")[2] in str(caught.value)
    (tmp_path / "half.py").write_text(sound)
    assert _run(tmp_path, fresh=True)[1] == good


def test_a_filter_that_changes_the_package_as_it_runs_fails_alone(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    """The blocks of other filters have the numbers that they have without it."""
    patch = (
        "import trackbench.core.kalman as kalman\nsound = kalman.condition\n"
        "def late():\n    kalman.condition = lambda *a, **k: sound(*a, **k)\n    return 1\n"
    )
    written(patch, "late()")
    options = {"out": tmp_path / "out", "quiet": True, "formats": (), "engine": "serial"}
    report = api.run(tmp_path / "own.yaml", allow_plugins=True, **options)
    assert [line.partition(" (")[0] for line in report.failed] == [
        "Half failed: replaces trackbench.core.kalman.condition, which filters of the package use, "
        "too; a plugin may only add: write the changed function into a filter of its own"
    ]
    beside = report.per_run.query("filter == 'UKF'")["value"].to_numpy()
    (tmp_path / "own.yaml").write_text(CONFIG.replace("DECLARED", "only: [UKF]"))
    alone = api.run(tmp_path / "own.yaml", allow_plugins=True, fresh=True, **options)
    np.testing.assert_array_equal(beside, alone.per_run["value"].to_numpy())


def test_an_unchanged_plugin_has_the_same_keys_in_another_folder(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    written("import helper", "helper.FACTOR")
    (tmp_path / "helper.py").write_text("FACTOR = 2.5\n")
    moved = tmp_path / "moved"
    moved.mkdir()
    for name in ("half.py", "own.yaml", "helper.py"):
        (moved / name).write_bytes((tmp_path / name).read_bytes())
    keys = []
    for folder in (tmp_path, moved):
        experiment = api.prepare(folder / "own.yaml", api.Options(allow_plugins=True))
        task = make_plan(experiment).tasks[0, "Half"][0]
        keys.append(block_key(task, task.runs_used))
    assert keys[0] == keys[1]


HELPERS: dict[str, tuple[str, str, str]] = {
    "a declared file that a module reads": (
        "from pathlib import Path\nFACTOR = float((Path(__file__).parent / 'w.txt').read_text())\n",
        "helper.FACTOR",
        "files: [w.txt]\n",
    ),
    "a file that a module reads undeclared": (
        "from pathlib import Path\nFACTOR = float((Path(__file__).parent / 'w.txt').read_text())\n",
        "helper.FACTOR",
        "",
    ),
    "a file opened to be read and written": (
        "from pathlib import Path\n"
        "with open(Path(__file__).parent / 'w.txt', 'r+') as f:\n    FACTOR = float(f.read())\n",
        "helper.FACTOR",
        "",
    ),
    "a declared file that a module reads once in a run": (
        "from functools import cache\nfrom pathlib import Path\n"
        "@cache\ndef factor():\n    return (Path(__file__).parent / 'w.txt').read_text()\n",
        "helper.factor()",
        "files: [w.txt]\n",
    ),
}


FRESH_RUNS = """
import sys
from pathlib import Path
from trackbench import api

for folder in map(Path, sys.argv[1:]):
    keys = {"allow_plugins": True, "quiet": True, "formats": (), "engine": "serial"}
    api.run(folder / "own.yaml", out=folder / "fresh", fresh=True, **keys)
"""
"""A program that computes the configs of some folders anew."""


def test_a_module_with_the_old_content_of_a_file_is_imported_again(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    """The module's own source stays; a new process must find no other number in the cache."""
    folders = {case: tmp_path / str(i) for i, case in enumerate(HELPERS)}
    for case, folder in folders.items():
        helper, factor, declared = HELPERS[case]
        folder.mkdir()
        written("import outer", f"outer.{factor}", declared, folder=folder)
        (folder / "outer.py").write_text("import helper\n")
        (folder / "helper.py").write_text(helper)
        errors = []
        for value in ("2.5", "7.5"):
            (folder / "w.txt").write_text(value)
            errors.append(_run(folder)[1])
        assert errors[0] != errors[1], case
    program = [sys.executable, "-W", "error", "-c", FRESH_RUNS, *map(str, folders.values())]
    done = subprocess.run(program, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    for case, folder in folders.items():
        fresh = (folder / "fresh" / "per_run.csv").read_bytes()
        assert fresh == (folder / "out" / "per_run.csv").read_bytes(), case


def test_a_module_keeps_nothing_of_what_an_earlier_content_of_the_plugin_set(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    (tmp_path / "helper.py").write_text("FACTOR = 2.5\n")
    written("import helper", "helper.FACTOR")
    _, plain = _run(tmp_path)
    written("import helper\nhelper.FACTOR = 7.5", "helper.FACTOR")
    _, changed = _run(tmp_path)
    written("import helper\n# edited", "helper.FACTOR")
    assert _run(tmp_path)[1] == plain != changed


def test_two_plugins_that_share_a_module_depend_on_what_it_reads(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    """Only the first of them executes the module; its objects are those of both."""
    (tmp_path / "helper.py").write_text(
        "from dataclasses import dataclass\nfrom pathlib import Path\n\n\n"
        "@dataclass(frozen=True)\nclass Part:\n    value: float\n\n\n"
        "FACTOR = float((Path(__file__).parent / 'w.txt').read_text())\n"
    )
    written("import helper", "helper.FACTOR")
    plugin = (tmp_path / "half.py").read_text()
    key = '\n\n    part: helper.Part = helper.Part(1.0)\n    """a part"""\n'
    doc = '"""A factor of the prior."""\n'
    for name in ("half", "other"):
        text = plugin.replace('"half"', f'"{name}"').replace(doc, doc + key)
        (tmp_path / f"{name}.py").write_text(text)
    config = CONFIG.replace("DECLARED", "").replace("[half.py]", "[half.py, other.py]")
    (tmp_path / "own.yaml").write_text(f"{config}  Other: {{kind: other}}\n")
    (tmp_path / "second.yaml").write_text(
        CONFIG.replace("DECLARED", "").replace("half", "other").replace("name: own", "name: second")
    )
    (tmp_path / "w.txt").write_text("2.5")
    assert _run(tmp_path)[0] == {"computed": 6, "reused": 0}
    assert _run(tmp_path)[0] == {"computed": 0, "reused": 6}
    options = api.Options(allow_plugins=True)
    first = api.prepare(tmp_path / "own.yaml", options)
    second = api.prepare(tmp_path / "second.yaml", options)
    assert first.plugins[1].identity == second.plugins[0].identity
    (tmp_path / "w.txt").write_text("7.5")
    assert _run(tmp_path, workers=2, engine="processes")[0] == {"computed": 4, "reused": 2}


def test_files_of_one_name_may_exchange_their_contents(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    """Declared files, and modules of two packages."""
    reads = (
        "from pathlib import Path\nimport helper.a, helper.b\n"
        "def late():\n    return (Path(__file__).parent / 'a' / 'w.txt').read_text()\n"
    )
    written(reads, "late()) * float(helper.a.FACTOR", "files: [a/w.txt, b/w.txt]\n")
    for folder in ("a", "b", "helper", "helper/a", "helper/b"):
        (tmp_path / folder).mkdir()
    (tmp_path / "helper" / "__init__.py").write_text("")

    def write(weights: tuple[str, str], factors: tuple[str, str]) -> None:
        for name, weight, factor in zip("ab", weights, factors, strict=True):
            (tmp_path / name / "w.txt").write_text(weight)
            source = tmp_path / "helper" / name / "__init__.py"
            source.write_text(f"FACTOR = {factor}\n")

    found = []
    for weights in (("0.2", "0.3"), ("0.3", "0.2")):
        for factors in (("0.5", "0.7"), ("0.7", "0.5")):
            write(weights, factors)
            found.append(_run(tmp_path))
    assert [blocks["computed"] for blocks, _ in found] == [4, 2, 2, 2]
    assert len({error for _, error in found}) == 4


def test_links_in_a_declared_folder_are_followed(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    late = (
        "from pathlib import Path\n"
        "def late():\n    return (Path(__file__).parent / 'data' / 'l' / 'w.txt').read_text()\n"
    )
    written(late, "late()", "files: [data]\n")
    for folder in ("data", "far", "far/inner"):
        (tmp_path / folder).mkdir()
    (tmp_path / "data" / "l").symlink_to(tmp_path / "far")
    (tmp_path / "far" / "inner" / "v.txt").write_text("0")
    found = []
    for value in ("2.5", "7.5"):
        (tmp_path / "far" / "w.txt").write_text(value)
        found.append(_run(tmp_path))
    assert [blocks["computed"] for blocks, _ in found] == [4, 2]
    assert found[0][1] != found[1][1]
    (tmp_path / "far" / "inner" / "round").symlink_to(tmp_path / "data")
    message = r"own\.yaml:7:9: files\.0: .*round, a link to .*data, a folder around it"
    with pytest.raises(UserError, match=message):
        _run(tmp_path)


def test_variables_read_as_bytes_databases_and_libraries_are_noticed(
    tmp_path: Path, written: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    base = tmp_path / "w.db"
    with sqlite3.connect(base) as connection:
        connection.execute("create table w (v real)")
        connection.execute("insert into w values (2.5)")
    connection.close()
    monkeypatch.setenv("GAIN", "2")
    library = tmp_path / "lib.so"
    library.write_text("not a library")
    reads = (
        "import ctypes, os, sqlite3\nfrom pathlib import Path\n"
        "HOME = Path(__file__).parent\n"
        "connection = sqlite3.connect(HOME / 'w.db')\n"
        "W = connection.execute('select v from w').fetchone()[0] * float(os.environb[b'GAIN'])\n"
        "connection.close()\n"
        "try:\n    ctypes.CDLL(str(HOME / 'lib.so'))\nexcept OSError:\n    pass\n"
    )
    written(reads, "W")
    (plugin,) = api.prepare(tmp_path / "own.yaml", api.Options(allow_plugins=True)).plugins
    assert [Path(name).name for name, _ in plugin.opened] == ["lib.so", "w.db"]
    assert [name for name, _ in plugin.variables] == ["GAIN"]


@pytest.mark.parametrize(
    ("read", "name"),
    [("os.path.expandvars('$GAIN')", "GAIN"), ("len(os.path.expanduser('~'))", "HOME")],
)
def test_variables_read_by_functions_on_paths_are_noticed(
    read: str,
    name: str,
    written: Callable[..., None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("GAIN", "2")
    written(f"import os\nW = float({read})\n", "W")
    (plugin,) = api.prepare(tmp_path / "own.yaml", api.Options(allow_plugins=True)).plugins
    assert [variable for variable, _ in plugin.variables] == [name]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_plugin_that_changes_the_working_folder_moves_no_results(
    workers: int, tmp_path: Path, written: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own files are found from the folder that it went to, in every process."""
    reads = (
        "import os\nfrom pathlib import Path\nos.chdir(Path(__file__).parent / 'data')\n"
        "def late():\n    os.chdir('inner')\n    return Path('w.txt').read_text()\n"
    )
    written(reads, "late()")
    (tmp_path / "data" / "inner").mkdir(parents=True)
    (tmp_path / "data" / "inner" / "w.txt").write_text("2.5")
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.chdir(home)
    monkeypatch.setenv("TRACKBENCH_CACHE", "cache")
    report = api.run(
        "../own.yaml", allow_plugins=True, quiet=True, formats=["svg"], workers=workers
    )
    assert not report.failed
    assert Path.cwd() == home
    assert sorted(file.name for file in home.iterdir()) == ["cache", "results"]
    assert (home / "results" / "own" / "per_run.csv").is_file()


def test_paths_in_keys_of_any_type_count_from_the_config(
    tmp_path: Path, written: Callable[..., None]
) -> None:
    """A bare word or variable, and files in an optional list, as a list of each."""
    imports = (
        "from trackbench.field_types import DataFile, ProgramWord, VariableName\n"
        "NAMES = (DataFile, ProgramWord, VariableName)"
    )
    written(imports, "1.0")
    plugin = tmp_path / "half.py"
    keys = (
        "    table: DataFile\n    tables: tuple[DataFile, ...] | None = None\n"
        "    word: ProgramWord\n    variable: VariableName\n\n    def init"
    )
    plugin.write_text(plugin.read_text().replace("    def init", keys, 1))
    config = tmp_path / "own.yaml"
    values = "{kind: half, table: a.csv, tables: [b.csv], word: --fast, variable: GAIN}"
    config.write_text(config.read_text().replace("{kind: half}", values))
    experiment = api.prepare(config, api.Options(allow_plugins=True))
    half = experiment.points[0].filters["Half"]
    assert half.table == str(tmp_path / "a.csv")
    assert half.tables == (str(tmp_path / "b.csv"),)
    assert half.word == "--fast"
    assert half.variable == "GAIN"


def test_a_variable_that_a_plugin_removes_is_there_again(
    tmp_path: Path, written: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The code runs again in each worker, and a variable that it sets stays for libraries."""
    monkeypatch.setenv("GAIN", "2")
    monkeypatch.delenv("OWN_SETTING", raising=False)
    written("import os\nW = float(os.environ.pop('GAIN'))\nos.environ['OWN_SETTING'] = '1'", "W")
    words = ("run", "own.yaml", "--allow-plugins", "--workers", "2")
    done = trackbench(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert os.environ["GAIN"] == "2"
    assert os.environ.pop("OWN_SETTING") == "1"
    assert "note: half.py read GAIN while it was loaded" in done.stderr


def test_a_module_in_a_zip_archive_is_part_of_the_key(
    tmp_path: Path, written: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    written("import zipped", "zipped.FACTOR")
    archive = tmp_path / "parts.zip"
    monkeypatch.syspath_prepend(str(archive))
    found = []
    for value in ("2.5", "7.5"):
        with zipfile.ZipFile(archive, "w") as parts:
            parts.writestr("zipped.py", f"FACTOR = {value}")
        monkeypatch.delitem(sys.modules, "zipped", raising=False)
        invalidate_caches()
        found.append(_run(tmp_path))
    assert [blocks["computed"] for blocks, _ in found] == [4, 2]
    assert found[0][1] != found[1][1]


def test_a_long_text_of_an_error_is_cut() -> None:
    text = message_of(ValueError("x" * 900_000))
    assert text.startswith("ValueError: xxx")
    assert text.endswith("xxx...")
    assert len(text) < 600
