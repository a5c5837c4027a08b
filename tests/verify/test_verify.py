"""`trackbench verify`: the same bytes, or what differs by filter."""

import json
import shutil

import numpy as np
import pytest
import yaml

from tests.commands import ran, trackbench
from tests.papers import banana_text, merwe_text
from tests.report.forging import edit, elsewhere, reseal
from trackbench import api
from trackbench.errors import UserError
from trackbench.results.file_names import is_in_git
from trackbench.results.manifest import read_manifest, write_manifest
from trackbench.verify.verify_folder import verify

CONFIG = """
name: small
runs: 20
scenario: MERWE
filters: {PF: {kind: pf, N: 50}, UKF: {kind: ukf}, No data: {kind: prior-mean}}
tables: {t: {kind: metrics, columns: {Mean: mean(rmse), "At 5": rmse@5}}}
""".replace("MERWE", merwe_text(T=6))


def of_runs(lines):
    """Choose the lines about per_run.csv."""
    return [line for line in lines if line.startswith("per_run.csv")]


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
    assert verify(folder, 1) == [f"{name}: has another digest when it is computed again"]


@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        ("summary.csv", "PF,mean(rmse),0.", "PF,mean(rmse),1.", "summary.csv: PF: 1 of "),
        ("summary.csv", "No data,mean(", "PF,mean(", "summary.csv: has other rows"),
        ("tables/table1.csv", "PF,0.", "PF,1.", "tables/table1.csv: 1 row "),
        ("claims.csv", "better,fails", "better,holds", "claims.csv: 1 row does not follow"),
    ],
)
def test_an_edited_number_in_a_clone_is_changed(folder, name, old, new, line):
    edit(as_cloned(folder), name, old, new)
    lines = verify(folder, 1)
    assert [text for text in lines if text.startswith(line)], lines


def test_the_clone_of_other_results_names_the_filters_that_differ(config):
    lines = verify(as_cloned(elsewhere(config, "ukf", lambda rng, shape: 1.02)), 1)
    assert {line.partition(":")[0] for line in lines} == {
        *("per_run.csv", "per_step.csv", "summary.csv")
    }
    (of_filter,) = (line for line in lines if line.startswith("summary.csv"))
    assert of_filter.startswith("summary.csv: UKF: ")


def test_blocks_that_fit_come_out_again_of_fewer_runs(tmp_path):
    text = (
        f"name: fitted\nruns: 20\nblock: fit\nscenario: {merwe_text(T=4)}\n"
        "filters: {PF: {kind: pf, N: 2000}}\n"
        "figures: {last: {kind: estimates, run: 20}}\n"
    )
    folder = ran(tmp_path, text).folder
    assert verify(folder, 3) == []
    assert verify(folder, 12) == []
    assert verify(folder, 20) == []


def test_a_filter_that_loses_all_of_the_first_runs_comes_out_again(tmp_path):
    """It has no rows over the steps then; the stored ones were called rows that are not computed."""
    text = (
        "name: losing\nruns: 20\nscenario:\n  kind: tracking\n  last: 8\n"
        "  target: {kind: driven, motion: {kind: cwna, q: 1}}\n  sensor: {kind: position, sigma: 1}\n"
        "  start: {kind: gaussian, sigma: [3, 1, 3, 1]}\n  score: {lost_beyond: 12}\n"
        "filters: {KF: {kind: kf}, None: {kind: prior-mean}}\n"
    )
    report = ran(tmp_path, text)
    frame = report.results.per_run.query("filter == 'None' and metric == 'lost'")
    lost = frame["value"].to_numpy() != 0.0
    first = int(np.argmin(lost))
    assert first > 0
    assert verify(report.folder, first) == []


@pytest.mark.parametrize("kind", ["pf", "ukf"])
def test_the_largest_relative_difference_of_each_filter_is_reported(config, kind):
    folder = elsewhere(config, kind, lambda rng, shape: 1.0 + 2e-5)
    (line,) = of_runs(verify(folder, 3))
    assert line.startswith(f"per_run.csv: {kind.upper()}: ")
    assert line.endswith(" numbers differ, by 2.0e-05 of the value at most")


def test_runs_that_are_not_computed_are_not_compared(config):
    def third(rng, shape):
        return np.where(np.arange(shape[1]) == 3, 1.001, 1.0)

    folder = elsewhere(config, "ukf", third)
    assert of_runs(verify(folder, 4))[0].startswith("per_run.csv: UKF: ")
    assert verify(folder, 3) == []


def test_other_noise_of_a_particle_filter_is_changed(config):
    (line,) = of_runs(verify(elsewhere(config, "pf", None), 20))
    assert line.startswith("per_run.csv: PF: ")


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
def test_odd_experiments_come_out_again(tmp_path, case):
    given = yaml.safe_load(CONFIG) | yaml.safe_load(ODD[case])
    (tmp_path / "own.py").write_text(PLUGIN)
    folder = ran(tmp_path, yaml.safe_dump(given), allow_plugins=True).folder
    assert verify(folder, 5, allow_plugins=True) == []
    assert verify(folder, 20, allow_plugins=True) == []


def test_another_filter_than_the_one_that_was_run_is_changed(folder):
    edit(folder, "config.yaml", "N: 50,", "N: 500,")
    lines = of_runs(verify(folder, 20))
    assert [line for line in lines if line.startswith("per_run.csv: PF (N=50): ")]


def test_a_filter_that_is_not_stored_is_changed(folder):
    rows = (folder / "per_run.csv").read_text().splitlines(keepends=True)
    (folder / "per_run.csv").write_text("".join(r for r in rows if not r.startswith("No data")))
    reseal(folder)
    (line,) = of_runs(verify(folder, 1))
    assert "has other rows than are computed again" in line
    assert line.endswith("the first is 'Exact, 0, lost', it should be 'No data, 0, lost'")


def test_the_command_says_which_and_leaves_with_1_if_it_is_changed(config, folder, tmp_path):
    forged = shutil.copytree(folder, tmp_path / "forged")
    edit(forged, "tables/table1.csv", "PF,0.", "PF,1.")
    assert command_lines(folder) == [f"{folder}: the same bytes"]
    lines = command_lines(forged, tmp_path / "nowhere", folder, status=2)
    assert lines[0] == f"{forged}: changed"
    assert lines[1].startswith("  tables/table1.csv: 1 row ")
    assert f"{folder}: the same bytes" in lines
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
    assert verify(folder, 1) == [
        f"{folder}: points.json is missing: run the experiment again",
        f"{folder}: summary.csv was changed after the run: run the experiment again",
    ]
    (folder / "manifest.json").write_text(json.dumps({}))
    (line,) = verify(folder, 1)
    assert line == f"{folder}: manifest.json cannot be read: run the experiment again"
