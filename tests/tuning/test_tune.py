"""Tuning as it is typed: what comes out, and that it comes out again."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trackbench
from tests.commands import trackbench as run_trackbench
from trackbench import api
from trackbench.commands.jobs_with_tuned_values import with_tuned
from trackbench.commands.prepare_jobs import jobs_of
from trackbench.errors import UserError
from trackbench.report.tables.tuning import _cells
from trackbench.report.tables_and_figures import Results
from trackbench.tuning.range_of_good_values import values_within_stderr
from trackbench.tuning.record_of_trials import Record, Trial
from trackbench.tuning.remarks_on_keys import remarks_on_keys
from trackbench.verify.compare_tuning import compare_tuning
from trackbench.verify.verify_folder import verify

CONFIG = """
name: small
seed: 11
runs: 60
scenario:
  kind: tracking
  last: 40
  target: {kind: driven, motion: {kind: cwna, q: 0.5}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
filters:
  KF: {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}
  Kind: {kind: kf, assume: {motion: {kind: cv, q: 0.4}}}
tune:
  KF: {assume.motion.q: log:1e-3..100}
  Kind: {assume.motion.kind: [cv, cwna], assume.motion.q: log:1e-3..100}
tuning: {runs: 80, evaluations: 20}
metrics: [rmse_position, nees]
tables:
  rmse: {kind: metrics, columns: {Position: rms(rmse_position), ANEES: anees}}
"""
SAME = ("tuning.csv", "per_run.csv", "per_step.csv", "summary.csv", "paired.csv", "config.yaml")


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tune") / "small.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture(scope="module")
def report(config: Path) -> api.Report:
    return trackbench.run(config, out=config.parent / "out", workers=1, quiet=True, formats=["svg"])


def rerun(config: Path, folder: Path, **changes: Any) -> api.Report:
    """Run once more into another folder, without figures."""
    options = api.Options(workers=1, quiet=True, formats=())
    return trackbench.run(config, options, out=folder / "out", **changes)


def _files(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in SAME}


def test_a_kalman_filter_finds_the_noise_that_drives_the_target(report: api.Report) -> None:
    """Of a linear Gaussian target the true q is the best: the error rises by its square from there."""
    found = report.results.tuning["KF"]
    assert 0.25 < found.best.values["assume.motion.q"] < 1.0
    low, high = values_within_stderr(found, found.axes[0])
    assert low < 0.5 < high
    assert found.trials[0].values["assume.motion.q"] == 0.01
    assert len(found.trials) <= 20


def test_the_time_of_training_is_counted_whether_it_was_kept_or_not(
    report: api.Report, config: Path
) -> None:
    trained = sum(record.cpu_s for record in _tuned_by(config).values())
    results = report.results.timing["cpu_s"].sum()
    assert trained > results > 0.0  # 20 trials of 80 runs beside 60 runs
    assert report.results.manifest["cpu_s"] == pytest.approx(trained + results, abs=2e-3)


def _tuned_by(config: Path) -> dict[str, Record]:
    """What is found from the blocks that the run kept."""
    options = api.Options(engine="serial", quiet=True)
    return dict(with_tuned(jobs_of([config], options)[0], options).tuning)


READ_BLOCKS = """
import sys
from trackbench.__main__ import main

reads = []

def count(event, arguments):
    if event == "open" and str(arguments[0]).endswith(".block"):
        reads.append(arguments[0])

sys.addaudithook(count)
if __name__ == "__main__":
    try:
        main()
    except SystemExit:
        pass
    print(len(reads))
"""
"""A program that runs trackbench, and prints how often it opened a block."""


def test_a_dry_run_after_tuning_reads_each_trial_once(report: api.Report, config: Path) -> None:
    words = ["run", str(config), "--dry-run", "--engine", "serial"]
    command = [sys.executable, "-c", READ_BLOCKS, *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    size, reads = done.stdout.splitlines()
    assert size.endswith("every block is in the cache")
    trials = sum(len(record.trials) for record in report.results.tuning.values())
    assert trials > 20
    assert int(reads) == trials  # each is one block


def test_tuned_filters_stand_beside_the_others(report: api.Report) -> None:
    labels = ["KF", "KF (tuned)", "Kind", "Kind (tuned)"]
    assert [keys[0] for keys in report.tables["rmse"].keys] == labels
    values = [cells[0].estimate.value for cells in report.tables["rmse"].cells]
    assert values[1] < 0.9 * values[0]
    paired = (report.folder / "paired.csv").read_text()
    assert "KF (tuned),Kind (tuned),rms(rmse_position)" in paired
    entry = report.results.config["filters"]["KF (tuned)"]
    best = report.results.tuning["KF"].best.values["assume.motion.q"]
    assert entry["assume"]["motion"] == {"kind": "cwna", "q": best}


def test_the_table_has_both_numbers_and_their_gap(report: api.Report) -> None:
    """Held against numpy over the runs; the training's against the file."""
    table = report.tables["tuning"]
    training, result, gap, untuned, gained = (cell.estimate for cell in table.cells[0])
    runs = report.results.runs({})
    tuned, given = (runs[label, "rmse_position"] for label in ("KF (tuned)", "KF"))
    assert result.value == pytest.approx(np.sqrt(np.mean(tuned**2)))
    assert untuned.value == pytest.approx(np.sqrt(np.mean(given**2)))
    assert training.value == report.results.tuning["KF"].best.objective
    assert gap.value == pytest.approx(result.value - training.value)
    assert gap.stderr == pytest.approx(np.hypot(result.stderr, training.stderr))
    assert abs(gap.value) < 4 * gap.stderr
    assert gained.value == pytest.approx(untuned.value - result.value)
    rng = np.random.default_rng(1)
    numbers = rng.integers(len(tuned), size=(2000, len(tuned)))
    resampled = np.sqrt((given[numbers] ** 2).mean(1)) - np.sqrt((tuned[numbers] ** 2).mean(1))
    assert gained.stderr == pytest.approx(resampled.std(), rel=0.15)


def test_a_figure_per_filter(report: api.Report) -> None:
    names = sorted(path.name for path in (report.folder / "figures").iterdir())
    assert names == ["tuning-KF.svg", "tuning-Kind.svg"]
    drawn = (report.folder / "figures" / "tuning-Kind.svg").read_text()
    assert "kind of motion" in drawn
    assert "cwna" in drawn
    page = (report.folder / "report.html").read_text()
    assert 'id="figure-tuning-KF"' in page


@pytest.mark.parametrize("workers", [1, 2])
def test_the_same_bytes_for_any_workers_and_from_nothing(
    report: api.Report, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    again = rerun(config, tmp_path, workers=workers)
    assert _files(again.folder) == _files(report.folder)


def test_fresh_and_resumed(report: api.Report, config: Path, tmp_path: Path) -> None:
    for fresh in (True, False):
        again = rerun(config, tmp_path, fresh=fresh)
        assert _files(again.folder) == _files(report.folder)
    manifest = again.results.manifest
    assert manifest["blocks"] == {"computed": 0, "reused": 4}  # one of each filter


def test_another_filter_beside_it_changes_nothing(
    report: api.Report, config: Path, tmp_path: Path
) -> None:
    alone = rerun(config, tmp_path, only=["Kind"])
    assert list(alone.results.tuning) == ["Kind"]
    mine = [
        line for line in (report.folder / "tuning.csv").read_text().splitlines() if "Kind" in line
    ]
    assert (alone.folder / "tuning.csv").read_text().splitlines()[1:] == mine
    assert [keys[0] for keys in alone.tables["rmse"].keys] == ["Kind", "Kind (tuned)"]


def test_the_tuned_config_gives_the_same_again(report: api.Report, tmp_path: Path) -> None:
    again = rerun(report.folder / "config.yaml", tmp_path)
    assert _files(again.folder) == _files(report.folder)
    assert not verify(report.folder, 20)
    figure = (report.folder / "figures" / "tuning-KF.svg").read_bytes()
    api.plot(report.folder, ("svg",))
    assert (report.folder / "figures" / "tuning-KF.svg").read_bytes() == figure


def _found_in(folder: Path, runs: int = 20) -> list[str]:
    experiment = api.prepare(folder / "config.yaml", api.Options())
    return [*compare_tuning(Results(folder), experiment, runs)]


def test_every_trial_is_computed_again_where_every_run_is(report: api.Report) -> None:
    assert not _found_in(report.folder, runs=60)


def test_a_forged_tuning_is_found(report: api.Report, tmp_path: Path) -> None:
    """A number of the first trial, a value that was not asked for, a value not taken into the config."""
    whole = report.folder / "tuning.csv"
    rows = [line.split(",") for line in whole.read_text().splitlines()]
    for name, place, column, said in (
        ("number", 1, 4, "tuning.csv: KF at assume.motion.q = 0.01: "),
        ("value", 4, 3, "tuning.csv: KF: trial 3 is not what the search asks for"),
    ):
        folder = Path(shutil.copytree(report.folder, tmp_path / name))
        forged = [list(row) for row in rows]
        forged[place][column] = f"{1.001 * float(rows[place][column]):.7g}"
        (folder / "tuning.csv").write_text("\n".join(map(",".join, forged)) + "\n")
        (found,) = _found_in(folder)
        assert found.startswith(said)
    folder = Path(shutil.copytree(report.folder, tmp_path / "config"))
    q = report.results.tuning["KF"].best.values["assume.motion.q"]
    text = (folder / "config.yaml").read_text()
    assert f"q: {q}" in text
    (folder / "config.yaml").write_text(text.replace(f"q: {q}", "q: 0.9", 1))
    assert _found_in(folder) == [
        f"config.yaml: KF (tuned): assume.motion.q is 0.9, the best trial of tuning.csv has {q}"
    ]


def test_what_should_be_known_is_said(config: Path, tmp_path: Path) -> None:
    changes = [
        "tune.KF={assume.motion.q: log:1e-3..0.05}",
        "tune.Kind={assume.motion.q: 0.4..0.45}",
        "scenario.score.lost_beyond=7",
    ]
    report = rerun(config, tmp_path, set=changes)
    notes = "\n".join(report.tables["tuning"].notes)
    assert "KF: assume.motion.q is at its upper bound, 0.05: let it go further." in notes
    assert "Kind: assume.motion.q hardly matters: from 0.4 to 0.45" in notes
    assert "of 80 training runs are lost with the best values." in notes
    # The table counts the lost training runs among all training runs.
    training = report.tables["tuning"].cells[0][0]
    assert training.lost == report.results.tuning["KF"].best.lost > 0
    assert training.runs == 80 - training.lost
    changes = ["tune.Kind={assume.motion.q: [0.4, 50]}", "only=[Kind]"]
    report = rerun(config, tmp_path, set=changes)
    text = (
        "on the runs of the results the tuned filter is not significantly better than the one as "
        "configured"
    )
    assert f"Kind: {text}." in report.tables["tuning"].notes


def test_a_filter_that_failed_in_training_has_lost_no_number_of_runs(report: api.Report) -> None:
    record = report.results.tuning["KF"]
    failed = [Trial.of(trial.values, None) for trial in record.trials]
    record = Record(axes=record.axes, trials=failed)
    training, *others = _cells(record, 80, None, None)
    assert np.isnan(training.estimate.value)
    assert [cell.lost for cell in (training, *others)] == [0, 0, 0, 0]
    text = f"the filter failed in all {len(failed)} trials, first with assume.motion.q = 0.01"
    assert [*remarks_on_keys(record, 80)] == [text]


FRAGILE = """
from trackbench.adapters import PerRun


class Fragile(PerRun, kind="fragile"):
    g: float = 1.0
    idle: float = 1.0

    def __post_init__(self):
        if 0.25 < self.g < 0.35:
            raise ValueError("this gain is not allowed")

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        if self.g > 0.5:
            raise RuntimeError("this gain is too large")
        if z is not None:
            self.x[::2] += self.g * (z - self.x[::2])
        return self.x, self.P
"""


def fragile(folder: Path, tune: str, g: float) -> api.Report:
    """Run the experiment with a filter that fails if its key g is above 0.5."""
    (folder / "fragile.py").write_text(FRAGILE)
    config = folder / "fragile.yaml"
    scenario = CONFIG.partition("filters:")[0]
    filters = f"filters: {{Fragile: {{kind: fragile, g: {g}}}}}\ntune: {{Fragile: {tune}}}\n"
    tuning = "tuning: {runs: 4, evaluations: 9}\n"
    config.write_text(f"plugins: [fragile.py]\n{scenario}{filters}{tuning}")
    return rerun(config, folder, allow_plugins=True)


@pytest.mark.parametrize(
    ("range_of_g", "g", "which"), [("0.6..2", 1.0, "all 9"), ("0.1..0.9", 0.2, "[1-8] of 9")]
)
def test_failed_trials_have_the_reason_of_the_first(
    tmp_path: Path, range_of_g: str, g: float, which: str
) -> None:
    report = fragile(tmp_path, f"{{g: {range_of_g}}}", g)
    reason = r"fragile\.py:\d+: RuntimeError: this gain is too large \(run -1, step 1, 1 s\)"
    pattern = rf"the filter failed in {which} trials, first with g = 0?[\d.]+: {reason}"
    # On the screen, in the table, and in the table of the stored results.
    assert re.fullmatch(f"tuning of Fragile: {pattern}", report.run_notes[0])
    for results in (report.results, Results(report.folder)):
        notes = results.tables["tuning"].notes
        assert re.fullmatch(rf"Fragile: {pattern}\.", notes[0])
    assert not verify(report.folder, 20, allow_plugins=True)


def test_an_invalid_trial_has_its_mistake(tmp_path: Path) -> None:
    """A combination that the ends of the ranges do not show."""
    report = fragile(tmp_path, "{g: 0.1..0.4}", 0.2)
    assert re.search(r"first with g = 0\.[23]\d*: .*this gain is not allowed", report.run_notes[0])


def test_a_key_without_effect_is_named(tmp_path: Path) -> None:
    report = fragile(tmp_path, "{idle: 0.1..2}", 0.2)
    text = "idle has no effect: 9 trials with different values of it have an equal metric"
    expected = f"{text}; check that the filter reads this key"
    assert report.run_notes == [f"tuning of Fragile: {expected}"]
    assert report.tables["tuning"].notes[0] == f"Fragile: {expected}."
    assert not [note for note in report.tables["tuning"].notes if "hardly matters" in note]


def test_filters_share_a_note_on_tuning(config: Path, tmp_path: Path) -> None:
    changes = [
        "tune.KF={assume.motion.q: log:1e-3..0.05}",
        "tune.Kind={assume.motion.q: log:1e-3..0.05}",
    ]
    report = rerun(config, tmp_path, set=changes)
    text = "assume.motion.q is at its upper bound, 0.05: let it go further"
    assert f"KF and Kind: {text}." in report.tables["tuning"].notes


def test_a_run_takes_the_old_tuning_away(config: Path, tmp_path: Path) -> None:
    rerun(config, tmp_path)
    assert not (rerun(config, tmp_path, set=["tune={}"]).folder / "tuning.csv").exists()


def test_by_anees_it_is_consistent(config: Path, tmp_path: Path) -> None:
    changes = ["tuning.metric=anees", "only=[KF]"]
    report = rerun(config, tmp_path, set=changes)
    assert report.results.tuning["KF"].best.objective < 0.05
    (_, anees), (_, tuned) = report.tables["rmse"].cells
    assert anees.estimate.value > 1.5
    assert abs(tuned.estimate.value - 1.0) < 0.1 + 3.0 * tuned.estimate.stderr


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("tune.XF={q: 1..2}", "tune.XF: 'XF' is not a filter here; did you mean KF?"),
        ("tune.KF={}", "tune.KF: 0 keys; a filter is tuned in 1 to 5"),
        ("tune.KF={assume.motion.q: 2..1}", "tune.KF.assume.motion.q: '2..1' does not rise"),
        ("tune.KF={assume.motion.q: -1..1}", "tune.KF.assume.motion.q: at -1.0: assume.motion.q:"),
        ("tune.KF={asume.q: 1..2}", "tune.KF.asume.q: at 1: asume: unknown key; did you mean"),
        (
            "tune.Kind={assume.motion.kind: [cv, cvv]}",
            "tune.Kind.assume.motion.kind: at cvv: assume.motion.kind: 'cvv' is not a kind of motion",
        ),
        ("tuning.metric=rmse@3", "tuning.metric: 'rmse@3' is no statistic over runs"),
        (
            "tuning.metric=rms(rmse_positon)",
            "tuning.metric: 'rms(rmse_positon)' is no metric here; did you mean rms(rmse_position)?",
        ),
        ("tuning.metric=rms(rmse_velocity)", "rmse_velocity"),
        ("tuning.evaluations=1", "tuning.evaluations: 1 is less than 2"),
        ("tuning.budget=1", "tuning.budget: unknown key; known:"),
        (
            "grid={scenario.sensor.sigma: [1, 2]}",
            "tune: each point of a grid has values of its own",
        ),
        ("reference=KF", "tune.KF: the reference filter measures the others; tune another filter"),
        ("tune=3", "tune: 3 is not a mapping"),
    ],
)
def test_a_mistake_is_a_line(config: Path, change: str, what: str) -> None:
    with pytest.raises(UserError) as error:
        api.prepare(config, api.Options(set=[change]))
    lines = str(error.value).splitlines()
    assert any(what in line for line in lines), lines
    assert all(line.startswith((f"--set {change}: ", f"{config}:")) for line in lines), lines


def test_fit_finds_q_and_r_by_the_likelihood(config: Path, tmp_path: Path) -> None:
    """The maximum of the log score is near the true q and sigma."""
    keys = "{assume.motion.q: log:1e-3..100, assume.sensor.sigma: 0.5..8}"
    assume = "{motion: {kind: cwna, q: 0.01}, sensor: {kind: position, sigma: 5}}"
    given = [f"tune={{KF: {keys}}}", f"filters.KF.assume={assume}", "tables={}", "metrics=null"]
    words = [word for text in given for word in ("--set", text)]
    options = [*words, "--runs", "20", "--only", "KF", "--engine", "serial", "--format", "svg"]
    done = run_trackbench("fit", config, *options, "--out", "fitted", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    best = Results(tmp_path / "fitted").tuning["KF"].best.values
    assert 0.25 < best["assume.motion.q"] < 1.0
    assert best["assume.sensor.sigma"] == pytest.approx(2.0, abs=0.2)
