"""Shards on a batch system: scripts of docs/cluster.md with local processes, and the merged bytes."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.papers import merwe_text
from trackbench import api
from trackbench.errors import UserError

pytestmark = pytest.mark.usefixtures("no_report")

CONFIG = """
name: s
runs: 24
block: 4
scenario: MERWE
filters: {PF: {kind: pf, N: 5}, UKF: {kind: ukf}}
figures: {}
""".replace("MERWE", merwe_text(T=5))


@pytest.mark.skipif(sys.platform == "win32", reason="scripts of a POSIX shell")
def test_the_scripts_of_the_page_compute_the_bytes_of_one_run(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
    array, merge = re.findall(r"```bash\n(#!/bin/sh.*?)```", page, re.DOTALL)
    (tmp_path / "s.yaml").write_text(CONFIG)
    program = tmp_path / "bin" / "trackbench"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m trackbench "$@"\n')
    program.chmod(0o755)
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    slurm = {"SLURM_ARRAY_TASK_COUNT": "3", "SLURM_CPUS_PER_TASK": "1"}
    shared = {"PATH": path, "PYTHONPATH": str(ROOT), "TRACKBENCH_CACHE": str(tmp_path / "blocks")}

    def run(script: str, **task: str) -> str:
        return subprocess.run(
            ["sh", "-c", script, "array.sh", "s.yaml"],
            env=os.environ | shared | task,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        ).stderr

    for i in ("1", "2", "3"):
        assert f"shard {i}/3: 4 of 12 blocks" in run(array, SLURM_ARRAY_TASK_ID=i, **slurm)
        assert not (tmp_path / "results").exists()
    assert "reused 12 of 12 blocks" in run(merge)
    whole = tmp_path / "whole"
    api.run(tmp_path / "s.yaml", out=whole, engine="serial", quiet=True, fresh=True, formats=())
    for name in ("per_run.csv", "per_step.csv", "summary.csv"):
        assert (whole / name).read_bytes() == (tmp_path / "results" / "s" / name).read_bytes()


@pytest.mark.parametrize("shard", ["0/3", "4/3", "x", "1/0"])
def test_a_wrong_shard_is_one_line(shard: str, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(CONFIG)
    with pytest.raises(UserError, match=r"--shard: .* is no shard"):
        list(api.run_all([tmp_path / "s.yaml"], shard=shard, quiet=True, out=tmp_path / "o"))


@pytest.mark.parametrize("function", [api.run, api.sweep])
def test_a_shard_has_no_report(function: Callable[..., api.Report], tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(CONFIG)
    with pytest.raises(
        UserError, match=r"shard=: a shard has no report: compute it by list\(run_all"
    ):
        function(tmp_path / "s.yaml", shard="1/2", quiet=True, out=tmp_path / "o")
