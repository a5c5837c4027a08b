"""The scenario that filters are tuned on: laid over the judged one, and what it holds out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import trackbench as command
from tests.conftest import EXPERIMENT_FILES
from trackbench.config.load import load
from trackbench.config.resolved_config import as_yaml, resolved
from trackbench.config.training_data import held_out_data
from trackbench.errors import UserError
from trackbench.evaluation.simulated_runs import simulate
from trackbench.execution.block_key import block_key
from trackbench.execution.cache import BlockStore
from trackbench.execution.engines import engine
from trackbench.report.tables_and_figures import Results
from trackbench.tuning.range_of_good_values import values_within_stderr
from trackbench.tuning.tuner import Training, tune

CONFIG = """
name: other
seed: 3
runs: 30
scenario:
  kind: tracking
  last: 60
  target:
    kind: legs
    launch: {x: 0, y: 0, vx: 10, vy: 0}
    legs: [{start: 20, end: 40, ax: 0.1, ay: 0.4}]
  sensor: {kind: position, sigma: 2}
  start: two-scan
  assume: {motion: {kind: cwna, q: 0.1}}
filters: {KF: {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}}
tune: {KF: {assume.motion.q: log:1e-3..100}}
tuning: {runs: 60, evaluations: 12}
"""
DRIVEN = "{kind: driven, motion: {kind: cwna, q: 0.5}}"
RANDOM = (
    "{kind: random-legs, area: 9, speed: [5, 9], legs: [9, 9], leg_steps: [9, 9], sigma_along: 0, "
    "across: 1}"
)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "other.yaml"
    path.write_text(CONFIG)
    return path


def _with(config: Path, scenario: str) -> Path:
    config.write_text(CONFIG.replace("12}", f"12, scenario: {scenario}}}"))
    return config


def _keys(config: Path, *changes: str) -> list[str]:
    training = Training(load(config, changes), "KF")
    return [block_key(task, task.runs_used) for task in training.tasks((0.1,))]


def test_training_flies_the_other_target_and_the_results_do_not(config: Path) -> None:
    plain = load(config)
    experiment = load(_with(config, f"{{target: {RANDOM}}}"))
    assert experiment.points[0].scenario == plain.points[0].scenario
    (task,) = Training(experiment, "KF").tasks((0.1,))
    assert task.scenario.target.kind == "random-legs"  # type: ignore[attr-defined]
    assert task.scenario.true_sensor == plain.points[0].scenario.true_sensor
    truth = simulate(task.scenario, task.seed, task.first_run, task.width).truth
    assert np.ptp(truth[0, -1]) > 1.0
    (task,) = Training(plain, "KF").tasks((0.1,))
    truth = simulate(task.scenario, task.seed, task.first_run, task.width).truth
    assert np.ptp(truth[0, -1]) == 0.0


def test_it_finds_what_is_best_there(config: Path) -> None:
    """Of a linear Gaussian target the true q is best: that of training, whatever judges."""
    text = CONFIG.replace("12}", "12, scenario: {target: {motion: {q: 20}}}}")
    legs = text[text.index("  target:") : text.index("  sensor:")]
    config.write_text(text.replace(legs, f"  target: {DRIVEN}\n"))
    store = BlockStore(config.parent / "cache")
    record = tune(load(config), store, engine("serial", 1), 1, progress=False)["KF"]
    low, high = values_within_stderr(record, record.axes[0])
    assert 0.5 < low < 20 < high


def test_a_file_is_laid_over_the_scenario_too(config: Path) -> None:
    folder = config.parent / "paths"
    folder.mkdir()
    (folder / "path.csv").write_text("time,x,y\n0,0,0\n30,90,9\n60,200,80\n")
    target = "target: {kind: recorded, file: path.csv}\n"
    (folder / "training.yaml").write_text(f"last: 50\n{target}")
    by_path = load(_with(config, "paths/training.yaml")).training
    by_use = load(_with(config, "{use: paths/training.yaml, last: 40}")).training
    assert by_path is not None
    assert by_use is not None
    assert [len(point.scenario.steps) for point in (by_path, by_use)] == [50, 40]
    assert by_path.scenario.target.kind == "recorded"  # type: ignore[attr-defined]
    assert by_path.scenario.true_sensor == load(config).points[0].scenario.true_sensor


def test_the_tuned_config_keeps_what_was_given_and_no_more(config: Path) -> None:
    """So that another sensor, say, is that of training as well."""
    experiment = load(_with(config, f"{{target: {RANDOM}}}"))
    data = resolved(experiment, config.parent)
    assert set(data["tuning"]["scenario"]) == {"target"}
    written = config.with_name("config.yaml")
    written.write_text(as_yaml(data))
    again = load(written)
    assert again.training == experiment.training
    sharper = load(written, ["scenario.sensor.sigma=1"]).training
    assert sharper is not None
    assert sharper.scenario.true_sensor == again.training.scenario.true_sensor.__class__(sigma=1)  # type: ignore[union-attr]
    config.write_text(CONFIG)
    assert "scenario" not in resolved(load(config), config.parent)["tuning"]


def test_blocks_of_another_training_scenario_are_other_blocks(config: Path) -> None:
    _with(config, f"{{target: {RANDOM}}}")
    keys = [
        _keys(config),
        _keys(config, "tuning.scenario.target.across=2"),
        _keys(config, "tuning.scenario.last=50"),
        _keys(config, "tuning.scenario=null"),
    ]
    assert len({tuple(k) for k in keys}) == 4
    assert keys[0] == _keys(config, "runs=10", "scenario.target.launch.vx=3")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ([], "noise"),
        (["tuning.scenario={sensor: {sigma: 9}}"], "noise"),
        (["tuning.scenario={last: 50}"], "noise"),
        (["tuning.scenario={target: {launch: {vx: 9}}}"], "noise and path"),
        ([f"tuning.scenario={{target: {RANDOM}}}"], "noise and path"),
        ([f"scenario.target={DRIVEN}"], "noise and path"),
        ([f"scenario.target={RANDOM}"], "noise and path"),
        (["scenario.target={kind: waypoints, x: [0, 9], y: [0, 9], speed: 3}"], "noise"),
    ],
)
def test_what_is_held_out(config: Path, changes: list[str], expected: str) -> None:
    assert held_out_data(load(config, changes)) == expected


def test_what_is_held_out_of_recordings(tmp_path: Path) -> None:
    rows = [f"{run},{step},{run},{step}" for run in range(10) for step in range(13)]
    (tmp_path / "z.csv").write_text("run,step,x,y\n" + "\n".join(rows) + "\n")
    (tmp_path / "y.csv").write_text("run,step,x,y\n" + "\n".join(rows[:52]) + "\n")
    path = tmp_path / "recorded.yaml"
    data = "target: {kind: measured, measurements: z.csv}"
    text = CONFIG[: CONFIG.index("  target:")] + f"  {data}\n" + CONFIG[CONFIG.index("  sensor:") :]
    path.write_text(text.replace("last: 60", "last: null").replace("runs: 30", "runs: 6"))
    with pytest.raises(UserError, match=r"60 training runs beside 6"):
        load(path)
    assert held_out_data(load(path, ["tuning.runs=4"])) == "recordings"
    shared = ["tuning.runs=4", "runs=10", "scenario.score={train: 0.5}"]
    assert held_out_data(load(path, shared)) == "time"
    (tmp_path / "paths.yaml").write_text("target: {measurements: y.csv}\n")
    path.write_text(path.read_text().replace("12}", "12, scenario: paths.yaml}"))
    assert held_out_data(load(path, ["runs=10", "tuning.runs=4"])) == "noise and path"
    with pytest.raises(UserError, match="5 is more than the 4 recorded runs"):
        load(path, ["runs=10", "tuning.runs=5"])


def test_one_plain_note_says_so(config: Path) -> None:
    said = "note: filters are tuned on the path that judges them, and only the noise is held out"
    checked = command("check", str(config))
    assert checked.stderr.count(said) == 1
    assert "tuning: {scenario:" in checked.stderr
    for change in (f"tuning.scenario={{target: {RANDOM}}}", f"scenario.target={DRIVEN}"):
        assert "note" not in command("check", str(config), "--set", change).stderr
    out = config.parent / "out"
    words = ("--out", str(out), "--workers", "1", "--format", "svg", "--runs", "8")
    ran = command("run", str(config), *words, "--set", "tuning.evaluations=2")
    assert ran.stderr.count(said) == 1
    assert "60 training runs on the path of the results, with other noise" in _said_in(out)
    _with(config, f"{{target: {RANDOM}}}")
    ran = command("run", str(config), *words, "--set", "tuning.evaluations=2")
    assert said not in ran.stderr
    assert "60 training runs on other paths than those of the results" in _said_in(out)


def _said_in(folder: Path) -> str:
    """The tuning table, once report and manifest were seen to say what it says."""
    results = Results(folder)
    table = (folder / "tables" / "tuning.md").read_text()
    assert results.tables["tuning"].title in table
    assert results.tables["tuning"].title in (folder / "report.html").read_text()
    assert results.manifest["training_holds_out"] == (
        "noise" if "on the path" in table else "noise and path"
    )
    return table


@pytest.mark.parametrize(
    ("scenario", "what"),
    [
        ("{lst: 3}", ":{line}:{column}: tuning.scenario.lst: unknown key; did you mean"),
        ("{target: {kind: leg}}", ": tuning.scenario.target.kind: 'leg' is not a kind of target"),
        ("{sensor: {sigma: -1}}", ": tuning.scenario.sensor.sigma: -1 is "),
        ("none.yaml", ": tuning.scenario: cannot read "),
        ("3", ": tuning.scenario: is neither a mapping nor a path"),
        (
            f"{{target: {RANDOM}}}, metric: 'mean(rmse_position[turns])'",
            ": tuning.scenario: tuning.metric: 'mean(rmse_position[turns])' is no metric here",
        ),
    ],
)
def test_a_mistake_is_a_line(config: Path, scenario: str, what: str) -> None:
    text = _with(config, scenario).read_text()
    line, column = text[: text.index("scenario: " + scenario)].count("\n") + 1, 0
    column = text.splitlines()[line - 1].index("lst") + 1 if "lst" in scenario else 0
    with pytest.raises(UserError) as error:
        load(config)
    (found,) = str(error.value).splitlines()
    assert found.startswith(f"{config}:{line}:")
    assert what.format(line=line, column=column) in found


def test_a_scenario_among_the_filters_is_pointed_to_its_place(config: Path) -> None:
    config.write_text(CONFIG.replace("tune: {", "tune: {scenario: {last: 9}, "))
    with pytest.raises(UserError, match=r"tune.scenario: is no filter; .* `tuning: {scenario:"):
        load(config)


def test_the_papers_experiment_holds_its_track_out() -> None:
    """Settings for a track that is printed are found on tracks of the kind, not on it."""
    experiment: Any = load(EXPERIMENT_FILES["adaptive-kf-tuned"])
    assert held_out_data(experiment) == "noise and path"
    others = load(EXPERIMENT_FILES["adaptive-kf-tuned-paths"])
    assert experiment.training.scenario == others.training.scenario  # type: ignore[union-attr]
    assert experiment.settings.tune == others.settings.tune
    assert experiment.settings.seed == others.settings.seed
