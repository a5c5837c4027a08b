"""Files of one's own: refused unless allowed, the same in workers, part of a block's key."""

import json
import sys
from pathlib import Path

import pytest

from tests.commands import BARE, spawned, trackbench
from tests.papers import merwe_text
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.execution.block_key import block_key
from trackbench.execution.plan import make_plan
from trackbench.plugins.load import load_plugin
from trackbench.plugins.plugin_errors import PluginError
from trackbench.results.manifest import read_manifest

pytestmark = pytest.mark.usefixtures("no_report")

PLUGIN = '''
"""A filter that believes the first measurement component."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.core.distributions import Gaussian
from trackbench.registry import register


@register("filters", "half")
@dataclass(frozen=True, kw_only=True)
class Half:
    """FACTOR of the prior, for ever."""

    scale: float = FACTOR
    """factor on the prior's mean"""

    def init(self, model, prior, rng):
        n, runs = prior.mean.shape
        return Gaussian(self.scale * prior.mean, np.ones((n, n, runs)))

    def step(self, model, state, z, k, rng):
        return state

    def estimate(self, state):
        return state
'''
CONFIG = """
name: own
runs: 8
block: 2
scenario: MERWE
plugins: [half.py]
filters:
  Half: {kind: half}
  PF: {kind: pf, N: 5}
""".replace("MERWE", merwe_text(T=4))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "half.py").write_text(PLUGIN.replace("FACTOR", "0.5"))
    path = tmp_path / "own.yaml"
    path.write_text(CONFIG)
    return path


def blocks(folder: Path) -> dict[str, int]:
    return read_manifest(folder)["blocks"]


def test_a_plugin_is_refused_and_not_run(config: Path) -> None:
    (config.parent / "half.py").write_text("open('ran', 'w').close()\n")
    done = trackbench("run", "own.yaml", cwd=config.parent)
    assert done.returncode == 2
    assert "own.yaml:6:11: plugins.0: the code in half.py is run only with" in done.stderr
    assert not (config.parent / "ran").exists()
    assert not (config.parent / "results").exists()


def test_a_plugin_runs_in_worker_processes(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    options = {"allow_plugins": True, "quiet": True, "formats": (), "fresh": True}
    one = api.run(config, out=tmp_path / "one", engine="serial", **options)
    two = api.run(config, out=tmp_path / "two", workers=2, **options)
    for name in ("per_run.csv", "config.yaml"):
        assert (one.folder / name).read_bytes() == (two.folder / name).read_bytes()
    frame = one.per_run
    assert (frame[(frame["filter"] == "Half") & (frame["metric"] == "lost")]["value"] == 0).all()
    manifest = read_manifest(one.folder)
    assert len(next(iter(manifest["plugins"].values()))) == 64


def test_what_a_plugin_leaves_open_is_written_at_the_end(config: Path) -> None:
    text = (config.parent / "half.py").read_text()
    (config.parent / "half.py").write_text(
        f"{text}\nLOG = open('log.txt', 'w')\nLOG.write('seen')\n"
    )
    done = spawned("check", "own.yaml", "--allow-plugins", cwd=config.parent)
    assert done.returncode == 0, done.stderr
    assert (config.parent / "log.txt").read_text() == "seen"


def test_an_edited_plugin_never_meets_an_old_block(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    options = {"allow_plugins": True, "quiet": True, "formats": (), "workers": 1}
    first = api.run(config, out=tmp_path / "out", **options)
    assert blocks(first.folder) == {"computed": 8, "reused": 0}
    text = (config.parent / "half.py").read_text()
    (config.parent / "half.py").write_text(text + "\n# edited\n")
    second = api.run(config, out=tmp_path / "out", **options)
    assert blocks(second.folder) == {"computed": 4, "reused": 4}  # PF is not its business
    again = api.run(tmp_path / "out" / "config.yaml", out=tmp_path / "again", **options)
    assert blocks(again.folder) == {"computed": 0, "reused": 8}


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("half.py", "1 / 0\n", "half.py:1: ZeroDivisionError: division by zero"),
        ("half.py", "def (\n", "SyntaxError"),
        ("half.py", None, "half.py: no such file or directory"),
        ("half.txt", "x = 1\n", "is not the path of a Python file"),
        ("half.py", PLUGIN.replace('"half"', '"pf"'), "kind 'pf' is already taken"),
        (
            "half.py",
            "from trackbench.metrics import metric\nmetric('late_s', '', better='low')\n",
            "half.py:2: ValueError: better='low' is none of lower, higher, zero, one, or nothing",
        ),
        (
            "half.py",
            PLUGIN.replace('"filters"', '"filter"'),
            "half.py:13: ValueError: 'filter' is not a group of kinds: filters, scenarios, targets",
        ),
        (
            "half.py",
            PLUGIN.replace("    scale:", "    summed_diagnostics = 'mine'\n    scale:"),
            "half.py:13: Half: summed_diagnostics is a word, not a set of words",
        ),
    ],
)
def test_plugins_with_mistakes(config: Path, name: str, content: str | None, expected: str) -> None:
    config.write_text(CONFIG.replace("half.py", name))
    (config.parent / "half.py").unlink()
    if content is not None:
        (config.parent / name).write_text(content.replace("FACTOR", "1"))
    with pytest.raises(UserError) as caught:
        load(config, allow_plugins=True)
    assert str(caught.value).startswith(f"{config}:6:11: plugins.0: ")
    assert expected in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


OTHER = PLUGIN.replace("FACTOR", "2")


def test_two_plugins_cannot_register_the_same_kind(config: Path) -> None:
    (config.parent / "sub").mkdir()
    (config.parent / "sub" / "half.py").write_text(OTHER)
    config.write_text(CONFIG.replace("[half.py]", "[half.py, sub/half.py]"))
    with pytest.raises(UserError) as caught:
        load(config, allow_plugins=True)
    assert "the kind 'half' is registered by" in str(caught.value)
    assert str(caught.value).startswith(f"{config}:6:20: plugins.1: ")


def with_helpers(folder: Path) -> list[str]:
    """Write two plugins in folders of their own, each with a module factor.py beside it."""
    for name, factor in (("one", 3.0), ("two", 5.0)):
        (folder / name).mkdir()
        (folder / name / "factor.py").write_text(f"FACTOR = {factor}\n")
        text = PLUGIN.replace('"half"', f'"{name}"').replace(
            "import numpy", "import factor\nimport numpy"
        )
        (folder / name / "half.py").write_text(text.replace("= FACTOR", "= factor.FACTOR"))
    return ["one/half.py", "two/half.py"]


def test_two_plugins_cannot_import_two_modules_of_one_name(config: Path) -> None:
    """The second plugin would get the module of the first one."""
    paths = with_helpers(config.parent)
    text = CONFIG.replace("[half.py]", str(paths)).replace("kind: half", "kind: two")
    config.write_text(text.replace("'", ""))
    with pytest.raises(
        UserError, match=r"imports factor from .*two.*, and another plugin has imported"
    ):
        load(config, allow_plugins=True)
    # Two files of the same content are one module.
    (config.parent / "two" / "factor.py").write_text("FACTOR = 3.0\n")
    assert load(config, allow_plugins=True).points[0].filters["Half"].scale == 3.0


def test_plugins_of_two_configs_may_import_modules_of_one_name(config: Path) -> None:
    paths = with_helpers(config.parent)
    scales = []
    for i in (0, 1, 0):
        kind = paths[i].partition("/")[0]
        config.write_text(
            CONFIG.replace("half.py", paths[i]).replace("kind: half", f"kind: {kind}")
        )
        scales.append(load(config, allow_plugins=True).points[0].filters["Half"].scale)
    assert scales == [3.0, 5.0, 3.0]


def test_a_plugin_that_was_loaded_before_has_its_kinds_again(config: Path) -> None:
    """In one process, after another file of the same name took them."""
    other = config.parent / "sub"
    other.mkdir()
    (other / "half.py").write_text(OTHER)
    (other / "own.yaml").write_text(CONFIG)
    paths = (config, other / "own.yaml", config)
    made = [load(path, allow_plugins=True).points[0].filters["Half"] for path in paths]
    assert [tracker.scale for tracker in made] == [0.5, 2.0, 0.5]


def test_a_plugin_may_be_mended(config: Path) -> None:
    """What the code registered before it failed is not in the way of the next attempt."""
    good = (config.parent / "half.py").read_text()
    (config.parent / "half.py").write_text(good + "\n1 / 0\n")
    for _ in range(2):
        with pytest.raises(UserError, match=r"half\.py:\d+: ZeroDivisionError"):
            load(config, allow_plugins=True)
    (config.parent / "half.py").write_text(good + "\n# mended\n")
    assert load(config, allow_plugins=True).points[0].filters["Half"].scale == 0.5


def test_the_versions_of_what_a_plugin_imports_are_part_of_its_blocks_keys(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = config.parent / "half.py"
    path.write_text("import os, numpy\nfrom yaml.nodes import Node\n" + path.read_text())
    keys, plugins = [], []
    for number in ("1.0", "2.0"):
        monkeypatch.setattr(
            "trackbench.plugins.installed_packages.version", lambda name, n=number: n
        )
        monkeypatch.setattr(
            "trackbench.plugins.installed_packages.packages_distributions",
            lambda: {"yaml": ["PyYAML"]},
        )
        experiment = load(config, allow_plugins=True)
        plugins += experiment.plugins
        task = make_plan(experiment).tasks[0, "Half"][0]
        keys.append(block_key(task, task.runs_used))
    assert [plugin.packages for plugin in plugins] == [(("yaml", "1.0"),), (("yaml", "2.0"),)]
    assert keys[0] != keys[1]
    monkeypatch.undo()
    monkeypatch.delitem(sys.modules, plugins[0].module)
    with pytest.raises(PluginError, match=r"this worker has PyYAML .*, not yaml 1\.0"):
        load_plugin(plugins[0])


@pytest.mark.parametrize(
    "change",
    ["z.setflags(write=True); z -= 50", "import ctypes; ctypes.memset(z.ctypes.data, 1, 8)"],
)
def test_a_plugin_changes_no_block_of_another_filter(
    config: Path, change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(config.parent / "cache"))
    plugin = config.parent / "half.py"
    plugin.write_text(plugin.read_text().replace("return state\n", f"{change}; return state\n", 1))
    options = {"engine": "serial", "quiet": True}
    beside = api.run(config, allow_plugins=True, out=config.parent / "beside", **options)
    assert [line.partition(":")[0] for line in beside.failed] == ["Half failed"]
    config.write_text(config.read_text().replace("plugins: [half.py]\n", "").replace("Half:", "# "))
    again = api.run(config, out=config.parent / "again", **options)
    fresh = api.run(config, out=config.parent / "fresh", fresh=True, **options)
    assert blocks(again.folder) == {"computed": 0, "reused": 4}
    assert again.per_run.equals(fresh.per_run)
    of_pf = beside.per_run[beside.per_run["filter"] == "PF"].reset_index(drop=True)
    assert of_pf.equals(fresh.per_run)


@pytest.mark.parametrize("engine", ["serial", "processes"])
def test_what_a_plugin_prints_is_not_among_the_objects(config: Path, engine: str) -> None:
    loud = PLUGIN.replace("FACTOR", "0.5").replace(
        "        return state\n",
        "        print('hi')\n        os.system('echo there')\n        return state\n",
        1,
    )
    (config.parent / "half.py").write_text("import os\nprint('loaded')\n" + loud)
    words = ("run", "own.yaml", "--allow-plugins", "--json", "--fresh", *BARE)
    how = ("--engine", engine, "--workers", "2")
    done = spawned(*words, *how, cwd=config.parent)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["experiment"] == "own"
    assert {"loaded", "hi", "there"} <= set(done.stderr.splitlines())
    done = trackbench("check", "none.yaml", "--json", cwd=config.parent)
    assert (done.returncode, json.loads(done.stdout)["good"]) == (2, False)
    done = trackbench(*words, "--engine", "serial", cwd=config.parent)
    assert json.loads(done.stdout)["failed"] == []
