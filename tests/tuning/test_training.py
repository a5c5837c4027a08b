"""Training runs: others than those of the results, and the same for every filter and width."""

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import EXPERIMENT_FILES
from trackbench.config.load import load
from trackbench.config.values_of_filter import configured_values
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_blocks_side_by_side import run_whole_block
from trackbench.evaluation.simulated_runs import simulate
from trackbench.tuning.tuner import Training

CONFIG = """
name: small
runs: 30
scenario:
  kind: tracking
  last: 12
  target: {kind: driven, motion: {kind: cwna, q: 0.5}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
filters:
  KF: {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}
  PF: {kind: rpf, N: 2000}
tune:
  KF: {assume.motion.q: log:1e-3..10}
  PF: {N: 500..3000}
tuning: {runs: 100}
"""


def test_streams_of_training_are_streams_of_no_run() -> None:
    words = {
        tuple(g.bit_generator.random_raw(2))
        for numbers in (range(300), range(-1, -301, -1))
        for g in (
            *RunStreams(5, numbers)._generators,
            *(block_stream(5, n) for n in numbers),
        )
    }
    assert len(words) == 4 * 300


def test_a_training_run_is_the_same_in_blocks_of_any_width(tmp_path: Path) -> None:
    point = load(_written(tmp_path)).points[0]
    wide = BlockTask(point.scenario, point.filters["KF"], 3, index=-1, width=6, runs_used=6)
    narrow = [
        BlockTask(point.scenario, point.filters["KF"], 3, index=-1 - i, width=2, runs_used=2)
        for i in range(3)
    ]
    whole = run_whole_block(wide)[6]
    parts = [run_whole_block(task)[2].per_run["rmse_position"] for task in narrow]
    np.testing.assert_array_equal(whole.per_run["rmse_position"], np.concatenate(parts))
    assert not whole.steps
    assert whole.tracks is None
    judged = BlockTask(point.scenario, point.filters["KF"], 3, index=0, width=6, runs_used=6)
    there = run_whole_block(judged)[6].per_run["rmse_position"]
    assert not set(there) & set(whole.per_run["rmse_position"])


def test_every_filter_is_tuned_on_the_same_runs(tmp_path: Path) -> None:
    experiment = load(_written(tmp_path))
    used = []
    for label, values in (("KF", (0.1,)), ("PF", (3000,))):
        tasks = Training(experiment, label).tasks(values)
        assert sum(task.runs_used for task in tasks) == 100
        data = [simulate(t.scenario, t.seed, t.first_run, t.width) for t in tasks]
        truth = [d.truth[..., : t.runs_used] for d, t in zip(data, tasks, strict=True)]
        used.append(np.concatenate(truth, axis=-1))
    assert len(Training(experiment, "PF").tasks((3000,))) > 1
    np.testing.assert_array_equal(*used)


def test_it_begins_with_the_values_of_the_config() -> None:
    experiment = load(EXPERIMENT_FILES["adaptive-kf-tuned"])
    assert configured_values(experiment, "IMM")["motions.1.q"] == 1e-4
    assert configured_values(experiment, "eta = 35")["detector.eta"] == 35.0  # of a preset
    training = Training(experiment, "Any threshold")
    assert training.axes[0].at(training.start[0]) == 20.0


def test_training_runs_of_a_recording_are_its_last(tmp_path: Path) -> None:
    rows = [f"{run},{step},{run},{step}" for run in range(10) for step in range(13)]
    (tmp_path / "z.csv").write_text("run,step,x,y\n" + "\n".join(rows) + "\n")
    config = tmp_path / "recorded.yaml"
    config.write_text(
        "name: r\nruns: 6\nscenario:\n  kind: tracking\n"
        "  target: {kind: measured, measurements: z.csv}\n  sensor: {kind: position, sigma: 2}\n"
        "  start: two-scan\n  assume: {motion: {kind: cwna, q: 0.1}}\n"
        "filters: {KF: {kind: kf, assume: {motion: {kind: cwna, q: 0.1}}}}\n"
        "tune: {KF: {assume.motion.q: log:0.01..1}}\ntuning: {runs: 4}\n"
    )
    experiment = load(config)
    seen = [
        simulate(t.scenario, t.seed, t.first_run, t.width).measurements[0, 0]
        for t in Training(experiment, "KF").tasks((0.1,))
    ]
    assert np.concatenate(seen).tolist() == [9.0, 8.0, 7.0, 6.0]
    with pytest.raises(UserError, match=r"5 training runs beside 6 .* the 10 recorded"):
        load(config, ["tuning.runs=5"])
    assert Training(experiment, "KF").tasks((0.1,))[0].predictive_metrics == ("score",)
    with pytest.raises(UserError, match=r"tuning.metric: 'mean\(nope\)' is no metric here"):
        load(config, ["tuning.metric=mean(nope)"])


def _written(folder: Path) -> Path:
    path = folder / "small.yaml"
    path.write_text(CONFIG)
    return path
