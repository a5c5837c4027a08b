"""The second-order extended Kalman filter against a scalar program and exact moments."""

from math import cos
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.conftest import PLANE, make_filter
from trackbench.adapters.per_run import RunFunctions
from trackbench.config.load import load
from trackbench.core.distributions import Gaussian
from trackbench.errors import UserError
from trackbench.models.base import Model
from trackbench.models.motions.coordinated_turn import UnknownTurn
from trackbench.models.motions.map_or_ode import MapMotion, OdeMotion
from trackbench.models.motions.nonlinear import NonlinearMotion
from trackbench.models.numerical_derivatives import hessian_by_differences
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth

GROWTH = Model(
    MapMotion(
        components=("x",), next={"x": "x/2 + 25*x/(1 + x**2) + 8*cos(1.2*k)"}, Q=10.0
    ).sampled(1.0),
    FunctionSensor(h={"z": "x**2/20"}, R=1.0, state=("x",)),
)
Z = (3.0, 11.0, 0.4, 7.0, 2.5, 5.0)


class Growth(NonlinearMotion):
    """The same motion without expressions: its Jacobian is one of differences."""

    components = ("x",)

    def f(self, x: Any, k: int, T: float) -> Any:
        return x / 2 + 25 * x / (1 + x * x) + 8 * np.cos(1.2 * k)

    def Q(self, T: float) -> Any:
        return np.array([[10.0]])


def scalar_program(m: float, P: float) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
    """Posteriors and predictions (mean, variance, F); Gelb 1974, section 6.1, derivatives by hand."""
    posteriors, predictions = [(m, P)], []
    for k, z in enumerate(Z, 1):
        f = m / 2 + 25 * m / (1 + m * m) + 8 * cos(1.2 * k)
        f1 = 0.5 + 25 * (1 - m * m) / (1 + m * m) ** 2
        f2 = 50 * m * (m * m - 3) / (1 + m * m) ** 3
        m, P = f + f2 * P / 2, f1 * f1 * P + f2 * f2 * P * P / 2 + 10
        predictions.append((m, P, f1))
        S = (m / 10) ** 2 * P + (P / 10) ** 2 / 2 + 1
        K = P * m / 10 / S
        m, P = m + K * (z - m * m / 20 - P / 20), P - K * K * S
        posteriors.append((m, P))
    return posteriors, predictions


@pytest.mark.parametrize(("motion", "tolerance"), [(GROWTH.motion, 1e-12), (None, 1e-3)])
def test_the_growth_model_by_a_scalar_program(motion: Any, tolerance: float) -> None:
    """The errors of differences of differences, some 1e-6, grow as the filter diverges."""
    model = Model(motion or Growth().sampled(1.0), GROWTH.sensor)
    tracker: Any = make_filter("ekf", order=2, smooth=True)
    rng = np.random.default_rng(1)
    states = [tracker.init(model, Gaussian(np.array([[0.4]]), np.array([[2.0]])), rng)]
    for k, z in enumerate(Z, 1):
        states.append(tracker.step(model, states[-1], np.array([[z]]), k, rng))
    posteriors, predictions = scalar_program(0.4, 2.0)
    got = [(s.posterior.mean.item(), s.posterior.cov.item()) for s in states]
    np.testing.assert_allclose(got, posteriors, rtol=tolerance)
    m, P = posteriors[-1]
    smoothed = [(m, P)]
    for (m0, P0), (mp, Pp, F) in zip(posteriors[-2::-1], predictions[::-1], strict=True):
        G = P0 * F / Pp
        m, P = m0 + G * (m - mp), P0 + G * G * (P - Pp)
        smoothed.append((m, P))
    backwards = [s.posterior for s in tracker.smoothed(model, states, 0, np.random.default_rng(0))]
    got = [(s.mean.item(), s.cov.item()) for s in backwards]
    np.testing.assert_allclose(got, smoothed[::-1], rtol=tolerance)


def test_a_square_has_its_exact_moments() -> None:
    """E x^2 = m^2 + P, var x^2 = 4 m^2 P + 2 P^2, cov(x, x^2) = 2 m P of x ~ N(m, P)."""
    m, P, R, z = 0.3, 1.7, 0.2, 2.0
    model = Model(
        MapMotion(components=("x",), next={"x": "x"}, Q=0.0).sampled(1.0),
        FunctionSensor(h={"z": "x**2"}, R=R, state=("x",)),
    )
    tracker: Any = make_filter("ekf", order=2)
    state = Gaussian(np.array([[m]]), np.array([[P]]))
    posterior, innovation = tracker.update(model, state, np.array([[z]]), 1)
    S, C = 4 * m * m * P + 2 * P * P + R, 2 * m * P
    assert innovation.S.item() == pytest.approx(S, rel=1e-14)
    assert posterior.mean.item() == pytest.approx(m + C / S * (z - m * m - P), rel=1e-13)
    assert posterior.cov.item() == pytest.approx(P - C * C / S, rel=1e-13)


def test_quadratic_functions_of_two_components_are_those_of_exact_quadrature() -> None:
    """Three Gauss-Hermite points integrate the fourth degree of the covariances exactly."""
    model = Model(
        MapMotion(
            components=("a", "b"),
            next={"a": "a + 0.3*a*b - b**2", "b": "b/2 + a**2/4 + 1"},
            Q=((0.5, 0.1), (0.1, 0.3)),
        ).sampled(1.0),
        FunctionSensor(h={"u": "a*b", "v": "b - a**2"}, R=0.4, state=("a", "b")),
    )
    rng = np.random.default_rng(4)
    root = rng.normal(size=(2, 2, 3))
    state = Gaussian(rng.normal(size=(2, 3)), np.einsum("ijm,kjm->ikm", root, root))
    z = rng.normal(size=(2, 3))
    z[0, 1] = np.nan
    exact, second = (
        make_filter(kind, order=order).update(model, state, z, 1)  # type: ignore[attr-defined]
        for kind, order in (("ghkf", 3), ("ekf", 2))
    )
    np.testing.assert_allclose(second[0].mean, exact[0].mean, rtol=1e-9)
    np.testing.assert_allclose(second[0].cov, exact[0].cov, rtol=1e-8)
    measured = ~np.isnan(z)
    np.testing.assert_allclose(second[1].nu[measured], exact[1].nu[measured], rtol=1e-9)


def test_expressions_have_the_second_derivatives_of_differences() -> None:
    x = np.random.default_rng(1).uniform(0.5, 1.5, (3, 4))
    terms = {
        "a": "exp(a*b)/c + tan(a/3) - abs(b - 5)", "b": "atan2(b, c)*log(a) + sqrt(a**2 + b**2)",
        "c": "sin(a)*cos(b*c) + c**1.5 + max(a, 9)*b + a**b",
    }  # fmt: skip
    motion: Any = MapMotion(components=("a", "b", "c"), next=terms, Q=1.0).sampled(1.0)
    sensor = FunctionSensor(h=terms, R=1.0, state=("a", "b", "c"))
    for part in (motion, sensor):
        second = part.hessian(x, 1)
        np.testing.assert_allclose(second, hessian_by_differences(part.jacobian, x, 1), atol=2e-7)
        np.testing.assert_allclose(second, second.swapaxes(1, 2), rtol=1e-10, atol=1e-12)
    padded = sensor.hessian(np.concatenate([x, x[:1]]), 1)
    assert padded.shape == (3, 4, 4, 4)
    np.testing.assert_array_equal(padded[:, :3, :3], second)
    assert (padded[:, 3] == 0.0).all()
    assert (padded[:, :, 3] == 0.0).all()


def test_differences_of_a_built_in_sensor_are_those_of_its_expression() -> None:
    radar = RangeAzimuth(sigma_range=1.0, sigma_azimuth_mrad=1.0)
    names = ("px", "vx", "py", "vy")
    h = {"r": "sqrt(px**2 + py**2)", "a": "atan2(py, px)"}
    exact = FunctionSensor(h=h, R=1.0, state=names)
    x = np.array([[3000.0, -20.0], [-40.0, 3.0], [2000.0, 5.0], [30.0, 1.0]])
    got = hessian_by_differences(radar.jacobian, x, 1)
    np.testing.assert_allclose(got, exact.hessian(x, 1), rtol=1e-5, atol=1e-13)


def test_one_state_has_the_second_derivatives_that_it_has_in_a_batch() -> None:
    pendulum = OdeMotion(
        components=("x", "y"), derivative={"x": "y", "y": "-sin(x)"}, Q=0.1
    ).sampled(0.5)
    x = np.array([1.0, 2.0])
    of_batch = pendulum.hessian(x[:, None], 1)[..., 0]
    assert np.abs(of_batch).max() > 0.05
    np.testing.assert_allclose(pendulum.hessian(x, 1), of_batch, rtol=1e-6, atol=1e-12)
    radar = RangeAzimuth(sigma_range=1.0, sigma_azimuth_mrad=1.0)
    x = np.array([300.0, -4.0, 200.0, 3.0])
    of_batch = hessian_by_differences(radar.jacobian, x[:, None], 1)[..., 0]
    assert np.abs(of_batch).max() > 1e-4
    np.testing.assert_allclose(hessian_by_differences(radar.jacobian, x, 1), of_batch)


def test_a_matrix_for_one_state_is_not_taken_for_a_constant() -> None:
    def jacobian(x: np.ndarray, k: int) -> np.ndarray:
        """Return the Jacobian (2, 2) of (a + a^2, b) at the first of the states, as if it were one."""
        return np.array([[1.0 + 2.0 * x[0].flat[0], 0.0], [0.0, 1.0]])

    second = hessian_by_differences(jacobian, np.array([[3.0], [1.0]]), 1)
    expected = np.zeros((2, 2, 2, 1))
    expected[0, 0, 0] = 2.0
    np.testing.assert_allclose(second, expected, atol=1e-9)
    with pytest.raises(ValueError, match=r"one matrix \(2, 2\) for 5 states, and depends on"):
        hessian_by_differences(jacobian, np.ones((2, 5)), 1)
    # The matrix of a linear function has no second derivatives.
    for states in (np.ones(2), np.ones((2, 1)), np.ones((2, 5))):
        second = hessian_by_differences(lambda x, k: np.eye(2), states, 1)
        assert second.shape[:3] == (2, 2, 2)
        assert not second.any()


@pytest.mark.parametrize(
    "motion",
    [
        UnknownTurn(q=0.1, turn_walk_deg_s=0.1).sampled(1.0),
        OdeMotion(
            components=("x", "y"), derivative={"x": "y", "y": "-sin(x)"}, Q=0.1
        ).sampled(0.5),
    ],
)  # fmt: skip
def test_other_motions_predict_a_monte_carlo_mean(motion: Any) -> None:
    """Second order: the error of the mean is of fourth order in the deviations, here 2 %."""
    n = len(motion.components)
    mean = np.array([0.0, 40.0, 0.0, 30.0, 0.3]) if n == 5 else np.array([1.2, 0.4])
    P = np.diag([1.0, 1.0, 1.0, 1.0, 0.04]) if n == 5 else np.diag([0.09, 0.04])
    sensor = FunctionSensor(h={"z": "0"}, R=1.0, state=motion.components)
    state = Gaussian(mean[:, None], P[..., None])
    nothing = np.full((1, 1), np.nan)
    linear, second = (
        make_filter("ekf", order=order).update(Model(motion, sensor), state, nothing, 1)[0]  # type: ignore[attr-defined]
        for order in (1, 2)
    )
    exact, _ = make_filter("ghkf", order=5).update(Model(motion, sensor), state, nothing, 1)  # type: ignore[attr-defined]
    error, first = (np.abs(s.mean - exact.mean).max() for s in (second, linear))
    assert error < 0.1 * first


def test_order_of_a_linear_model_is_refused(tmp_path: Path) -> None:
    text = f"name: c\n{PLANE}filters: {{E: {{kind: ekf, order: 2}}}}\n"
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(UserError, match="order: has no effect as motion and sensor are linear"):
        load(tmp_path / "c.yaml")
    (tmp_path / "c.yaml").write_text(text.replace("order: 2", "order: 3"))
    with pytest.raises(UserError, match="order"):
        load(tmp_path / "c.yaml")


def test_a_jacobian_of_a_tiny_state_without_a_covariance() -> None:
    """Differences had a step of 1e-6 of the state, which the rounding of the function's value hid."""

    class Wave(Growth):
        """100 + sin(x), whose derivative at zero is one."""

        def f(self, x: Any, k: int, T: float) -> Any:
            return 100.0 + np.sin(x)

    model = Model(Wave().sampled(1.0), GROWTH.sensor)
    functions = RunFunctions(SimpleNamespace(model=model, k=1))  # type: ignore[arg-type]
    for x in (1e-9, 0.0, 1e-3):
        np.testing.assert_allclose(functions.F(np.array([x])), [[np.cos(x)]], atol=1e-6)
