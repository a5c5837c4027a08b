"""Faults of sensors against scalar programs of a few lines."""

import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy import stats

from trackbench import api
from trackbench.config.experiment import Experiment
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams
from trackbench.errors import UserError
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.exact_errors import exact_series, why_not_exact
from trackbench.evaluation.run_blocks_side_by_side import run_block, run_stack
from trackbench.execution.block_key import block_key
from trackbench.execution.plan import make_plan
from trackbench.models.sensors.position import ScalarSensor
from trackbench.scenarios.faults import Bias, FaultContext
from trackbench.scenarios.recovery_time import recovery
from trackbench.scenarios.tracking import Tracking

PHI, Q, R, RUNS = 0.95, 1.0, 4.0, 40
BURST = {"name": "burst", "kind": "outliers", "steps": [30, 40], "factor": 50}
SCENARIO = {
    "kind": "tracking",
    "last": 100,
    "target": {"kind": "driven", "motion": {"kind": "ar1", "phi": PHI, "q": Q}},
    "sensor": {"kind": "scalar", "sigma": R**0.5},
    "start": {"kind": "gaussian", "sigma": [1.5]},
}
FILTERS = {"KF": {"kind": "kf"}, "Gated": {"kind": "ekf", "gate": 0.999}}
KNOWN = {"KF": {"kind": "kf"}, "Known": {"kind": "kf", "assume": {"faults": "known"}}}


def experiment(
    folder: Path, *faults: dict[str, Any], filters: dict[str, Any] = FILTERS, **keys: Any
) -> Experiment:
    """Return an experiment with these faults; ``keys`` are those of the scenario."""
    config = {"name": "f", "filters": filters}
    config["scenario"] = SCENARIO | {"faults": list(faults)} | keys
    if "target" not in keys:
        config["runs"] = RUNS
    (folder / "f.yaml").write_text(yaml.safe_dump(config))
    return load(folder / "f.yaml")


def scenario(folder: Path, *faults: dict[str, Any], **keys: Any) -> Tracking:
    """Return the scenario alone."""
    built = experiment(folder, *faults, **keys).points[0].scenario
    assert isinstance(built, Tracking)
    return built


def measured(of: Tracking, runs: int = RUNS) -> tuple[Array, Array]:
    """Return truth and measurements."""
    data = of.simulate(RunStreams(1, range(runs)), runs)
    return data.truth, data.measurements


def result(of: Experiment, label: str) -> BlockResult:
    """Return the result of one block."""
    point = of.points[0]
    assume = point.assumed.get(label)
    task = BlockTask(point.scenario, point.filters[label], 1, 0, RUNS, RUNS, assume=assume)
    return run_block(task)


def kalman(z: Array, limit: float = np.inf, factors: Array | None = None) -> tuple[Array, Array]:
    """Return estimates and refusals of a scalar Kalman filter from N(0, 1.5^2)."""
    x, P, estimates, refused = 0.0, 2.25, [0.0], [False]
    for value, factor in zip(z, np.ones(len(z)) if factors is None else factors, strict=True):
        x, P = PHI * x, PHI * PHI * P + Q
        S = P + R * factor
        out = (value - x) ** 2 / S > limit
        if not (out or np.isnan(value)):
            x, P = x + P / S * (value - x), P - P * P / S
        estimates.append(x)
        refused.append(out)
    return np.array(estimates), np.array(refused)


@pytest.mark.parametrize(("label", "limit"), [("KF", np.inf), ("Gated", 10.827566170662733)])
def test_metrics_are_those_of_a_scalar_program(tmp_path: Path, label: str, limit: float) -> None:
    of = experiment(tmp_path, BURST)
    got = result(of, label).per_run
    faulty = of.points[0].scenario
    truth, z = measured(faulty)
    _, clean = measured(faulty.without_faults)
    for m in range(RUNS):
        estimate, refused = kalman(z[0, :, m], limit)
        twin, _ = kalman(clean[0, :, m], limit)
        error, of_twin = abs(estimate - truth[0, :, m]), abs(twin - truth[0, :, m])
        excess = error - of_twin
        assert got["damage"][m] == pytest.approx(excess.mean(), abs=1e-9)
        assert got["damage[burst]"][m] == pytest.approx(excess[30:41].mean(), abs=1e-9)
        assert got["damage[after burst]"][m] == pytest.approx(excess[41:].mean(), abs=1e-9)
        assert got["rmse[burst]"][m] == pytest.approx((error[30:41] ** 2).mean() ** 0.5, abs=1e-9)
        # Recovered: from step k on, 40 at the earliest, no excess above a tenth of the twin's RMSE.
        small = excess <= 0.1 * (of_twin[41:] ** 2).mean() ** 0.5
        recovered = next((k for k in range(40, 101) if small[k:].all()), None)
        assert got["not_recovered[burst]"][m] == (recovered is None)
        if recovered is not None:
            assert got["recovery_s[burst]"][m] == recovered - 40
        if label == "Gated":
            assert got["rejected_good"][m] == np.delete(refused[1:], slice(29, 40)).mean()
            assert got["accepted_bad"][m] == (~refused[30:41]).mean()


def test_the_burst_shows_and_the_gate_helps(tmp_path: Path) -> None:
    of = experiment(tmp_path, BURST)
    plain, gated = (result(of, label).per_run for label in FILTERS)
    assert plain["damage[burst]"].mean() > 20 * abs(gated["damage[burst]"].mean())
    assert 0 < plain["recovery_s[burst]"].mean() < 60


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"kind": "outliers", "factor": 50}, lambda z, x, t: x + 50 * (z - x)),
        ({"kind": "noise", "factor": 0.5}, lambda z, x, t: x + 0.5 * (z - x)),
        ({"kind": "blackout"}, lambda z, x, t: z * np.nan),
        ({"kind": "bias", "value": {"z": 3}}, lambda z, x, t: z + 3),
        ({"kind": "bias", "value": [3], "ramp": [0.5]}, lambda z, x, t: z + 3 + 0.5 * t),
        ({"kind": "freeze"}, lambda z, x, t: np.broadcast_to(z[:1], z.shape)),
    ],
)
@pytest.mark.parametrize("when", [{"steps": [30, 40]}, {"from": 15.0, "to": 20.0}])
def test_a_fault_changes_the_measurements_of_its_window_alone(
    tmp_path: Path, keys: dict[str, Any], expected: Any, when: dict[str, Any]
) -> None:
    faulty = scenario(tmp_path, {"name": "a", **when, **keys}, T=0.5)
    truth, z = measured(faulty)
    same, clean = measured(faulty.without_faults)
    np.testing.assert_array_equal(truth, same)
    inside = np.zeros(100, dtype=bool)
    inside[29:40] = True
    np.testing.assert_array_equal(z[:, ~inside], clean[:, ~inside])
    # Steps 29 to 40 of the measurements, the first one before the fault.
    t = (np.arange(-1, 11) * 0.5)[:, None]
    changed = expected(clean[0, 28:40], truth[0, 29:41], t)[1:]
    np.testing.assert_allclose(z[0, inside], changed, rtol=1e-12, atol=1e-12)


def test_a_ramp_grows_from_the_given_time_also_between_two_steps(tmp_path: Path) -> None:
    """From 14.8 s on: the first measurement with the fault, at 15 s, has 0.2 s of the ramp."""
    ramp = {"name": "a", "kind": "bias", "ramp": [3.0], "from": 14.8, "to": 20.0}
    of = experiment(tmp_path, ramp, filters=KNOWN, T=0.5)
    faulty = of.points[0].scenario
    assert isinstance(faulty, Tracking)
    (_, z), (_, clean) = measured(faulty), measured(faulty.without_faults)
    times = faulty.times[1:]
    expected = np.where((times > 14.8) & (times < 20.1), 3.0 * (times - 14.8), 0.0)
    np.testing.assert_allclose((z - clean)[0], expected[:, None] + 0.0 * z[0], atol=1e-12)
    np.testing.assert_allclose(result(of, "Known").per_run["damage"], 0.0, atol=1e-9)


@pytest.mark.parametrize(("first", "last"), [(1.01, 1.99), (0.96, 2.04), (1.0, 2.0)])
def test_a_fault_between_two_steps_changes_none_outside_its_times(
    tmp_path: Path, first: float, last: float
) -> None:
    bias = {"name": "a", "kind": "bias", "value": [3], "from": first, "to": last}
    faulty = scenario(tmp_path, bias, T=0.05)
    (_, z), (_, clean) = measured(faulty), measured(faulty.without_faults)
    inside = [first - 1e-9 <= 0.05 * k <= last + 1e-9 for k in range(1, 101)]
    np.testing.assert_array_equal((z != clean)[0, :, 0], inside)


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ({"density": {"kind": "uniform", "region": {"z": [5, 5]}}}, "ends before it begins"),
        ({"density": {"kind": "uniform", "region": {"z": [5, 4]}}}, "ends before it begins"),
        ({"factor": 3, "share": 0}, "a share of 0 changes nothing"),
    ],
)
def test_outliers_that_change_nothing_are_refused(
    tmp_path: Path, keys: dict[str, Any], what: str
) -> None:
    with pytest.raises(UserError, match=what):
        scenario(tmp_path, {"name": "a", "kind": "outliers", **keys})


def test_a_factor_multiplies_the_errors_about_the_sensors_bias(tmp_path: Path) -> None:
    noise = {"name": "a", "kind": "noise", "factor": 3, "steps": [30, 40]}
    faulty = scenario(tmp_path, noise, sensor={"kind": "scalar", "sigma": 2.0, "bias": [5.0]})
    (truth, z), (_, clean) = measured(faulty), measured(faulty.without_faults)
    error = clean[0, 29:40] - truth[0, 30:41]
    assert abs(error.mean() - 5.0) < 5 * 2.0 / error.size**0.5
    expected = truth[0, 30:41] + 5.0 + 3.0 * (error - 5.0)
    np.testing.assert_allclose(z[0, 29:40], expected, rtol=1e-12, atol=1e-12)


def test_drawn_faults_have_streams_of_their_own(tmp_path: Path) -> None:
    half = BURST | {"share": 0.5, "steps": [1, 100]}
    _, z = measured(scenario(tmp_path, half), 400)
    _, few = measured(scenario(tmp_path, half), 10)
    np.testing.assert_array_equal(z[..., :10], few)
    # A fault in front with no draws, and one behind, leave the first one's draws.
    _, clean = measured(scenario(tmp_path), 400)
    number, share = z.size, (z != clean).mean()
    assert abs(share - 0.5) < 4 * 0.5 / number**0.5
    second = half | {"name": "second"}
    _, both = measured(scenario(tmp_path, half, second), 400)
    changed = (both != clean).mean()
    assert abs(changed - 0.75) < 4 * 0.44 / number**0.5


def test_outliers_have_a_density(tmp_path: Path) -> None:
    """Of 40 000 measurements: quantiles of Student's t, moments of the uniform law, a share."""
    law = {"kind": "student-t", "df": 3, "scale": 5}
    fault = {"name": "a", "kind": "outliers", "steps": [1, 100], "density": law}
    truth, z = measured(scenario(tmp_path, fault), 400)
    error = (z - truth[:, 1:]).ravel() / (5.0 * R**0.5)
    assert stats.kstest(error, "t", (3,)).pvalue > 1e-4
    region = {"kind": "uniform", "region": {"z": [-300, 100]}}
    half = fault | {"density": region, "share": 0.5}
    (_, z), (_, clean) = measured(scenario(tmp_path, half), 400), measured(scenario(tmp_path), 400)
    drawn = z[z != clean]
    assert abs(drawn.size / z.size - 0.5) < 4 * 0.5 / z.size**0.5
    assert stats.kstest(drawn, "uniform", (-300, 400)).pvalue > 1e-4
    # A recording without truth has false measurements, too, and gaps stay.
    faulty = scenario(tmp_path, fault | {"density": region}, **recording(tmp_path))
    (_, z), (_, clean) = measured(faulty, 2), measured(faulty.without_faults, 2)
    np.testing.assert_array_equal(np.isnan(z), np.isnan(clean))
    assert (np.abs(z - clean)[~np.isnan(z)] > 0.0).all()


def test_a_fault_is_of_one_sensor_and_begins_with_its_last_value(tmp_path: Path) -> None:
    sensors = [{"kind": "scalar", "sigma": 1.0}, {"kind": "scalar", "sigma": 2.0, "detection": 0.5}]
    faults = [
        {"name": "a", "kind": "freeze", "steps": [50, 60], "sensor": 2},
        {"name": "b", "kind": "bias", "steps": [55, 70], "sensor": 1, "value": [7]},
    ]
    faulty = scenario(tmp_path, *faults, sensor=sensors)
    (_, z), (_, clean) = measured(faulty), measured(faulty.without_faults)
    np.testing.assert_array_equal(z[0, 54:70], clean[0, 54:70] + 7)
    for m in range(RUNS):
        before = clean[1, :49, m]
        last = before[~np.isnan(before)][-1]
        np.testing.assert_array_equal(
            z[1, 49:60, m], np.where(np.isnan(clean[1, 49:60, m]), np.nan, last)
        )
    windows = faulty.windows
    assert [*np.flatnonzero(windows["after a"])] == [*range(71, 101)]  # b lasts longer
    assert [*np.flatnonzero(windows["after b"])] == [*range(71, 101)]


def test_the_time_after_a_fault_ends_with_the_next_one(tmp_path: Path) -> None:
    late = {"name": "late", "kind": "blackout", "from": 60}
    windows = scenario(tmp_path, BURST, late).windows
    assert [*np.flatnonzero(windows["after burst"])] == [*range(41, 60)]
    assert [*np.flatnonzero(windows["late"])] == [*range(60, 101)]
    assert "after late" not in windows


@pytest.mark.parametrize(
    ("keys", "corrected", "factor"),
    [
        ({"kind": "noise", "factor": 3}, lambda z: z, 9.0),
        ({"kind": "outliers", "factor": 50, "share": 0.5}, lambda z: z, 1250.5),
        (
            {"kind": "outliers", "density": {"kind": "student-t", "df": 4, "scale": 5}},
            lambda z: z,
            50,
        ),
        ({"kind": "bias", "value": [30]}, lambda z: z - 30.0, 1.0),
        ({"kind": "blackout"}, lambda z: z, 1.0),
        ({"kind": "freeze"}, lambda z: z * np.nan, 1.0),
    ],
)
def test_a_filter_that_knows_the_fault_has_its_law(
    tmp_path: Path, keys: dict[str, Any], corrected: Any, factor: float
) -> None:
    of = experiment(tmp_path, {"name": "a", "steps": [30, 40], **keys}, filters=KNOWN)
    known, plain = (result(of, label).per_run for label in ("Known", "KF"))
    truth, z = measured(of.points[0].scenario)
    z[:, 29:40] = corrected(z[:, 29:40])
    factors = np.where((np.arange(1, 101) >= 30) & (np.arange(1, 101) <= 40), factor, 1.0)
    for m in range(RUNS):
        error = kalman(z[0, :, m], factors=factors)[0] - truth[0, :, m]
        assert known["rmse"][m] == pytest.approx((error**2).mean() ** 0.5, abs=1e-9)
    # It is not beaten, beyond the error of the paired difference.
    excess = known["rmse"] - plain["rmse"]
    assert excess.mean() <= 3 * excess.std() / RUNS**0.5
    if keys["kind"] == "bias":  # known exactly: no damage at all
        np.testing.assert_allclose(known["damage"], 0.0, atol=1e-9)


def test_the_reference_may_know_the_fault(tmp_path: Path) -> None:
    experiment(tmp_path, BURST, filters=KNOWN)
    config = yaml.safe_load((tmp_path / "f.yaml").read_text()) | {"reference": "Known"}
    (tmp_path / "f.yaml").write_text(yaml.safe_dump(config))
    of = load(tmp_path / "f.yaml")
    plan = make_plan(of)
    (task,) = plan.tasks[0, "KF"]
    distance = run_block(task).per_run["rmsd"]
    seeded = of.points[0].scenario.simulate(RunStreams(of.settings.seed, range(1)), 1)
    z, inside = seeded.measurements[0, :, 0], (np.arange(1, 101) >= 30) & (np.arange(1, 101) <= 40)
    known = kalman(z, factors=np.where(inside, 2500.0, 1.0))[0]
    expected = (np.square(kalman(z)[0] - known).mean()) ** 0.5
    assert distance[0] == pytest.approx(expected, abs=1e-9)
    assert block_key(task, 1) != block_key(replace(task, reference_assume=None), 1)


MEASURED = "run,time,z\n" + "".join(
    f"{m},{t},{2 * t + 0.1 * m}\n" for m in (1, 2) for t in range(9)
)
TRUE = "run,time,x\n" + "".join(
    f"{m},{t},{2 * t}\n" for m in (1, 2) for t in range(9) if m + t != 6
)
TRUTH = {"truth": "t.csv", "truth_gap": 1.5}
NOISY = {"name": "a", "kind": "noise", "from": 4, "to": 6, "factor": 10}


def recording(folder: Path, **keys: Any) -> dict[str, Any]:
    """Return keys of a scenario with two recorded runs; the truth of each lacks a step."""
    (folder / "m.csv").write_text(MEASURED)
    (folder / "t.csv").write_text(TRUE)
    target = {"kind": "measured", "axes": 0, "measurements": "m.csv"} | keys
    start = {"kind": "given", "mean": [0.0], "sigma": [2.0]}
    motion = {"motion": {"kind": "ar1", "phi": 1.0, "q": 4.0}}
    return {"target": target, "start": start, "assume": motion, "last": None}


def test_a_fault_is_put_into_a_recording(tmp_path: Path) -> None:
    faulty = scenario(tmp_path, NOISY, **recording(tmp_path, **TRUTH))
    (_, z), (_, clean) = measured(faulty, 2), measured(faulty.without_faults, 2)
    changed = (z != clean)[0]
    # The errors are 0.1 and 0.2 m; where the truth is unknown the measurement stays.
    times = faulty.times[1:]
    for m, unknown in enumerate((5, 4)):
        inside = (times >= 4) & (times <= 6) & (times != unknown)
        np.testing.assert_array_equal(changed[:, m], inside)
        np.testing.assert_allclose((z - clean)[0, inside, m], 9 * 0.1 * (m + 1), rtol=1e-9)


def test_a_recording_without_truth_has_faults_that_need_none(tmp_path: Path) -> None:
    bias = {"name": "a", "kind": "bias", "steps": [4, 6], "value": [5]}
    faulty = scenario(tmp_path, bias, **recording(tmp_path))
    (_, z), (_, clean) = measured(faulty, 2), measured(faulty.without_faults, 2)
    assert (z - clean).sum() == pytest.approx(2 * 3 * 5)
    point = experiment(tmp_path, bias, **recording(tmp_path)).points[0]
    got = run_block(BlockTask(point.scenario, point.filters["Gated"], 1, 0, 2, 2)).per_run
    assert "damage" not in got
    # The gate is 3.29 sqrt(10.5) = 10.7 m wide on either side: it lets in what is off by 5 m.
    np.testing.assert_array_equal(got["accepted_bad[a]"], 1.0)
    np.testing.assert_array_equal(got["rejected_good"], 0.0)
    with pytest.raises(UserError, match="errors, which are known with a truth only"):
        scenario(tmp_path, NOISY, **recording(tmp_path))


def test_recovery_is_judged_by_the_steps_that_have_a_truth() -> None:
    """Half of the twin's RMSE over three known steps is 0.5: the first run is below from step 4 on."""
    fault = Bias(name="a", steps=(1, 2), value=(9.0,), recovered=0.5)
    steps = np.arange(7)
    context = FaultContext(ScalarSensor(sigma=1.0), steps, 2.0 * steps)
    first = np.array([0.0, 9.0, 9.0, 2.0, 0.45, np.nan, 0.45])
    damage = np.stack([first, np.where(steps == 6, 0.55, first)], axis=1)
    squared = np.square(damage + 1.0)  # the twin's error is one at every step
    values = {"damage": damage, "squared": squared}
    found = recovery(context, [fault], {"after a": steps > 2}, values)
    np.testing.assert_array_equal(found["recovery_s[a]"], [4.0, np.nan])
    np.testing.assert_array_equal(found["not_recovered[a]"], [0.0, 1.0])


def test_a_run_without_a_truth_after_the_fault_has_no_recovery(tmp_path: Path) -> None:
    bias = {"name": "a", "kind": "bias", "steps": [2, 3], "value": [40]}
    keys = recording(tmp_path, **TRUTH)
    rows = TRUE.splitlines(keepends=True)
    early = [row for row in rows[1:] if row.startswith("2") or int(row.split(",")[1]) <= 2]
    (tmp_path / "t.csv").write_text(rows[0] + "".join(early))
    point = experiment(tmp_path, bias, filters={"KF": {"kind": "kf"}}, **keys).points[0]
    got = run_block(BlockTask(point.scenario, point.filters["KF"], 1, 0, 2, 2)).per_run
    for name in ("recovery_s[a]", "not_recovered[a]"):
        assert np.isnan(got[name][0])
    assert np.isfinite(got["not_recovered[a]"][1])


def one(lines: list[str], word: str) -> str:
    """The line on a word."""
    (line,) = (line for line in lines if f"'{word}'" in line)
    return line


def test_a_fault_without_steps_after_it_is_told_so(tmp_path: Path) -> None:
    """Fault b covers all from a's end to c, so that neither errors after a nor its recovery exist."""
    first = {"name": "a", "kind": "bias", "from": 20.5, "to": 30, "value": [4]}
    second = {"name": "b", "kind": "noise", "from": 25, "to": 50, "factor": 3}
    third = {"name": "c", "kind": "noise", "from": 45, "to": 60, "factor": 3}
    experiment(tmp_path, first, second, third)
    config = yaml.safe_load((tmp_path / "f.yaml").read_text())
    words = ("rmse[after a]", "recovery_s[a]", "rmse[after bb]")
    columns = {word: f"mean({word})" for word in words}
    config["tables"] = {"t": {"kind": "metrics", "columns": columns}}
    (tmp_path / "f.yaml").write_text(yaml.safe_dump(config))
    with pytest.raises(UserError) as caught:
        load(tmp_path / "f.yaml")
    lines = str(caught.value).splitlines()
    after, recovery_of, misspelt = (one(lines, word) for word in words)
    for line in (after, recovery_of):
        assert "no scored step after the fault a and before the next one is without a fault" in line
    assert "did you mean rmse[after b]?" in misspelt


def test_training_has_the_faults_before_its_end(tmp_path: Path) -> None:
    late = NOISY | {"name": "late", "from": 7, "to": 8}
    keys = recording(tmp_path, **TRUTH) | {"score": {"train": 0.6}}
    training = scenario(tmp_path, NOISY, late, **keys).training
    assert isinstance(training, Tracking)
    assert [fault.name for fault in training.faults] == ["a"]


def test_results_have_the_metrics_and_rerun_from_their_config(tmp_path: Path) -> None:
    built = experiment(tmp_path, BURST, {"name": "late", "kind": "blackout", "from": 60})
    assert built.settings.runs == RUNS
    config = yaml.safe_load((tmp_path / "f.yaml").read_text())
    config["tables"] = {"t": {"kind": "metrics", "columns": {"D": "mean(damage[after burst])"}}}
    config["figures"] = {"f": {"kind": "rmse-vs-time", "metric": "damage", "x": "time"}}
    (tmp_path / "f.yaml").write_text(yaml.safe_dump(config))
    options = {"workers": 1, "quiet": True}
    report = api.run(tmp_path / "f.yaml", out=tmp_path / "a", formats=("svg",), **options)
    rows = report.summary.set_index(["filter", "metric"])["value"]
    assert rows["KF", "mean(damage[burst])"] > rows["Gated", "mean(damage[burst])"]
    assert 0 < rows["Gated", "mean(accepted_bad)"] < 1
    figure = (tmp_path / "a" / "figures" / "f.svg").read_text()
    assert "burst" in figure
    assert "late" in figure
    api.run(tmp_path / "a" / "config.yaml", out=tmp_path / "b", formats=(), **options)
    for name in ("summary.csv", "per_run.csv", "points.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@pytest.mark.parametrize(
    "keys", [{"kind": "noise", "factor": 3}, {"kind": "bias", "value": [4], "ramp": [0.5]}]
)
def test_exact_errors_are_those_of_the_covariance_recursion(
    tmp_path: Path, keys: dict[str, Any]
) -> None:
    point = experiment(tmp_path, {"name": "a", "steps": [30, 40], **keys}, filters=KNOWN).points[0]
    exact = exact_series(BlockTask(point.scenario, point.filters["KF"], 1, 0, 1, 1))["squared"]
    # Mean and variance of the error of a filter with the gain of P.
    mean, variance, P, expected = 0.0, 2.25, 2.25, [2.25]
    for k in range(1, 101):
        inside = 30 <= k <= 40
        factor = keys.get("factor", 1.0) if inside else 1.0
        bias = 4 + 0.5 * (k - 30) if inside and keys["kind"] == "bias" else 0.0
        P, variance, mean = PHI**2 * P + Q, PHI**2 * variance + Q, PHI * mean
        K = P / (P + R)
        P, mean = (1 - K) * P, (1 - K) * mean + K * bias
        variance = (1 - K) ** 2 * variance + K**2 * R * factor**2
        expected.append(mean**2 + variance)
    np.testing.assert_allclose(exact, expected, rtol=1e-9)


def test_exact_errors_of_a_drawn_fault_are_refused(tmp_path: Path) -> None:
    point = experiment(tmp_path, BURST | {"share": 0.5}).points[0]
    task = BlockTask(point.scenario, point.filters["KF"], 1, 0, 1, 1)
    assert "draws more than normal noise" in str(why_not_exact(task))


def test_stacked_blocks_have_the_twins_of_each(tmp_path: Path) -> None:
    point = experiment(tmp_path, BURST).points[0]
    tasks = [BlockTask(point.scenario, point.filters["Gated"], 1, i, 10, 10) for i in range(3)]
    for task, stacked in zip(tasks, run_stack(tasks), strict=True):
        alone = run_block(task).per_run
        for name, values in stacked[10].per_run.items():
            np.testing.assert_array_equal(values, alone[name])


TWO = """name: two
runs: 3
scenario:
  kind: tracking
  last: 40
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 10, vx: 1}}
  sensor: [{kind: position, sigma: 2, period: 5}, {kind: position, sigma: 3}]
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
  faults: FAULTS
filters:
  EKF: {kind: ekf}
"""


def _errors(tmp_path: Path, *faults: str) -> Array:
    """The measurements less those without faults (n_z, T, M), over the errors without faults."""
    z = []
    for listed in ((), faults):
        text = TWO.replace("FAULTS", f"[{', '.join(listed)}]")
        (tmp_path / "two.yaml").write_text(text)
        scenario = load(tmp_path / "two.yaml").points[0].scenario
        data = scenario.simulate(RunStreams(1, range(3)), 3)
        z.append(data.measurements)
    truth = np.tile(data.truth[::2, 1:], (2, 1, 1))
    return (z[1] - truth) / (z[0] - truth)


def test_a_fault_in_which_its_sensor_measures_nothing_is_a_mistake(tmp_path: Path) -> None:
    """Sensor 1 measures at steps 5, 10, 15 and so on."""
    for steps, is_idle in (([6, 9], True), ([6, 10], False)):
        fault = f"[{{name: B, kind: bias, sensor: 1, value: {{x: 9}}, steps: {steps}}}]"
        (tmp_path / "two.yaml").write_text(TWO.replace("FAULTS", fault))
        if not is_idle:
            load(tmp_path / "two.yaml")
            continue
        with pytest.raises(UserError, match="the sensor measures at no step of it"):
            load(tmp_path / "two.yaml")


NOISE = "{name: N, kind: noise, factor: 10, steps: [10, 30]}"
WITHIN = "{name: W, kind: noise, factor: 3, steps: [20, 25]}"
SHARED = "{name: B, kind: outliers, factor: 7, share: 0.5, steps: [5, 9]}"


def test_a_sensor_has_the_fault_also_while_another_is_silent(tmp_path: Path) -> None:
    factors = _errors(tmp_path, NOISE)
    np.testing.assert_allclose(factors[2:, 9:30], 10.0)
    np.testing.assert_allclose(factors[2:, 30:], 1.0)
    assert np.isnan(factors[:2]).sum() == 2 * 32 * 3


def test_faults_that_multiply_errors_multiply_each_other(tmp_path: Path) -> None:
    factors = _errors(tmp_path, NOISE, WITHIN)
    np.testing.assert_allclose(factors[2:, 19:25], 30.0)
    np.testing.assert_allclose(factors[2:, 25:30], 10.0)


def test_the_order_of_the_list_does_not_matter(tmp_path: Path) -> None:
    first, other = (_errors(tmp_path, *which) for which in ((SHARED, NOISE), (NOISE, SHARED)))
    np.testing.assert_array_equal(first, other)
    assert {*np.round(first[2:, 4:9].ravel(), 6)} == {1.0, 7.0}


def test_filters_that_need_the_kind_of_sensor_say_so(tmp_path: Path) -> None:
    text = TWO.replace("FAULTS", f"[{NOISE}]").replace("{kind: ekf}", "{kind: los-rbpf}")
    text = text.replace("los-rbpf}", "los-rbpf, assume: {faults: known}}")
    radar = "{kind: range-azimuth, sigma_range: 9, sigma_azimuth_mrad: 3}"
    text = text.replace(text[text.index("[{kind: position") : text.index("\n  start")], radar)
    text = text.replace("{kind: gaussian, sigma: [2, 1, 2, 1]}", "two-scan")
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(UserError, match="radar of constant noise"):
        load(tmp_path / "c.yaml")
    (tmp_path / "c.yaml").write_text(text.replace("los-rbpf", "cmkf"))
    with pytest.raises(UserError, match="`cmkf` cannot know a fault that multiplies noise"):
        load(tmp_path / "c.yaml")
    (tmp_path / "c.yaml").write_text(text.replace("los-rbpf", "gaussian-sum"))
    assert api.run(tmp_path / "c.yaml", out=tmp_path / "out", quiet=True, formats=()).failed == []


def test_a_fault_of_one_time_has_one_measurement(tmp_path: Path) -> None:
    faulty = scenario(tmp_path, {"name": "a", "kind": "bias", "from": 30, "to": 30, "value": [9]})
    _, z = measured(faulty)
    _, clean = measured(faulty.without_faults)
    changed = np.zeros(100)
    changed[29] = 9.0
    np.testing.assert_allclose((z - clean)[0], np.tile(changed[:, None], (1, RUNS)), atol=1e-12)
    with pytest.raises(UserError, match="ends at 29 s, and begins at 30 s; take a later end"):
        scenario(tmp_path, {"name": "a", "kind": "bias", "from": 30, "to": 29, "value": [9]})


OFF = {"name": "off", "kind": "bias", "steps": [20, 50], "value": [100]}
STUCK = {"name": "stuck", "kind": "freeze", "steps": [20, 50]}
WILD = {"name": "wild", "kind": "outliers", "steps": [30, 40], "factor": 10}


def test_later_faults_multiply_the_errors_of_earlier_ones(tmp_path: Path) -> None:
    """Errors e of a bias become 10 (e + 100); of a frozen value ten times its distance."""
    for first, error_before in (
        (OFF, lambda z, x: z[29:40] - x[30:41] + 100.0),
        (STUCK, lambda z, x: z[18:19] - x[30:41]),
    ):
        faulty = scenario(tmp_path, first, WILD)
        truth, z = measured(faulty)
        _, clean = measured(faulty.without_faults)
        error = z[0, 29:40] - truth[0, 30:41]
        np.testing.assert_allclose(error, 10.0 * error_before(clean[0], truth[0]), rtol=1e-9)
    # A bias that begins later is added to the larger errors.
    late = OFF | {"steps": [35, 50]}
    truth, z = measured(scenario(tmp_path, late, WILD))
    _, clean = measured(scenario(tmp_path))
    error, before = z[0, 34:40] - truth[0, 35:41], clean[0, 34:40] - truth[0, 35:41]
    np.testing.assert_allclose(error, 10.0 * before + 100.0, rtol=1e-9, atol=1e-9)


def test_a_filter_knows_a_bias_that_a_later_fault_multiplies(tmp_path: Path) -> None:
    """It has the errors of a filter that knows the larger noise without any bias."""
    found = []
    for faults in ((OFF, WILD), (WILD,)):
        of = experiment(tmp_path, *faults, filters=KNOWN)
        found.append(result(of, "Known").per_run["rmse"])
    np.testing.assert_allclose(*found, rtol=1e-9)
    some = WILD | {"share": 0.5}
    with pytest.raises(UserError, match="multiplies the bias of 'off' by a random factor"):
        experiment(tmp_path, OFF, some, filters=KNOWN)


def test_a_filter_that_knows_overlapping_faults_keeps_their_measurements(tmp_path: Path) -> None:
    """Where a later fault multiplies some of the larger errors, it has the product of both variances."""
    larger = {"name": "larger", "kind": "noise", "steps": [20, 35], "factor": 3}
    of = experiment(tmp_path, larger, WILD | {"share": 0.5}, filters=KNOWN)
    known = result(of, "Known").per_run["rmse"]
    truth, z = measured(of.points[0].scenario)
    factors = np.ones(100)
    factors[19:35] *= 9.0
    factors[29:40] *= 50.5  # half of the errors are ten times as large
    for m in range(RUNS):
        error = kalman(z[0, :, m], factors=factors)[0] - truth[0, :, m]
        assert known[m] == pytest.approx((error**2).mean() ** 0.5, abs=1e-9)


def test_a_sensor_freezes_after_its_first_measurement(tmp_path: Path) -> None:
    for when in ({"steps": [1, 30]}, {"from": 0, "to": 30}, {"to": 30}):
        with pytest.raises(UserError, match="no measurement is before this fault"):
            scenario(tmp_path, {"name": "a", "kind": "freeze", **when})
    scenario(tmp_path, {"name": "a", "kind": "freeze", "steps": [2, 30]})
    # A recorded sensor may begin later than its recording.
    sensors = [{"kind": "scalar", "sigma": 2}, {"kind": "scalar", "sigma": 2}]
    rows = [f"{t},{t},{t if t > 5 else ''}" for t in range(10)]
    (tmp_path / "two.csv").write_text("\n".join(["time,1.z,2.z", *rows, ""]))
    keys = recording(tmp_path) | {"sensor": sensors}
    keys["target"] |= {"measurements": "two.csv"}
    fault = {"name": "a", "kind": "freeze", "from": 4, "to": 8}
    scenario(tmp_path, fault | {"sensor": 1}, **keys).simulate(RunStreams(1, range(1)), 1)
    late = scenario(tmp_path, fault | {"sensor": 2}, **keys)
    with pytest.raises(ValueError, match="freezes `z` before its first measurement"):
        late.simulate(RunStreams(1, range(1)), 1)


def test_faults_whose_names_have_one_crc_have_other_draws(tmp_path: Path) -> None:
    """Of two sensors both are bad in 9 % of the steps, as of any other names."""
    names = "plumless", "buckeroo"
    assert len({zlib.crc32(name.encode()) for name in names}) == 1
    half = {"kind": "outliers", "steps": [1, 100], "factor": 50, "share": 0.3}
    sensors = [{"kind": "scalar", "sigma": 2}, {"kind": "scalar", "sigma": 2}]
    changed = {}
    for pair in (names, ("first", "second")):
        faults = [{"name": n, "sensor": i, **half} for i, n in enumerate(pair, 1)]
        faulty = scenario(tmp_path, *faults, sensor=sensors)
        _, z = measured(faulty, 200)
        _, clean = measured(faulty.without_faults, 200)
        changed[pair] = z != clean
        both = changed[pair].all(axis=0).mean()
        assert both == pytest.approx(0.09, abs=5 * (0.09 * 0.91 / clean[0].size) ** 0.5)
    # The fault that is listed first has the draws that it has alone.
    alone = scenario(tmp_path, {"name": "plumless", "sensor": 1, **half}, sensor=sensors)
    np.testing.assert_array_equal(measured(alone, 200)[1][0] != clean[0], changed[names][0])
