"""Square-root forms: equal to the usual one on a benign case, exact where that one fails."""

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter, track
from tests.filters.test_conflicts import refusals
from tests.papers import merwe
from trackbench.core.distributions import Factored, Gaussian
from trackbench.filters.smoother_keys import FixedLag
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import ConstantVelocity, WhiteAcceleration
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking

RADAR = Tracking(
    target=Driven(
        motion=WhiteAcceleration(q=2.0), launch=Launch(x=900.0, y=700.0, vx=-5.0, vy=4.0)
    ),
    sensor=RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=8.0, detection=0.8),
    start=GaussianStart(sigma=(60.0, 4.0, 60.0, 4.0)),
    last=12,
)
POSITION = replace(RADAR, sensor=PositionSensor(sigma=20.0, detection=0.8))
TWO = (ConstantVelocity(q=0.1), ConstantVelocity(q=9.0))
CASES: list[tuple[Any, str, dict[str, Any]]] = [
    (POSITION, "kf", {}),
    (POSITION, "kf", {"smooth": True, "fading": 1.05}),
    *(
        (RADAR, kind, {})
        for kind in ("ekf", "ckf", "ukf", "ghkf", "iekf", "mcaekf", "iplf", "cmkf")
    ),
    (RADAR, "ekf", {"order": 2, "fading": 1.05, "gate": 0.9}),
    (RADAR, "ukf", {"noise": "additive", "beta": 2.0, "smooth": True}),
    (RADAR, "ukf", {"smooth": FixedLag(lag=2)}),
    (merwe(T=20), "ekf", {}),
    (merwe(T=20), "ckf", {"Q": 0.5, "P0": 2.0}),
]


@pytest.mark.parametrize(("scenario", "kind", "keys"), CASES, ids=str)
def test_it_is_the_usual_form_on_a_benign_case(
    scenario: Any, kind: str, keys: dict[str, Any]
) -> None:
    usual, root = (
        track(scenario, make_filter(kind, form=form, **keys), 4, covariances=4,
              predictive_metrics=("score",))
        for form in ("covariance", "square-root")
    )  # fmt: skip
    scale = np.sqrt(np.einsum("iikm->ikm", usual.cov)[:, 1:])
    assert np.abs((root.mean - usual.mean)[:, 1:] / scale).max() < 1e-9
    scale = scale[:, None] * scale[None]
    assert np.abs((root.cov - usual.cov)[:, :, 1:] / scale).max() < 1e-9
    for name, values in usual.diagnostics.items():
        np.testing.assert_allclose(root.diagnostics[name], values, rtol=1e-8, atol=1e-9)
    assert "log_likelihood" in usual.diagnostics


def test_an_imm_of_square_roots() -> None:
    usual, root = (
        track(
            RADAR,
            make_filter(
                "imm",
                filter=make_filter("ekf", form=form),
                motions=TWO,
                transition=((0.9, 0.1), (0.1, 0.9)),
            ),
            4,
        )
        for form in ("covariance", "square-root")
    )
    np.testing.assert_allclose(root.mean, usual.mean, rtol=1e-8)
    np.testing.assert_allclose(root.diagnostics["mode"], usual.diagnostics["mode"], atol=1e-8)


Matrix = list[list[Fraction]]


def product(A: Matrix, B: Matrix) -> Matrix:
    columns = list(zip(*B, strict=True))
    return [
        [sum((a * b for a, b in zip(row, c, strict=True)), Fraction(0)) for c in columns]
        for row in A
    ]


def exact_means(d: float, measurements: np.ndarray) -> np.ndarray:
    """Means (3, K) of the Kalman filter of a constant in rational numbers, from N(0, I)."""
    one, H = Fraction(1), [[Fraction(1)] * 3, [Fraction(1)] * 2 + [1 + Fraction(d)]]
    P = [[one * (i == j) for j in range(3)] for i in range(3)]
    m, out = [[Fraction(0)] for _ in range(3)], []
    for z in measurements:
        PH = product(P, [list(c) for c in zip(*H, strict=True)])
        (a, b), (_, c) = product(H, PH)
        a, c = a + Fraction(d) ** 2, c + Fraction(d) ** 2
        det = a * c - b * b
        K = product(PH, [[c / det, -b / det], [-b / det, a / det]])
        nu = [[Fraction(float(v)) - h[0]] for v, h in zip(z, product(H, m), strict=True)]
        m = [[u[0] + v[0]] for u, v in zip(m, product(K, nu), strict=True)]
        KHP = product(product(K, H), P)
        P = [[p - q for p, q in zip(u, v, strict=True)] for u, v in zip(P, KHP, strict=True)]
        out.append([float(v[0]) for v in m])
    return np.array(out).T


@pytest.mark.parametrize("kind", ["kf", "ekf", "ckf", "ukf"])
@pytest.mark.parametrize("exponent", [-28, -35])
def test_two_nearly_equal_accurate_measurements(kind: str, exponent: int) -> None:
    """Two sums that differ by d, each with standard deviation d, where 1 + d^2 rounds to one.

    Bierman 1977 and Grewal & Andrews 2015, section 7.2: ``H P H' + R`` is singular in floating point.
    A factor has relative errors of some 2^-52 / d.
    """
    names, d = ("a", "b", "c"), 2.0**exponent
    model = Model(
        MapMotion(components=names, next={n: n for n in names}, Q=0.0).sampled(1.0),
        FunctionSensor(h={"u": "a + b + c", "v": f"a + b + {1.0 + d!r}*c"}, R=d * d, state=names),
    )
    H, x = np.array([[1, 1, 1], [1, 1, 1 + d]]), np.array([0.5, -0.25, 0.75])
    z = H @ x + d * np.array([[1.0, -0.5]])
    prior, rng = Gaussian(np.zeros((3, 1)), np.eye(3)), np.random.default_rng(1)
    errors = {}
    for form in ("covariance", "square-root"):
        tracker: Any = make_filter(kind, form=form)
        state = tracker.init(model, prior, rng)
        for k, row in enumerate(z, 1):
            with np.errstate(all="ignore"):
                state = tracker.step(model, state, row[:, None], k, rng)
        errors[form] = np.abs(state.posterior.mean - exact_means(d, z)[:, -1:]).max()
    assert errors["square-root"] < 100.0 * 2.0**-52 / d
    assert not errors["covariance"] < 0.1
    assert np.isfinite([state.nis, tracker.log_likelihood(state)]).all()


def test_points_keep_the_variance_of_an_accurate_measurement() -> None:
    """A scalar: P R / (P + R) with R = 2^-80 P, of which P - K S K' leaves nothing."""
    model = Model(
        MapMotion(components=("x",), next={"x": "x"}, Q=0.0).sampled(1.0),
        FunctionSensor(h={"z": "x"}, R=2.0**-80, state=("x",)),
    )
    prior, z = Gaussian(np.zeros((1, 1)), np.ones((1, 1))), np.ones((1, 1))
    for kind in ("kf", "ckf", "ukf"):
        root: Any = make_filter(kind, form="square-root")
        state = root.update(model, root.prepared(prior), z, 1)[0]
        assert isinstance(state, Factored)
        assert state.cov.item() == pytest.approx(2.0**-80, rel=1e-12)
    usual: Any = make_filter("ckf")  # by the squares over the points
    assert usual.update(model, prior, z, 1)[0].cov.item() == pytest.approx(2.0**-80, rel=1e-6)


@pytest.mark.parametrize(
    ("keys", "refused"),
    [
        ({"kappa": -1.0}, True),
        ({"kappa": -1.0, "beta": 2.0}, False),
        ({"alpha": 0.1, "kappa": 0.0, "noise": "additive"}, True),
        ({}, False),
    ],
)
def test_a_negative_center_weight_is_refused(keys: dict[str, Any], refused: bool) -> None:
    found = refusals(make_filter("ukf", form="square-root", **keys), RADAR)
    assert [p.path for p in found] == ["f.form"] * refused
    assert refusals(make_filter("ukf", **keys), RADAR) == []
