"""The expected time of a block, from its first steps."""

import numpy as np
import pytest

from trackbench.commands import expected_time as expected_times
from trackbench.commands.expected_time import expected_time
from trackbench.commands.prepare_jobs import jobs_of
from trackbench.commands.run_options import Options
from trackbench.evaluation import time_by_trial as trial
from trackbench.evaluation.time_by_trial import estimate_cpu_s

CONFIG = {
    "name": "trial",
    "runs": 4,
    "scenario": {
        "kind": "tracking",
        "last": 200,
        "target": {
            "kind": "driven",
            "motion": {"kind": "cv", "q": 1},
            "launch": {"x": 10, "vx": 1},
        },
        "sensor": {"kind": "position", "sigma": 2},
        "start": {"kind": "gaussian", "sigma": [2, 1, 2, 1]},
    },
    "filters": {"PF": {"kind": "pf", "N": 20}, "KF": {"kind": "kf"}},
}


def test_the_time_grows_with_the_steps_that_are_not_tried(monkeypatch) -> None:
    (job,) = jobs_of([CONFIG], Options(quiet=True))
    tried = []

    def one_second_for_eight_steps(task, data, steps):
        tried.append((steps, data.measurements.shape[1], data.truth.shape[1]))
        return steps / 8.0

    monkeypatch.setattr(trial, "_trial_cpu_s", one_second_for_eight_steps)
    assert estimate_cpu_s(job.plan.unique[0]) == pytest.approx(200 / 8)
    assert {steps for steps, *_ in tried} == {8}  # which are long enough
    monkeypatch.setattr(
        trial, "_trial_cpu_s", lambda task, data, steps: tried.append(steps) or 1e-9
    )
    estimate_cpu_s(job.plan.unique[0])
    assert tried[-1] == 200  # the whole block, as it takes no time


def test_a_trial_filters_the_first_steps(monkeypatch) -> None:
    (job,) = jobs_of([CONFIG], Options(quiet=True))
    task = job.plan.unique[0]
    outputs = []

    def run(trial_task, data):
        outputs.append(run_filter(trial_task, data))

    run_filter = trial.run_filter
    monkeypatch.setattr(trial, "run_filter", run)
    trial._trial_cpu_s(task, task.data, 8)
    (output,) = outputs
    whole = run_filter(task, task.data)
    np.testing.assert_array_equal(output.mean, whole.mean[:, :9])


def test_many_filters_and_failing_ones_have_no_trial(monkeypatch) -> None:
    (job,) = jobs_of([CONFIG], Options(quiet=True, fresh=True))
    assert "by a trial" in expected_time(job, Options(fresh=True))
    assert "time unknown" in expected_time(job, Options(fresh=True), tries=False)
    monkeypatch.setattr(expected_times, "_MOST_TRIED_FILTERS", 1)
    assert "time unknown" in expected_time(job, Options(fresh=True))
    monkeypatch.undo()
    monkeypatch.setattr(trial, "run_filter", lambda task, data: 1 / 0)
    assert "time unknown" in expected_time(job, Options(fresh=True))
