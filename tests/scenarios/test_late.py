"""Late measurements against batch solutions, scalar loops, and filters that begin anew at each step."""

import re
import sys
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.stats import chisquare

from tests.conftest import make_filter
from tests.papers import maneuver
from tests.report.forging import edit
from trackbench import api
from trackbench.adapters.per_run import PerRun, loop_over_runs
from trackbench.config.experiment import Experiment, Point, cautions
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.errors import UserError
from trackbench.evaluation import measure_cpu_times as timing
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.damage_of_faults import task_without_faults
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.measure_cpu_times import Measured, measure
from trackbench.evaluation.run_blocks_side_by_side import run_block, run_stack
from trackbench.evaluation.run_filter import prior_of, run_filter
from trackbench.execution.memory import _kept_states
from trackbench.filters.base import AnyFilter
from trackbench.filters.external import External
from trackbench.filters.kf import KF
from trackbench.models.assume import Assume
from trackbench.models.delays import GeometricDelay, SharesDelay, UniformDelay
from trackbench.models.sensors.position import ScalarSensor
from trackbench.new_experiment_from_tables import write_config_for
from trackbench.results.manifest import read_manifest
from trackbench.scenarios.base import Simulation
from trackbench.scenarios.delays import arrivals
from trackbench.scenarios.faults import Bias
from trackbench.verify.verify_folder import verify

pytestmark = pytest.mark.usefixtures("no_report")

PHI, Q, R, RUNS = 0.95, 1.0, 4.0, 12
SCALAR = {
    "kind": "tracking",
    "last": 40,
    "target": {"kind": "driven", "motion": {"kind": "ar1", "phi": PHI, "q": Q}},
    "sensor": {"kind": "scalar", "sigma": R**0.5, "delay": {"kind": "geometric", "mean": 2}},
    "start": {"kind": "gaussian", "sigma": [1.5]},
}
FAST = {"kind": "position", "sigma": 10, "detection": 0.9, "delay": {"kind": "uniform", "most": 6}}
SLOW = {"kind": "position", "sigma": 20, "period": 3}
PLANAR = {
    "kind": "tracking",
    "last": 30,
    "target": {"kind": "driven", "motion": {"kind": "cwna", "q": 1}, "launch": {"vx": 10}},
    "sensor": [FAST, SLOW],
    "start": {"kind": "gaussian", "sigma": [10, 2, 10, 2]},
}
WAYS: dict[str, Any] = {
    "drop": "drop",
    "apply": "apply",
    "refilter": "refilter",
    "three": {"kind": "refilter", "memory": 3},
}
FILTERS: dict[str, Any] = {name: {"kind": "kf", "late": late} for name, late in WAYS.items()}
FILTERS["bound"] = {"kind": "kf", "assume": {"delay": "none"}}


def experiment(folder: Path, scenario: dict[str, Any], **keys: Any) -> Experiment:
    """Return an experiment with a filter of each treatment."""
    config = {"name": "late", "runs": RUNS, "scenario": scenario, "filters": FILTERS} | keys
    (folder / "late.yaml").write_text(yaml.safe_dump(config))
    return load(folder / "late.yaml")


def task_of(point: Point, label: str, tracker: AnyFilter | None = None) -> BlockTask:
    """Return the task of a block with the assumptions of a label."""
    tracker = tracker or point.filters[label]
    return BlockTask(point.scenario, tracker, 1, 0, RUNS, RUNS, assume=point.assumed.get(label))


def output_of(point: Point, label: str) -> tuple[Simulation, FilterOutput]:
    """Return data and output of a block."""
    task = task_of(point, label)
    return task.data, run_filter(task, task.data, RUNS)


def batch(point: Point, data: Simulation, m: int, k: int, memory: int = 99) -> tuple[Array, Array]:
    """Return the last state's mean and covariance by least squares of all states up to step k.

    Measurement j counts if it arrived by step k, and at most ``memory`` steps late.
    """
    model, steps, n = point.scenario.model, point.scenario.steps, len(data.truth)
    rows: list[Array] = []

    def add(blocks: dict[int, Array], value: Array, cov: Array) -> None:
        """Add the rows ``L^-1 (A x - value)``, cov = L L'."""
        row = np.zeros((len(value), n * (k + 2) + 1))
        row[:, -1] = value
        for j, block in blocks.items():
            row[:, n * j : n * (j + 1)] = block
        rows.append(np.linalg.solve(np.linalg.cholesky(cov), row))

    add({0: np.eye(n)}, data.prior.mean[:, m], data.prior.cov)
    for j in range(k + 1):
        moved = model.motion.transition(np.eye(n), int(steps[j + 1]))
        add({j: -moved.mean, j + 1: np.eye(n)}, np.zeros(n), moved.cov.reshape(n, n))
        first = 0
        for s, sensor in enumerate(getattr(model.sensor, "sensors", (model.sensor,))):
            H, R = sensor.H(n), sensor.measurement(np.zeros((n, 1)), 1).cov
            z = data.measurements[first : first + len(H), j, m]
            arrival, first = data.arrival[s, j, m], first + len(H)
            if not (np.isnan(z).any() or arrival > k or arrival - j > memory):
                add({j + 1: H}, z, R)
    triangle = np.linalg.qr(np.concatenate(rows))[1][: n * (k + 2)]
    inverse = np.linalg.inv(triangle[:, :-1])
    return (inverse @ triangle[:, -1])[-n:], (inverse @ inverse.T)[-n:, -n:]


def check_batch(point: Point, label: str, memory: int, runs: int) -> None:
    """Check estimates and covariances of every step and some runs."""
    data, output = output_of(point, label)
    assert data.arrival is not None
    assert output.cov is not None
    late = data.arrival > np.arange(data.arrival.shape[1])[:, None]
    assert late[0].mean() > 0.3
    for m in range(runs):
        for k in range(data.measurements.shape[1]):
            mean, cov = batch(point, data, m, k, memory)
            np.testing.assert_allclose(output.mean[:, k + 1, m], mean, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(output.cov[..., k + 1, m], cov, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("label", "memory"), [("refilter", 99), ("three", 3), ("drop", 0)])
def test_the_kalman_filter_is_the_batch_solution(tmp_path: Path, label: str, memory: int) -> None:
    check_batch(experiment(tmp_path, PLANAR).points[0], label, memory, 3)


def scalar_kalman(given: Array) -> Array:
    """Return estimates of a scalar Kalman filter from N(0, 1.5^2), NaN for no measurement."""
    x, P, out = 0.0, 2.25, [0.0]
    for z in given:
        x, P = PHI * x, PHI * PHI * P + Q
        if not np.isnan(z):
            x, P = x + P / (P + R) * (z - x), P * R / (P + R)
        out.append(x)
    return np.array(out)


@pytest.mark.parametrize("label", ["drop", "apply"])
def test_drop_and_apply_are_scalar_loops(tmp_path: Path, label: str) -> None:
    data, output = output_of(experiment(tmp_path, SCALAR).points[0], label)
    z, arrival = data.measurements[0], data.arrival[0]
    for m in range(RUNS):
        given, late, dropped = np.full(40, np.nan), np.zeros(40), np.zeros(40)
        for k in range(40):
            arrived = [j for j in range(k + 1) if arrival[j, m] == k]
            used = [j for j in arrived if label == "apply" or j == k][-1:]
            given[k] = z[used[0], m] if used else np.nan
            late[k] = sum(j < k for j in arrived)
            dropped[k] = sum(j < k for j in arrived if j not in used)
        expected = scalar_kalman(given)
        np.testing.assert_allclose(output.mean[0, :, m], expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(output.diagnostics["arrived_late"][1:, m], late)
        np.testing.assert_array_equal(output.diagnostics["late_dropped"][1:, m], dropped)


class Walker(PerRun):
    """A filter of one run that changes its own arrays, and draws random numbers."""

    def start(self, mean: Array, cov: Array) -> None:
        self.mean, self.cov = mean, cov

    def predict(self, dt: float) -> tuple[Array, Array]:
        self.mean[0] += dt * self.mean[1] + 0.01 * self.rng.standard_normal()
        return self.mean, self.cov

    def update(self, z: Array) -> tuple[Array, Array]:
        self.mean[::2] += 0.3 * np.nan_to_num(z[:2] - self.mean[::2])
        return self.mean, self.cov


PROGRAM = """
import sys
hello = input()
print("ready", flush=True)
x = []
for line in sys.stdin:
    word, *fields = line.split()
    if word == "init":
        x = [float(field) for field in fields[2:6]]
    elif word == "step":
        for i, z in enumerate(fields[1:3]):
            x[2 * i] += x[2 * i + 1]
            if z != "nan":
                x[2 * i] += 0.3 * (float(z) - x[2 * i])
    print(*x, flush=True)
"""


def all_kinds(folder: Path) -> dict[str, AnyFilter]:
    """Return a filter of each way in which the runner treats one."""
    (folder / "program.py").write_text(PROGRAM)
    imm = {
        "motions": [{"kind": "cwna", "q": 0.1}, {"kind": "cwna", "q": 9}],
        "transition": [[0.9, 0.1], [0.1, 0.9]],
    }
    built = load_filters(folder, {"imm": {"kind": "imm", **imm}})
    return {
        "kf": make_filter("kf"),
        "gated": make_filter("ekf", gate=0.9),
        "ukf": make_filter("ukf"),
        "imm": built["imm"],
        "rpf": make_filter("rpf", N=100),
        "pf": make_filter("pf", N=100),
        "per-run": loop_over_runs(Walker)(),
        "external": External(command=(sys.executable, str(folder / "program.py")), timeout=20.0),
    }


def load_filters(folder: Path, filters: dict[str, Any]) -> dict[str, AnyFilter]:
    """Return filters of YAML."""
    with_late = {name: {**keys, "late": "drop"} for name, keys in filters.items()}
    return experiment(folder, PLANAR, filters=with_late).points[0].filters


KINDS = ("kf", "gated", "ukf", "imm", "rpf", "pf", "per-run", "external")


def anew(task: BlockTask, k: int) -> Array:
    """Return the estimate of step k by a filter that begins with what has arrived by step k."""
    data, rows = task.data, (slice(0, 2), slice(2, 4))
    assert data.arrival is not None
    model, rng = task.scenario.model, block_stream(task.seed, 0)
    z = data.measurements.copy()
    for of, arrival in zip(rows, data.arrival, strict=True):
        z[of, arrival > k] = np.nan
    state = task.filter.init(model, prior_of(data, model), rng)
    for j in range(k + 1):
        state = task.filter.step(model, state, z[:, j], int(task.scenario.steps[j + 1]), rng)
    return task.filter.estimate(state).mean.copy()


@pytest.mark.parametrize("kind", KINDS)
def test_every_filter_equals_one_that_begins_anew(tmp_path: Path, kind: str) -> None:
    point = experiment(tmp_path, PLANAR).points[0]
    task = task_of(point, "refilter", all_kinds(tmp_path)[kind])
    output = run_filter(task, task.data)
    for k in (0, 1, 5, 6, 17, 29):
        np.testing.assert_array_equal(output.mean[:, k + 1], anew(task, k))


@pytest.mark.parametrize("kind", KINDS)
def test_without_late_ones_it_is_the_plain_filter(tmp_path: Path, kind: str) -> None:
    sensors = [{**FAST, "delay": {"kind": "shares", "shares": [1, 0]}}, SLOW]
    point = experiment(tmp_path, PLANAR | {"sensor": sensors}).points[0]
    task = task_of(point, "refilter", all_kinds(tmp_path)[kind])
    assert task.assumed_scenario.late is not None
    assert task.data.arrival is not None
    plain = task_of(experiment(tmp_path, PLANAR).points[0], "bound", task.filter)
    assert plain.assumed_scenario.late is None
    same = run_filter(plain, plain.data)
    for label in ("refilter", "three", "drop", "apply"):
        got = run_filter(replace(task, assume=point.assumed[label]), task.data)
        np.testing.assert_array_equal(got.mean, same.mean)
        np.testing.assert_array_equal(got.nees, same.nees)


def test_the_bound_is_the_run_without_delays(tmp_path: Path) -> None:
    on_time = [{k: v for k, v in FAST.items() if k != "delay"}, SLOW]
    plain = experiment(tmp_path, PLANAR | {"sensor": on_time}, filters={"KF": {"kind": "kf"}})
    late = experiment(tmp_path, PLANAR).points[0]
    _, expected = output_of(plain.points[0], "KF")
    data, got = output_of(late, "bound")
    np.testing.assert_array_equal(got.mean, expected.mean)
    errors = {label: output_of(late, label)[1].mean - data.truth for label in FILTERS}
    mse = {label: (error[::2] ** 2).mean() for label, error in errors.items()}
    assert mse["bound"] < mse["refilter"] < mse["three"] < mse["drop"]


@pytest.mark.parametrize("kind", ["kf", "imm", "rpf"])
def test_a_block_is_the_same_in_a_stack(tmp_path: Path, kind: str) -> None:
    point = experiment(tmp_path, PLANAR).points[0]
    task = task_of(point, "refilter", all_kinds(tmp_path)[kind])
    blocks = [replace(task, index=i) for i in range(3)]
    stacked = [one[RUNS] for one in run_stack(blocks)]
    for block, got in zip(blocks, stacked, strict=True):
        check_equal(run_block(block), got)


def check_equal(alone: BlockResult, stacked: BlockResult) -> None:
    assert "arrived_late" in alone.per_run
    for name, values in alone.per_run.items():
        np.testing.assert_array_equal(stacked.per_run[name], values)


@pytest.mark.parametrize("late", ["apply", "refilter"])
def test_filters_side_by_side_have_their_bytes(late: Any) -> None:
    plain = maneuver(duration=60.0, legs=(), score_from=0.0)
    sensor = replace(plain.sensor, delay=UniformDelay(most=3))
    keys: dict[str, Any] = {"nmf": {"q": 0.0}, "mf": {"q": 1e-3}}
    filters = [make_filter("vdf", **keys, eta=eta) for eta in (10.0, 20.0)]
    fault = Bias(name="b", steps=(3, 5), value=(50.0, 0.0))
    scenario = replace(plain, sensor=sensor, faults=(fault,))
    tasks = [BlockTask(scenario, f, 3, 0, RUNS, RUNS, assume=Assume(late=late)) for f in filters]
    for task, got in zip(tasks, run_stack(tasks), strict=True):
        check_equal(run_block(task), got[RUNS])


def test_a_gate_is_judged_by_the_measurements_that_it_was_given(tmp_path: Path) -> None:
    fault = {"name": "b", "kind": "bias", "value": [20], "steps": [20, 30]}
    filters = {w: {"kind": "ekf", "gate": 0.999, "late": w} for w in ("drop", "apply", "refilter")}
    point = experiment(tmp_path, SCALAR | {"faults": [fault]}, filters=filters).points[0]
    blocks = [replace(task_of(point, "apply"), index=i) for i in range(2)]
    for block, got in zip(blocks, run_stack(blocks), strict=True):
        check_equal(run_block(block), got[RUNS])
    for label in filters:
        task = task_of(point, label)
        gated = run_filter(task, task.data).diagnostics["gated"][1:]
        arrival, refused = task.data.arrival[0], dict[bool, list[float]]({True: [], False: []})
        for k in range(40):
            for m in range(RUNS):
                arrived = [j for j in range(k + 1) if arrival[j, m] == k]
                used = [j for j in arrived if label == "apply" or j == k][-1:]
                for j in used:
                    refused[20 <= j + 1 <= 30].append(gated[k, m])
        number = {is_bad: len(values) for is_bad, values in refused.items()}
        assert number[True] > 30
        accepted, rejected = number[True] - sum(refused[True]), sum(refused[False])
        series = run_block(replace(task, keep_steps=("accepted_bad", "rejected_good"))).run_series
        assert np.nansum(series["accepted_bad"]) == accepted
        assert np.nansum(series["rejected_good"]) == rejected
        assert np.isfinite(series["accepted_bad"]).sum() == number[True]
        assert np.isfinite(series["rejected_good"]).sum() == number[False]


def test_costs_count_the_repeated_steps(tmp_path: Path) -> None:
    built = experiment(tmp_path, PLANAR)
    point = built.points[0]
    task = task_of(point, "three")
    data, repeated = task.data, 0
    assert data.arrival is not None
    exists = ~np.isnan(data.measurements[0])
    for m in range(RUNS):
        for k in range(30):
            back = [j for j in range(max(0, k - 3), k) if data.arrival[0, j, m] == k]
            repeated += k - min([j for j in back if exists[j, m]], default=k)
    factor = 1 + repeated / (30 * RUNS)
    one, other = measure([task, task_of(point, "bound")])
    assert isinstance(one, Measured)
    assert isinstance(other, Measured)
    assert one.covariances == pytest.approx(factor * float(other.covariances or 0.0))
    states = {label: _kept_states(point.filters[label], point, label) for label in FILTERS}
    assert states == {"drop": 1, "apply": 1, "refilter": 7, "three": 4, "bound": 1}


def test_a_run_has_the_time_of_its_repeated_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that moves by one at each step: one that filters again takes longer."""
    monkeypatch.setattr(timing, "REPEATS", 6)
    steps, step = [0], KF.step

    def counted(*arguments: Any) -> Any:
        steps[0] += 1
        return step(*arguments)

    monkeypatch.setattr(KF, "step", counted)
    monkeypatch.setattr(timing, "_clock", lambda: 1e-4 * steps[0])
    point = experiment(tmp_path, PLANAR).points[0]
    late, bound = measure([task_of(point, "refilter"), task_of(point, "bound")])
    assert isinstance(late, Measured)
    assert isinstance(bound, Measured)
    assert np.median(bound.seconds) == pytest.approx(30 * 1e-4 / RUNS)
    # As its operations, which are those of a Kalman filter in each step.
    factor = float(late.covariances or 0.0) / float(bound.covariances or 0.0)
    assert factor > 2.0
    assert np.median(late.seconds) == pytest.approx(factor * 30 * 1e-4 / RUNS)


def recorded(folder: Path, **keys: Any) -> dict[str, Any]:
    """Return a scenario of two recorded runs and sensors at unequal times, one of them late."""
    rng, lines = np.random.default_rng(5), ["run,time,sensor,x,y,received"]
    for run in (1, 2):
        times = np.cumsum(rng.uniform(0.3, 2.0, 30))
        for i, t in enumerate(times.tolist()):
            sensor = 1 + (i % 3 == 0)
            late = rng.exponential(2.0) * (sensor == 1)
            x, y = 5.0 * t + rng.normal(0, 10), rng.normal(0, 10)
            lines.append(f"{run},{t!r},{sensor},{x!r},{y!r},{t + late!r}")
    (folder / "m.csv").write_text("\n".join(lines))
    return {
        "kind": "tracking",
        "target": {"kind": "measured", "measurements": "m.csv", **keys},
        "sensor": [{"kind": "position", "sigma": 10}, {"kind": "position", "sigma": 20}],
        "start": {"kind": "given", "mean": [0, 5, 0, 0], "sigma": [10, 2, 10, 2]},
        "assume": {"motion": {"kind": "cwna", "q": 1}},
    }


@pytest.mark.parametrize(("label", "memory"), [("refilter", 99), ("three", 3)])
def test_a_recording_knows_when_rows_were_received(tmp_path: Path, label: str, memory: int) -> None:
    point = experiment(tmp_path, recorded(tmp_path), runs=2).points[0]
    times = point.scenario.times[1:]
    task = replace(task_of(point, label), width=2, runs_used=2)
    data, output = task.data, run_filter(task, task.data, 2)
    assert data.arrival is not None
    assert output.cov is not None
    rows = [line.split(",") for line in (tmp_path / "m.csv").read_text().splitlines()[1:]]
    for run, time, sensor, *_, received in rows:
        (j,) = np.flatnonzero(np.abs(times - float(time)) < 1e-6)
        k = next((k for k, t in enumerate(times) if t >= float(received) - 1e-6), len(times))
        assert data.arrival[int(sensor) - 1, j, int(run) - 1] == k
    assert len({*np.diff(times).round(6)}) > 40
    for m in range(2):
        for k in (0, 3, 20, len(times) - 1):
            mean, cov = batch(point, data, m, k, memory)
            np.testing.assert_allclose(output.mean[:, k + 1, m], mean, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(output.cov[..., k + 1, m], cov, rtol=1e-9, atol=1e-9)


def test_rows_of_one_time_were_received_with_the_last_one_used(tmp_path: Path) -> None:
    text = "time,x,y,received\n1,0,0,1\n2,1,1,4\n2,1,1,3\n3,2,2,4\n3,4,4,6\n4,5,5,4\n5,5,5,5\n6,6,6,6\n"
    keys = recorded(tmp_path, same_time="mean")
    (tmp_path / "m.csv").write_text(text)
    keys["sensor"] = keys["sensor"][0]
    scenario = experiment(tmp_path, keys, runs=1).points[0].scenario
    data = scenario.simulate(RunStreams(1, range(1)), 1)
    assert data.arrival is not None
    assert data.arrival[0, :, 0].tolist() == [0, 2, 5, 3, 4, 5]
    assert scenario.cautions[-1] == "2 measurements were received late, by 3 steps at most"


def test_a_joined_row_was_received_with_the_last_of_its_values(tmp_path: Path) -> None:
    """A value was received with its first row, and a row without values does not count."""
    rows = ["1,0,0,1", "2,1,,2", "2,,1,4", "2,1,,6", "3,2,2,6", "3,,,3", "4,4,4,6", "4,4,4,5"]
    keys = recorded(tmp_path)
    text = "\n".join(["time,x,y,received", *rows, "5,5,5,5", "6,6,6,6"])
    (tmp_path / "m.csv").write_text(text + "\n")
    keys["sensor"] = keys["sensor"][0]
    scenario = experiment(tmp_path, keys, runs=1).points[0].scenario
    data = scenario.simulate(RunStreams(1, range(1)), 1)
    assert data.arrival is not None
    assert data.arrival[0, :, 0].tolist() == [0, 3, 5, 4, 4, 5]


@pytest.mark.parametrize(
    ("row", "what"),
    [
        ("2,0,0,1.5", "received: received 0.5 s before its time"),
        ("2,0,0,", "received: '' is not a time"),
    ],
)
def test_a_row_is_received_after_its_time(tmp_path: Path, row: str, what: str) -> None:
    keys = recorded(tmp_path)
    (tmp_path / "m.csv").write_text(f"time,x,y,received\n1,0,0,1\n{row}\n3,0,0,3\n")
    keys["sensor"] = keys["sensor"][0]
    with pytest.raises(UserError, match=what):
        experiment(tmp_path, keys, runs=1)


def test_a_config_for_a_recording_filters_late_rows_again(tmp_path: Path) -> None:
    recorded(tmp_path)
    (path,), *_ = write_config_for(tmp_path / "m.csv", "guessed", tmp_path)
    late = load(path).points[0].scenario.late
    assert late is not None
    assert late.kind == "refilter"


def test_delays_have_the_law_and_random_numbers_of_their_own(tmp_path: Path) -> None:
    shares = [0.5, 0.2, 0.0, 0.3]
    laws = {
        "uniform": ({"least": 1, "most": 4}, [0.0, 0.25, 0.25, 0.25, 0.25]),
        "geometric": ({"mean": 1.5}, [0.4, 0.24, 0.144, 0.0864]),
        "shares": ({"shares": shares}, shares),
    }
    on_time = {k: v for k, v in SCALAR.items() if k != "sensor"}
    runs = 500
    plain = on_time | {"sensor": {"kind": "scalar", "sigma": 2.0}}
    filters = {"filters": {"KF": {"kind": "kf"}}}
    streams = RunStreams(1, range(runs))
    clean = experiment(tmp_path, plain, **filters).points[0].scenario.simulate(streams, runs)
    assert clean.arrival is None
    for kind, (keys, expected) in laws.items():
        sensor = {"kind": "scalar", "sigma": 2.0, "delay": {"kind": kind, **keys}}
        scenario = experiment(tmp_path, on_time | {"sensor": sensor}).points[0].scenario
        data = scenario.simulate(RunStreams(1, range(runs)), runs)
        np.testing.assert_array_equal(data.measurements, clean.measurements)
        np.testing.assert_array_equal(data.truth, clean.truth)
        few = scenario.simulate(RunStreams(1, range(3)), 3)
        assert data.arrival is not None
        assert few.arrival is not None
        np.testing.assert_array_equal(few.arrival, data.arrival[..., :3])
        delays = (data.arrival - np.arange(40)[:, None])[0, :30]
        for n, share in enumerate(expected):
            error = (share * (1 - share) / delays.size) ** 0.5
            assert abs((delays == n).mean() - share) <= 4 * error
        assert (data.arrival <= 40).all()


@pytest.mark.parametrize("mean", [1e-4, 0.01, 0.5, 1.0, 2.0, 37.0, 1e5])
def test_a_delay_is_its_longest_or_more_once_in_a_thousand(mean: float) -> None:
    """The least such number, and one at least: measurements of any such sensor may be late."""
    longest, q = GeometricDelay(mean=mean).longest, mean / (1.0 + mean)
    assert longest >= 1
    assert q**longest <= 1e-3 * (1.0 + 1e-9)
    assert longest == 1 or q ** (longest - 1) > 1e-3 * (1.0 - 1e-9)


def test_delays_of_a_range_or_a_list_have_a_largest() -> None:
    assert UniformDelay(least=2, most=5).longest == 5
    assert SharesDelay(shares=(0.5, 0.2, 0.3)).longest == 2
    # Shares that sum to a little less than one leave no room beyond the last number.
    rounded = SharesDelay(shares=(0.5, 0.5 - 5e-10))
    u = np.array([0.0, 0.4999, 0.5, 0.9999, 1.0 - 2.0**-53])
    assert rounded.steps(u).tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("delays", "notes"),
    [
        ((3, 0), ["drop: `late: drop` drops all measurements of sensor 1, as they are at least 3"]),
        (
            ({"kind": "uniform", "least": 4, "most": 9}, 8),
            [
                "drop: `late: drop` drops all measurements, as they are at least 4 steps late, so that "
                "the filter only predicts; take `refilter` or `apply`",
                "three: `memory: 3` drops all measurements, as they are at least 4 steps late, so that "
                "the filter only predicts; take a longer memory",
            ],
        ),
        (
            (0, {"kind": "shares", "shares": [0, 1]}),
            ["drop: `late: drop` drops all measurements of"],
        ),
        ((FAST["delay"], {"kind": "geometric", "mean": 9}), []),
    ],
)
def test_a_filter_that_drops_all_measurements_of_a_sensor_has_a_note(
    tmp_path: Path, delays: tuple[Any, Any], notes: list[str]
) -> None:
    sensors = [
        {"kind": "position", "sigma": 10, "delay": delays[0]},
        {"kind": "position", "sigma": 20, "delay": delays[1]},
    ]
    points = experiment(tmp_path, PLANAR | {"sensor": sensors}).points
    for text, expected in zip(cautions(points), notes, strict=True):
        assert text.startswith(expected)


def test_a_filter_that_drops_all_rows_of_a_recording_has_a_note(tmp_path: Path) -> None:
    """Those of the first sensor, of which the second one is on time."""
    lines = ["time,sensor,x,y,received"]
    for time in range(1, 9):
        lines.append(f"{time},a,{time},0,{time + 1.5}")
        lines.append(f"{time},b,{time},0,{time}")
    keys = recorded(tmp_path, sensors=["a", "b"])
    (tmp_path / "m.csv").write_text("\n".join(lines) + "\n")
    points = experiment(tmp_path, keys, runs=1).points
    assert [text for text in cautions(points) if "drops" in text] == [
        "drop: `late: drop` drops all measurements of sensor 1 (a), as they are at least 2 steps late; "
        "take `refilter` or `apply`"
    ]


def test_training_on_a_recording_needs_a_measurement_that_arrives(tmp_path: Path) -> None:
    keys = recorded(tmp_path)
    lines = [f"{time},{time},0" for time in range(1, 21)]
    (tmp_path / "m.csv").write_text("\n".join(["time,x,y", *lines]) + "\n")
    keys["score"] = {"train": 0.5}
    keys["sensor"] = {"kind": "position", "sigma": 10, "delay": 9}
    experiment(tmp_path, keys, runs=1)
    keys["sensor"]["delay"] = 10
    with pytest.raises(UserError, match="the training ends at step 10"):
        experiment(tmp_path, keys, runs=1)


def test_what_would_arrive_after_the_end_never_arrives(tmp_path: Path) -> None:
    """A constant delay of three steps: the last three measurements are not there in time."""
    sensor = {"kind": "scalar", "sigma": 2.0, "delay": 3}
    data = task_of(experiment(tmp_path, SCALAR | {"sensor": sensor}).points[0], "apply").data
    assert data.arrival is not None
    due = np.arange(40)
    expected = np.where(due < 37, due + 3, 40)
    np.testing.assert_array_equal(data.arrival[0], np.repeat(expected[:, None], RUNS, axis=1))


def test_a_recorded_arrival_that_is_unknown_is_on_time(tmp_path: Path) -> None:
    recorded = np.array([[[2.0], [np.nan], [9.0], [np.nan]]])
    found = arrivals(ScalarSensor(sigma=1.0), recorded, np.zeros((1, 4, 1)), RunStreams(1, [0]))
    assert found is not None
    assert found[0, :, 0].tolist() == [2, 1, 4, 3]


def test_each_sensor_draws_its_delays(tmp_path: Path) -> None:
    sensors = [FAST, {**SLOW, "delay": FAST["delay"]}]
    data = task_of(experiment(tmp_path, PLANAR | {"sensor": sensors}).points[0], "drop").data
    assert data.arrival is not None
    assert 0.05 < (data.arrival[0] == data.arrival[1]).mean() < 0.4


def test_results_rerun_from_their_config_and_count(tmp_path: Path) -> None:
    fault = {"name": "gone", "kind": "bias", "value": [9], "steps": [20, 25]}
    columns = {"late": "mean(arrived_late)", "dropped": "mean(late_dropped)"}
    table = {"kind": "metrics", "columns": columns | {"damage": "mean(damage[gone])"}}
    experiment(tmp_path, SCALAR | {"faults": [fault]}, tables={"t": table}, reference="bound")
    options = {"workers": 1, "quiet": True, "formats": ()}
    report = api.run(tmp_path / "late.yaml", out=tmp_path / "a", **options)
    rows = report.summary.set_index(["filter", "metric"])["value"]
    late = rows["drop", "mean(arrived_late)"]
    assert late == rows["drop", "mean(late_dropped)"] == rows["apply", "mean(arrived_late)"]
    assert rows["refilter", "mean(late_dropped)"] == 0 < rows["three", "mean(late_dropped)"] < late
    api.run(tmp_path / "a" / "config.yaml", out=tmp_path / "b", **options)
    for name in ("summary.csv", "per_run.csv", "points.json", "config.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


QUIET: dict[str, Any] = {"engine": "serial", "quiet": True, "formats": ()}


def test_the_file_of_arrivals_has_the_law_and_what_filters_got(tmp_path: Path) -> None:
    """Chi-square of 1 to 12 steps; each row is a draw of the filters, which count each late one."""
    late = {"kind": "position", "sigma": 10, "delay": {"kind": "uniform", "least": 1, "most": 12}}
    keys: dict[str, Any] = {"runs": 30, "filters": {"Drop": {"kind": "kf", "late": "drop"}}}
    point = experiment(tmp_path, PLANAR | {"last": 200, "sensor": [SLOW, late]}, **keys).points[0]
    folder = api.run(tmp_path / "late.yaml", out=tmp_path / "o", **QUIET).folder
    rows = pd.read_csv(folder / "arrivals.csv")
    assert [*rows] == ["run", "sensor", "step", "arrived"]
    assert [*rows["run"].unique()] == [*range(20)]
    # The last 12 steps are left out, because late measurements of these may never arrive.
    delayed = rows[(rows["sensor"] == 2) & (rows["step"] <= 200 - 12)]
    counts = (delayed["arrived"] - delayed["step"]).value_counts()
    assert [*sorted(counts.index)] == [*range(1, 13)]
    assert chisquare(counts).pvalue > 1e-6
    # Rows are the draws, and only those of measurements that there are.
    data = point.scenario.simulate(RunStreams(0, range(30)), 30)
    assert data.arrival is not None
    first = int(point.scenario.steps[1])
    for (run, sensor), of in rows.groupby(["run", "sensor"]):
        z, arrival = data.measurements[2 * (sensor - 1), :, run], data.arrival[sensor - 1, :, run]
        places = np.flatnonzero(~np.isnan(z))
        np.testing.assert_array_equal(of["step"] - first, places)
        expected = np.where(arrival[places] < len(z), arrival[places] + first, np.nan)
        np.testing.assert_array_equal(of["arrived"], expected)
    # A filter counts them, too.
    per_run = pd.read_csv(folder / "per_run.csv").query("metric == 'arrived_late'")
    number = rows[rows["arrived"] > rows["step"]].groupby("run").size()
    np.testing.assert_array_equal(per_run["value"][:20], number)


def test_arrivals_are_equal_after_a_resumed_run_and_of_shards(tmp_path: Path) -> None:
    keys = {"block": 3, "grid": {"scenario.sensor.delay": [0, 2, {"kind": "uniform", "most": 3}]}}
    experiment(tmp_path, SCALAR, **keys)
    config = tmp_path / "late.yaml"
    once = api.run(config, out=tmp_path / "a", **QUIET, runs=8).folder
    text = (once / "arrivals.csv").read_text()
    assert text.startswith("scenario.sensor.delay,run,sensor,step,arrived\n2,0,1,")
    # These runs have no tables, which `no_report` leaves out; nothing else is missing.
    lines = verify(once, 5) + verify(once, 8)
    assert {line.partition(": ")[2] for line in lines} == {"is not there"}
    assert api.report(once)
    # More runs of kept blocks, then all of them by two shards.
    more = api.run(config, out=once, **QUIET).folder
    rows = [pd.read_csv(StringIO(t)) for t in (text, (more / "arrivals.csv").read_text())]
    pd.testing.assert_frame_equal(rows[0], rows[1].query("run < 8").reset_index(drop=True))
    for shard in ("1/2", "2/2"):
        list(api.run_all([config], out=tmp_path / "b", fresh=True, shard=shard, **QUIET))
    sharded = api.run(config, out=tmp_path / "b", **QUIET).folder
    assert (sharded / "arrivals.csv").read_bytes() == (more / "arrivals.csv").read_bytes()
    assert "arrivals.csv" in read_manifest(sharded)["files"]
    # An edited row is found, by some runs or by all.
    edit(sharded, "arrivals.csv", "\n2,0,1,1,3\n", "\n2,0,1,1,4\n")
    line = "arrivals.csv: 1 row differs from what is computed again; the first is '2,0,1,1,4', it"
    for runs in (5, RUNS):
        assert [found for found in verify(sharded, runs) if found.startswith(line)]
    # Without delays there is no such file, and an older one is removed.
    on_time = ["grid={}", "scenario.sensor.delay=0", "filters={KF: {kind: kf}}"]
    api.run(config, out=sharded, set=on_time, **QUIET)
    assert not (sharded / "arrivals.csv").exists()


def test_arrivals_of_long_runs_are_of_fewer_runs(tmp_path: Path) -> None:
    filters = {"Drop": {"kind": "kf", "late": "drop"}}
    for last, runs in ((40, 6), (4000, 5), (25_000, 1)):
        experiment(tmp_path, SCALAR | {"last": last}, filters=filters, runs=6, per_step=[])
        folder = api.run(tmp_path / "late.yaml", out=tmp_path / "o", **QUIET).folder
        assert pd.read_csv(folder / "arrivals.csv")["run"].nunique() == runs


def test_a_twin_without_the_fault_has_the_same_delays(tmp_path: Path) -> None:
    fault = {"name": "gone", "kind": "blackout", "steps": [20, 25]}
    point = experiment(tmp_path, SCALAR | {"faults": [fault]}).points[0]
    task = task_of(point, "refilter")
    twin = task_without_faults(task)
    assert twin is not None
    assert twin.data.arrival is not None
    np.testing.assert_array_equal(task.data.arrival, twin.data.arrival)


@pytest.mark.parametrize("late", WAYS.values(), ids=WAYS)
def test_a_bias_that_is_known_changes_nothing(tmp_path: Path, late: Any) -> None:
    fault = {"name": "b", "kind": "bias", "value": [50], "steps": [20, 25]}
    filters = {"K": {"kind": "kf", "late": late, "assume": {"faults": "known"}}}
    known = experiment(tmp_path, SCALAR | {"faults": [fault]}, filters=filters).points[0]
    clean = experiment(tmp_path, SCALAR, filters={"K": {"kind": "kf", "late": late}}).points[0]
    expected = output_of(clean, "K")[1].mean
    np.testing.assert_allclose(output_of(known, "K")[1].mean, expected, atol=1e-9)


def test_a_held_out_measurement_never_arrives(tmp_path: Path) -> None:
    point = experiment(tmp_path, SCALAR).points[0]
    for label in ("drop", "apply", "refilter"):
        task = replace(task_of(point, label), hold_out=4, predictive_metrics=("score",))
        output, z = run_filter(task, task.data), task.data.measurements
        visible = np.where(np.arange(1, 41)[:, None] % 4 == 0, np.nan, z)
        without = task.data._replace(measurements=visible)
        expected = run_filter(replace(task, hold_out=None), without)
        np.testing.assert_array_equal(output.mean, expected.mean)
        held = output.diagnostics["error_held_z"][1:]
        np.testing.assert_allclose(held[3::4], z[0, 3::4] - output.mean[0, 4::4], atol=1e-9)


def test_delays_may_be_swept_from_none(tmp_path: Path) -> None:
    grid = {"scenario.sensor.delay": [0, 2, {"kind": "uniform", "most": 3}]}
    points = experiment(tmp_path, SCALAR, grid=grid).points
    rmse = [
        {b: run_block(task_of(p, b)).per_run["rmse"] for b in ("drop", "refilter", "bound")}
        for p in points
    ]
    np.testing.assert_array_equal(rmse[0]["drop"], rmse[0]["bound"])
    np.testing.assert_array_equal(rmse[0]["refilter"], rmse[2]["bound"])
    assert rmse[1]["refilter"].mean() > rmse[1]["bound"].mean()


@pytest.mark.parametrize(
    ("received", "words"),
    [
        (lambda t: 1e3 * t + 300.0, "received: its times are 1e+03 times as far apart as those of"),
        (lambda t: 1e6 * t + 300.0, "write both in one unit, such as seconds"),
        (lambda t: 0.0 * t + 40.0, ""),
        (lambda t: 1.2 * t + 0.3, ""),
    ],
)
def test_times_of_arrival_have_the_unit_of_the_others(
    tmp_path: Path, received: Any, words: str
) -> None:
    """All measurements were taken for late ones, by the whole recording."""
    t = np.arange(40.0)
    rows = [f"{a:g},{b:.9g},{9.0 * a:g},{3.0 * a:g}" for a, b in zip(t, received(t), strict=True)]
    keys = recorded(tmp_path)
    (tmp_path / "m.csv").write_text("\n".join(["time,received,x,y", *rows]) + "\n")
    keys["sensor"] = keys["sensor"][0]
    if not words:
        experiment(tmp_path, keys, runs=1)
        return
    with pytest.raises(UserError, match=re.escape(words)):
        experiment(tmp_path, keys, runs=1)


def test_dates_of_arrival_beside_seconds_are_named(tmp_path: Path) -> None:
    rows = [f"{t},2024-05-03T10:00:{t:02}Z,{9 * t},{3 * t}" for t in range(40)]
    keys = recorded(tmp_path)
    (tmp_path / "m.csv").write_text("\n".join(["time,received,x,y", *rows]) + "\n")
    keys["sensor"] = keys["sensor"][0]
    words = "is not a number, as the other times are: write all times in one form"
    with pytest.raises(UserError, match=words):
        experiment(tmp_path, keys, runs=1)
