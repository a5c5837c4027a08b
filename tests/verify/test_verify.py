"""`trackbench verify`: the same bytes, the same but for rounding, or changed."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from tests.papers import banana_text, merwe_text
from tests.report.forging import edit, elsewhere, reseal
from trackbench import api
from trackbench.errors import UserError
from trackbench.results.folder_contents import is_in_git, read_manifest, write_manifest
from trackbench.verify import verdict, verify

CONFIG = """
name: small
runs: 20
scenario: MERWE
filters: {PF: {kind: pf, N: 50}, UKF: {kind: ukf}, No data: {kind: prior-mean}}
tables: {t: {kind: metrics, columns: {Mean: mean(rmse), "At 5": rmse@5}}}
""".replace("MERWE", merwe_text(T=6))
SAME, ROUNDING, CHANGED = "the same bytes", "the same but for rounding", "changed"


def found(folder, runs=20):
    """The verdict, and the lines about per_run.csv."""
    findings = verify(folder, runs)
    return verdict(findings), [f.text for f in findings if f.text.startswith("per_run.csv")]


@pytest.fixture
def config(tmp_path):
    (tmp_path / "c.yaml").write_text(CONFIG)
    return tmp_path / "c.yaml"


def as_cloned(folder):
    """Keep what git keeps of a results folder."""
    for path in [p for p in folder.rglob("*") if p.is_file()]:
        if not is_in_git(path.relative_to(folder).as_posix()):
            path.unlink()
    return folder


def test_stored_results_are_reproduced(folder):
    assert verify(folder, 5) == []
    assert verify(as_cloned(folder), 5) == []
    assert api.load(folder).summary["value"].notna().any()
    for command in (api.compare, api.plot, api.report):
        with pytest.raises(UserError, match=r"is missing.*: run the experiment again"):
            command(folder)
    assert verify(folder, 5) == []


def test_the_overview_needs_the_runs_of_published_experiments_alone(config, tmp_path):
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "all" / "small")
    as_cloned(api.run(config, options, formats=("svg",)).folder)
    assert len(api.report(tmp_path / "all")) == 2


def mend_digest(folder, name):
    manifest = read_manifest(folder)
    manifest["files"][name] = "0" * 64
    write_manifest(folder, manifest, [])


@pytest.mark.parametrize("name", ["per_run.csv", "per_step.csv", "shown.npz"])
def test_a_wrong_digest_in_a_clone_is_changed(folder, name):
    mend_digest(as_cloned(folder), name)
    (finding,) = verify(folder, 1)
    assert finding.text == f"{name}: has another digest when it is computed again"
    assert not finding.is_rounding


@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        ("summary.csv", "PF,mean(rmse),0.", "PF,mean(rmse),1.", "summary.csv: 1 of "),
        ("summary.csv", "No data,mean(", "PF,mean(", "summary.csv: has other rows"),
        ("tables/table1.csv", "PF,0.", "PF,1.", "tables/table1.csv: 1 rows "),
        ("claims.csv", "better,fails", "better,holds", "claims.csv: 1 rows do not follow"),
    ],
)
def test_an_edited_number_in_a_clone_is_changed(folder, name, old, new, line):
    edit(as_cloned(folder), name, old, new)
    found = verify(folder, 1)
    assert verdict(found) == CHANGED
    assert [f.text for f in found if f.text.startswith(line)], [f.text for f in found]


@pytest.mark.parametrize("kind", ["pf", "ukf"])
def test_the_clone_of_another_machine_s_results_is_rounding(config, kind):
    def last_digits(rng, shape):
        return 1.0 + 1e-6 * rng.standard_normal(shape)

    found = verify(as_cloned(elsewhere(config, kind, last_digits)), 1)
    assert verdict(found) == ROUNDING, found
    assert {"summary.csv", "per_run.csv"} <= {f.text.partition(":")[0] for f in found}


def test_the_clone_of_a_filter_that_draws_other_noise_is_rounding(config):
    found = verify(as_cloned(elsewhere(config, "pf", None)), 1)
    assert verdict(found) == ROUNDING, found


def test_the_clone_of_a_worse_kalman_filter_is_changed(config):
    found = verify(as_cloned(elsewhere(config, "ukf", lambda rng, shape: 1.02)), 1)
    assert verdict(found) == CHANGED


def test_blocks_that_fit_come_out_again_of_fewer_runs(tmp_path):
    config = tmp_path / "fitted.yaml"
    config.write_text(
        f"name: fitted\nruns: 20\nblock: fit\nscenario: {merwe_text(T=4)}\n"
        "filters: {PF: {kind: pf, N: 2000}}\n"
        "figures: {last: {kind: estimates, run: 20}}\n"
    )
    folder = api.run(config, out=tmp_path / "out", workers=1, quiet=True, formats=()).folder
    assert verify(folder, 3) == []
    assert verify(folder, 12) == []
    assert verify(folder, 20) == []


@pytest.mark.parametrize("kind", ["pf", "ukf"])
def test_last_digits_of_any_filter_are_rounding(config, kind):
    folder = elsewhere(config, kind, lambda rng, shape: 1.0 + 1e-6 * rng.standard_normal(shape))
    is_, (line,) = found(folder)
    assert is_ == ROUNDING
    assert line.startswith(f"per_run.csv: {kind.upper()}: ")
    assert "values differ in the first 20 runs, by " in line
    assert line.endswith("e-06 at most: they agree in 5 digits")


def test_an_error_of_a_kalman_filter_that_is_larger_is_changed(config):
    is_, (line,) = found(elsewhere(config, "ukf", lambda rng, shape: 1.02))
    assert is_ == CHANGED
    assert line.startswith("per_run.csv: UKF: ")
    assert "by more than rounding: " in line


def test_one_run_of_a_filter_that_draws_nothing_is_changed(config):
    def third(rng, shape):
        return np.where(np.arange(shape[1]) == 3, 1.001, 1.0)

    folder = elsewhere(config, "ukf", third)
    is_, (line,) = found(folder, 4)
    assert is_ == CHANGED
    assert "by more than rounding: rmse" in line
    assert " of run 3 is 0." in line
    assert found(folder, 3) == (SAME, [])


def test_runs_of_a_particle_filter_that_differ_both_ways_are_rounding(config):
    is_, (line,) = found(elsewhere(config, "pf", None))
    assert is_ == ROUNDING
    assert line.startswith("per_run.csv: PF: ")
    assert line.endswith("it draws, so that rounding grows, and no mean differs beyond chance")


@pytest.mark.parametrize("heavy", [False, True])
def test_runs_of_a_particle_filter_that_are_all_worse_are_changed(config, heavy):
    def worse(rng, shape):  # one run that is far better hides the mean of the others
        factor = np.exp(0.2 + 0.05 * rng.standard_normal(shape[1]))
        factor[7] = 0.01 if heavy else 1.0
        return factor

    is_, (line,) = found(elsewhere(config, "pf", worse))
    assert is_ == CHANGED
    assert "PF: " in line
    assert "on average beyond chance: rmse by 0." in line


PLUGIN = """
from dataclasses import dataclass

from trackbench.filters.baselines import PriorMean
from trackbench.registry import register


@register("filters", "raises")
@dataclass(frozen=True, kw_only=True)
class Raises(PriorMean):
    'Fails.'

    def init(self, model, prior, rng):
        raise ValueError("no")
"""
ODD = {
    "one run": "runs: 1",
    "nothing kept": "metrics: []\nper_step: []\ntables: {}",
    "steps kept only": "metrics: [nees]\nper_step: [rmse, bias]\nmedians: [nees]\ntables: {}",
    "words in a grid": "grid: {filters.PF.resampling: [systematic, residual], "
    "scenario.score.lost_beyond: [null, 0.4]}",
    "every filter fails": "plugins: [own.py]\nfilters: {A: {kind: raises}}\n"
    "grid: {scenario.sensor.R: [1, 2]}",
    "a bound": f"bound: PCRLB\ntables: {{}}\nscenario: {banana_text(scans=4)}\n"
    "filters: {EKF: {kind: ekf, start: mucm}}",
}


@pytest.mark.parametrize("case", ODD)
def test_odd_experiments_come_out_again(config, case):
    given = yaml.safe_load(CONFIG) | yaml.safe_load(ODD[case])
    config.write_text(yaml.safe_dump(given))
    (config.parent / "own.py").write_text(PLUGIN)
    options = api.Options(engine="serial", quiet=True, out=config.parent / "out", formats=())
    folder = api.run(config, options, allow_plugins=True).folder
    assert verify(folder, 5, allow_plugins=True) == []
    assert verify(folder, 20, allow_plugins=True) == []


def test_another_filter_than_the_one_that_was_run_is_changed(folder):
    edit(folder, "config.yaml", "N: 50,", "N: 500,")
    is_, lines = found(folder)
    assert is_ == CHANGED
    assert [line for line in lines if line.startswith("per_run.csv: PF (N=50): ")]


def test_a_filter_that_is_not_stored_is_changed(folder):
    rows = (folder / "per_run.csv").read_text().splitlines(keepends=True)
    (folder / "per_run.csv").write_text("".join(r for r in rows if not r.startswith("No data")))
    reseal(folder)
    is_, (line,) = found(folder, 1)
    assert is_ == CHANGED
    assert "metrics are stored or computed again only; the first is No data, lost" in line


def test_another_processor_gives_no_change(tmp_path):
    """Whatever it does to the bytes: perhaps nothing."""
    config = tmp_path / "c.yaml"
    config.write_text(
        f"name: cloud\nruns: 20\nscenario: {banana_text(scans=12)}\n"
        "filters: {RPF: {kind: rpf, N: 200}, EKF: {kind: ekf, start: mucm}}\n"
    )
    old = {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": "X86_V4"}
    command = [sys.executable, "-m", "trackbench", "run", str(config), "--workers", "1"]
    subprocess.run([*command, "--out", tmp_path / "out"], check=True, env={**os.environ, **old})
    assert found(tmp_path / "out")[0] in (SAME, ROUNDING)


def test_the_command_says_which_and_leaves_with_1_if_it_is_changed(config, tmp_path):
    rounded = elsewhere(config, "ukf", lambda rng, shape: 1.0 + 2e-6)
    forged = shutil.copytree(rounded, tmp_path / "forged")
    edit(forged, "summary.csv", "PF,mean(rmse),0.", "PF,mean(rmse),1.")
    lines = command_lines(rounded)
    assert lines[0] == f"{rounded}: the same but for rounding"
    assert all(line.startswith("  ") for line in lines[1:])
    lines = command_lines(forged, tmp_path / "nowhere", rounded, status=2)
    assert lines[0] == f"{forged}: changed"
    assert lines[1].startswith("  tables/t.csv: 1 rows ")
    assert f"{rounded}: the same but for rounding" in lines
    command_lines(forged, status=1)


def command_lines(*folders, status=0):
    done = trackbench("verify", *folders, "--runs", 3)
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout.splitlines()


def test_what_is_no_results_folder_is_bad_input(tmp_path):
    with pytest.raises(UserError, match="there is no such folder"):
        verify(tmp_path / "nowhere", 1)


def test_a_folder_that_is_not_whole_is_changed(folder):
    (folder / "summary.csv").write_text("")
    (folder / "points.json").unlink()
    assert [f.text for f in verify(folder, 1)] == [
        f"{folder}: points.json is missing: run the experiment again",
        f"{folder}: summary.csv was changed after the run: run the experiment again",
    ]
    (folder / "manifest.json").write_text(json.dumps({}))
    (finding,) = verify(folder, 1)
    assert not finding.is_rounding
