"""Known inputs of a motion, from a recording: every filter gets those of the file, at the right step."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

from trackbench import api
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.errors import UserError
from trackbench.models.inputs import KnownInputs
from trackbench.models.motions.map_or_ode import MapMotion, OdeMotion
from trackbench.models.numerical_derivatives import central_differences

pytestmark = pytest.mark.usefixtures("no_report")

Q = 0.04
R = 0.25
START = (1.0, 4.0)
"""Mean and variance of the first state."""
CONFIG = """
name: cart
seed: 1
scenario:
  kind: tracking
  target:
    kind: measured
    measurements: log.csv
    input: {v: speed}
    state: [x]
    axes: 0
    MORE: 0
  sensor: {kind: function, h: {z: x}, R: 0.25}
  start: {kind: given, mean: [1], sigma: [2]}
  assume: {motion: {kind: map, components: [x], input: [v], next: {x: x + v*T}, Q: 0.04*T}}
filters:
  KF: {kind: kf}
metrics: [nis]
tables: {t: {kind: metrics, columns: {NIS: mean(nis)}}}
"""
LOG = """time,speed,z
1,2,3.1
2,3,5.9
3,-1,
4,0.5,5.8
6,1,7.7
7,2,10.2
"""
"""The interval before 6 s is longer than usual, which the config allows by `input_gap`."""


def estimates(folder: Path, text: str, files: dict[str, str]) -> dict[str, Array]:
    """Run a config, and return the mean (T + 1,) of each filter."""
    for name, content in files.items():
        (folder / name).write_text(content)
    config = folder / "cart.yaml"
    config.write_text(text)
    out = api.run(
        config, out=folder / "out", workers=1, quiet=True, formats=(), save_tracks=True,
        allow_plugins=True,
    ).folder  # fmt: skip
    with np.load(out / "tracks.npz") as tracks:
        labels = [name for name in tracks.files if name.startswith("mean/")]
        return {name.removeprefix("mean/"): tracks[name][0, :, 0] for name in labels}


def scalar_filter(log: str, first_interval: float = 1.0) -> list[float]:
    """A Kalman filter of one component, which reads the log itself."""
    rows = list(csv.DictReader(log.splitlines()))
    before = float(rows[0]["time"]) - first_interval
    if not rows[0]["z"]:  # the first state is that at the first row
        before = float(rows.pop(0)["time"])
    x, P = START
    means = [x]
    for row in rows:
        T = float(row["time"]) - before
        before = float(row["time"])
        x += float(row["speed"]) * T
        P += Q * T
        if row["z"]:
            K = P / (P + R)
            x += K * (float(row["z"]) - x)
            P *= 1.0 - K
        means.append(x)
    return means


def with_keys(*keys: str) -> str:
    """Return the config with further lines of the target."""
    return CONFIG.replace("    MORE: 0\n", "".join(f"    {key}\n" for key in keys))


def test_a_prediction_with_inputs_is_exact(tmp_path: Path) -> None:
    means = estimates(tmp_path, with_keys("input_gap: 2"), {"log.csv": LOG})
    np.testing.assert_allclose(means["KF"], scalar_filter(LOG), rtol=1e-12)


def test_without_measurements_the_position_is_the_sum_of_the_inputs(tmp_path: Path) -> None:
    log = "time,speed,z\n" + "".join(f"{k},{k},{3.0 if k == 9 else ''}\n" for k in range(1, 10))
    means = estimates(tmp_path, with_keys(), {"log.csv": log})
    # The first row has no measurement, and the first state is that at its time.
    expected = 1.0 + np.cumsum([0.0, *np.arange(2.0, 9.0)])
    np.testing.assert_allclose(means["KF"][:-1], expected, rtol=1e-14)


PLUGIN = '''
from trackbench.adapters import PerRun
import numpy as np

class Scalar(PerRun, kind="scalar"):
    """A Kalman filter of one component."""

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        self.x = self.x + self.inputs["v"] * dt
        assert np.allclose(self.functions.F(self.x), 1.0)
        self.P = self.P + 0.04 * dt
        if z is not None:
            K = self.P / (self.P + 0.25)
            self.x = self.x + K[0] * (z - self.x)
            self.P = self.P * (1.0 - K)
        return self.x, self.P


class Functions(PerRun, kind="by-functions"):
    """The same by the functions of the model."""

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        self.P = self.P + self.functions.Q(self.x)
        self.x = self.functions.f(self.x)
        if z is not None:
            K = self.P / (self.P + self.functions.R(self.x))
            self.x = self.x + K[0] * (z - self.x)
            self.P = self.P * (1.0 - K)
        return self.x, self.P
'''
PROGRAM = """
import json, math, sys

for line in sys.stdin:
    word, *fields = line.split()
    if word == "trackbench":
        facts = json.loads(line.split(maxsplit=2)[2])
        assert facts["input"] == ["v"], facts
        print("ready", flush=True)
    elif word == "init":
        before, x, P = map(float, fields[1:])
        print(x, P, flush=True)
    elif word == "step":
        time, z, v = map(float, fields)
        x, P = x + v * (time - before), P + 0.04 * (time - before)
        before = time
        if not math.isnan(z):
            K = P / (P + 0.25)
            x, P = x + K * (z - x), P * (1.0 - K)
        print(repr(x), repr(P), flush=True)
    else:
        break
"""


def test_every_sort_of_filter_gets_the_same_inputs(tmp_path: Path) -> None:
    """EKF, UKF, a smoother's filter, an IMM of equal motions, a filter of one run, and a program."""
    motion = "{kind: map, components: [x], input: [v], next: {x: x + v*T}, Q: 0.04*T}"
    filters = f"""
  EKF: {{kind: ekf}}
  UKF: {{kind: ukf, form: square-root}}
  IMM: {{kind: imm, motions: [{motion}, {motion}], transition: [[0.9, 0.1], [0.1, 0.9]]}}
  Scalar: {{kind: scalar}}
  Functions: {{kind: by-functions}}
  Program: {{kind: external, command: [{sys.executable}, program.py]}}
"""
    text = with_keys("input_gap: 2").replace("  KF: {kind: kf}", "  KF: {kind: kf}" + filters)
    text = text.replace("seed: 1", "seed: 1\nplugins: [own.py]")
    files = {"log.csv": LOG, "own.py": PLUGIN, "program.py": PROGRAM}
    means = estimates(tmp_path, text, files)
    assert len(means) == 7
    for mean in means.values():
        np.testing.assert_allclose(mean, scalar_filter(LOG), rtol=1e-9)


MOTIONS_OF_TWO_INPUTS = """
  IMM:
    kind: imm
    transition: [[0.9, 0.1], [0.1, 0.9]]
    motions:
      - {kind: map, components: [x], input: [v, w], next: {x: x + (v + w)*T}, Q: 0.04*T}
      - {kind: map, components: [x], input: [w, v], next: {x: x + (v + w)*T}, Q: 0.04*T}
"""


@pytest.mark.parametrize("assumed", ["", "input: [v], "])
def test_an_imm_has_inputs_that_the_assumed_motion_lacks(tmp_path: Path, assumed: str) -> None:
    """At equal steps too, where the assumed motion may be linear, without any input."""
    log = "time,speed,z\n" + "".join(f"{k},{k},{1 + k}\n" for k in range(1, 6))
    split = "time,half,rest,z\n"
    split += "".join(f"{k},{0.25 * k},{0.75 * k},{1 + k}\n" for k in range(1, 6))
    expression = "x + v*T" if assumed else "x"
    text = with_keys().replace("{v: speed}", "{v: half, w: rest}")
    text = text.replace("input: [v], next: {x: x + v*T}", f"{assumed}next: {{x: {expression}}}")
    text = text.replace("  KF: {kind: kf}\n", MOTIONS_OF_TWO_INPUTS.lstrip("\n"))
    means = estimates(tmp_path, text, {"log.csv": split})
    np.testing.assert_allclose(means["IMM"], scalar_filter(log), rtol=1e-9)


@pytest.mark.parametrize("fourth", ["4", "4.1"])
def test_an_imm_with_an_unknown_input_is_a_mistake(tmp_path: Path, fourth: str) -> None:
    """At equal steps and at others."""
    log = f"time,speed,z\n1,1,1\n2,1,2\n3,1,3\n{fourth},1,4\n5,1,5\n"
    (tmp_path / "log.csv").write_text(log)
    config = tmp_path / "cart.yaml"
    filters = MOTIONS_OF_TWO_INPUTS.lstrip("\n")
    config.write_text(with_keys().replace("  KF: {kind: kf}\n", filters))
    with pytest.raises(UserError, match=r"motions\.0\.input: .*`input` has no 'w'; known: v"):
        load(config)


def test_last_cuts_the_inputs_too(tmp_path: Path) -> None:
    """A gap after the last step is no mistake."""
    text = with_keys().replace("  T: 1", "").replace("kind: tracking", "kind: tracking\n  last: 4")
    means = estimates(tmp_path, text, {"log.csv": LOG})
    np.testing.assert_allclose(means["KF"], scalar_filter(LOG)[:5], rtol=1e-12)


def test_a_row_may_hold_until_the_next_one(tmp_path: Path) -> None:
    """The first value holds before its row, too, as there is none earlier."""
    means = estimates(tmp_path, with_keys("input_gap: 2", "input_holds: after"), {"log.csv": LOG})
    held = LOG
    for before, after in (("2,3,", "2,2,"), ("3,-1", "3,3"), ("4,0.5", "4,-1"), ("6,1,", "6,0.5,"),
                          ("7,2,", "7,1,")):  # fmt: skip
        held = held.replace(f"\n{before}", f"\n{after}")
    np.testing.assert_allclose(means["KF"], scalar_filter(held), rtol=1e-12)


def test_inputs_of_a_file_of_their_own_make_steps(tmp_path: Path) -> None:
    """The wheels measure four times a second, the position once, and each at times of its own."""
    times = np.arange(0.25, 4.3, 0.25)
    speeds = np.round(np.sin(times), 3)
    odometry = "time,speed\n" + "".join(f"{t},{v}\n" for t, v in zip(times, speeds, strict=True))
    positions = {1.1: 2.0, 2.1: 2.5, 3.1: 3.5}
    log = "time,z\n" + "".join(f"{t},{z}\n" for t, z in positions.items())
    files = {"log.csv": log, "wheels.csv": odometry}
    means = estimates(tmp_path, with_keys("input_file: wheels.csv"), files)
    merged = "time,speed,z\n"
    for time in sorted([*times, *positions]):
        speed = speeds[np.searchsorted(times, time)]
        merged += f"{time},{speed},{positions.get(time, '')}\n"
    np.testing.assert_allclose(means["KF"], scalar_filter(merged, 0.25), rtol=1e-12)


def test_a_file_of_inputs_has_names_and_units_of_its_own(tmp_path: Path) -> None:
    """Numbers of the log's clock are seconds, those of the wheels milliseconds."""
    rows = list(csv.DictReader(LOG.splitlines()))
    wheels = "stamp;kmh\n"
    log = "time,z\n"
    for row in rows:
        wheels += f"{1000 * int(row['time'])};{3.6 * float(row['speed'])!r}\n"
        if row["z"]:
            log += f"{row['time']},{row['z']}\n"
    naming = (
        "input_naming: {columns: {time: stamp}, units: {time: ms, v: km/h}, format: {separator: ;}}"
    )
    text = with_keys("input_file: wheels.csv", "input_gap: 2", naming)
    text = text.replace("{v: speed}", "{v: kmh}")
    means = estimates(tmp_path, text, {"log.csv": log, "wheels.csv": wheels})
    np.testing.assert_allclose(means["KF"], scalar_filter(LOG), rtol=1e-12)


def test_longer_steps_have_the_mean_of_their_inputs(tmp_path: Path) -> None:
    log = "time,speed,z\n" + "".join(f"{k},{k},{5.0 if k == 6 else ''}\n" for k in range(1, 7))
    means = estimates(tmp_path, with_keys("resample: 2"), {"log.csv": log})
    # Steps from 1 to 3, 5 and 7 s: the first state is that at the first row, without a measurement.
    np.testing.assert_allclose(np.diff(means["KF"][:2]), [2 + 3], rtol=1e-12)


def test_inputs_have_units(tmp_path: Path) -> None:
    log = LOG.replace("speed", "kmh")
    rows = [line.split(",") for line in log.splitlines()[1:]]
    log = "time,kmh,z\n" + "".join(f"{t},{3.6 * float(v)!r},{z}\n" for t, v, z in rows)
    text = with_keys("input_gap: 2", "units: {v: km/h}").replace("{v: speed}", "{v: kmh}")
    means = estimates(tmp_path, text, {"log.csv": log})
    np.testing.assert_allclose(means["KF"], scalar_filter(LOG), rtol=1e-12)


def test_each_of_several_runs_has_its_own_inputs_as_a_value_of_a_grid(tmp_path: Path) -> None:
    log = "run,time,speed,z\n"
    log += "".join(f"a,{k},1,{k}\n" for k in range(1, 6))
    log += "".join(f"b,{k},2,{2 * k}\n" for k in range(1, 6))
    (tmp_path / "log.csv").write_text(log)
    config = tmp_path / "cart.yaml"
    config.write_text(with_keys())
    with pytest.raises(UserError, match=r"runs a and b have different inputs.*runs: \[a\]"):
        load(config)
    config.write_text(with_keys() + "grid: {scenario.target.runs: [[a], [b]]}\n")
    values = [
        point.scenario.model.motion.known_inputs.values[0, 1] for point in load(config).points
    ]
    assert values == [1.0, 2.0]


@pytest.mark.parametrize("kind", ["map", "ode"])
def test_derivatives_hold_the_inputs_fixed(kind: str) -> None:
    equations = {"x": "x + v*T*cos(h)", "h": "h + w*T"}
    if kind == "map":
        motion = MapMotion(components=("x", "h"), input=("v", "w"), next=equations, Q=0.1)
    else:
        rates = {"x": "v*cos(h)", "h": "w"}
        motion = OdeMotion(components=("x", "h"), input=("v", "w"), derivative=rates, Q=0.1)
    values = np.array([[np.nan, 2.0], [np.nan, 0.3]])
    known = KnownInputs(names=("v", "w"), first=0, values=values)
    sampled = motion.sampled(0.5).with_inputs(known)
    x = np.array([[1.0, -2.0], [0.4, 2.0]])
    J = central_differences(lambda states: sampled.transition(states, 1).mean, x)
    np.testing.assert_allclose(sampled.jacobian(x, 1), J, atol=1e-8)
    assert sampled.jacobian(x, 1)[0, 1, 0] < -0.3  # v T sin(h): the speed counts


SHIP = """
name: ship
seed: 1
scenario:
  kind: tracking
  target:
    kind: measured
    measurements: log.csv
    input: {v: through_water, w: gyro}
    units: {v: kn, w: deg/s}
    state: [px, py, heading, cx, cy]
    angles: [heading]
  sensor: {kind: function, h: {x: px, y: py}, R: 25}
  start: {kind: given, mean: [0, 0, 0, 0, 0], sigma: [5, 5, 0.1, 2, 2]}
  assume:
    motion:
      kind: map
      components: [px, py, heading, cx, cy]
      input: [v, w]
      next:
        px: px + (v*cos(heading) + cx)*T
        py: py + (v*sin(heading) + cy)*T
        heading: heading + w*T
        cx: cx
        cy: cy
      Q: {px: 0.01, py: 0.01, heading: 1e-6}
filters:
  EKF: {kind: ekf}
  Without log:
    kind: ekf
    assume:
      motion:
        kind: map
        components: [px, py, heading, cx, cy]
        next: {px: px + cx*T, py: py + cy*T, heading: heading, cx: cx, cy: cy}
        Q: {px: 1, py: 1, cx: 0.1, cy: 0.1}
metrics: [nis]
tables: {t: {kind: metrics, columns: {NIS: mean(nis)}}}
"""


def test_a_ship_finds_the_current_and_another_filter_does_without_inputs(tmp_path: Path) -> None:
    """5 m/s through the water on a circle, in a current of 1 m/s to the north."""
    rng = np.random.default_rng(3)
    turn_rate = np.deg2rad(1.0)
    position, heading = np.zeros(2), 0.0
    log = "time,through_water,gyro,x,y\n"
    for k in range(1, 361):
        position = position + np.array([5.0 * np.cos(heading), 5.0 * np.sin(heading) + 1.0])
        heading += turn_rate
        x, y = position + 5.0 * rng.standard_normal(2)
        log += f"{k},{5.0 * 3600 / 1852!r},1,{x:.2f},{y:.2f}\n"
    (tmp_path / "log.csv").write_text(log)
    (tmp_path / "ship.yaml").write_text(SHIP)
    out = api.run(
        tmp_path / "ship.yaml", out=tmp_path / "out", workers=1, quiet=True, formats=(),
        save_tracks=True,
    ).folder  # fmt: skip
    with np.load(out / "tracks.npz") as tracks:
        current = tracks["mean/EKF"][3:, -1, 0]
        other = tracks["mean/Without log"][:2, -1, 0]
    # 360 positions of 5 m over 360 s tell a constant current to some centimeters a second.
    np.testing.assert_allclose(current, [0.0, 1.0], atol=0.1)
    assert np.abs(other - position).max() < 25.0


HEADED = """
name: headed
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: log.csv, state: [px, py], input: {v: speed, h: yaw}, MORE: 0}
  sensor: {kind: function, h: {x: px, y: py}, R: 4}
  start: {kind: given, mean: [0, 0], sigma: [2, 2]}
  assume:
    motion:
      kind: map
      components: [px, py]
      input: [v, h]
      next: {px: px + v*T*cos(h), py: py + v*T*sin(h)}
      Q: [0.01, 0.01]
filters:
  KF: {kind: ekf}
metrics: [nis]
tables: {t: {kind: metrics, columns: {NIS: mean(nis)}}}
"""


@pytest.mark.parametrize("unit", ["deg", "rad", ""])
@pytest.mark.parametrize("around", [0.0, 180.0])
@pytest.mark.parametrize("way", ["resample: 1", "same_time: mean"])
def test_a_heading_among_the_inputs_is_averaged_over_the_shorter_way(
    tmp_path: Path, unit: str, around: float, way: str
) -> None:
    """A compass around north jumps from 360 to 0 deg, and one around south from 180 to -180 deg."""
    rng = np.random.default_rng(8)
    yaw = around + np.cumsum(rng.choice([-6.0, 5.0], 60)) / 2.0
    jumping = yaw % 360.0
    if around == 180.0:
        jumping = (yaw + 180.0) % 360.0 - 180.0
    assert np.ptp(jumping) > 300.0
    more = way if not unit else f"{way}, units: {{h: {unit}}}"
    (tmp_path / "headed.yaml").write_text(HEADED.replace("MORE: 0", more))
    headings = []
    for angles in (yaw, jumping):
        in_unit = angles if unit == "deg" else np.deg2rad(angles)
        rows = ["time,speed,yaw,x,y"]
        for i, h in enumerate(in_unit):
            time = 0.5 * (i + 1) if way == "resample: 1" else float(i // 2 + 1)
            rows.append(f"{time},2,{float(h)!r},{i},1")
        (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
        motion = load(tmp_path / "headed.yaml").points[0].scenario.model.motion
        headings.append(motion.known_inputs.values[1, 1:])
    goes_on, jumps = headings
    assert np.ptp(goes_on) < 1.0
    assert np.cos(jumps - goes_on) == pytest.approx(1.0, abs=1e-9)
