"""Files of one's own: refused unless allowed, the same in workers, part of a block's key."""

import json
from pathlib import Path

import pytest

from tests.papers import merwe_text
from tests.test_cli import trackbench
from trackbench import api
from trackbench.experiment.problems import UserError
from trackbench.experiment.reading.config import load

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
    return json.loads((folder / "manifest.json").read_text())["blocks"]


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
    manifest = json.loads((one.folder / "manifest.json").read_text())
    assert len(next(iter(manifest["plugins"].values()))) == 64


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
