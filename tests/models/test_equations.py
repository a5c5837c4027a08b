"""Motions and sensors that are written as equations, against those of the package and other programs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.conftest import make_filter
from trackbench import api
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Model
from trackbench.models.motions.coordinated_turn import UnknownTurn
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.map_or_ode import MapMotion, OdeMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.stacked import StackedSensor
from trackbench.report.tables_and_figures import Results

pytestmark = pytest.mark.usefixtures("no_report")

PLANE = ("px", "vx", "py", "vy")
LORENZ: dict[str, Any] = {
    "components": ("x", "y", "z"),
    "parameters": {"s": 10.0, "r": 28.0, "b": 8.0 / 3.0},
    "derivative": {"x": "s*(y - x)", "y": "x*(r - z) - y", "z": "x*y - b*z"},
    "Q": 1.0,
}
STATES = np.array([[1.5], [-1.5], [25.5]]) + np.random.default_rng(2).normal(size=(3, 20))


def lorenz(**changes: Any) -> OdeMotion:
    return OdeMotion(**LORENZ | changes)


def slopes(function: Any, x: np.ndarray) -> np.ndarray:
    """Return the derivatives of a function of states by central differences."""
    steps = 1e-6 * np.eye(len(x))[:, :, None]
    return np.stack([(function(x + h) - function(x - h)) / 2e-6 for h in steps], axis=1)


def test_a_map_is_the_turn_of_the_package() -> None:
    T, turn = 2.0, UnknownTurn(q=0.3, turn_walk_deg_s=1.0).sampled(2.0)
    motion = MapMotion(
        components=(*PLANE, "w"),
        where={"c": "cos(w*T)", "s": "sin(w*T)"},
        next={
            "px": "px + s/w*vx - (1 - c)/w*vy",
            "vx": "c*vx - s*vy",
            "py": "py + (1 - c)/w*vx + s/w*vy",
            "vy": "s*vx + c*vy",
            "w": "w",
        },
        Q=tuple(map(tuple, turn.Q.tolist())),
    ).sampled(T)
    x = np.random.default_rng(1).normal(size=(5, 30))
    ours, theirs = motion.transition(x, 1), turn.transition(x, 1)
    np.testing.assert_allclose(ours.mean, theirs.mean, atol=1e-12)
    np.testing.assert_array_equal(ours.cov, theirs.cov)
    np.testing.assert_allclose(motion.jacobian(x, 1), turn.jacobian(x, 1), atol=1e-9)


def test_a_function_is_the_radar_of_the_package() -> None:
    radar = RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=4.0)
    sensor = FunctionSensor(
        h={"range": "sqrt(px**2 + py**2)", "azimuth": "atan2(py, px)"},
        angles=("azimuth",),
        R={"range": 25.0, "azimuth": 16e-6},
    ).for_state(PLANE)
    x = 100.0 * np.random.default_rng(1).normal(size=(5, 30))
    ours, theirs = sensor.measurement(x, 1), radar.measurement(x, 1)
    np.testing.assert_allclose(ours.mean, theirs.mean, rtol=1e-12)
    np.testing.assert_allclose(ours.cov, theirs.cov, rtol=1e-12)
    np.testing.assert_allclose(sensor.jacobian(x, 1), radar.jacobian(x, 1), rtol=1e-6, atol=1e-9)
    z, z_pred = np.array([[1.0], [3.1]]), np.array([[2.0], [-3.1]])
    np.testing.assert_array_equal(sensor.innovation(z, z_pred), radar.innovation(z, z_pred))


@pytest.mark.parametrize(("substeps", "order"), [(2, 16.0), (4, 16.0)])
def test_runge_kutta_has_order_four(substeps: int, order: float) -> None:
    def error(n: int) -> float:
        step = lorenz(substeps=n).sampled(0.1).transition(STATES, 3).mean
        return float(np.abs(step - exact).max())

    exact = np.stack(
        [
            solve_ivp(
                lambda t, v: [
                    10 * (v[1] - v[0]),
                    v[0] * (28 - v[2]) - v[1],
                    v[0] * v[1] - 8 / 3 * v[2],
                ],
                (0.0, 0.1),
                x,
                rtol=1e-12,
                atol=1e-12,
            ).y[:, -1]
            for x in STATES.T
        ],
        axis=1,
    )
    assert 0.6 * order < error(substeps) / error(2 * substeps) < 1.6 * order


def test_an_equation_may_depend_on_the_time() -> None:
    """dx/dt = cos t from step 3 to step 4, T = .5."""
    motion = OdeMotion(components=("x",), derivative={"x": "cos(t)"}, substeps=8, Q=1.0)
    moved = motion.sampled(0.5).transition(np.zeros((1, 1)), 4).mean[0, 0]
    assert moved == pytest.approx(np.sin(2.0) - np.sin(1.5), abs=1e-9)
    assert motion.uses_time
    assert not lorenz().uses_time


def test_the_jacobian_of_a_runge_kutta_step() -> None:
    motion = lorenz(substeps=3).sampled(0.1)
    expected = slopes(lambda x: motion.transition(x, 1).mean, STATES)
    np.testing.assert_allclose(motion.jacobian(STATES, 1), expected, rtol=1e-6, atol=1e-7)
    timed = OdeMotion(components=("x",), derivative={"x": "x*cos(t)"}, substeps=2, Q=1.0).sampled(
        0.5
    )
    x = np.array([[1.0, -3.0]])  # linear in x: the derivative is the quotient
    np.testing.assert_allclose(timed.jacobian(x, 4)[0], timed.transition(x, 4).mean / x, rtol=1e-14)


def test_noise_may_depend_on_the_state() -> None:
    motion = lorenz(Q={"x": "0.1*x**2", "z": "T"}).sampled(0.1)
    cov = motion.transition(STATES, 1).cov
    np.testing.assert_allclose(cov[0, 0], 0.1 * STATES[0] ** 2)
    assert (cov[2, 2] == 0.1).all()
    assert not cov[1, 1].any()
    assert not cov[0, 2].any()
    assert not hasattr(motion, "Q")


def test_linear_equations_are_a_linear_motion_and_sensor() -> None:
    motion = MapMotion(components=("a", "b"), next={"a": "a + T*b", "b": "b/2"}, Q=(1.0, 2.0))
    sampled = motion.sampled(4.0)
    assert isinstance(sampled, Linear)
    np.testing.assert_array_equal(sampled.F, [[1.0, 4.0], [0.0, 0.5]])
    sensor = FunctionSensor(h={"z": "a - b"}, R=1.0).for_state(("a", "b"))
    np.testing.assert_array_equal(sensor.H(3), [[1.0, -1.0, 0.0]])
    for h in ("a - b + 1", "a*b", "a + k"):
        assert not hasattr(FunctionSensor(h={"z": h}, R=1.0).for_state(("a", "b")), "H")


CONFIG = """name: c
runs: 8
block: 4
scenario:
  kind: tracking
  T: 0.1
  last: 20
  target:
    kind: driven
    motion:
      kind: ode
      components: [x, y, z]
      derivative: {x: 10*(y - x), y: x*(28 - z) - y, z: x*y - 8/3*z}
      substeps: 2
      Q: 0.1
    initial: {x: 1.5, y: -1.5, z: 25.5}
  sensor: {kind: function, h: {sum: x + y, height: z}, R: [1, 2]}
  start: {kind: gaussian, sigma: {x: 1, y: 1, z: 1}}
  score: {errors: {plane: [x, y]}}
filters: {EKF: {kind: ekf}, UKF: {kind: ukf}, PF: {kind: pf, N: 50}, EnKF: {kind: enkf, N: 20}}
metrics: [rmse_x, rmse_plane, nees]
"""


def test_from_the_config_to_the_results(tmp_path: Path) -> None:
    """The same bytes with one process and two, and errors of components and groups."""
    (tmp_path / "c.yaml").write_text(CONFIG)
    texts = []
    for n, engine in enumerate(("serial", "processes")):
        options = api.Options(engine=engine, quiet=True, out=tmp_path / str(n), workers=2)
        results = api.run(tmp_path / "c.yaml", options)
        texts.append((results.folder / "per_run.csv").read_bytes())
    assert texts[0] == texts[1]
    runs = Results(results.folder).runs({})
    plane, x = (runs["EKF", metric] for metric in ("rmse_plane", "rmse_x"))
    assert np.isfinite(plane).all()
    assert (plane > x).all()


def test_mean_square_and_mean_length_of_the_error(tmp_path: Path) -> None:
    """Of the tracks' errors over all steps; stored only where they are named."""
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out", save_tracks=True)
    (tmp_path / "c.yaml").write_text(CONFIG.replace("nees]", "mse_plane, mae_plane, mae_z]"))
    results = Results(api.run(tmp_path / "c.yaml", options).folder)
    runs, tracks = results.runs({}), np.load(results.folder / "tracks.npz")
    errors = tracks["mean/UKF"] - tracks["truth"]
    length = np.sqrt(np.sum(np.square(errors[:2]), axis=0))
    np.testing.assert_allclose(runs["UKF", "mse_plane"], np.mean(length**2, axis=0), rtol=1e-6)
    np.testing.assert_allclose(runs["UKF", "mae_plane"], np.mean(length, axis=0), rtol=1e-6)
    np.testing.assert_allclose(runs["UKF", "mae_z"], np.mean(np.abs(errors[2]), axis=0), rtol=1e-6)
    (tmp_path / "c.yaml").write_text(CONFIG.partition("metrics:")[0])
    every = Results(api.run(tmp_path / "c.yaml", options).folder).runs({})
    assert ("UKF", "rmse_plane") in every
    assert not any(name.startswith(("mse", "mae")) for _, name in every)


NILE = """
1120 1160 963 1210 1160 1160 813 1230 1370 1140 995 935 1110 994 1020 960 1180 799 958 1140 1100
1210 1150 1250 1260 1220 1030 1100 774 840 874 694 940 833 701 916 692 1020 1050 969 831 726 456 824
702 1120 1100 832 764 821 768 845 864 862 698 845 744 796 1040 759 781 865 845 944 984 897 822 1010
771 676 649 846 812 742 801 1040 860 874 848 890 744 749 838 1050 918 986 797 923 975 815 1020 906
901 1170 912 746 919 718 714 740
"""
LOCAL_LEVEL = """name: nile
scenario:
  kind: tracking
  target: {kind: measured, measurements: nile.csv, axes: 0}
  assume: {motion: {kind: map, components: [x], next: {x: x}, Q: 1469.1}}
  sensor: {kind: function, h: {z: x}, R: 15099}
  start: {kind: given, mean: [0], cov: [[9998530.9]]}
filters: {KF: {kind: kf}}
metrics: [log_score]
"""


def test_the_log_likelihood_of_the_nile(tmp_path: Path) -> None:
    """Durbin & Koopman 2012: -641.5856 with P_1 = 1e7, by the variances 15099 and 1469.1."""
    rows = [f"{k},{z}\n" for k, z in enumerate(NILE.split(), 1)]
    (tmp_path / "nile.csv").write_text("".join(["step,z\n", *rows]))
    (tmp_path / "c.yaml").write_text(LOCAL_LEVEL)
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out")
    folder = api.run(tmp_path / "c.yaml", options).folder
    score = Results(folder).runs({})["KF", "log_score"][0]
    assert 100.0 * score == pytest.approx(-641.5856, abs=6e-5)


def test_known_inputs_leave_the_kalman_filter() -> None:
    """x' = F x + b(k): the filter is that of a scalar program; a nonlinear motion stays refused."""
    F, Q, R, b = np.array([[1.0, 0.5], [0.0, 0.9]]), np.diag([0.1, 0.2]), 4.0, 1.5
    motion: Any = MapMotion(
        components=("p", "v"), parameters={"u": b},
        next={"p": "p + v*T + u*T**2/2", "v": "0.9*v + u*T*cos(k)"}, Q=(0.1, 0.2),
    ).sampled(0.5)  # fmt: skip
    model = Model(motion, FunctionSensor(h={"z": "p"}, R=R, state=("p", "v")))
    tracker: Any = make_filter("kf")
    assert motion.linear
    rng = np.random.default_rng(1)
    m, P, H = np.array([1.0, 2.0]), np.diag([9.0, 1.0]), np.array([[1.0, 0.0]])
    state = tracker.init(model, Gaussian(m[:, None], P), rng)
    for k in range(1, 8):
        z = 3.0 * rng.standard_normal()
        state = tracker.step(model, state, np.array([[z]]), k, rng)
        m = F @ m + np.array([b * 0.125, b * 0.5 * np.cos(k)])
        P = F @ P @ F.T + Q
        K = P @ H.T / (P[0, 0] + R)
        m, P = m + K[:, 0] * (z - m[0]), P - K @ H @ P
        got = tracker.estimate(state)
        np.testing.assert_allclose(got.mean[:, 0], m, rtol=1e-12)
        np.testing.assert_allclose(got.cov.reshape(2, 2), P, rtol=1e-12)
    for bent in ({"p": "p*v", "v": "v"}, {"p": "p + sin(v)", "v": "v"}):
        other: Any = MapMotion(components=("p", "v"), next=bent, Q=1.0).sampled(1.0)
        assert not hasattr(other, "linear")
    noisy: Any = MapMotion(components=("p",), next={"p": "p + 1"}, Q="1 + p**2").sampled(1.0)
    assert not hasattr(noisy, "linear")


def test_a_sensor_with_an_offset_that_changes_leaves_the_kalman_filter() -> None:
    """z = H(k) x + b(k) + N(0, R(k)) by a program of its own; a nonlinear sensor stays refused."""
    motion: Any = MapMotion(components=("p", "v"), next={"p": "p + v", "v": "v"}, Q=0.1).sampled(1)
    sensor = FunctionSensor(
        h={"z": "2*p + 0.5*sin(k) + 3", "w": "p*(1 + 0.1*k) - v"},
        R={"z": "4", "w": "1 + 0.1*k"},
        state=("p", "v"),
    )
    model, tracker = Model(motion, sensor), make_filter("kf")
    F, rng = np.array([[1.0, 1.0], [0.0, 1.0]]), np.random.default_rng(2)
    m, P = np.array([1.0, 2.0]), np.diag([9.0, 1.0])
    state: Any = tracker.init(model, Gaussian(m[:, None], P), rng)
    for k in range(1, 8):
        z = 10.0 * rng.standard_normal(2)
        state = tracker.step(model, state, z[:, None], k, rng)
        H, R = np.array([[2.0, 0.0], [1.0 + 0.1 * k, -1.0]]), np.diag([4.0, 1.0 + 0.1 * k])
        m, P = F @ m, F @ P @ F.T + 0.1 * np.eye(2)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        m, P = m + K @ (z - H @ m - [0.5 * np.sin(k) + 3.0, 0.0]), P - K @ H @ P
        got = tracker.estimate(state)
        np.testing.assert_allclose(got.mean[:, 0], m, rtol=1e-11)
        np.testing.assert_allclose(got.cov.reshape(2, 2), P, rtol=1e-11)
    assert StackedSensor((sensor, sensor)).linear
    for h, R in (("p*v", "1"), ("sin(p)", "1"), ("p + 1", "1 + p**2")):
        bent = FunctionSensor(h={"z": h}, R=R, state=("p", "v"), angles=())
        assert not hasattr(bent, "linear")
        assert not hasattr(StackedSensor((sensor, bent)), "linear")


def test_an_eigenvalue_of_zero_is_judged_relative_to_the_largest() -> None:
    MapMotion(components=("a", "b"), next={"a": "a", "b": "b"}, Q=((1e9, 1e9), (1e9, 1e9)))
