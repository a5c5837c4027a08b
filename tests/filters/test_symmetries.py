"""Estimates turn with the data, and do not depend on the unit of length."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from tests.conftest import make_filter
from trackbench.core.distributions import Gaussian
from trackbench.filters.grid_2d import PlaneGrid
from trackbench.models.base import Model
from trackbench.models.motions.coordinated_turn import UnknownTurn
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.map_or_ode import MapMotion, OdeMotion
from trackbench.models.motions.nonlinear import NonlinearMotion
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth

UNIT = 2.0**30
"""Of length, m: a power of two, so that numbers scale without rounding."""


def posteriors(
    kind: str, keys: dict[str, Any], model: Model, prior: Gaussian, z: np.ndarray
) -> list[Any]:
    """Return mean and covariance after each of the measurements z (n_z, T)."""
    rng, tracker, out = np.random.default_rng(0), make_filter(kind, **keys), []
    state: Any = tracker.init(model, prior, rng)
    for k in range(1, z.shape[1] + 1):
        state = tracker.step(model, state, z[:, k - 1 : k], k, rng)
        out.append(tracker.estimate(state))
    return [(np.asarray(s.mean)[:, 0], np.asarray(s.cov).reshape(len(s.mean), -1)) for s in out]


SIGMA_POINTS: list[tuple[str, dict[str, Any]]] = [
    ("ekf", {}),
    ("ekf", {"order": 2}),
    ("iekf", {}),
    ("cmkf", {}),
    ("ukf", {}),
    ("ukf", {"alpha": 0.1, "beta": 2.0, "kappa": 0.0, "noise": "additive"}),
    ("ckf", {}),
    ("ckf", {"form": "square-root"}),
    ("ghkf", {"order": 3}),
    ("ghkf", {"order": 4}),
    ("ghkf", {"order": 5}),
    ("iplf", {}),
    ("iplf", {"order": 4}),
    ("iplf", {"order": 5}),
]


@pytest.mark.parametrize(("kind", "keys"), SIGMA_POINTS)
def test_data_turned_by_half_a_turn_give_turned_estimates(kind: str, keys: dict[str, Any]) -> None:
    """A prior so wide that sigma points lie on both sides of the cut of the azimuth, or of none."""
    model = Model(
        WhiteAcceleration(q=0.5).sampled(2.0), RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=50)
    )
    mean = np.array([[2500.0], [0.0], [900.0], [0.0]])
    cov = np.diag([1500.0, 30.0, 1500.0, 30.0]) ** 2
    z = np.array([[2984.0, 2931.0, 2910.0, 2841.0], [0.134, 0.058, 0.093, 0.041]])
    turned = np.stack([z[0], z[1] - np.pi])
    there = posteriors(kind, keys, model, Gaussian(mean, cov), z)
    back = posteriors(kind, keys, model, Gaussian(-mean, cov), turned)
    for (m, P), (m_turned, P_turned) in zip(there, back, strict=True):
        np.testing.assert_allclose(m_turned, -m, rtol=1e-7, atol=1e-5)
        np.testing.assert_allclose(P_turned, P, rtol=1e-7, atol=1e-5)


@dataclass(frozen=True, kw_only=True)
class Ranges(SensorBase):
    """Ranges from two places, without a Jacobian."""

    unit: float
    components: ClassVar[tuple[str, ...]] = ("a", "b")

    def measurement(self, x: Any, k: int) -> Gaussian:
        places = ((0.0, 0.0), (100.0 / self.unit, 300.0 / self.unit))
        ranges = [np.sqrt((x[0] - px) ** 2 + (x[2] - py) ** 2) for px, py in places]
        return Gaussian(np.stack(ranges), np.eye(2) * (2.0 / self.unit) ** 2)


@dataclass(frozen=True, kw_only=True)
class Drag(NonlinearMotion):
    """Drag by the square of the speed, without a Jacobian."""

    unit: float
    components: ClassVar[tuple[str, ...]] = ("px", "vx", "py", "vy")

    def f(self, x: Any, k: int, T: float) -> Any:
        px, vx, py, vy = x
        drag = 1.0 - T * 0.01 * self.unit * np.sqrt(vx * vx + vy * vy)
        return np.stack([px + T * vx, drag * vx, py + T * vy, drag * vy])

    def Q(self, T: float) -> Any:
        return np.eye(4) * (0.5 / self.unit) ** 2


def planar(part: str, unit: float) -> Model:
    """Return a model with this nonlinear part in units of so many meters."""
    radar = RangeAzimuth(sigma_range=2.0 / unit, sigma_azimuth_mrad=20.0)
    motion = WhiteAcceleration(q=0.1 / unit**2).sampled(1.0)
    match part:
        case "radar":
            return Model(motion, radar)
        case "sensor without Jacobian":
            return Model(motion, Ranges(unit=unit))
        case "motion without Jacobian":
            return Model(Drag(unit=unit).sampled(1.0), radar)
        case _:
            speed = f"0.01*{unit}*sqrt(vx**2 + vy**2)"
            slopes = {"px": "vx", "vx": f"-vx*{speed}", "py": "vy", "vy": f"-vy*{speed}"}
            ode = OdeMotion(components=tuple(slopes), derivative=slopes, Q=0.25 / unit**2)
            return Model(ode.sampled(1.0), radar)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    "part", ["radar", "sensor without Jacobian", "motion without Jacobian", "ode"]
)
def test_estimates_do_not_depend_on_the_unit_of_length(part: str, order: int) -> None:
    z = np.array([[302.0, 296.0, 290.0, 285.0], [0.23, 0.30, 0.26, 0.31]])
    found = []
    for unit in (1.0, UNIT, 1.0 / UNIT):
        lengths = np.array([[1.0 / unit], [1.0 / unit if part == "sensor without Jacobian" else 1]])
        measured = z if part != "sensor without Jacobian" else np.array([z[0], z[0] - 40.0])
        prior = Gaussian(
            np.array([[300.0], [-5.0], [80.0], [3.0]]) / unit,
            np.diag(np.square([60.0, 4.0, 60.0, 4.0])) / unit**2,
        )
        of_unit = posteriors("ekf", {"order": order}, planar(part, unit), prior, measured * lengths)
        found.append([(m * unit, P * unit**2) for m, P in of_unit])
    for other in found[1:]:
        for (m, P), (m_other, P_other) in zip(found[0], other, strict=True):
            np.testing.assert_allclose(m_other, m, rtol=1e-9)
            np.testing.assert_allclose(P_other, P, rtol=1e-9)


@pytest.mark.parametrize("part", ["radar", "turn"])
def test_curvature_is_that_of_expressions(part: str) -> None:
    """Differences over the spread give the moments of second derivatives in closed form."""
    state = Gaussian(
        np.array([[300.0], [-5.0], [80.0], [3.0]]), np.diag(np.square([60.0, 4.0, 60.0, 4.0]))
    )
    names = ("px", "vx", "py", "vy")
    h = {"range": "sqrt(px**2 + py**2)", "azimuth": "atan2(py, px)"}
    exact: Any = FunctionSensor(h=h, R=(4.0, 4e-4), state=names)
    motion: Any = WhiteAcceleration(q=0.1).sampled(1.0)
    z = np.array([[302.0], [0.23]])
    if part == "radar":
        models = [Model(motion, RangeAzimuth(sigma_range=2.0, sigma_azimuth_mrad=20.0))]
        models.append(Model(motion, exact))
    else:
        turn: Any = UnknownTurn(q=0.3, turn_walk_deg_s=1.0).sampled(2.0)
        state = Gaussian(
            np.append(state.mean, [[0.05]], axis=0), np.diag([3600.0, 16, 3600, 16, 1e-4])
        )
        where = {"c": "cos(w*T)", "s": "sin(w*T)"}
        next_state = {
            "px": "px + s/w*vx - (1 - c)/w*vy", "vx": "c*vx - s*vy",
            "py": "py + (1 - c)/w*vx + s/w*vy", "vy": "s*vx + c*vy", "w": "w",
        }  # fmt: skip
        Q = tuple(map(tuple, turn.Q.tolist()))
        same = MapMotion(components=(*names, "w"), where=where, next=next_state, Q=Q).sampled(2.0)
        models = [Model(turn, exact), Model(same, exact)]
    got, expected = (posteriors("ekf", {"order": 2}, m, state, z)[0] for m in models)
    np.testing.assert_allclose(got[0], expected[0], rtol=1e-6)
    np.testing.assert_allclose(
        got[1], expected[1], rtol=1e-6, atol=1e-6 * np.abs(expected[1]).max()
    )


def test_the_grid_of_a_plane_does_not_depend_on_the_unit() -> None:
    found = []
    for unit in (1.0, UNIT):
        next_state = {"a": f"a + 0.2*b + 0.01*{unit}*a**2", "b": f"0.9*b + 0.01*{unit}*a*b"}
        motion = MapMotion(components=("a", "b"), next=next_state, Q=0.3 / unit**2).sampled(1.0)
        sensor = FunctionSensor(h={"z": "a"}, R=0.2 / unit**2, state=("a", "b"))
        prior = Gaussian(np.array([[0.4], [0.1]]) / unit, np.eye(2) * 0.5 / unit**2)
        grid, rng = PlaneGrid(nodes=100), np.random.default_rng(0)
        state: Any = grid.init(Model(motion, sensor), prior, rng)
        for k, z in enumerate((0.6, 0.9), 1):
            state = grid.step(Model(motion, sensor), state, np.array([[z / unit]]), k, rng)
        m = grid.estimate(state)
        found.append((m.mean * unit, m.cov * unit**2))
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=1e-9)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-9)
