"""Tuned keys that a filter's entry lacks: of the scenario, of the truth and of defaults."""

from pathlib import Path

import numpy as np
import pytest

from trackbench import api
from trackbench.commands import expected_time
from trackbench.commands.expected_time import expected_time_of_tuning
from trackbench.commands.prepare_jobs import jobs_of
from trackbench.config.load import load
from trackbench.config.values_of_filter import configured_values
from trackbench.errors import UserError

CONFIG = """
name: keys
seed: 1
runs: 8
scenario:
  kind: tracking
  last: 20
  target: {kind: driven, motion: {kind: cwna, q: 0.1}, launch: {vx: 10}}
  sensor: {kind: position, sigma: 10, outliers: {share: 0.05, times: 5}}
  start: {kind: gaussian, sigma: [10, 1, 10, 1]}
filters:
  KF: {kind: kf}
  IMM: {kind: imm, motions: [{kind: cv, q: 1}, {kind: cv, q: 8}], transition: [[0.9, 0.1], [0.1, 0.9]]}
  UKF: {kind: ukf}
tuning: {evaluations: 4, runs: 8}
"""
ASSUMED = "scenario.assume={motion: {kind: cwna, q: 5}}"
TWO_SENSORS = (
    "scenario.sensor=[{kind: position, sigma: 10, detection: 0.9}, {kind: velocity, sigma: 2}]"
)

GIVEN_START = [
    "scenario.start={kind: given, mean: [0, 10, 0, 0], sigma: [10, 1, 10, 1]}",
    "scenario.target={kind: driven, motion: {kind: cwna, q: 0.1}}",
]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "keys.yaml"
    path.write_text(CONFIG)
    return path


@pytest.mark.parametrize(
    ("words", "label", "key", "axis", "given"),
    [
        ([ASSUMED], "KF", "assume.motion.q", "log:1e-3..10", 5.0),
        ([], "KF", "assume.motion.q", "log:1e-3..10", 0.1),
        ([], "KF", "assume.motion.kind", "[cv, cwna]", "cwna"),
        ([], "KF", "assume.sensor.sigma", "1..50", 10.0),
        ([TWO_SENSORS], "KF", "assume.sensor.1.sigma", "1..50", 2.0),
        (GIVEN_START, "KF", "assume.start.sigma.0", "1..50", 10.0),
        ([], "KF", "gate", "0.9..0.9999", None),
        ([], "IMM", "filter.gate", "0.9..0.9999", None),
        ([], "UKF", "alpha", "0.5..1", 1.0),
    ],
)
def test_every_tuned_key_is_found_begun_from_and_drawn(
    config: Path, words: list[str], label: str, key: str, axis: str, given: object
) -> None:
    words = [*words, f"tune.{label}={{{key}: {axis}}}"]
    experiment = load(config, overrides=words)
    if given is not None:
        assert configured_values(experiment, label)[key] == given
    options = api.Options(engine="serial", quiet=True, formats=("svg",), set=words, only=[label])
    report = api.run(config, options, out=config.parent / "out")
    assert not report.results.unmade
    assert (report.folder / "figures" / f"tuning-{label}.svg").is_file()
    trial = report.results.tuning[label].trials[0]
    assert given is None or trial.values[key] == given
    # The filter as configured is not changed by what its tuned copy needs.
    assert report.results.config["filters"][label].get("assume") in (None, {})
    again = load(report.folder / "config.yaml")
    assert again.points[0].assumed.keys() == {f"{label} (tuned)"} & again.points[0].assumed.keys()


def test_the_unit_of_the_scenarios_model_stands_at_the_axis(config: Path) -> None:
    words = [ASSUMED, "tune.KF={assume.motion.q: 'log:1e-3..10'}"]
    options = api.Options(engine="serial", quiet=True, formats=("svg",), set=words, only=["KF"])
    report = api.run(config, options, out=config.parent / "out")
    assert "q of motion (m²/s³)" in (report.folder / "figures" / "tuning-KF.svg").read_text()


@pytest.mark.parametrize(
    ("words", "key", "axis", "what"),
    [
        ([], "assume.motion", "[{kind: cv, q: 1}, {kind: cv, q: 2}]", "a choice is a word or a number"),
        ([], "'assume.motion.q & gate'", "0.5..0.9", "keys that vary together are of a grid"),
        ([TWO_SENSORS], "assume.sensor.sigma", "1..9", "by number, from 0, as assume.sensor.0.sigma"),
        ([], "assume.motion.qq", "1..9", "unknown key; did you mean q?"),
    ],
)  # fmt: skip
def test_a_key_that_cannot_be_tuned_says_why(
    config: Path, words: list[str], key: str, axis: str, what: str
) -> None:
    config.write_text(CONFIG + f"tune: {{KF: {{{key}: {axis}}}}}\n")
    with pytest.raises(UserError) as caught:
        load(config, overrides=words)
    for problem in caught.value.problems:
        assert str(problem).startswith(f"{config}:16:")
        assert what in str(problem)


def test_the_longest_time_of_tuning_is_announced(
    config: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four trials of 2 s each are 8 s; they are said if they are no shorter than the limit."""
    monkeypatch.setenv("TRACKBENCH_CACHE", str(config.parent / "cache"))
    monkeypatch.setattr(expected_time, "estimate_cpu_s", lambda task: 2.0)
    words = ["tune.KF={gate: 0.9..0.999}"]
    options = api.Options(engine="serial", formats=(), set=words, only=["KF"])
    (job,) = jobs_of([config], options)
    assert not expected_time_of_tuning(job, options)
    # The tuned filter runs beside the original one.
    assert expected_time.expected_time(job, options).startswith("about 4 s of filtering")
    monkeypatch.setattr(expected_time, "_SHORT_TUNING_S", 8.0)
    api.run(config, options, out=config.parent / "out")
    assert ", at most about 8 s of tuning\n" in capsys.readouterr().err
    # All trials are stored now.
    assert not expected_time_of_tuning(job, options)
    # Of more trials those that are stored take no time. Only the first one was looked at.
    (more,) = jobs_of([config], options.changed({"set": [*words, "tuning.evaluations=9"]}))
    assert expected_time_of_tuning(more, options).startswith("at most about 1")


def test_a_negative_gap_on_a_recording_is_explained(tmp_path: Path) -> None:
    """The noise of the second half is a fifth of the first's."""
    rng = np.random.default_rng(2)
    rows = ["time,x,y"]
    for k in range(120):
        x, y = 10.0 * k + rng.normal(size=2) * (5.0 if k < 60 else 1.0)
        rows.append(f"{k},{x:.3f},{y:.3f}")
    (tmp_path / "m.csv").write_text("\n".join(rows) + "\n")
    scenario = {
        "kind": "tracking",
        "target": {"kind": "measured", "measurements": str(tmp_path / "m.csv")},
        "sensor": {"kind": "position", "sigma": 5},
        "start": {"kind": "one-scan", "sigma_velocity": 10},
        "assume": {"motion": {"kind": "cwna", "q": 0.1}},
        "score": {"train": 0.5},
    }
    config = {
        "name": "easier",
        "scenario": scenario,
        "filters": {"KF": {"kind": "kf"}},
        "tune": {"KF": {"assume.motion.q": "log:1e-3..10"}},
        "tuning": {"evaluations": 4},
    }
    report = api.run(config, out=tmp_path / "out", engine="serial", quiet=True, formats=())
    notes = report.results.tables["tuning"].notes
    assert any(note.startswith("KF: the gap is negative: ") for note in notes)
