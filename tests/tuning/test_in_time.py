"""A recording shared out in time: its first part tunes, and the results are of the rest."""

from pathlib import Path

import numpy as np
import pytest

from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.tuning.tuner import Training

ROWS = 60
CONFIG = """
name: small
hold_out: 5
scenario:
  kind: tracking
  target: {kind: measured, measurements: m.csv}
  sensor: {kind: position, sigma: 2}
  start: {kind: one-scan, sigma_velocity: 5}
  assume: {motion: {kind: cwna, q: 0.3}}
  score: {train: 0.5}
filters:
  KF: {kind: kf, assume: {motion: {kind: cwna, q: 0.1}}}
tune:
  KF: {assume.motion.q: log:1e-3..10}
tuning: {evaluations: 8}
tables:
  t: {kind: metrics, columns: {Log score: mean(log_score), Held out: mean(held_log_score)}}
"""


def recording(times: np.ndarray) -> str:
    """Two runs that turn about, seen with errors of 2 m, at times that are not equally far apart."""
    rng = np.random.default_rng(1)
    lines = ["run,time,x,y"]
    for run in range(2):
        path = np.stack([10.0 * times, 200.0 * np.sin(times / 15.0 + run)])
        seen = path + rng.normal(0.0, 2.0, path.shape)
        lines += [f"{run},{t:.3f},{x:.3f},{y:.3f}" for t, x, y in zip(times, *seen, strict=True)]
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("in-time")
    times = np.cumsum(np.random.default_rng(2).uniform(0.5, 1.5, ROWS))
    (folder / "m.csv").write_text(recording(times))
    (folder / "small.yaml").write_text(CONFIG)
    return folder / "small.yaml"


@pytest.fixture(scope="module")
def report(config: Path) -> api.Report:
    return api.run(config, out=config.parent / "out", workers=1, quiet=True, formats=())


def test_tuning_sees_the_first_part_and_nothing_of_the_rest(
    config: Path, report: api.Report
) -> None:
    scenario = load(config).points[0].scenario
    (task,) = Training(load(config), "KF").tasks((0.5,))
    assert task.runs_used == 2
    assert scenario.training is not None
    last = scenario.training.steps[-1]
    assert 0.4 * ROWS < last < 0.6 * ROWS
    judged = scenario.steps[scenario.windows[""]]
    assert judged.tolist() == list(range(last + 1, ROWS))
    # What is measured later may be anything: the same trials with the same scores.
    lines = (config.parent / "m.csv").read_text().splitlines()
    end = scenario.times[last]
    begin = scenario.times[0]
    other = config.parent / "other"
    other.mkdir()
    spoilt = [
        f"{line}7" if i and float(line.split(",")[1]) > end - begin + _first(lines) else line
        for i, line in enumerate(lines)
    ]
    assert spoilt != lines
    (other / "m.csv").write_text("\n".join(spoilt))
    (other / "small.yaml").write_text(CONFIG)
    again = api.run(other / "small.yaml", out=other / "out", workers=1, quiet=True, formats=())
    name = "tuning.csv"
    assert (again.folder / name).read_bytes() == (report.folder / name).read_bytes()
    assert (again.folder / "per_run.csv").read_bytes() != (
        report.folder / "per_run.csv"
    ).read_bytes()


def _first(lines: list[str]) -> float:
    return float(lines[1].split(",")[1])


def test_the_results_are_those_of_the_rest(config: Path, report: api.Report) -> None:
    """With the found values typed in, and only the steps of the second part scored."""
    q = report.results.tuning["KF"].best.values["assume.motion.q"]
    last = load(config).points[0].scenario.training.steps[-1]
    text = CONFIG[: CONFIG.index("tune:")] + CONFIG[CONFIG.index("tables:") :]
    text = text.replace("train: 0.5", f"steps: [{last + 1}, null]").replace("q: 0.1", f"q: {q}")
    path = config.parent / "typed.yaml"
    path.write_text(text)
    typed = api.run(path, out=config.parent / "typed", workers=1, quiet=True, formats=()).per_run
    mine = report.per_run[report.per_run["filter"] == "KF (tuned)"]
    assert mine["value"].tolist() == typed["value"].tolist()


def test_the_config_of_the_results_gives_them_again(config: Path, report: api.Report) -> None:
    path = report.folder / "config.yaml"
    again = api.run(path, out=config.parent / "again", workers=1, quiet=True, formats=())
    for name in ("tuning.csv", "per_run.csv", "summary.csv", "tables/tuning.csv"):
        assert (again.folder / name).read_bytes() == (report.folder / name).read_bytes(), name
    assert "first 50 % of the time" in (again.folder / "tables/tuning.md").read_text()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("train: 0.5", "train: 0.001", "score.train: leaves no step to train on"),
        ("train: 0.5", "train: 0.9, steps: [null, 20]", "score.train: leaves no step to be scored"),
        ("train: 0.5", "train: 1", "score.train: 1 is not less than 1"),
        ("train: 0.5", "train: 0.5, steps: [50, null]", "none is scored before 50"),
        ("evaluations: 8", "runs: 3", "tuning.runs: 3 is more than the 2 recorded runs"),
        ("score: {train: 0.5}", "T: 1", "or share out their time"),
        (
            "{kind: measured, measurements: m.csv}",
            "{kind: driven, motion: {kind: cv, q: 1}}",
            "score.train: training has runs of its own",
        ),
    ],
)
def test_what_cannot_be_shared_out(config: Path, old: str, new: str, expected: str) -> None:
    text = CONFIG.replace(old, new)
    if "driven" in new:
        text = text.replace("  score:", "  last: 30\n  score:").replace("one-scan", "two-scan")
        text = text.replace(", sigma_velocity: 5", "")
    path = config.parent / "bad.yaml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        load(path)
    assert expected in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
