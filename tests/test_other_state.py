"""The page's filter with another state: what it converts there and back is what it was."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from docs.site.blocks import blocks
from tests.commands import trackbench
from tests.conftest import ROOT, plugins_forgotten, random_covariance
from tests.pages import BARE
from trackbench import run
from trackbench.config.plugins_of_config import load_file
from trackbench.registry import kinds

PAGE = (ROOT / "docs" / "your-filter.md").read_text(encoding="utf-8")


@pytest.fixture
def ctrv(tmp_path: Path) -> type:
    """The page's class, with the file beside it."""
    for block in blocks(PAGE):
        if block.title in ("ctrv.py", "my_ctrv.py"):
            (tmp_path / block.title).write_text(block.text)
    load_file(tmp_path / "my_ctrv.py")
    return kinds("filters")["my-ctrv"].run_class


@pytest.mark.parametrize("velocity", [(3.0, 4.0), (-15.0, 2.0), (0.5, -7.0)])
def test_mean_and_covariance_survive_the_conversion_and_back(
    ctrv: type, velocity: tuple[float, float], rng: np.random.Generator
) -> None:
    vx, vy = velocity
    mean, cov = np.array([100.0, vx, -50.0, vy]), random_covariance(rng, 4)
    one = ctrv()
    one.functions = SimpleNamespace(R=lambda: 25.0 * np.eye(2))
    one.start(mean, cov)
    back, of_back = one.converted()
    np.testing.assert_allclose(back, mean, rtol=1e-12)
    np.testing.assert_allclose(of_back, cov, rtol=1e-9, atol=1e-12)


def test_the_covariance_is_that_of_converted_samples(ctrv: type, rng: np.random.Generator) -> None:
    """For a prior so narrow that the functions are straight lines within it."""
    mean, cov = np.array([100.0, 8.0, -50.0, 6.0]), 1e-4 * random_covariance(rng, 4)
    one = ctrv()
    one.functions = SimpleNamespace(R=lambda: np.eye(2))
    one.start(mean, cov)
    px, vx, py, vy = rng.multivariate_normal(mean, cov, 200_000).T
    states = np.array([px, py, np.hypot(vx, vy), np.arctan2(vy, vx)])
    sd = np.sqrt(np.diag(one.f.P)[:4])
    error = (np.cov(states) - one.f.P[:4, :4]) / np.outer(sd, sd)
    assert np.abs(error).max() < 6.0 * np.sqrt(2.0 / 200_000)


def test_the_page_says_the_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for block in blocks(PAGE):
        if "ctrv" in block.title:
            (tmp_path / block.title).write_text(block.text)
    with plugins_forgotten():
        report = run("turn_ctrv.yaml", engine="serial", quiet=True, set=BARE, allow_plugins=True)
    rows = report.ranking()[0].markdown().splitlines()
    ekf, mine = (
        next(row.split("|")[2].split()[0] for row in rows if row.startswith(f"| {label} |"))
        for label in ("EKF", "mine")
    )
    words = " ".join(PAGE.split())
    assert (
        f"the EKF has an error of {float(ekf):.1f} m, and your filter has {float(mine):.1f} m"
        in words
    )


@pytest.mark.parametrize("module", ["helpers", "helpers.ctrv"])
def test_the_wrapped_filter_may_stand_in_a_package_of_a_subfolder(
    module: str, tmp_path: Path
) -> None:
    files = {b.title: b.text for b in blocks(PAGE) if "ctrv" in b.title}
    (tmp_path / "helpers").mkdir()
    (tmp_path / "helpers" / "__init__.py").write_text("from .ctrv import Ctrv\n")
    (tmp_path / "helpers" / "ctrv.py").write_text(files["ctrv.py"])
    plugin = files["my_ctrv.py"].replace("from ctrv", f"from {module}")
    (tmp_path / "my_ctrv.py").write_text(plugin)
    (tmp_path / "turn.yaml").write_text(files["turn_ctrv.yaml"])
    words = ("--runs", "3", "--format", "tex")
    done = trackbench("run", "turn.yaml", "--allow-plugins", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "\nmine " in done.stdout
    refused = trackbench("run", "radar-turns", "--filter", "my_ctrv.py", *words, cwd=tmp_path)
    assert refused.returncode == 2
    assert "it takes x, y; this scenario measures range, azimuth" in refused.stderr
