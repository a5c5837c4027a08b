"""Robust updates against scalar programs, a numerical minimizer and the plain filters."""

from dataclasses import replace
from math import fsum
from typing import Any

import numpy as np
import pytest
from scipy import integrate, optimize, stats
from scipy.special import gamma

from tests.conftest import make_filter, per_run, simulate, track
from tests.filters.test_conflicts import refusals
from trackbench.contract.run_contract import check_filter
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.filters.robust import Huber, StudentT, _log_integrals
from trackbench.models.base import Model
from trackbench.models.motions.autoregressive import Autoregressive
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.base import Outliers
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.noise import Noise
from trackbench.models.sensors.position import PositionSensor, ScalarSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.stacked import StackedSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking

HEAVY = Outliers(degrees=2)
PLANE = Tracking(
    target=Driven(
        motion=WhiteAcceleration(q=2.0), launch=Launch(x=900.0, y=700.0, vx=-5.0, vy=4.0)
    ),
    sensor=PositionSensor(sigma=20.0, detection=0.8, outliers=HEAVY),
    start=GaussianStart(sigma=(60.0, 4.0, 60.0, 4.0)),
    last=12,
)
RADAR = replace(PLANE, sensor=RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=8.0, outliers=HEAVY))
KINDS = ("kf", "ekf", "iekf", "iplf", "mcaekf", "ckf", "ukf", "ghkf")
UPDATES = (Huber(k=1.2), StudentT(df=3.0))
TWO = (WhiteAcceleration(q=0.1), WhiteAcceleration(q=9.0))
PHI, Q, R = 0.95, 1.0, 4.0


def scenario_of(kind: str) -> Tracking:
    """Return the radar, or measured positions for a linear filter."""
    return PLANE if kind == "kf" else RADAR


@pytest.mark.parametrize("form", ["covariance", "square-root"])
@pytest.mark.parametrize("kind", [*KINDS, "imm"])
@pytest.mark.parametrize("limit", [Huber(k=1e6), StudentT(df=1e12)], ids=["huber", "student-t"])
def test_the_limit_is_the_plain_filter(limit: Any, kind: str, form: str) -> None:
    keys: list[dict[str, Any]] = [{"form": form}, {"form": form, "robust": limit}]
    if kind == "ukf":
        keys = [one | {"smooth": True} for one in keys]
    if kind == "imm":
        banks = [make_filter("ekf", **one) for one in keys]
        matrix = ((0.9, 0.1), (0.2, 0.8))
        keys = [{"filter": one, "motions": TWO, "transition": matrix} for one in banks]
    scenario = scenario_of(kind)
    scenario = replace(scenario, sensor=replace(scenario.sensor, outliers=None))
    plain, robust = (
        track(scenario, make_filter(kind, **one), 4, covariances=4, predictive_metrics=("score",))
        for one in keys
    )
    scale = np.sqrt(np.einsum("iikm->ikm", plain.cov)[:, 1:])
    assert np.abs((robust.mean - plain.mean)[:, 1:] / scale).max() < 1e-9
    assert np.abs((robust.cov - plain.cov)[:, :, 1:] / (scale[:, None] * scale)).max() < 1e-9
    assert np.nanmax(np.abs(robust.diagnostics["measurement_weight"] - 1.0)) < 1e-9
    scores = (of.diagnostics["log_likelihood"] for of in (plain, robust))
    # The density of Student's t has lost digits at such a df.
    np.testing.assert_allclose(*scores, rtol=1e-9, atol=1e-9 if isinstance(limit, Huber) else 0.01)


def by_hand(robust: Huber | StudentT, z: Array) -> tuple[list[float], ...]:
    """Return means, variances, weights and log-likelihoods of one run of an AR(1) state."""
    m, P, rows = 0.0, 2.25, []
    for y in z.tolist():
        m, P = PHI * m, PHI * PHI * P + Q
        x, V, w = m, P, 1.0
        for i in range(1 + robust.iterations):
            if i and isinstance(robust, Huber):
                w = min(1.0, robust.k / (abs(y - x) / R**0.5))
            elif i and isinstance(robust, StudentT):
                w = (robust.df + 1.0) / (robust.df + ((y - x) ** 2 + V) / R)
            K = P / (P + R / w)
            x, V = m + K * (y - m), (1.0 - K) * P
        S = P + R
        if isinstance(robust, StudentT):
            score = stats.t.logpdf(y, robust.df, m, S**0.5)
        else:
            k, r = robust.k, abs(y - m) / S**0.5
            flat, tail = stats.norm.cdf(k) - 0.5, stats.norm.pdf(k) / k
            rho = 0.5 * r * r if r < k else k * r - 0.5 * k * k
            score = -rho - 0.5 * np.log(2.0 * np.pi * S) - np.log(2.0 * (flat + tail))
        m, P = x, V
        rows.append((x, V, w, score))
    return tuple(map(list, zip(*rows, strict=True)))


@pytest.mark.parametrize("robust", UPDATES, ids=["huber", "student-t"])
def test_a_scalar_program_gives_the_same(robust: Any) -> None:
    scenario = Tracking(
        target=Driven(motion=Autoregressive(phi=PHI, q=Q)),
        sensor=ScalarSensor(sigma=R**0.5, outliers=HEAVY),
        start=GaussianStart(sigma=(1.5,)),
        last=40,
    )
    tracker = make_filter("kf", robust=robust)
    output = track(scenario, tracker, 3, covariances=3, predictive_metrics=("score",))
    z = simulate(scenario, 1, 0, 3).measurements[0]
    for run in range(3):
        mean, var, weight, score = by_hand(robust, z[:, run])
        np.testing.assert_allclose(output.mean[0, 1:, run], mean, rtol=1e-9)
        np.testing.assert_allclose(output.cov[0, 0, 1:, run], var, rtol=1e-9)
        weights = output.diagnostics["measurement_weight"][1:, run]
        np.testing.assert_allclose(weights, weight, rtol=1e-9)
        np.testing.assert_allclose(output.diagnostics["log_likelihood"][1:, run], score, rtol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_log_densities_have_the_area_one(n: int) -> None:
    """Against scipy's t, and against the integral over shells of Huber's density."""
    r = np.array([0.1, 1.0, 3.0, 30.0])
    many, normal = np.full(4, n), stats.multivariate_normal(np.zeros(n))
    points = np.zeros((4, n))
    points[:, 0] = r
    student = normal.logpdf(points) + StudentT(df=2.5).log_ratio(r * r, many)
    expected = stats.multivariate_t(np.zeros(n), np.eye(n), df=2.5).logpdf(points)
    np.testing.assert_allclose(student, expected, rtol=1e-12)
    for k in (0.3, 1.5, 4.0):

        def shell(r: float, k: float = k) -> float:
            ratio = float(Huber(k=k).log_ratio(np.array([r * r]), np.array([n]))[0])
            area = 2.0 * np.pi ** (0.5 * n) / gamma(0.5 * n) * r ** (n - 1)
            return float(area * np.exp(ratio - 0.5 * r * r - 0.5 * n * np.log(2.0 * np.pi)))

        parts = (
            integrate.quad(shell, *part, limit=200)[0] for part in ((0, k), (k, 50), (50, 300))
        )
        assert sum(parts) == pytest.approx(1.0, abs=1e-9)


def test_the_integrals_of_huber_do_not_depend_on_the_version_of_sum(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From Python 3.12 on `sum` is compensated, nearly as `math.fsum` is."""
    compute = _log_integrals.__wrapped__  # without the cache
    constants = (0.7, 1.0, 1.2, 1.5, 2.0, 2.5)
    plain = [compute(k, 8) for k in constants]
    monkeypatch.setattr("trackbench.filters.robust.sum", fsum, raising=False)
    np.testing.assert_array_equal([compute(k, 8) for k in constants], plain)


@pytest.mark.parametrize("robust", UPDATES, ids=["huber", "student-t"])
@pytest.mark.parametrize("off", [1e5, 1e9, 1e20])
def test_an_outlier_of_many_standard_deviations_has_the_weight_of_its_law(
    robust: Any, off: float
) -> None:
    """Far below one in a thousand, and never zero, by which R would be divided."""
    posterior = Gaussian(np.zeros((1, 1)), np.eye(1))
    sensor, z = ScalarSensor(sigma=2.0), np.array([[2.0 * off]])
    weight = robust.weights(sensor, posterior, z, 1)[0, 0]
    if isinstance(robust, Huber):
        expected = robust.k / off
    else:
        # E (z - x)^2 / R = off^2 + P / R
        expected = (robust.df + 1.0) / (robust.df + off**2 + 0.25)
    assert weight == pytest.approx(max(expected, 1e-30), rel=1e-9)


def random_case(rng: np.random.Generator, sizes: tuple[int, ...]) -> tuple[Any, ...]:
    """Return a prior N(m, P), a random linear sensor per size, and a measurement with an outlier."""
    names = ("a", "b", "c")
    A = rng.normal(size=(3, 3))
    P, m = 0.1 * A @ A.T + 0.1 * np.eye(3), rng.normal(size=3)
    H, sensors = rng.normal(size=(sum(sizes), 3)), []
    R = np.zeros((sum(sizes), sum(sizes)))
    for first, size in zip(np.cumsum((0, *sizes[:-1])).tolist(), sizes, strict=True):
        rows = slice(first, first + size)
        B = rng.normal(size=(size, size))
        R[rows, rows] = B @ B.T + np.eye(size)
        terms = [
            " + ".join(f"({h!r}) * {x}" for h, x in zip(row, names, strict=True))
            for row in H[rows].tolist()
        ]
        h = {f"z{i}": term for i, term in enumerate(terms)}
        cov = tuple(map(tuple, R[rows, rows].tolist()))
        sensors.append(FunctionSensor(h=h, R=cov, state=names))
    z = H @ m + 3.0 * rng.normal(size=len(H)) + np.array([20.0] + [0.0] * (len(H) - 1))
    return m, P, H, R, StackedSensor(tuple(sensors)), z


class Still:
    """A motion of three components that stay."""

    components = ("a", "b", "c")

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return x without noise."""
        return Gaussian(x, np.zeros((3, 3)))

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the unit matrix."""
        return np.eye(3)


def updated(robust: Any, m: Array, P: Array, sensor: Any, z: Array, kind: str = "ekf") -> Any:
    """Return mean and covariance of one update of N(m, P), and the sensors' weights by them."""
    tracker, model = make_filter(kind, robust=robust), Model(Still(), sensor)
    posterior, *_ = tracker.predict_and_update(model, Gaussian(m[:, None], P), z[:, None], 1)
    weights = robust.weights(sensor, posterior, z[:, None], 1)
    return posterior.mean[:, 0], posterior.cov.reshape(3, 3, -1)[..., 0], weights[:, 0]


SIZES = [(1,), (3,), (2, 1), (1, 2, 1)]


@pytest.mark.parametrize("sizes", SIZES, ids=str)
@pytest.mark.parametrize("kind", ["ekf", "ckf"])
def test_hubers_update_minimizes_its_cost(sizes: tuple[int, ...], kind: str) -> None:
    rng, smallest = np.random.default_rng(5), []
    for _ in range(2):
        m, P, H, R, sensor, z = random_case(rng, sizes)

        def cost(x: Array) -> float:
            value = 0.5 * (x - m) @ np.linalg.solve(P, x - m)  # noqa: B023
            for rows in sensor.rows:  # noqa: B023
                e = z[rows] - H[rows] @ x  # noqa: B023
                r = np.sqrt(e @ np.linalg.solve(R[rows, rows], e))  # noqa: B023
                value += 0.5 * r * r if r < 1.5 else 1.5 * r - 1.125
            return float(value)

        x, V, weights = updated(Huber(k=1.5, iterations=100), m, P, sensor, z, kind)
        best = optimize.minimize(cost, x + 0.1 * rng.normal(size=3), tol=1e-12)
        assert cost(x) <= best.fun + 1e-12 * abs(best.fun)
        np.testing.assert_allclose(x, best.x, atol=1e-5 * np.abs(x).max())
        precise = np.linalg.inv(P)
        for w, rows in zip(weights, sensor.rows, strict=True):
            precise += w * H[rows].T @ np.linalg.solve(R[rows, rows], H[rows])
        np.testing.assert_allclose(V, np.linalg.inv(precise), rtol=1e-6)
        smallest.append(weights.min())
    assert min(smallest) < 0.5


@pytest.mark.parametrize("sizes", SIZES, ids=str)
@pytest.mark.parametrize("kind", ["ekf", "ckf"])
def test_the_variational_posterior_is_a_fixed_point(sizes: tuple[int, ...], kind: str) -> None:
    """Of the equations in information form, each sensor with a gamma law of its own."""
    rng = np.random.default_rng(6)
    for _ in range(2):
        m, P, H, R, sensor, z = random_case(rng, sizes)
        x, V, weights = updated(StudentT(df=3.0, iterations=100), m, P, sensor, z, kind)
        precise, information = np.linalg.inv(P), np.linalg.solve(P, m)
        for w, rows in zip(weights, sensor.rows, strict=True):
            e, inverse = z[rows] - H[rows] @ x, np.linalg.inv(R[rows, rows])
            squared = e @ inverse @ e + np.trace(inverse @ H[rows] @ V @ H[rows].T)
            assert w == pytest.approx((3.0 + len(e)) / (3.0 + squared), rel=1e-9)
            precise += w * H[rows].T @ inverse @ H[rows]
            information += w * H[rows].T @ inverse @ z[rows]
        np.testing.assert_allclose(x, np.linalg.solve(precise, information), rtol=1e-8)
        np.testing.assert_allclose(V, np.linalg.inv(precise), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("robust", UPDATES, ids=["huber", "student-t"])
def test_only_the_measured_part_counts(robust: Any) -> None:
    m, P, _, R, both, z = random_case(np.random.default_rng(7), (2, 1))
    first, second = both.sensors
    z[1] = np.nan
    half = replace(first, h={"z0": first.h["z0"]}, R=((R[0, 0],),))
    expected = updated(robust, m, P, StackedSensor((half, second)), z[[0, 2]])
    for one, other in zip(updated(robust, m, P, both, z), expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    # Without a measurement, and with one that has no noise, the weight is one.
    z[0] = np.nan
    assert updated(robust, m, P, both, z)[2][0] == 1.0
    exact = replace(second, R=((0.0,),))
    x, _, weights = updated(robust, m, P, exact, z[2:])
    assert weights == 1.0
    np.testing.assert_allclose(x, updated(Huber(k=1e9), m, P, exact, z[2:])[0])


def test_it_is_better_with_heavy_tails_and_costs_little_without() -> None:
    """Paired differences of 200 runs; what a tail of 2 degrees costs the plain filter, and back."""
    normal = replace(PLANE, last=50, sensor=PositionSensor(sigma=20.0))
    heavy = replace(PLANE, last=50, sensor=PositionSensor(sigma=20.0, outliers=HEAVY))
    for robust in (Huber(k=1.5), StudentT(df=4.0)):
        ratios = []
        for scenario in (heavy, normal):
            plain, other = (
                per_run(scenario, make_filter("kf", **keys), 200, "rmse_position")
                for keys in ({}, {"robust": robust})
            )
            gain = plain - other
            ratios.append(other.mean() / plain.mean())
            if scenario is heavy:
                assert gain.mean() > 5.0 * gain.std(ddof=1) / np.sqrt(200)
        assert ratios[0] < 0.9
        assert 1.0 < ratios[1] < 1.1


@pytest.mark.parametrize("robust", UPDATES, ids=["huber", "student-t"])
def test_the_contract(robust: Any) -> None:
    for kind, keys in (("kf", {}), ("ukf", {}), ("ekf", {"form": "square-root"})):
        tracker = make_filter(kind, robust=robust, **keys)
        findings = check_filter(type(tracker), tracker)
        assert [f for f in findings if f.verdict == "bad"] == []


def test_refusals() -> None:
    key = {"robust": StudentT()}
    (problem,) = refusals(make_filter("cmkf", **key), RADAR)
    assert "take ekf or mcaekf" in str(problem)
    heavy = FunctionSensor(h={"z": "px"}, noise=Noise(kind="student-t", df=4.0), R=1.0)
    heavy = heavy.for_state(PLANE.model.motion.components)
    (problem,) = refusals(make_filter("ekf", **key), replace(PLANE, sensor=heavy))
    assert "is not normal" in str(problem)


@pytest.mark.parametrize("robust", UPDATES, ids=["huber", "student-t"])
def test_a_gate_refuses_and_the_weights_are_of_the_rest(robust: Any) -> None:
    keys = ({"gate": 0.99}, {"gate": 0.99, "robust": robust})
    gated, both = (track(PLANE, make_filter("kf", **one), 20).diagnostics for one in keys)
    weight, refused = both["measurement_weight"], both["gated"] > 0.0
    assert refused.any()
    assert (gated["gated"] > 0.0)[1].tolist() == refused[1].tolist()
    np.testing.assert_array_equal(np.isnan(weight), np.isnan(both["nis"]))
    assert np.isnan(weight[refused]).all()
    assert np.nanmin(weight) < 0.8
