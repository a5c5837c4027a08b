"""`run --watch`: a run at each save of a file that counts, whatever is in it, until Ctrl-C."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.execution.test_resume import _heed_ctrl_c
from tests.papers import merwe_text
from trackbench.cli.changed_files import EVERY_S, stamps_of, wait_for_changes
from trackbench.config.file_paths import with_parts

CONFIG = """
name: small
seed: 1
runs: 5
scenario: MERWE
filters:
  UKF: ukf.yaml
figures: {}
tables: {one: {kind: metrics, columns: {Mean: mean(rmse)}}}
""".replace("MERWE", merwe_text(T=4))


PLUGIN = """
from dataclasses import dataclass
from trackbench.registry import register
from trackbench.report.kinds import FigureKind

@register("figures", "broken")
@dataclass(frozen=True, kw_only=True)
class Broken(FigureKind):
    asked = []

    @property
    def shown_runs(self):
        self.asked.append(None)
        return 0 if len(self.asked) == 1 else 1 / 0  # not yet while the config is read

    def draw(self, results):
        return None
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "ukf.yaml").write_text("kind: ukf\n")
    (tmp_path / "c.yaml").write_text(CONFIG)
    return tmp_path / "c.yaml"


@pytest.fixture
def watched(config: Path) -> Iterator["subprocess.Popen[str]"]:
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "trackbench",
            "run",
            "c.yaml",
            "--watch",
            "--allow-plugins",
            "--workers",
            "1",
        ],
        cwd=config.parent,
        env={**os.environ, "TRACKBENCH_CACHE": "cache"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_heed_ctrl_c,
    )
    yield process
    process.kill()
    process.communicate()


def until_it_waits(process: "subprocess.Popen[str]") -> list[str]:
    """Lines that are said before it waits for a change."""
    said: list[str] = []
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("watching"):
            return said
        said.append(line.rstrip())
    pytest.fail("\n".join(said))


def test_it_runs_at_each_save_until_ctrl_c(watched: "subprocess.Popen[str]", config: Path) -> None:
    assert until_it_waits(watched)[-1].startswith("results in results/small/: ")
    part = config.parent / "ukf.yaml"
    part.write_text("kind: ukf\nalpha: 0.5\n")
    first, *_, last = until_it_waits(watched)
    assert first.endswith("ukf.yaml was saved")
    assert last.startswith("results in results/small/: ")
    assert "alpha: 0.5" in (config.parent / "results" / "small" / "config.yaml").read_text()
    part.write_text("kind: [ukf\n")
    assert until_it_waits(watched)[-1].startswith("ukf.yaml:2:1: filters.UKF: not valid YAML")
    part.write_text("kind: ukf\n")
    assert until_it_waits(watched)[-1].startswith("results in results/small/: ")
    (config.parent / "own.py").write_text(PLUGIN)
    broken = CONFIG.replace("figures: {}", "figures: {own: {kind: broken}}\nplugins: [own.py]")
    config.write_text(broken)
    said = until_it_waits(watched)[-2]
    assert said == "error: own.py:14: ZeroDivisionError: division by zero"
    config.write_text(CONFIG)
    assert until_it_waits(watched)[-1].startswith("results in results/small/: ")
    watched.send_signal(signal.SIGINT)
    assert watched.wait() == 0


def test_what_is_not_watched(config: Path) -> None:
    for words in (["c.yaml", "c.yaml"], ["-"]):
        done = trackbench("run", "--watch", "--workers", "1", *words, cwd=config.parent)
        assert done.returncode == 2
        assert done.stderr == "--watch: watches one config, and that a file\n"


def test_every_file_that_is_named_counts_and_those_that_these_name(tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(
        "{published: [p.csv], title: Of eq. 3, filters: {A: a.yaml, B: {use: c.yaml}}}"
    )
    (tmp_path / "a.yaml").write_text("{kind: pf, target: {measurements: data/m.csv}}")
    names = {str(path.relative_to(tmp_path)) for path in with_parts(config)}
    assert names >= {"c.yaml", "a.yaml", "p.csv", "data/m.csv"}


def test_a_file_counts_if_its_content_does(tmp_path: Path) -> None:
    """Not if it is only written again; and so does one that was missing."""
    same, new = tmp_path / "same.yaml", tmp_path / "new.csv"
    same.write_text("a")
    before = stamps_of([same, new, tmp_path, Path("x" * 5000)], {})
    assert [path for path, stamp in before.items() if stamp is not None] == [same]

    def save() -> None:
        same.write_text("a")
        os.utime(same, ns=(1, 1))
        time.sleep(3 * EVERY_S)
        new.write_text("1,2")

    saving = threading.Thread(target=save)
    saving.start()
    assert wait_for_changes(before) == [new]
    saving.join()
