"""Suites: a roster of filters on many problems, with the scores of single runs of these problems."""

import csv
import json
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from math import exp, log
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.commands import trackbench
from tests.conftest import ROOT
from tests.suite_scores import stored_suite
from trackbench.commands import expected_time, expected_time_of_suite, suite_contract
from trackbench.commands.dry_run import preview_suite
from trackbench.commands.run_options import Options
from trackbench.commands.run_suite import run_suite
from trackbench.commands.suite_report import SuiteReport
from trackbench.config.added_filters import typed_file_of
from trackbench.config.quick_run import QUICK_RUNS_OF_PROBLEM as QUICK_RUNS
from trackbench.config.shipped_suites import SuiteTime, suite_names, suite_times
from trackbench.config.suite import load_suite
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.filters.external import External
from trackbench.models.sensor_places import sensor_places
from trackbench.report.plotting import file_formats, style
from trackbench.report.plotting.point_labels import PointLabel, label_points
from trackbench.report.suite.filter_sentences import _typical_ratio_sentence, filter_sentences
from trackbench.report.suite.leading_filter import leader_of
from trackbench.report.suite.matrix_figure import cell_text, draw_matrix, ordered_problems
from trackbench.report.suite.nearest_filter import likeness_sentences, nearest_filter
from trackbench.report.suite.profile_and_cost_figures import draw_cost, draw_profile
from trackbench.report.suite.score_words import fails, indefinite_text
from trackbench.report.suite.scores import (
    FILTER,
    WORST,
    ProblemRuns,
    Ratio,
    Score,
    SuiteScores,
    profile,
    ratio_matrix,
    typical_ratio_where_run,
    typical_ratios,
)
from trackbench.report.suite.tables import filter_table, roster_table
from trackbench.statistics.significance_rules import FEWEST_RUNS

SUITE = """\
name: small
runs: 6
groups:
  known:
    title: The filter knows the model
    filters:
      EKF: {kind: ekf}
      UKF: {kind: ukf}
      UPF: {kind: upf, N: 5}
    smoothed: [EKF]
    problems:
      ungm:
        {class: multimodal, score: rms(rmse), reference: PF, set: {scenario.last: 20, filters.PF.N: 50}}
      turn: {class: mild, use: turning-aircraft, score: rms(rmse_position), set: {scenario.last: 20}}
      body: {class: singular, use: falling-body, score: rms(rmse_altitude), set: {scenario.last: 20}}
"""
LORENZ = """\
name: s
runs: 3
groups:
  g:
    title: G
    filters: {EKF: {kind: ekf}, CKF: {kind: ckf}}
    problems:
      l: {class: c, use: lorenz63, score: rms(rmse_state), set: {scenario.last: 70}}
"""
EKF = '''\
import numpy as np
from trackbench.adapters import PerRun


class MyEKF(PerRun, kind="my-ekf"):
    """An EKF for one run, on any model."""

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        m = self.functions
        F = m.F(self.x, self.P)
        self.x, self.P = m.f(self.x), F @ self.P @ F.T + m.Q(self.x)
        if z is None:
            return self.x, self.P
        seen = ~np.isnan(z)
        H = m.H(self.x, self.P)[seen]
        S = H @ self.P @ H.T + m.R(self.x)[np.ix_(seen, seen)]
        K = np.linalg.solve(S, H @ self.P).T
        self.x = self.x + K @ m.innovation(z, m.h(self.x))[seen]
        self.P = self.P - K @ S @ K.T
        return self.x, self.P
'''


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> SuiteReport:
    """The small suite with a filter of the user."""
    folder = tmp_path_factory.mktemp("suite")
    (folder / "small.yaml").write_text(SUITE)
    (folder / "my.py").write_text(EKF)
    options = Options(
        out=folder / "out", quiet=True, engine="serial", formats=("svg",), times=False,
        filters=[folder / "my.py"],
    )  # fmt: skip
    report = run_suite(folder / "small.yaml", options)
    assert report is not None
    return report


def of(report: SuiteReport, problem: str, label: str) -> Score:
    (score,) = [
        s for s in report.groups[0].scores if (s.problem, s.label) == (problem, label)
    ]  # fmt: skip
    return score


def test_errors_are_those_of_single_runs(small: SuiteReport, tmp_path: Path) -> None:
    words = (
        "--set",
        "scenario.last=20",
        "--set",
        "filters.PF.N=50",
        "--runs",
        "6",
        "--only",
        "EKF",
    )
    done = trackbench("run", "ungm", *words, "--out", str(tmp_path / "o"), "--format", "svg")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "o" / "summary.csv").open() as file:
        rows = {(row["filter"], row["metric"]): row["value"] for row in csv.DictReader(file)}
    single = float(rows["EKF", "mean(mse)"]) ** 0.5
    assert of(small, "ungm", "EKF").error == pytest.approx(single, rel=1e-6)


def test_a_plain_filter_of_the_models_functions_is_the_shipped_one(small: SuiteReport) -> None:
    group = small.groups[0]
    likeness = nearest_filter(group, "my-ekf", list(group.runs))
    assert likeness is not None
    assert likeness.label == "EKF"
    assert list(likeness.differences) == ["ungm", "turn", "body"]
    assert max(likeness.differences.values()) < 1e-9
    assert any("It is the EKF: the errors" in line for line in small.sentences())


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_filter_in_c_is_the_shipped_one_where_it_fits(tmp_path: Path) -> None:
    assert trackbench("new", "filter", "mine", "--language", "c", cwd=tmp_path).returncode == 0
    subprocess.run(["cc", "-O2", "-o", "mine", "mine.c", "-lm"], cwd=tmp_path, check=True)
    report = run_suite(
        "standard", problems=["linear", "position", "ungm"], only=["EKF"], runs=2,
        filters=[tmp_path / "mine"], out=tmp_path / "out",
        quiet=True, engine="serial", formats=("svg",), times=False,
    )  # fmt: skip
    assert report is not None
    assert report.failed == []
    score = of(report, "ungm", "mine")
    assert score.is_left_out
    assert "this filter needs a linear, constant model" in score.reason
    group = report.groups[0]
    likeness = nearest_filter(group, "mine", list(group.runs))
    assert likeness is not None
    assert likeness.label == "EKF"
    assert list(likeness.differences) == ["linear", "position"]
    assert max(likeness.differences.values()) < 1e-9
    # Both problems are linear, where another kind of Kalman filter would have the same errors.
    (sentence,) = [line for line in report.sentences() if " it equals EKF: " in line]
    assert "On the linear problems linear and position it equals EKF: the errors" in sentence
    assert "It is the" not in sentence


OWN = """\
name: own
runs: 2
groups:
  known:
    title: Known
    filters: {EKF: {kind: ekf}, CKF: {kind: ckf}}
    problems:
      ungm: {class: a, score: rms(rmse), set: {scenario.last: 20}}
      turns: {class: b, use: coordinated-turn, score: rms(rmse_position)}
  late:
    title: Late
    filters: {EKF: {kind: ekf, late: drop}, CKF: {kind: ckf, late: drop}}
    problems:
      late-turns:
        {class: c, use: coordinated-turn, score: rms(rmse_position), set: {scenario.sensor.delay: 2}}
"""


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a suite, and a program of fixed gain that measures positions."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("own")
    source = Path(__file__).parent / "programs" / "fixed_gain.c"
    warn = ["-Wall", "-Wextra", "-Werror"]
    program = folder / "mine"
    subprocess.run([compiler, "-O2", *warn, source, "-o", program, "-lm"], check=True)
    (folder / "own.yaml").write_text(OWN)
    return folder


def test_a_program_is_asked_before_anything_runs(own: Path) -> None:
    done = trackbench("suite", "own.yaml", "--filter", "./mine", "--dry-run", cwd=own)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "mine runs on 1 of 3 problems"
    assert lines[1].startswith("2 problems on which no filter of yours runs are not computed")
    refusal = "needs the state px py vx vy (state: x; measurement: y)"
    assert lines[2] == f"mine is left out of ungm: the program refuses this problem: {refusal}"
    assert lines[3].endswith("write --set filters.mine.late=drop")
    assert [line.partition(":")[0] for line in lines[4:]] == ["turns"]
    assert "(state px vx py vy, measurement x y)" in lines[4]
    done = trackbench("run", "ungm", "--filter", "./mine", cwd=own)
    assert done.returncode == 2
    assert refusal in done.stderr
    assert not (own / "results").exists()


SILENT = "#!/bin/sh\necho start >> starts\nwhile read line; do :; done\n"
"""A program that reads lines and answers none; each start adds a line to the file `starts`."""


def test_a_program_that_does_not_answer_stops_at_its_first_line(own: Path) -> None:
    (own / "silent").write_text(SILENT)
    (own / "silent").chmod(0o755)
    starts = own / "starts"
    commands = (
        ("suite", "own.yaml", "--dry-run"),
        ("suite", "own.yaml", "--quick"),
        ("suite", "own.yaml", "--problem", "turns"),
        ("run", "ungm"),
        ("run", "ungm", "--dry-run"),
    )
    for i, words in enumerate(commands):
        # This process runs all commands, and starts a filter of equal keys no second time.
        timeout = 1.0 + i / 100
        starts.unlink(missing_ok=True)
        set_ = ("--set", f"filters.silent.timeout={timeout}")
        done = trackbench(*words, "--filter", "./silent", *set_, cwd=own)
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(done.stderr.splitlines()) == 1
        assert "filters.silent: the program does not answer the first line" in done.stderr
        assert f"within {timeout:g} s; print `ready`, or `error TEXT`" in done.stderr
        assert "docs/any-language.md" in done.stderr
        assert starts.read_text() == "start\n"
    assert not (own / "results").exists()


def test_a_program_that_ends_at_its_first_line_runs_on_no_problem(own: Path) -> None:
    (own / "ending").write_text("#!/bin/sh\necho 'no table' >&2\nexit 3\n")
    (own / "ending").chmod(0o755)
    done = trackbench("suite", "own.yaml", "--filter", "./ending", "--dry-run", cwd=own)
    assert done.returncode == 2
    assert "fits no problem: the program ended with code 3" in done.stderr
    assert "'no table'" in done.stderr


def test_a_dry_run_of_a_shipped_suite_times_the_users_filter(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time was said to be without the filter, also where it took most of it."""
    options = Options(
        quiet=True,
        engine="serial",
        quick=True,
        filters=[own / "mine"],
        out=own / "timed",
        fresh=True,
    )
    problems = ["air-traffic", "two-turns"]
    tried = []

    def trial(task: BlockTask) -> float:
        tried.append(task.filter.runs_program)
        return 3600.0

    monkeypatch.setattr(expected_time, "estimate_cpu_s", trial)
    last = preview_suite(Path("standard"), options, problems)[-1]
    assert tried == [True, True]
    assert last.startswith("in all about 2 h on 1 workers")
    assert last.endswith("mine by a trial of the first steps")
    # If trials take long, the pace on the first problems counts for the other ones.
    monkeypatch.setattr(expected_time_of_suite, "_TRIALS_S", 0.0)
    assert preview_suite(Path("standard"), options, problems)[-1].endswith("and without mine")
    assert len(tried) == 2
    # A filter that fails in its trial has no time.
    monkeypatch.setattr(expected_time_of_suite, "_TRIALS_S", 10.0)
    monkeypatch.setattr(expected_time, "estimate_cpu_s", lambda task: 1 / 0)
    assert preview_suite(Path("standard"), options, problems)[-1].endswith("and without mine")


def test_the_time_of_a_tuned_filter_is_that_of_both_runs_and_of_its_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the filter as configured and its tuned copy only one was counted."""
    with_key = EKF.replace("    def start(", "    scale: float = 1.0\n\n    def start(", 1)
    (tmp_path / "my.py").write_text(with_key)
    options = Options(
        quiet=True, engine="serial", filters=[tmp_path / "my.py"], out=tmp_path / "out", fresh=True
    )  # fmt: skip
    tune = "groups.known.tune={my-ekf: {scale: 1..2}}"
    tuning = "groups.known.tuning={evaluations: 4, runs: 40}"
    tuned_options = options.changed({"set": [tune, tuning]})
    monkeypatch.setattr(expected_time, "estimate_cpu_s", lambda task: 36000.0)

    def hours(options: Options) -> float:
        last = preview_suite(Path("standard"), options, ["position"])[-1]
        return float(re.match(r"in all about (\S+) h on 1 workers", last)[1])

    # The experiment and each trial have 40 runs.
    assert hours(tuned_options) == pytest.approx((2 + 4) * hours(options), rel=0.05)


def test_a_problem_of_a_suite_is_no_experiment_and_has_a_hint() -> None:
    done = trackbench("show", "position")
    assert done.returncode == 2
    assert "a problem of the suite standard: `trackbench suite standard --problem position`" in (
        done.stderr
    )
    done = trackbench("show", "short-range")
    assert "neither a file" not in done.stderr
    assert "`trackbench show banana-short` prints the experiment with its scenario" in done.stderr


TURNS = """\
name: turns
runs: 5
groups:
  g:
    title: G
    filters: {EKF: {kind: ekf}}
    problems:
      t: {class: turns, use: turning-aircraft, score: rms(rmse_position), set: {scenario.last: 20}}
"""


def test_the_contract_is_checked_before_a_suite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Once for each of the user's own filters; failed checks are notes, and the last sentences."""
    (tmp_path / "turns.yaml").write_text(TURNS)
    (tmp_path / "good.py").write_text(EKF.replace("my-ekf", "good").replace("MyEKF", "Good"))
    text = EKF.replace("my-ekf", "raw").replace("MyEKF", "Raw")
    assert "m.innovation(z, m.h(self.x))" in text
    (tmp_path / "raw.py").write_text(
        text.replace("m.innovation(z, m.h(self.x))", "(z - m.h(self.x))")
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(suite_contract, "_CONTRACT_S", 300.0)  # on a busy machine, too
    options = Options(
        engine="serial", formats=("svg",), times=False, filters=["good.py", "raw.py"], out="out"
    )
    report = run_suite(Path("turns.yaml"), options)
    assert report is not None
    good, raw = report.contract
    assert (good.label, good.bad, good.is_finished, good.sentence()) == ("good", (), True, "")
    assert "wraps angles at their cut" in {finding.check for finding in raw.bad}
    assert report.sentences()[-1] == raw.sentence()
    dry = preview_suite(Path("turns.yaml"), options)
    assert [*raw.notes()] == [line for line in dry if line.startswith("raw: fails the check")]
    assert raw.sentence().startswith("raw fails 2 checks of the contract of filters, 'wraps angles")
    assert "`trackbench check --contract raw.py`" in raw.sentence()
    notes = capsys.readouterr().err
    assert (
        "note: raw: fails the check 'wraps angles at their cut' of the contract: the inn" in notes
    )
    assert "note: good" not in notes
    assert "raw fails 2 checks of the contract" in (tmp_path / "out" / "suite.html").read_text()
    # A filter whose checks take long is not checked to the end, and a sentence says so.
    monkeypatch.setattr(suite_contract, "_CONTRACT_S", 0.0)
    report = run_suite(Path("turns.yaml"), options)
    assert report is not None
    assert [outcome.is_finished for outcome in report.contract] == [False, False]
    assert report.sentences()[-1] == (
        "raw was not checked by the whole contract of filters, which takes long: "
        "`trackbench check --contract raw.py`."
    )


def test_problems_without_the_users_filter_are_not_computed(own: Path) -> None:
    options = Options(
        quiet=True, engine="serial", formats=("svg",), times=False, filters=[own / "mine"],
        out=own / "out",
    )  # fmt: skip
    report = run_suite(own / "own.yaml", options)
    assert report is not None
    assert {path.name for path in (own / "out").iterdir() if path.is_dir()} == {"figures", "turns"}
    known, late = report.groups
    assert known.problems == ["turns"]
    assert [score.problem for score in known.not_computed] == ["ungm"]
    assert late.scores == []
    with (own / "out" / "scores.csv").open() as file:
        reasons = {row["problem"]: row["reason"] for row in csv.DictReader(file)}
    assert "the program refuses" in reasons["ungm"]
    assert "arrive late" in reasons["late-turns"]
    sentences = report.sentences()
    assert any("mine ran on 1 of 2 problems" in line for line in sentences)
    assert any("--language c" in line for line in sentences)
    assert not any("--per-run" in line for line in sentences)
    # A problem that is chosen is computed, also without the user's filter.
    part = run_suite(own / "own.yaml", replace(options, out=own / "part"), ["ungm", "turns"])
    assert part is not None
    assert part.groups[0].problems == ["ungm", "turns"]
    rows = {row[0].text: row for row in part.tables()[0].rows}
    assert rows["ungm"][3].text == "–"


def test_a_program_in_a_suite_of_the_users_own_has_its_table(own: Path, tmp_path: Path) -> None:
    """Only a filter of --filter had one."""
    text = OWN.replace("CKF: {kind: ckf}}", "mine: {kind: external, command: [./mine]}}")
    (own / "with-program.yaml").write_text(text)
    options = Options(
        quiet=True, engine="serial", formats=("svg",), times=False, out=tmp_path / "out",
        allow_plugins=True,
    )  # fmt: skip
    report = run_suite(own / "with-program.yaml", options)
    assert report is not None
    table = report.tables()[0]
    assert table.title == "mine, problem by problem"
    assert [row[0].text for row in table.rows] == ["ungm", "turns"]
    known, late = report.groups
    assert (known.added, late.added) == (("mine",), ())
    sentences = report.sentences()
    assert sentences[0].startswith("Known: mine ran on 1 of 2 problems.")
    assert not any(line.startswith("Late: mine") for line in sentences)


def test_keys_of_the_users_filter_are_set_where_they_have_an_effect(own: Path) -> None:
    words = ("suite", "own.yaml", "--filter", "./mine", "--dry-run")
    done = trackbench(*words, "--set", "filters.mine.late=drop", cwd=own)
    assert "mine runs on 2 of 3 problems" in done.stdout
    done = trackbench(*words, "--set", "filters.mine.late=drop", "--problem", "turns", cwd=own)
    assert done.returncode == 2
    assert "filters.mine.late: has no effect on any problem" in done.stderr
    done = trackbench(*words, "--set", "filters.min.late=drop", cwd=own)
    assert done.returncode == 2
    assert "no filter of --filter is called 'min'" in done.stderr
    # A key that does not exist is named with its option.
    done = trackbench(*words, "--set", "filters.mine.gain=3", cwd=own)
    assert done.returncode == 2
    assert "fits no problem: --set filters.mine.gain=3: unknown key; known:" in done.stderr
    # The name of a program may have an equals sign itself.
    shutil.copy(own / "mine", own / "gain=1")
    words = ("suite", "own.yaml", "--filter", "./gain=1", "--dry-run", "--problem", "turns")
    done = trackbench(*words, "--set", "filters.gain=1.late=drop", cwd=own)
    assert done.returncode == 2
    assert "filters.gain=1.late: has no effect on any problem" in done.stderr


def test_a_tuned_filter_is_left_out_of_problems_that_it_refuses(own: Path) -> None:
    """The refusals of its tuned copy, and at the ends of the tuned key, stopped the suite."""
    words = ("suite", "own.yaml", "--filter", "./mine", "--dry-run")
    tune = ("--set", "groups.known.tune.mine={parameters.q: 1..2}")
    done = trackbench(*words, *tune, cwd=own)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "mine runs on 1 of 3 problems"
    assert lines[2].startswith("mine is left out of ungm: the program refuses this problem:")
    assert lines[4].startswith("turns: tunes mine by ")
    # A mistake in the tuned key is one on the problems that the filter runs on.
    mistaken = ("--set", "groups.known.tune.mine={parametrs.q: 1..2}")
    done = trackbench(*words, *mistaken, cwd=own)
    assert done.returncode == 2
    assert "did you mean parameters?" in done.stderr
    assert "refuses" not in done.stderr


def test_the_advice_on_late_measurements_has_the_refusal_beside_it(own: Path) -> None:
    """A program that refuses a problem was told to set `late`, which then had no effect anywhere."""
    text = (own / "own.yaml").read_text()
    late_problem = (
        "late-turns:\n        {class: c, use: coordinated-turn, score: rms(rmse_position)"
    )
    assert late_problem in text
    refused = "late-turns:\n        {class: c, use: ungm, score: rms(rmse)"
    (own / "late.yaml").write_text(text.replace(late_problem, refused))
    words = ("suite", "late.yaml", "--filter", "./mine", "--dry-run")
    done = trackbench(*words, cwd=own)
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if "left out of late-turns" in line]
    assert "write --set filters.mine.late=drop; and the program refuses this problem:" in line
    done = trackbench(*words, "--set", "filters.mine.late=drop", cwd=own)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "has no effect where the filter runs" in line
    assert "is left out of late-turns: the program refuses this problem:" in line


def test_a_filter_that_does_not_fit_has_the_reason_of_check(small: SuiteReport) -> None:
    score = of(small, "body", "UPF")
    assert "singular" in score.reason
    assert score.limited_ratio == WORST
    assert "singular" in (small.folder / "suite.html").read_text()


def test_smoothers_and_references_stand_apart(small: SuiteReport) -> None:
    group = small.groups[0]
    assert group.labels(FILTER) == ["EKF", "UKF", "UPF", "my-ekf"]
    assert of(small, "ungm", "EKF, smoothed").role == "smoother"
    reference = of(small, "ungm", "PF")
    assert reference.role == "reference"
    score = of(small, "ungm", "EKF")
    assert score.ratio_to_reference.value == pytest.approx(score.error / reference.error)


def test_files_of_a_suite(small: SuiteReport) -> None:
    with (small.folder / "scores.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(small.groups[0].scores)
    assert {row["problem"] for row in rows} == {"ungm", "turn", "body"}
    for name in ("known-matrix.svg", "known-profile.svg", "known-cost.svg"):
        assert (small.folder / "figures" / name).is_file() or name == "known-cost.svg"
    for problem in ("ungm", "turn", "body"):
        assert (small.folder / problem / "report.html").is_file()


def test_mistakes_have_file_and_line(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(SUITE.replace("kind: ukf", "kind: ufk"))
    (tmp_path / "b.yaml").write_text(SUITE.replace("use: falling-body", "use: faling-body"))
    (tmp_path / "c.yaml").write_text(SUITE.replace("reference: PF", "reference: PG"))
    (tmp_path / "d.yaml").write_text(SUITE.replace("class: mild", "clas: mild"))
    for name, line, what in (
        ("a", 8, "'ufk' is not a kind of filter"),
        ("b", 15, "did you mean falling-body"),
        ("c", 13, "'PG' is neither a filter"),
        ("d", 14, "clas"),
    ):
        done = trackbench("suite", f"{name}.yaml", cwd=tmp_path)
        assert done.returncode == 2
        assert f"{name}.yaml:{line}:" in done.stderr
        assert what in done.stderr
    done = trackbench("suite", "standrad", cwd=tmp_path)
    assert done.returncode == 2
    assert "did you mean standard" in done.stderr
    done = trackbench("suite", "standard", "--problem", "umgm", cwd=tmp_path)
    assert done.returncode == 2
    assert "did you mean ungm" in done.stderr
    done = trackbench("suite", "standard", "--only", "EKV", "--problem", "ungm", cwd=tmp_path)
    assert done.returncode == 2
    assert "--only EKV: is no filter of this suite; did you mean EKF" in done.stderr
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == []


def test_a_filter_that_raises_costs_its_cells(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SUITE)
    source = EKF.replace(
        "m = self.functions\n", "m = self.functions\n        assert len(self.x) > 1\n"
    )
    (tmp_path / "my.py").write_text(source)
    words = ("--filter", "my.py", "--only", "EKF", "--runs", "2", "--workers", "1", "--json")
    done = trackbench("suite", "s.yaml", *words, cwd=tmp_path)
    assert done.returncode == 1
    assert "ungm: my-ekf failed" in done.stderr
    cells = [json.loads(line) for line in done.stdout.splitlines()]
    mine = {cell["problem"]: cell for cell in cells if cell["label"] == "my-ekf"}
    reason = mine["ungm"]["reason"]
    assert "AssertionError" in reason
    assert mine["turn"]["error"] > 0
    assert not [cell for cell in cells if cell["label"] == "EKF" and cell["reason"]]


def test_a_dry_run_and_one_problem(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SUITE)
    done = trackbench("suite", "s.yaml", "--problem", "turn", "--dry-run", cwd=tmp_path)
    assert done.returncode == 0
    assert "turn: 4 filters x 6 runs x 20 steps" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["s.yaml"]


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to another process")
def test_an_interrupted_suite_writes_no_scores(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(
        SUITE.replace("runs: 6", "runs: 60").replace("N: 50", "N: 2000")
    )
    words = [sys.executable, "-m", "trackbench", "suite", "s.yaml", "--engine", "serial"]
    # Signals of their own: a job in the background of a shell ignores SIGINT.
    with subprocess.Popen(
        words,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.startswith("body: "):  # the last problem is announced, and blocks begin
                break
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
    assert process.returncode in (130, -signal.SIGINT)
    if process.returncode == 130:
        assert "interrupted" in rest
    assert not (tmp_path / "results" / "small" / "scores.csv").exists()


def test_blocks_are_computed_once(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SUITE)
    words = ("suite", "s.yaml", "--only", "EKF", "--runs", "2", "--seed", "77", "--workers", "1")
    first = trackbench(*words, "--problem", "turn", cwd=tmp_path)
    assert "reused" not in first.stderr
    whole = trackbench(*words, cwd=tmp_path)
    assert "reused 2 of 2 blocks" in whole.stderr
    scores = (tmp_path / "results" / "small-part" / "scores.csv").read_bytes()
    again = trackbench(*words, cwd=tmp_path)
    assert again.stderr.count("reused") == 3
    assert (tmp_path / "results" / "small-part" / "scores.csv").read_bytes() == scores


def test_problems_one_after_the_other_keep_their_scores(tmp_path: Path) -> None:
    """The second command replaced the scores of the first, and said nothing."""
    (tmp_path / "s.yaml").write_text(SUITE)
    words = ("suite", "s.yaml", "--runs", "2", "--workers", "1", "--no-times")
    for name in ("turn", "ungm"):
        assert trackbench(*words, "--problem", name, cwd=tmp_path).returncode == 0
        assert (tmp_path / "results" / f"small-{name}" / name / "report.html").is_file()
    for name in ("turn", "ungm"):
        scores = (tmp_path / "results" / f"small-{name}" / "scores.csv").read_text()
        assert f"known,{name}," in scores
    # In a folder of the user's own the scores are those of the last command, which is said.
    into = (*words, "--only", "EKF", "--out", "own")
    first = trackbench(*into, "--problem", "turn", cwd=tmp_path)
    assert "earlier commands" not in first.stderr
    second = trackbench(*into, "--problem", "ungm", cwd=tmp_path)
    assert "note: own also has turn of earlier commands" in second.stderr


def score(problem: str, problem_class: str, label: str, ratio: float, **keys: object) -> Score:
    beside = {"ratio_to_best": Ratio(value=ratio), "error": ratio, "runs": 8}
    return Score(
        group="g", problem=problem, problem_class=problem_class, label=label, role=FILTER,
        **beside | keys,  # type: ignore[arg-type]
    )  # fmt: skip


def by_hand(ratios: dict[str, tuple[float, ...]], classes: tuple[str, ...]) -> SuiteScores:
    """Scores of filters on problems p0, p1, ...; each run has the error of the problem."""
    scores = []
    runs = {}
    for j, name in enumerate(classes):
        values = {}
        for label, numbers in ratios.items():
            reason = "" if np.isfinite(numbers[j]) else "does not fit"
            scores.append(score(f"p{j}", name, label, numbers[j], reason=reason))
            values[label] = np.full(8, numbers[j])
        runs[f"p{j}"] = ProblemRuns(statistic="mean", values=values)
    return SuiteScores(group="g", title="G", scores=scores, runs=runs)


def test_a_filter_without_covariance_is_not_called_free_of_overconfidence() -> None:
    scores = [
        score("p", "x", "own", 1.0, word="best"),
        score("p", "x", "A", 1.0, word="worse", anees=1.1, consistency="calibrated"),
        score("p", "x", "B", 1.0, word="worse", anees=9.0, consistency="overconfident"),
        score("p", "x", "C", 1.0, word="worse", anees=1.2),  # too few runs for a word
    ]
    group = SuiteScores(
        group="g", title="G", scores=scores, runs={"p": ProblemRuns(statistic="mean", values={})}
    )
    table = roster_table(group)
    column = table.heads.index("Overconfident at")
    assert {row[0].text: row[column].text for row in table.rows} == {
        "own": "–", "A": "0", "B": "1", "C": "0",
    }  # fmt: skip
    assert "–: the filter gives no covariance" in " ".join(filter_table([group], "own").notes)
    assert "no covariance" not in " ".join(filter_table([group], "A").notes)


def test_typical_ratios_and_profiles_by_hand() -> None:
    group = by_hand(
        {"A": (1.0, 1.0, 30.0), "B": (2.0, 4.0, 1.0), "C": (1.5, np.nan, 2.0)}, ("x", "x", "y")
    )
    typical = typical_ratios(group)
    assert typical["A"] == pytest.approx(10.0 ** (1 / 3))
    assert typical["B"] == pytest.approx(2.0)
    assert typical["C"] == pytest.approx(30.0 ** (1 / 3))
    labels, problems, ratios = ratio_matrix(group)
    assert (labels, problems) == (["A", "B", "C"], ["p0", "p1", "p2"])
    shares = profile(ratios, np.array([1.0, 1.5, 2.0, 9.9]))
    assert shares.tolist() == [
        [2 / 3, 2 / 3, 2 / 3, 2 / 3],
        [1 / 3, 1 / 3, 2 / 3, 1.0],
        [0.0, 1 / 3, 2 / 3, 2 / 3],
    ]
    # The area under a profile over log factors is one minus the logarithm of the typical ratio.
    factors = np.exp(np.linspace(0.0, log(WORST), 20_001))
    areas = profile(ratios, factors)[:, :-1].mean(axis=1)
    for label, area in zip(labels, areas, strict=True):
        assert exp((1.0 - area) * log(WORST)) == pytest.approx(typical[label], rel=1e-3)


def test_words_of_the_users_table_are_explained() -> None:
    words = {"word": "untested", "consistency": "undecided", "anees": 16.74, "anees_stderr": 3.4}
    scores = [score("p", "x", "A", 1.2, **words), score("q", "x", "A", 1.0, reason="does not fit")]
    table = filter_table([SuiteScores(group="g", title="G", scores=scores, runs={})], "A")
    assert [cell.text for cell in table.rows[0][3:]] == ["0", "16.7 ± 3.4", "undecided"]
    assert [cell.text for cell in table.rows[1][3:]] == ["–", "–", "–"]
    assert [note.partition(":")[0] for note in table.notes] == ["untested", "ANEES", "undecided"]


INDEFINITE = EKF.replace(
    "        self.P = self.P - K @ S @ K.T\n        return self.x, self.P\n",
    """        self.P = self.P - K @ S @ K.T
        if self.k < 4:
            return self.x, self.P
        return self.x, self.P - 2.0 * np.diag(np.diag(self.P))
""",
)


def test_a_covariance_that_is_not_positive_definite_is_named(tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(SUITE)
    (tmp_path / "my.py").write_text(INDEFINITE)
    report = run_suite(
        tmp_path / "small.yaml", problems=["turn"], only=["EKF"], filters=[tmp_path / "my.py"],
        out=tmp_path / "out", quiet=True, engine="serial", formats=("svg",), times=False,
    )  # fmt: skip
    assert report is not None
    score = of(report, "turn", "my-ekf")
    assert (score.indefinite, score.first_indefinite_step) == (6, 4.0)
    assert (score.collapsed, score.consistency) == (0, "not positive definite in all")
    notes = " ".join(report.tables()[0].notes)
    assert "Covariance not positive definite: on turn in 6 of 6 runs, first at step 4." in notes
    assert "float32" in notes
    assert "Joseph form" in notes
    assert "collapsed" not in notes.lower()
    text = "Its covariance is not positive definite on turn in 6 of 6 runs, first at step 4."
    assert text in " ".join(report.sentences())
    # The report of the problem has its words in the ranking.
    page = (tmp_path / "out" / "turn" / "report.html").read_text()
    assert "Covariance not positive definite: my-ekf in 6 of 6 runs, first at step 4." in page
    # A lost run has no judged covariance.
    with_loss = replace(score, indefinite=5, lost=1)
    text = indefinite_text(with_loss)
    assert text == "on turn in 5 of 5 runs that it did not lose, first at step 4"


def test_a_collapsed_covariance_is_too_small_or_has_no_spread() -> None:
    words = {"consistency": "collapsed in 2 of 8", "collapsed": 2}
    scores = [
        score("p", "x", "A", 1.2, **words),
        score("q", "x", "A", 1.2, without_spread=1, **words),
    ]
    notes = [
        filter_table([SuiteScores(group="g", title="G", scores=part, runs={})], "A").notes[-1]
        for part in (scores[:1], scores)
    ]
    assert notes[0].endswith("Here the covariance is far too small, but has some spread.")
    assert notes[1].endswith("as if all particles were at one point: on q in 1 of 8 runs.")


def likeness_sentence(mine: tuple[float, ...], lost: bool = False) -> str:
    """Return the last sentence on a filter with these errors beside one with the error 1."""
    group = by_hand({"A": (1.0,) * len(mine), "own": mine}, ("x", "y", "z")[: len(mine)])
    if lost:
        group.runs["p0"].values["own"][3] = np.nan
    return filter_sentences(replace(group, added=("own",)), "own")[-1]


def test_a_filter_that_is_like_no_other_has_no_nearest_one() -> None:
    near = "The nearest filter is A: the errors of a run differ by up to"
    assert likeness_sentence((1.05, 1.1, 3.0)) == f"{near} 9.1 % on half of the problems."
    assert likeness_sentence((1.05,)) == f"{near} 4.8 % on p0."
    none = "No filter of the roster resembles it: on half of the problems the error of some run differs"
    assert likeness_sentence((30.0, 25.0, 1.2)).startswith(none)
    assert "inf" not in likeness_sentence((1.05,), lost=True)
    assert likeness_sentence((1.05,), lost=True).startswith(
        "No filter of the roster resembles it: on p0"
    )
    assert likeness_sentence((1.0, 3.0, 4.0)).startswith("On 1 of 3 problems it is the A:")


def test_linear_problems_do_not_show_which_kalman_filter_it_is() -> None:
    """Where all kinds of Kalman filters are equal, a filter was called one of them."""
    filters = {
        "EKF": (1.0, 2.0, 3.0, 1.0),
        "IEKF": (1.0, 2.0, 3.0, 1.1),
        "PF": (1.1, 2.1, 3.2, 1.2),
    }
    classes = ("x", "x", "y", "y")

    def sentences(*mine: float) -> str:
        group = by_hand(filters | {"own": mine}, classes)
        group = replace(group, added=("own",), linear=frozenset({"p0", "p1"}))
        return " ".join(likeness_sentences(group, "own"))

    linear = "On the linear problems p0 and p1 it equals EKF and IEKF: the errors of every run"
    text = sentences(1.0, 2.0, 3.3, 1.3)
    assert text.startswith(linear)
    assert "it is the" not in text.lower()
    assert "The nearest filter is PF: " in text
    assert text.endswith("on half of the other problems.")
    # The other problems show which of them it is, on all or on some of them.
    text = sentences(1.0, 2.0, 3.0, 1.0)
    assert text.startswith(linear)
    assert "It is the EKF: the errors of every run agree to 1e-6 on all other problems" in text
    text = sentences(1.0, 2.0, 3.0, 1.3)
    assert "On 1 of 2 other problems it is the IEKF, which equals EKF there: the errors" in text
    # A filter that differs from all of them on the linear problems is none of them.
    assert sentences(1.2, 2.2, 3.3, 1.3).startswith("The nearest filter is PF: ")
    assert sentences(1.2, 2.2, 3.3, 1.3).endswith("on half of the problems.")


def test_who_is_tuned_is_said_as_it_is() -> None:
    group = by_hand({"A": (1.0, 1.0), "own": (1.2, 1.2)}, ("x", "y"))
    group = replace(group, added=("own",))

    def text(**tuned: tuple[str, ...]) -> str:
        return " ".join(filter_sentences(replace(group, tuned=tuned), "own"))

    assert "are tuned on each problem, and yours is not: --set" in text(p0=("A",), p1=("A",))
    assert "'groups.g.tune.own={KEY" in text(p0=("A",), p1=("A",))
    assert "tuned" not in text(p0=("A", "own"), p1=("A", "own"))
    assert "are tuned on p1, and yours is not" in text(p0=("A", "own"), p1=("A",))
    assert "Your filter is tuned on p0, and those of the roster are not." in text(
        p0=("own",), p1=()
    )
    assert "tuned" not in text()
    # Of two filters one is tuned.
    group = by_hand({"A": (1.0, 1.0), "B, C": (1.1, 1.1), "own": (1.2, 1.2)}, ("x", "y"))
    group = replace(group, added=("own",))
    one = text(p0=("A",), p1=("A",))
    assert "A is tuned on each problem, and yours is not: --set" in one
    assert "filters of the roster" not in one
    both = text(p0=("A", "own"), p1=("A", "own"))
    assert "Your filter is tuned on each problem, and “B, C” is not." in both
    assert "tuned" not in text(p0=("A", "B, C", "own"), p1=("A", "B, C", "own"))


def test_a_filter_that_raised_did_not_run_and_lost_nothing() -> None:
    """The exception is named. A filter that lost all its runs ran on the problem."""
    group = by_hand({"A": (1.0, 1.0, 1.0), "own": (1.2, 1.2, 1.2)}, ("x", "x", "x"))
    exception = "own.py:34: IndexError: too many indices (run 0, step 1, 1 s)"
    changes = {
        "p1": {"reason": exception, "failed": True, "runs": 0, "error": np.nan},
        "p2": {"reason": "lost all runs", "failed": True, "lost": 8, "error": np.nan},
    }
    scores = []
    for one in group.scores:
        change = changes.get(one.problem, {}) if one.label == "own" else {}
        scores.append(replace(one, ratio_to_best=Ratio(), **change) if change else one)
    group = replace(group, scores=scores, added=("own",))
    first, raised, *others = filter_sentences(group, "own")
    assert first == "G: own ran on 2 of 3 problems."
    assert raised == f"It raised an exception on p1 ({exception})."
    assert any(line.startswith("It fails on p2: its error is 10 times") for line in others)
    table = filter_table([group], "own")
    column = table.heads.index("Lost runs")
    assert [row[column].text for row in table.rows] == ["0", "–", "8 of 8"]
    # A filter that runs everywhere has no such sentence, and neither has one that is left out.
    assert "exception" not in " ".join(filter_sentences(group, "A"))


def test_the_table_of_a_group_names_its_tuned_filters() -> None:
    group = by_hand({"A": (1.0, 1.0), "B, C": (1.1, np.nan), "D": (1.2, 1.2)}, ("x", "y"))

    def note(**tuned: tuple[str, ...]) -> str:
        return roster_table(replace(group, tuned=tuned)).notes[-1]

    assert "uned" not in note()
    assert note(p0=("A",), p1=("A",)).startswith("Tuned: A on each problem. All other")
    assert note(p0=("A", "B, C"), p1=("D",)).startswith(
        "Tuned: A on p0; “B, C” on each problem; D on p1. All other"
    )
    assert note(p0=("A", "B, C", "D"), p1=("A", "D")) == "All filters are tuned on each problem."


def test_problems_where_tuning_makes_a_filter_worse_are_named(tmp_path: Path) -> None:
    """The untuned filter is not among the trials if its value is outside the range."""
    scaled = EKF.replace("    def start(", "    scale: float = 1.0\n\n    def start(", 1)
    scaled = scaled.replace(
        "m.R(self.x)[np.ix_(seen, seen)]", "self.scale * m.R(self.x)[np.ix_(seen, seen)]"
    )
    (tmp_path / "my.py").write_text(scaled)
    (tmp_path / "small.yaml").write_text(SUITE)

    def sentences(range_of_scale: str) -> str:
        tune = f"groups.known.tune={{my-ekf: {{scale: {range_of_scale}}}}}"
        report = run_suite(
            tmp_path / "small.yaml", problems=["turn", "body"], only=["EKF"], runs=8,
            set=[tune, "groups.known.tuning={evaluations: 3, runs: 8}"],
            filters=[tmp_path / "my.py"], out=tmp_path / "out",
            quiet=True, engine="serial", formats=("svg",), times=False,
        )  # fmt: skip
        assert report is not None
        return report.sentences()[0]

    worse = sentences("log:1e4..1e6")
    assert "Tuning makes it significantly worse on turn (" in worse
    assert "--set filters.my-ekf.KEY=VALUE" in worse
    # The first trial has the configured value.
    assert "Tuning makes it" not in sentences("log:1e-6..1e6")


def test_tuning_in_vain_is_said(tmp_path: Path) -> None:
    """Of a key that the filter does not read, and of trials that fail."""
    idle = EKF.replace(
        "    def start(", "    idle: float = 1.0\n    scale: float = 1.0\n\n    def start(", 1
    )
    idle = idle.replace("        m = self", "        assert self.scale < 2\n        m = self", 1)
    (tmp_path / "my.py").write_text(idle)
    (tmp_path / "small.yaml").write_text(SUITE)

    def sentence(tune: str) -> str:
        report = run_suite(
            tmp_path / "small.yaml", problems=["turn", "body"], only=["EKF"], runs=8,
            set=[f"groups.known.tune={{my-ekf: {tune}}}",
                 "groups.known.tuning={evaluations: 4, runs: 2}"],
            filters=[tmp_path / "my.py"], out=tmp_path / "out",
            quiet=True, engine="serial", formats=("svg",), times=False,
        )  # fmt: skip
        assert report is not None
        return report.sentences()[0]

    text = (
        "Tuning of idle has no effect on each problem: trials with different values of it have an"
    )
    assert text in sentence("{idle: 0.1..3}")
    failing = sentence("{scale: 0.1..9}")
    assert "In the tuning on turn the filter failed in " in failing
    assert " of 4 trials, first with scale = " in failing
    assert "AssertionError" in failing
    assert " Trials fail on body, too." in failing


def test_a_large_ratio_that_is_not_significant_is_undecided() -> None:
    """An interval that excludes 1 is left out; so is the word n.s. at a ratio far from 1."""
    word = {"word": "no significant difference"}
    near = score("p", "x", "A", 1.03, **word)
    far = score(
        "q", "x", "A", 1.8, **word | {"ratio_to_best": Ratio(value=1.8, low=1.4, high=2.45)}
    )
    useless = score("r", "x", "A", 30.0, **word)
    group = SuiteScores(group="g", title="G", scores=[near, far, useless], runs={})
    table = filter_table([group], "A")
    assert [row[2].text for row in table.rows] == [
        "1.03 x n.s.", "1.8 x, undecided (8 runs)", "30 x, undecided (8 runs)"
    ]  # fmt: skip
    assert [note.partition(":")[0] for note in table.notes][:2] == ["n.s.", "undecided (8 runs)"]
    assert "; on r the runs do not yet decide this by a test." in " ".join(
        filter_sentences(group, "A")
    )
    with style.rc_context():
        figure = draw_matrix(group)
        legend = " ".join(text.get_text() for text in figure.axes[0].get_legend().get_texts())
        file_formats.close(figure)
    assert "1.20  undecided by these runs" in legend
    assert "may be as good" not in legend


@pytest.mark.parametrize(
    ("ratio", "low", "high", "word", "text"),
    [
        # Errors that are equal but for rounding: the ends of the interval are found to 1e-6.
        (1.0, 0.9999994, 1.000001, "no significant difference", "equal to the best"),
        (1.0, 0.99, 1.01, "no significant difference", "1.000 x (0.990 to 1.010) n.s."),
        (1.000176, 1.000165, 1.000191, "worse", "1.000 x (1.000 to 1.000) tiny"),
        (1.02, 1.015, 1.025, "worse", "1.020 x (1.015 to 1.025)"),
        (1.002, np.nan, np.nan, "untested", "1.002 x untested"),
    ],
)
def test_a_ratio_near_one_in_words(
    ratio: float, low: float, high: float, word: str, text: str
) -> None:
    own = score(
        "p", "x", "own", ratio, word=word, ratio_to_best=Ratio(value=ratio, low=low, high=high)
    )
    group = SuiteScores(
        group="g", title="G", scores=[own], runs={"p": ProblemRuns(statistic="mean", values={})}
    )
    table = filter_table([group], "own")
    assert table.rows[0][2].text == text
    has_note = any(note.startswith("tiny: ") for note in table.notes)
    assert has_note == text.endswith("tiny")


MIXED = """\
name: mixed
runs: 3
groups:
  g:
    title: G
    filters:
      EKF: {kind: ekf}
      IMM: {kind: imm, motions: [{kind: cwna, q: 1}, {kind: cwna, q: 9}], transition: [[1, 0], [0, 1]]}
    problems:
      air: {class: turns, use: air-traffic}
      body: {class: singular, use: falling-body, set: {scenario.last: 20}}
TUNE
"""


def test_a_key_of_a_group_that_does_not_fit_a_problem_names_the_problem(tmp_path: Path) -> None:
    """The IMM is left out of the falling body, and is no mistake; the tuned key fits one problem."""
    path = tmp_path / "mixed.yaml"
    path.write_text(MIXED.replace("TUNE", ""))
    suite = load_suite(path)
    assert [[*problem.left_out] for problem in suite.problems] == [[], ["IMM"]]
    path.write_text(MIXED.replace("TUNE", "    tune: {EKF: {assume.motion.q: 0.1..1}}"))
    with pytest.raises(UserError) as caught:
        load_suite(path)
    lines = str(caught.value).splitlines()
    assert len(lines) == 2  # at both ends of the range
    for line in lines:
        assert line.startswith(f"{path}:12:35: tune.EKF.assume.motion.q: at ")
        assert line.endswith(" (on the problem body)")
    # A mistake of the whole group needs no names of problems.
    path.write_text(MIXED.replace("TUNE", "    tune: {EKF: {asume.q: 0.1..1}}"))
    with pytest.raises(UserError) as caught:
        load_suite(path)
    assert "asume: unknown key" in str(caught.value)
    assert "on the problem" not in str(caught.value)


RECORDED = """\
name: recorded
scenario:
  kind: tracking
  target: {kind: measured, measurements: z.csv, truth: t.csv}
  sensor: {kind: position, sigma: 1}
  start: {kind: given, mean: [0, 1, 0, 0], sigma: [1, 1, 1, 1]}
  assume: {motion: {kind: cwna, q: 1}}
filters:
  KF: {kind: kf}
"""
OF_RECORDINGS = """\
name: own
runs: 6
groups:
  g:
    title: G
    filters: {KF: {kind: kf}, EKF: {kind: ekf}}
    problems:
      rec: {class: c, use: recorded.yaml}
"""


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """A suite of a problem of two recorded runs."""
    z = ["run,time,x,y"]
    truth = ["run,time,px,vx,py,vy"]
    for run in (1, 2):
        for k in range(1, 9):
            z.append(f"{run},{k},{k + 0.3 * (-1) ** k},{0.1 * run}")
            truth.append(f"{run},{k},{k},1,0,0")
    (tmp_path / "z.csv").write_text("\n".join(z) + "\n")
    (tmp_path / "t.csv").write_text("\n".join(truth) + "\n")
    (tmp_path / "recorded.yaml").write_text(RECORDED)
    path = tmp_path / "own.yaml"
    path.write_text(OF_RECORDINGS)
    return path


def test_a_recording_has_its_own_number_of_runs(recordings: Path) -> None:
    """That of the suite was a mistake; --runs and --quick are cut to it."""
    for options, runs in (({}, 2), ({"runs": 7}, 2), ({"runs": 1}, 1), ({"quick": True}, 2)):
        (problem,) = load_suite(recordings, **options).problems
        assert problem.experiment.settings.runs == runs
    recordings.write_text(OF_RECORDINGS.replace("class: c", "class: c, runs: 3"))
    with pytest.raises(UserError, match="runs: 3 is more than the 2 recorded runs"):
        load_suite(recordings)


def test_a_problem_without_a_truth_is_a_mistake(recordings: Path) -> None:
    """Filters were ranked by ratios of log scores, and one without a log score failed."""
    file = recordings.parent / "recorded.yaml"
    file.write_text(RECORDED.replace(", truth: t.csv", ""))
    for text in (OF_RECORDINGS, OF_RECORDINGS.replace("class: c", "class: c, score: mean(nis)")):
        recordings.write_text(text)
        with pytest.raises(UserError) as caught:
            load_suite(recordings)
        (problem,) = caught.value.problems
        assert str(problem).startswith(f"{recordings}:8:12: groups.g.problems.rec: has no truth at")


@pytest.mark.parametrize(
    ("score", "why"),
    [
        ("mean(log_score)", "more is better"),
        ("mean(bias_position)", "nearer zero is better"),
        ("mean(anis)", "nearer one is better"),
    ],
)
def test_a_suite_ranks_by_errors(tmp_path: Path, score: str, why: str) -> None:
    (tmp_path / "s.yaml").write_text(SUITE.replace("rms(rmse_position)", score))
    with pytest.raises(UserError, match=f"{why}, and a suite divides by the smallest error"):
        load_suite(tmp_path / "s.yaml")


def test_the_page_of_a_suite_has_its_runs_and_seeds(small: SuiteReport) -> None:
    page = (small.folder / "suite.html").read_text()
    assert f"trackbench suite, version 1; {small.runs_and_seeds()}</p>" in page
    assert small.runs_and_seeds().startswith("6 runs, seed")


def test_the_smallest_error_is_said_with_its_evidence() -> None:
    """On p every other filter is significantly worse; on q one is not, and on r one has equal errors."""
    alike = {"word": "no significant difference"}
    scores = [
        score("p", "x", "own", 1.0, word="best"),
        score("p", "x", "A", 1.5, word="worse"),
        score("p", "x", "B", 1.1, word="loses more runs"),
        score("q", "x", "own", 1.0, word="best"),
        score("q", "x", "A", 1.5, word="worse"),
        score("q", "x", "B", 1.1, **alike),
        score("r", "x", "own", 1.0, **alike),
        score("r", "x", "A", 1.0, word="best"),
        score("s", "x", "own", 1.2, word="worse"),
        score("s", "x", "A", 1.0, word="best"),
        score("t", "x", "own", 1.0, word="best"),
        score("t", "x", "A", 1.3, word="untested"),
    ]
    group = SuiteScores(group="g", title="G", scores=scores, runs={}, added=("own",))
    lines = filter_sentences(group, "own")
    assert "Its error is significantly smaller than that of every other filter on p." in lines
    assert (
        "It has the smallest error of these runs on q, r and t, but not significantly: with other runs "
        "another filter may have it."
    ) in lines
    table = filter_table([group], "own")
    assert table.notes[0] == "best: the smallest error of these runs, significant or not."


def test_the_typical_ratio_where_a_filter_ran_by_hand() -> None:
    group = by_hand({"A": (1.0, 1.0, 30.0), "C": (1.5, np.nan, 6.0)}, ("x", "x", "y"))
    assert typical_ratio_where_run(group, "C") == pytest.approx(3.0)
    assert typical_ratio_where_run(group, "A") == pytest.approx(10.0 ** (1 / 3))
    table = roster_table(group)
    assert table.heads[1:3] == ["Typical ratio", "Where it ran"]
    assert [row[2].text for row in table.rows] == ["2.15", "3.00"]


def test_the_number_of_problems_that_count_as_ten_is_said() -> None:
    group = by_hand({"A": (1.0, 1.0, 30.0), "C": (1.5, np.nan, np.nan)}, ("x", "x", "y"))
    line = _typical_ratio_sentence(group, "C", 1, 3)
    assert "all 3 problems here, of which 2 that it cannot run on count as 10, as a failure" in line
    line = _typical_ratio_sentence(group, "C", 2, 3)
    assert "of which one that it cannot run on counts as 10, as a failure does." in line


def test_a_leader_that_depends_on_a_class_is_said() -> None:
    group = by_hand({"A": (1.0, 1.0, 3.0), "B": (1.2, 1.2, 1.0)}, ("x", "y", "z"))
    leader = leader_of(group)
    assert leader is not None
    assert leader.label == "B"
    assert leader.without == {"z": "A"}
    assert leader.share_first == 1.0
    assert not leader.is_robust
    robust = by_hand({"A": (1.0, 1.0, 1.0), "B": (1.2, 1.2, 1.3)}, ("x", "y", "z"))
    leader = leader_of(robust)
    assert leader is not None
    assert (leader.label, leader.is_robust) == ("A", True)


def test_a_leader_that_depends_on_the_runs_is_said() -> None:
    rng = np.random.default_rng(1)
    values = {label: 1.0 + 0.5 * rng.standard_normal(20) for label in "AB"}
    group = by_hand({"A": (1.0,), "B": (1.01,)}, ("x",))
    noisy = SuiteScores(
        group="g", title="G", scores=group.scores,
        runs={"p0": ProblemRuns(statistic="mean", values=values)},
    )  # fmt: skip
    leader = leader_of(noisy)
    assert leader is not None
    assert leader.rivals == ("B",)
    assert leader.share_first < 0.95
    assert not leader.is_robust


def test_losing_runs_counts_as_the_worst_ratio() -> None:
    assert score("p", "x", "A", 1.2, word="loses more runs").limited_ratio == WORST
    assert score("p", "x", "A", 1.2, reason="fits not").limited_ratio == WORST
    assert score("p", "x", "A", 1.2, reason="fits not").is_left_out
    failed = score("p", "x", "A", float("nan"), reason="lost all runs", failed=True)
    assert fails(failed)
    assert not failed.is_left_out
    assert score("p", "x", "A", 1.2).limited_ratio == 1.2
    assert score("p", "x", "A", float("nan")).limited_ratio == WORST


def test_a_filter_fails_where_it_counts_as_the_worst_ratio() -> None:
    assert fails(score("p", "x", "A", 10.0))
    assert fails(score("p", "x", "A", 1.2, word="loses more runs"))
    assert not fails(score("p", "x", "A", 9.9, collapsed=3))
    assert not fails(score("p", "x", "A", 1.2, reason="fits not"))  # left out


def test_a_cell_of_the_matrix_has_the_ratio_and_one_mark() -> None:
    assert cell_text(score("p", "x", "A", 1.0)) == "1.00"
    assert cell_text(score("p", "x", "A", 1.846, consistency="overconfident")) == "1.85*"
    assert cell_text(score("p", "x", "A", 2.26, consistency="overconfident", collapsed=3)) == "2.3!"
    assert cell_text(score("p", "x", "A", 366.6)) == "367"
    assert cell_text(score("p", "x", "A", 1e6)) == "999+"
    assert cell_text(score("p", "x", "A", 1.2, word="loses more runs")) == "×"


def test_the_users_own_filter_has_a_color_and_a_label() -> None:
    ratios: dict[str, tuple[float, ...]] = {"mine": (5.0, np.nan)}
    for i, name in enumerate("ABCDEFGH"):
        ratios[name] = (1.0 + 0.1 * i, 1.0)
    group = replace(by_hand(ratios, ("x", "y")), added=("mine",))
    figure = draw_profile(group)
    axes = figure.axes[0]
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == [*"ABCDEF", "mine", "other filters", "95 % over resampled runs"]
    assert figure.get_suptitle() == group.title
    # An equal line that is drawn later has dashes, so that both are seen.
    dashes = [line.get_linestyle() for line in axes.get_lines() if line.get_label()[0] in "ABCDEF"]
    assert dashes[0] == "-"
    assert "-" not in dashes[1:]
    (line,) = [line for line in axes.get_lines() if line.get_label() == "mine"]
    assert line.get_linewidth() > 2.0
    scores = [replace(score, cpu_s=1.0) for score in group.scores]
    figure = draw_cost(replace(group, scores=scores))
    texts = {text.get_text(): text.get_fontweight() for text in figure.axes[0].texts}
    assert texts["mine (1 of 2)"] == "bold"
    assert texts["A"] == "normal"


def test_every_number_of_the_matrix_is_within_its_cell() -> None:
    for name in ("standard", "noise", "settings"):
        for group in stored_suite(name).values():
            with style.rc_context():
                figure = draw_matrix(group)
                figure.draw_without_rendering()
                (ax,) = figure.axes
                width = ax.get_window_extent().width / len(ax.get_xticks())
                cells = [text for text in ax.texts if text.get_horizontalalignment() == "center"]
                assert cells
                assert max(cell.get_window_extent().width for cell in cells) < width


def test_names_beside_points_do_not_overlap() -> None:
    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    ax = figure.subplots()
    ax.set(xlim=(1.0, 20.0), ylim=(0.0, 4.0))
    places = {"PF 2000": (3.0, 1.0), "RPF": (3.2, 1.0), "APF": (3.4, 1.0), "GPF": (3.0, 1.05)}
    labels = [PointLabel(text=text, point=point) for text, point in places.items()]
    label_points(figure, ax, labels, font_size=6.5)
    boxes = [text.get_window_extent() for text in ax.texts]
    assert [text.get_text() for text in ax.texts] == list(places)
    for place, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:place])


def test_texts_without_room_beside_their_point_are_left_out() -> None:
    figure = Figure(figsize=(3.5, 2.0), layout="constrained")
    ax = figure.subplots()
    ax.set(xlim=(0.0, 2.0), ylim=(0.0, 2.0))
    labels = [PointLabel(text=str(n), point=(n / 1000, 1.0)) for n in range(1000, 1020)]
    label_points(figure, ax, labels, font_size=7.0, leave_out=True)
    boxes = [text.get_window_extent() for text in ax.texts]
    assert 1 < len(boxes) < len(labels)
    for place, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:place])


def test_classes_with_the_same_good_filters_are_neighbors() -> None:
    group = by_hand(
        {"A": (1.0, 5.0, 1.0, 5.0), "B": (5.0, 1.0, 5.0, 1.0)}, ("a", "b", "c", "d")
    )  # fmt: skip
    problems = ordered_problems(group)
    assert abs(problems.index("p0") - problems.index("p2")) == 1
    assert abs(problems.index("p1") - problems.index("p3")) == 1


def test_the_shipped_suite_fits_its_problems() -> None:
    suite = load_suite(Path("standard"))
    known = [problem for problem in suite.problems if problem.group == "known"]
    assert len(known) >= 20
    assert len(suite.settings.groups["known"].filters) >= 15
    assert len([p for p in suite.problems if p.group != "known"]) >= 8
    for problem in suite.problems:
        for label, why in problem.left_out.items():
            assert why, (problem.name, label)


def test_the_shipped_suites_are_listed() -> None:
    done = trackbench("list", "suites")
    assert done.returncode == 0, done.stderr
    listed = [line.split()[0] for line in done.stdout.splitlines()[3:]]
    assert listed == suite_names()
    assert "Which filter is good where?" in done.stdout


def test_a_part_of_a_suite(tmp_path: Path) -> None:
    """Filters of the roster may fit no chosen problem; a label may be one of the user's files."""
    (tmp_path / "s.yaml").write_text(SUITE)
    (tmp_path / "my.py").write_text(EKF)
    (body,) = load_suite(tmp_path / "s.yaml", chosen_problems=["body"]).problems
    assert [*body.left_out] == ["UPF"]
    alone = load_suite(tmp_path / "s.yaml", only=["my-ekf"], filter_files=[tmp_path / "my.py"])
    assert [{*p.experiment.points[0].filters} for p in alone.problems] == [
        {"my-ekf", "PF"}, {"my-ekf"}, {"my-ekf"}
    ]  # fmt: skip
    # UPF fits two of the three problems, and the third is left out.
    part = load_suite(tmp_path / "s.yaml", only=["UPF"])
    assert [problem.name for problem in part.problems] == ["ungm", "turn"]
    with pytest.raises(UserError, match=r"UPF fits no problem: .*singular"):
        load_suite(tmp_path / "s.yaml", only=["UPF"], chosen_problems=["body"])


def test_scores_that_rank_nothing_are_mistakes(tmp_path: Path) -> None:
    for score in ("median(rmse)", "rms(rmse[turns])", "anees"):
        (tmp_path / "s.yaml").write_text(SUITE.replace("score: rms(rmse),", f"score: '{score}',"))
        with pytest.raises(UserError, match=r"s\.yaml:13:.*filters are not ranked by"):
            load_suite(tmp_path / "s.yaml")


def test_a_score_that_is_no_expression_is_a_mistake(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SUITE.replace("score: rms(rmse),", "score: rms(rmse,"))
    with pytest.raises(UserError, match=r"s\.yaml:13:.*'rms\(rmse' is no expression such as"):
        load_suite(tmp_path / "s.yaml")


def test_the_command_of_the_contract_names_a_program_on_the_path_by_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file of the working folder begins with ./, as shells need it."""
    programs = tmp_path / "bin"
    programs.mkdir()
    work = tmp_path / "work"
    work.mkdir()
    for file in (programs / "installed-ekf", work / "my-ekf"):
        file.write_text("#!/bin/sh\n")
        file.chmod(0o755)
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.chdir(work)
    found = [typed_file_of(External(command=(word,))) for word in ("installed-ekf", "./my-ekf")]
    assert found == [str(programs / "installed-ekf"), "./my-ekf"]


def test_a_filter_that_fits_no_problem_is_a_mistake(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SUITE)
    source = EKF.replace('"""An EKF for one run', 'state = ("a", "b")\n    """An EKF for one run')
    (tmp_path / "my.py").write_text(source)
    with pytest.raises(UserError, match="fits no problem"):
        load_suite(tmp_path / "s.yaml", filter_files=[tmp_path / "my.py"])


def test_the_plugins_of_a_suite_join_all_its_problems(tmp_path: Path) -> None:
    """Also a problem whose experiment names the same file; without them an unknown kind is a mistake."""
    path = tmp_path / "s.yaml"
    (tmp_path / "my.py").write_text(EKF.replace("my-ekf", "suite-ekf"))
    text = MIXED.replace("TUNE", "").replace("EKF: {kind: ekf}", "mine: {kind: suite-ekf}")
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        load_suite(path)
    assert "filters.mine.kind: 'suite-ekf' is not a kind of filter" in str(caught.value)
    assert "the key `plugins: [FILE.py]` of the suite, or the option `--filter" in str(caught.value)
    path.write_text(text.replace("runs: 3", "plugins: [my.py]\nruns: 3"))
    with pytest.raises(UserError, match=r"s.yaml:2:11: plugins.0: .* only with --allow-plugins"):
        load_suite(path)
    suite = load_suite(path, allow_plugins=True)
    assert suite.own == ("mine",)
    assert ["mine" in problem.experiment.points[0].filters for problem in suite.problems] == [
        True
    ] * 2
    # A problem whose experiment has the plugin itself gets it once.
    changed = text.replace("use: air-traffic", "use: air-traffic, set: {plugins: [PATH]}")
    changed = changed.replace("PATH", str(tmp_path / "my.py"))
    path.write_text(changed.replace("runs: 3", "plugins: [./my.py]\nruns: 3"))
    suite = load_suite(path, allow_plugins=True)
    assert [len(problem.experiment.settings.plugins) for problem in suite.problems] == [1, 1]


def test_filters_are_ranked_by_the_score_that_the_suite_names(tmp_path: Path) -> None:
    """The state's error is not the first one of this problem; ranking page and scores agree."""
    (tmp_path / "s.yaml").write_text(LORENZ)
    options = Options(out=tmp_path, quiet=True, engine="serial", formats=("svg",), times=False)
    report = run_suite(tmp_path / "s.yaml", options)
    assert report is not None
    assert {score.metric for score in report.groups[0].scores} == {"rms(rmse_state)"}
    with (tmp_path / "l" / "per_run.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["filter"] == "EKF"]
    runs = [float(row["value"]) for row in rows if row["metric"] == "rmse_state"]
    assert len(runs) == 3
    rms = float(np.sqrt(np.mean(np.square(runs))))
    assert of(report, "l", "EKF").error == pytest.approx(rms, rel=1e-6)


def test_expected_seconds_follow_from_two_recorded_times() -> None:
    times = [SuiteTime(runs=4, cpu_s=2.0), SuiteTime(runs=40, cpu_s=5.6)]
    seconds = [
        expected_time_of_suite._recorded_seconds(times, runs, is_tuned_in_full=False)
        for runs in (4, 20, 40, 80)
    ]
    assert seconds == pytest.approx([2.0, 3.6, 5.6, 11.2])
    assert expected_time_of_suite._recorded_seconds(times, 4, is_tuned_in_full=True) == 5.6


def test_each_problem_has_a_time_for_quick_and_for_all_runs() -> None:
    for name in suite_names():
        times = suite_times(name)
        for problem in load_suite(Path(name)).problems:
            runs = problem.experiment.settings.runs
            assert [time.runs for time in times[problem.name]] == [QUICK_RUNS, runs], problem.name


def test_the_page_has_the_state_and_measurement_of_the_problems() -> None:
    page = (ROOT / "docs" / "suites.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+)` \| `([^`]+)` \| ([a-z, -]+) \|$", page, re.MULTILINE)
    assert len(rows) == 5
    problems: dict[tuple[str, str], list[str]] = {}
    for problem in load_suite(Path("standard")).problems:
        motion, sensor = problem.experiment.points[0].scenario.model
        names = (" ".join(motion.components), " ".join(sensor.components))
        problems.setdefault(names, []).append(problem.name)
    for state, measurement, names in rows:
        assert names.split(", ") == problems[state, measurement]


def test_the_page_names_the_radars_that_do_not_stand_at_the_origin() -> None:
    """A filter that assumes the origin loses all runs there, and the page said nothing."""
    page = (ROOT / "docs" / "suites.md").read_text(encoding="utf-8")
    places: dict[str, list[tuple[float, ...]]] = {}
    for problem in load_suite(Path("standard")).problems:
        of_problem = sensor_places(problem.experiment.points[0].scenario.model)
        if any(any(place) for place in of_problem):
            places[problem.name] = of_problem
    assert places.pop("drone") == [(-1500.0, -1500.0)]
    assert "drone stands at [-1500, -1500], not at the origin" in page
    late = ["late", "little-late", "always-late", "late-slow", "late-maneuvers"]
    assert places == {key: [(0.0, 0.0), (10000.0, 0.0)] for key in late}
    assert "the second radar stands at [10000, 0]" in page
    done = trackbench("suite", "--dry-run", "--problem", "drone")
    assert "measurement range azimuth, sensor at [-1500, -1500])" in done.stdout


def test_a_quick_suite_has_few_runs_and_leaves_out_what_takes_long() -> None:
    quick = load_suite(Path("standard"), quick=True)
    assert quick.too_long == ("lorenz96-40", "double-pendulum-100")
    assert not {*quick.too_long} & {problem.name for problem in quick.problems}
    assert {problem.experiment.settings.runs for problem in quick.problems} == {QUICK_RUNS}
    (chosen,) = load_suite(Path("standard"), quick=True, chosen_problems=["lorenz96-40"]).problems
    assert chosen.experiment.settings.runs == QUICK_RUNS


def test_a_quick_suite_has_enough_runs_to_test_ratios() -> None:
    assert QUICK_RUNS >= FEWEST_RUNS
