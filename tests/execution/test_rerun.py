"""The config in a results folder is one to run: the same files come out again, byte for byte."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.commands import trackbench
from tests.conftest import EXPERIMENT_FILES, PLANE, shipped
from tests.papers import maneuver_text, merwe_text
from trackbench import api
from trackbench.config.experiment import Experiment
from trackbench.config.load import load
from trackbench.config.resolved_config import as_yaml, resolved
from trackbench.report.folder_check import open_results
from trackbench.verify.verify_folder import verify
from trackbench.yaml_source import parse

CONFIG = """
name: a
runs: 6
block: 4
scenario: MERWE
published: [numbers.csv]
reference: 1e5
filters:
  PF: {kind: pf, N: 5}
  HDEPF: {kind: hdepf, preset: matched, N: 7}
  "1e5": {kind: ukf}
tables:
  t:
    kind: metrics
    filters: [PF, HDEPF]
    columns: {Mean: mean(rmse), Gain: "ratio(rms(rmse), HDEPF)"}
    gain: {of: HDEPF, over: PF}
figures:
  f: {kind: rmse-vs-time, filters: [PF, HDEPF], baseline: HDEPF}
""".replace("MERWE", merwe_text(T=5))
NUMBERS = """paper,table,filter,metric,value,digits,label,expression
p,Table 1,HDEPF,mean,0.3,1,HDEPF,mean(rmse)
"""
GRID = ["filters.HDEPF.F=0.5,0.9", "scenario.sensor.R=log:1e-5..1e-3:2"]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"only": ["PF"]},
        {"set": ["filters.PF.N=9", "scenario.sensor.R=1e-3", "title=a: b"], "runs": 5, "seed": 3},
        {"grid": GRID},
        {"grid": GRID, "only": ["PF"]},
        {"grid": ["filters.PF.N & filters.HDEPF.N=4,6"]},
        {"grid": ["filters.HDEPF.preset=matched,literal,merwe-demo"]},
        {"grid": ["filters.PF.kind=pf,apf"]},
    ],
    ids=["plain", "only", "set", "grid", "grid-only", "together", "preset", "kind"],
)
def test_the_resolved_config_gives_the_same_bytes(tmp_path: Path, options: dict[str, Any]) -> None:
    config = tmp_path / "a.yaml"
    config.write_text(CONFIG.replace("reference: 1e5", 'reference: "1e5"'))
    (tmp_path / "numbers.csv").write_text(NUMBERS)
    first, again = tmp_path / "first", tmp_path / "elsewhere" / "again"
    quiet: dict[str, Any] = {"engine": "serial", "quiet": True, "fresh": True, "formats": ()}
    api.run(config, out=first, **quiet, **options)
    api.run(first / "config.yaml", out=again, **quiet)
    for name in ("per_run.csv", "per_step.csv", "summary.csv", "config.yaml"):
        assert (again / name).read_bytes() == (first / name).read_bytes(), name
    tables = [(folder / "tables" / "t.csv").read_bytes() for folder in (first, again)]
    assert tables[0] == tables[1]
    assert verify(first, 3) == []


def again(experiment: Experiment, folder: Path) -> Experiment:
    """What the config says that the experiment would write there; it says the same again."""
    (folder / "published").mkdir()
    for name, text in experiment.published.files.items():
        (folder / "published" / name).write_text(text)
    text = resolved(experiment, folder)
    (folder / "config.yaml").write_text(as_yaml(text))
    found = load(folder / "config.yaml")
    assert resolved(found, folder) == text
    return found


@pytest.mark.parametrize("name", [*EXPERIMENT_FILES])
def test_the_resolved_config_is_the_same_experiment(tmp_path: Path, name: str) -> None:
    experiment = shipped(name)
    assert again(experiment, tmp_path).points == experiment.points


VARIED = """
name: varied
runs: 4
scenario: MANEUVER
filters:
  A: {nmf: {q: 0}, mf: {q: 0}, kind: adaptive-kf, preset: seconds, exit: {p: 3}}
  B: {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}
  C: {kind: ukf}
  D: {kind: imm, motions: [{kind: cv, q: 0.1}, {kind: cv, q: 1}], transition: [[0.9, 0.1], [0.1, 0.9]]}
""".replace("MANEUVER", maneuver_text(duration=100, legs=()))


@pytest.mark.parametrize("only", [[], ["C"]])
@pytest.mark.parametrize(
    "axis",
    [
        "filters.A.preset: [paper-eta20, seconds, paper-eta35]",
        "filters.C.noise: [additive, augmented]",
        "filters.C.kind: [ukf, pf, ekf]",
        "filters.A.kind: [adaptive-kf]",
        "filters.B.assume.motion.kind: [cv, cwna]",
        "filters.D.motions.0.kind: [cv, cwna, ca]",
        "filters.B.assume.motion: [{kind: cv, q: 0.1}, {kind: cwna, q: 0.2}]",
        "scenario.assume.motion: [{kind: cv, q: 0.1}, {kind: ca, q: 0.2}]",
        "scenario.sensor.kind: [position]",
        "filters.C: [{kind: ukf}, {kind: pf, N: 50}, {kind: ukf, noise: additive}]",
        "scenario.kind: [tracking]",
        "scenario.target.legs: [[], [{start: 20, end: 60, ax: 0.1, ay: 0}]]",
    ],
)
def test_each_point_of_a_grid_has_the_defaults_of_its_own_kind_and_preset(
    tmp_path: Path, axis: str, only: list[str]
) -> None:
    path, _, values = axis.partition(": ")
    (tmp_path / "a.yaml").write_text(f'{VARIED}grid: {{"{path}": {values}}}\n')
    experiment = load(tmp_path / "a.yaml", only=only)
    assert again(experiment, tmp_path).points == experiment.points


@pytest.mark.usefixtures("no_report")
def test_only_may_be_taken_back(tmp_path: Path) -> None:
    config = tmp_path / "a.yaml"
    config.write_text(CONFIG.replace("published: [numbers.csv]\nreference: 1e5\n", ""))
    quiet: dict[str, Any] = {"engine": "serial", "quiet": True, "formats": ()}
    api.run(config, out=tmp_path / "first", only=["PF"], **quiet)
    assert open_results(tmp_path / "first").labels == ["PF"]
    api.run(tmp_path / "first" / "config.yaml", out=tmp_path / "o", only=["HDEPF"], **quiet)
    found = open_results(tmp_path / "o")
    assert found.labels == ["HDEPF"]
    assert set(found.summary["filter"]) == {"HDEPF"}


@pytest.mark.parametrize(
    "word",
    ["1e5", "1.", ".5", "-3", "no", "null", "~", "True", ".inf", "12:30", "0x1F", "a: b", ""],
)
def test_a_word_stays_a_word(word: str) -> None:
    data = {"title": word, word or "x": [word, 1e5, 1e-5, float("inf"), None, True, 10**20]}
    assert parse(as_yaml(data), "a.yaml").data == data
    assert yaml.safe_load(as_yaml({"title": word})) == {"title": word}


@pytest.mark.usefixtures("no_report")
def test_a_config_of_the_users_own_is_not_replaced(tmp_path: Path) -> None:
    """`--out .` in the folder of configs; but a run that was killed after its config goes on."""
    text = f"name: c\nruns: 4  # a comment\n{PLANE}filters:\n  UKF: {{kind: ukf}}\n"
    (tmp_path / "config.yaml").write_text(text)
    done = trackbench("run", "config.yaml", "--out", ".", cwd=tmp_path)
    assert (done.returncode, (tmp_path / "config.yaml").read_text()) == (2, text)
    assert "config.yaml: no run wrote this file, and this run would replace it" in done.stderr
    assert trackbench("run", "config.yaml", "--out", "o", cwd=tmp_path).returncode == 0
    for path in (tmp_path / "o").rglob("*"):
        if path.is_file() and path.name != "config.yaml":
            path.unlink()
    assert trackbench("run", "config.yaml", "--out", "o", cwd=tmp_path).returncode == 0
