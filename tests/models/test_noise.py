"""Noise that filters know: against scipy's densities and laws, and sums over many states."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.poisson import draw_poisson, log_poisson
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_filter import run_filter
from trackbench.field_types import InvalidKeyError
from trackbench.models.likelihood import log_likelihood
from trackbench.models.motions.autoregressive import Autoregressive
from trackbench.models.sensors.base import Outliers
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.noise import Noise
from trackbench.models.sensors.position import ScalarSensor
from trackbench.models.sensors.stacked import StackedSensor
from trackbench.plugins.plugin_errors import message_of
from trackbench.scenarios.base import Simulation
from trackbench.scenarios.cramer_rao_bound import why_no_bound
from trackbench.scenarios.starts.gaussian import GaussianStart

LEVEL = 1e-3  # of the tests of draws, for a fixed seed
RUNS = 20_000
T4 = Noise(kind="student-t", df=4.0, scale=0.5)
CAUCHY = Noise(kind="student-t", df=1.0)
LONG = Noise(kind="student-t", df=7.3, scale=2.0)
MIXTURE = Noise(kind="mixture", outliers=0.1, factor=10.0)

CONFIG = """
name: noise
seed: 5
scenario:
  kind: tracking
  last: 10
  target: {{kind: driven, motion: {{kind: ar1, phi: 0.9, q: 0.3}}}}
  sensor: {sensor}
  start: {{kind: gaussian, sigma: [1]}}
filters: {{Exact: {{kind: grid, nodes: 256}}, Other: {other}}}
metrics: [rmse, log_score]
"""
PF = "{kind: pf, N: 2000}"
Density = Callable[[np.ndarray, Any], np.ndarray]


def mixture_cdf(e: np.ndarray) -> np.ndarray:
    return 0.9 * stats.norm.cdf(e) + 0.1 * stats.norm.cdf(e, scale=10.0)


def mixture_pdf(e: np.ndarray) -> np.ndarray:
    return 0.9 * stats.norm.pdf(e) + 0.1 * stats.norm.pdf(e, scale=10.0)


def sensor(h: str = "x", **keys: Any) -> FunctionSensor:
    return FunctionSensor(h={"z": h}, **keys).for_state(("x",))


@pytest.mark.parametrize("noise", [T4, CAUCHY, LONG])
def test_student_t_is_scipys(noise: Noise) -> None:
    e = np.concatenate([np.linspace(-30, 30, 1001), [1e-9, 1e6, -1e8]])
    expected = stats.t.logpdf(e, noise.df, scale=noise.scale)
    np.testing.assert_allclose(noise.log_density(e), expected, rtol=1e-10, atol=1e-10)


def test_a_mixture_is_scipys() -> None:
    e = np.linspace(-300, 300, 4001)
    logs = stats.norm.logpdf(e) + np.log(0.9), stats.norm.logpdf(e, scale=10.0) + np.log(0.1)
    np.testing.assert_allclose(MIXTURE.log_density(e), np.logaddexp(*logs), rtol=1e-10, atol=1e-10)


def test_poisson_is_scipys() -> None:
    z = np.array([0.0, 1.0, 2.0, 7.0, 50.0, 3000.0])[:, None]
    rate = np.array([1e-8, 0.3, 1.0, 9.5, 60.0, 3000.0])
    expected = stats.poisson.logpmf(z, rate)
    np.testing.assert_allclose(log_poisson(z, rate), expected, rtol=1e-10, atol=1e-10)
    # No count, no rate: probability zero; a rate of zero gives zero.
    assert np.isneginf(log_poisson(np.array([1.5, -1.0, 2.0]), np.array([1.0, 1.0, -1.0]))).all()
    zero_rate = log_poisson(np.array([0.0, 1.0]), np.zeros(2))
    np.testing.assert_allclose(zero_rate, [0.0, -np.inf], atol=1e-13)  # rounding of log Gamma


@pytest.mark.parametrize(
    ("noise", "cdf"),
    [
        (T4, stats.t(4, scale=0.5).cdf),
        (CAUCHY, stats.cauchy.cdf),
        (LONG, stats.t(7.3, scale=2.0).cdf),
        (MIXTURE, mixture_cdf),
    ],
)
def test_draws_follow_the_law(noise: Noise, cdf: Callable[[np.ndarray], np.ndarray]) -> None:
    rng = np.random.default_rng(7)
    e = noise.draw(rng.standard_normal((2, RUNS)), rng)
    assert all(stats.kstest(row, cdf).pvalue > LEVEL for row in e)
    # Components are independent: uncorrelated in size, by ranks.
    assert stats.spearmanr(*np.abs(e)).pvalue > LEVEL
    if noise.variance < np.inf and noise is not T4:  # whose square has no variance
        sem = np.square(e).std() / np.sqrt(e.size)
        assert abs(np.square(e).mean() - noise.variance) < 4.0 * sem


@pytest.mark.parametrize("rate", [0.0, 0.2, 3.0, 85.0, 1e4])
def test_counts_follow_the_law(rate: float) -> None:
    u = np.random.default_rng(8).random(RUNS)
    z = draw_poisson(np.full(RUNS, rate), u)
    # Inversion: scipy's quantile of the same uniforms, but where u is within rounding of an edge.
    assert np.mean(z != stats.poisson.ppf(u, rate)) <= (2e-4 if rate else 0.0)
    if rate:
        assert abs(z.mean() - rate) < 4.0 * np.sqrt(rate / RUNS)
        assert abs(z.var() / rate - 1.0) < 4.0 * np.sqrt((2.0 + 1.0 / rate) / RUNS)


def test_a_draw_of_one_run_does_not_depend_on_the_others() -> None:
    x = np.linspace(0.0, 3.0, 5)[None]
    for s in (sensor(noise=T4), sensor(noise=MIXTURE, R=1.0), sensor("exp(x)", noise="poisson")):
        together, alone = RunStreams(1, range(5)), RunStreams(1, [3])
        both = [
            s.measure(x[:, runs], 1, rng.standard_normal((1, x[:, runs].shape[1])), rng)
            for runs, rng in ((slice(None), together), (slice(3, 4), alone))
        ]
        np.testing.assert_array_equal(both[0][:, 3], both[1][:, 0])


@pytest.mark.parametrize("noise", [T4, LONG, MIXTURE])
def test_information_is_the_integral_of_the_squared_score(noise: Noise) -> None:
    def integrand(e: float) -> float:
        log_p = noise.log_density(np.array([e - 1e-4, e, e + 1e-4]))
        return float(np.exp(log_p[1]) * ((log_p[2] - log_p[0]) / 2e-4) ** 2)

    edges = [0.0, 1.0, 3.0, 10.0, 40.0, 1000.0]
    parts = [integrate.quad(integrand, a, b)[0] for a, b in pairwise(edges)]
    np.testing.assert_allclose(noise.information, 2.0 * sum(parts), rtol=1e-5)
    s = sensor("3*x", noise=noise, R=4.0)
    np.testing.assert_allclose(s.information(np.ones(1), 1), 9.0 / 4.0 * noise.information)


def test_moments_are_those_of_the_law() -> None:
    x = np.array([[0.5, 1.0, 2.0]])
    np.testing.assert_allclose(sensor(noise=T4).measurement(x, 1).cov, stats.t(4, scale=0.5).var())
    two = FunctionSensor(h={"a": "x", "b": "2*x"}, noise=MIXTURE, R={"a": 1.0, "b": 4.0})
    cov = two.for_state(("x",)).measurement(x, 1).cov
    np.testing.assert_allclose(cov, np.diag([10.9, 4 * 10.9]))
    count = sensor("exp(x)", noise="poisson").measurement(x, 1)
    np.testing.assert_allclose(count.cov[0, 0], np.exp(x[0]))
    np.testing.assert_allclose(count.mean, np.exp(x))


def test_missing_components_and_stacked_sensors_leave_a_sum() -> None:
    pair = FunctionSensor(h={"a": "x", "b": "2*x"}, noise=T4, R={"a": 1.0, "b": 4.0})
    normal = sensor(R=2.0)
    stacked = StackedSensor((pair.for_state(("x",)), normal))
    x = np.random.default_rng(1).normal(size=(1, 3, 4))
    z = np.array([[1.0, np.nan, 0.5], [2.0, 1.0, np.nan], [0.3, np.nan, 1.0]])
    parts = np.stack(
        [
            stats.t.logpdf(z[0][:, None] - x[0], 4, scale=0.5),
            stats.t.logpdf(z[1][:, None] - 2 * x[0], 4, scale=1.0),
            stats.norm.logpdf(z[2][:, None] - x[0], scale=np.sqrt(2.0)),
        ]
    )
    expected = np.nansum(parts, axis=0)
    np.testing.assert_allclose(log_likelihood(stacked, z, x, 1), expected, rtol=1e-10)


def test_joined_sensors_draw_as_filters_know_them() -> None:
    """Without the bias and the outliers of a sensor, as a single sensor does."""
    pair = (sensor(noise=T4), sensor(R=2.0))
    spoilt = (
        sensor(noise=T4, bias=(100.0,)),
        sensor(R=2.0, bias=(100.0,), outliers=Outliers(share=0.5, times=1e6)),
    )
    x = np.zeros((1, 50))
    noise = np.random.default_rng(1).normal(size=(2, 50))
    drawn = []
    for sensors in (pair, spoilt):
        rng = RunStreams(2, range(50))
        drawn.append(StackedSensor(sensors).draw_known(x, 1, noise.copy(), rng))
    np.testing.assert_array_equal(*drawn)


def outputs(
    folder: Path, sensor: str, other: str, *labels: str
) -> tuple[Simulation, list[FilterOutput]]:
    """Return the data of 20 runs, and the output of the filters of these labels."""
    (folder / "c.yaml").write_text(CONFIG.format(sensor=sensor, other=other))
    point = load(folder / "c.yaml").points[0]
    tasks = [
        BlockTask(point.scenario, point.filters[label], 3, 0, 20, 20, predictive_metrics=("score",))
        for label in labels
    ]
    with np.errstate(all="ignore"):
        return tasks[0].data, [run_filter(task, task.data) for task in tasks]


LATTICE: list[tuple[str, Density]] = [
    (
        "{kind: function, h: {z: x}, noise: {kind: student-t, df: 4, scale: 0.5}}",
        lambda z, x: stats.t.pdf(z - x, 4, scale=0.5),
    ),
    (
        "{kind: function, h: {z: x}, noise: {kind: student-t, df: 1.5}, R: 0.25}",
        lambda z, x: stats.t.pdf(z - x, 1.5, scale=0.5),
    ),
    (
        "{kind: function, h: {z: x}, noise: {kind: mixture, outliers: .1, factor: 10}, R: 0.25}",
        lambda z, x: 2.0 * mixture_pdf(2.0 * (z - x)),
    ),
    (
        "{kind: function, h: {z: 3*exp(x/2)}, noise: poisson}",
        lambda z, x: stats.poisson.pmf(z, 3.0 * np.exp(x / 2.0)),
    ),
    (
        "{kind: function, h: {z: 0}, R: 0.5*exp(x)}",
        lambda z, x: stats.norm.pdf(z, scale=np.sqrt(0.5 * np.exp(x))),
    ),
]


@pytest.mark.parametrize(("sensor", "density"), LATTICE)
def test_the_grid_is_a_sum_over_a_lattice(sensor: str, density: Density, tmp_path: Path) -> None:
    """Point masses from -14 to 14 at a spacing of 0.05, and particles within their own errors."""
    data, (exact, pf) = outputs(tmp_path, sensor, PF, "Exact", "Other")
    x = np.linspace(-14.0, 14.0, 561)
    kernel = stats.norm.pdf(x[:, None], 0.9 * x, np.sqrt(0.3)) * (x[1] - x[0])
    p = np.tile(stats.norm.pdf(x)[:, None] * (x[1] - x[0]), 20)
    scores = np.empty((11, 20))
    for k in range(1, 11):
        p = (kernel @ p) * density(data.measurements[0, k - 1], x[:, None])
        mass = p.sum(axis=0)
        scores[k] = np.log(mass)
        p /= mass
        np.testing.assert_allclose(exact.mean[0, k], x @ p, atol=1e-5)
    found = exact.diagnostics["log_likelihood"]
    np.testing.assert_allclose(found[1:], scores[1:], atol=1e-5)
    # Mean over 20 runs with independent particles; the bias of N particles is of order 1 / N.
    difference = (pf.diagnostics["log_likelihood"][1:] - scores[1:]).mean(axis=0)
    assert abs(difference.mean()) < 4.0 * difference.std(ddof=1) / np.sqrt(20) + 1.0 / 2000
    away = (pf.mean[0, 1:] - exact.mean[0, 1:]).mean(axis=0)
    assert abs(away.mean()) < 4.0 * away.std(ddof=1) / np.sqrt(20) + 1.0 / 2000
    assert away.std() < 0.035


@pytest.mark.parametrize("kind", ["kf", "ekf", "ukf"])
def test_gaussian_filters_take_the_moments(kind: str, tmp_path: Path) -> None:
    """Student's t of df 4 and scale 0.5 has the variance 0.5."""
    noisy, _ = LATTICE[0]
    normal = "{kind: function, h: {z: x}, R: 0.5}"
    other = f"{{kind: {kind}, assume: {{sensor: {normal}}}}}"
    _, (by_moments,) = outputs(tmp_path, noisy, f"{{kind: {kind}}}", "Other")
    _, (by_variance,) = outputs(tmp_path, noisy, other, "Other")
    np.testing.assert_allclose(by_moments.mean, by_variance.mean, rtol=1e-12, atol=1e-12)


BOUND = """
name: bound
scenario:
  kind: tracking
  last: 10
  target: {{kind: driven, motion: {{kind: ar1, phi: 0.9, q: 0.3}}}}
  sensor: {{kind: function, h: {{z: x}}, {keys}}}
  start: {{kind: gaussian, sigma: [1]}}
filters: {{PF: {{kind: pf}}}}
metrics: [rmse]
"""


def scenario(keys: str, folder: Path) -> Any:
    (folder / "b.yaml").write_text(BOUND.format(keys=keys))
    return load(folder / "b.yaml").points[0].scenario


def test_the_bound_uses_the_information_of_the_law(tmp_path: Path) -> None:
    """J' = 1 / (0.3 + 0.81 / J) + 5 / 7 / 0.25 for Student's t of df 4 and scale 0.5."""
    s = scenario("noise: {kind: student-t, df: 4, scale: 0.5}", tmp_path)
    assert s.why_no_bound is None
    J = 1.0
    for _ in range(10):
        J = 1.0 / (0.3 + 0.81 / J) + 5.0 / 7.0 / 0.25
    (bound,) = s.bounds().values()
    np.testing.assert_allclose(bound[-1], J**-0.5, rtol=1e-12)


def test_the_bound_is_refused_where_noise_depends_on_the_state(tmp_path: Path) -> None:
    why = scenario("R: exp(x)", tmp_path).why_no_bound
    assert "depends on the state" in why
    assert scenario("R: exp(k/10)", tmp_path).why_no_bound is None


@dataclass(frozen=True)
class NoiselessPerState(ScalarSensor):
    """Sensor like that of a plugin, with a covariance (1, 1, *batch), which is zero."""

    def measurement(self, x: Array, k: int) -> Gaussian:
        return Gaussian(x, np.zeros((1, *x.shape)))


def test_the_bound_is_refused_without_noise_whatever_the_shape_of_its_covariance() -> None:
    why = why_no_bound(
        Autoregressive(phi=0.5, q=1.0).sampled(1.0),
        NoiselessPerState(sigma=1.0),
        GaussianStart(sigma=(1.0,)),
        n_x=1,
        is_recorded=False,
        has_faults=False,
    )
    assert why == "a component of the measurement has no noise (R is singular)"


@pytest.mark.parametrize(
    ("h", "keys", "where"),
    [
        ("x", {"R": "x"}, "R: step 3: the variance of z is -0.5 at x = -0.5"),
        ("x", {"R": "x", "noise": T4}, "R: step 3: the variance of z is -0.5 at x = -0.5"),
        ("log(x)", {"R": 1.0}, "h: step 3: z is no number at x = -0.5"),
    ],
)
def test_a_measurement_that_is_no_number_is_not_taken_for_a_missing_one(
    h: str, keys: dict[str, Any], where: str
) -> None:
    """A true state that is unknown has no measurement, which is no mistake."""
    known = sensor(h, **keys)
    rng = RunStreams(1, range(3))
    z = known.measure(np.array([[2.0, np.nan, 0.5]]), 3, np.zeros((1, 3)), rng)
    assert np.isnan(z).tolist() == [[False, True, False]]
    with pytest.raises(InvalidKeyError) as caught:
        known.measure(np.array([[2.0, -0.5, np.nan]]), 3, np.zeros((1, 3)), rng)
    assert message_of(caught.value).startswith(where)
