"""The C kernels give the bytes of the numpy code, for ordinary and for special numbers."""

import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.random import SFC64

from tests.papers import merwe
from trackbench.core import (
    arrays,
    compiled,
    differential_evolution,
    elementary,
    kalman,
    linalg,
    mixtures,
    particle_weights,
    particles,
    read_only,
    regularization,
    resampling,
    sigma_points,
    sums,
)
from trackbench.core.build_compiled import BUILT
from trackbench.core.distributions import Gaussian, zero_mean_log_prob
from trackbench.core.gamma_noise import Gamma
from trackbench.core.line_of_sight import along_line_of_sight
from trackbench.core.particles import displaced
from trackbench.core.random_streams import SomeRuns, block_stream
from trackbench.core.random_variates import NoiseGenerator
from trackbench.core.regularization import Mode, jitter_modes
from trackbench.core.sums import WindowSums
from trackbench.filters.assumed_noise import AssumedNoise
from trackbench.filters.base import Steps
from trackbench.filters.kf import KF
from trackbench.filters.sigma_point_steps import additive_step, augmented_step
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.position import PositionSensor, ScalarSensor, VelocitySensor
from trackbench.models.sensors.stacked import StackedSensor

pytestmark = pytest.mark.skipif(compiled.kernels is None, reason="no C compiler")
SPECIAL = np.array(
    [
        *(0.0, -0.0, 1.0, -1.0, 5e-324, -3e-310, 2.3e-308, 1e308, np.inf, -np.inf, np.nan),
        *(-708.0, -708.1, 709.7, 709.8, 1e6, 1.1e6, 1e300, 0.75, 1.5, 1 / 32, 3.0, np.pi),
    ]
)


EDGES = (127, 128, 255, 256, 511, 512, 513, 4095, 4096, 5000)
"""Lengths about those of blocks and pieces."""


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Call a function by numpy and by the kernels and compare all bytes but the payload of NaN."""

    def compare(function: Callable[..., object], *arguments: object, **keys: object) -> None:
        with monkeypatch.context() as patch, np.errstate(all="ignore"):
            got = _arrays(function(*arguments, **keys))
            patch.setattr(compiled, "kernels", None)
            expected = _arrays(function(*arguments, **keys))
        assert len(got) == len(expected)
        assert not any(a.dtype == object for a in got)
        for a, b in zip(got, expected, strict=True):
            assert a.shape == b.shape
            assert a.dtype == b.dtype
            nan = np.isnan(a) if a.dtype == float else np.zeros(a.shape, dtype=bool)
            np.testing.assert_array_equal(nan, b != b)
            assert a[~nan].tobytes() == b[~nan].tobytes()

    return compare


def draws_of(
    rng: np.random.Generator, special: float, decades: int = 0
) -> Callable[..., np.ndarray]:
    """Return a function that draws arrays of normal numbers, of which a share is special."""

    def draw(*shape: int) -> np.ndarray:
        values = 10.0 ** rng.integers(-decades, decades, shape, endpoint=True)
        values *= rng.standard_normal(shape)
        return np.where(rng.random(shape) < special, rng.choice(SPECIAL, shape), values)

    return draw


def _arrays(result: object) -> list[np.ndarray]:
    if isinstance(result, Gaussian):
        return [result.mean, result.cov]
    parts = result if isinstance(result, tuple | list) else [result]
    return [a for p in parts for a in (_arrays(p) if isinstance(p, tuple) else [np.asarray(p)])]


@pytest.mark.parametrize("name", ["exp", "log", "cos_sin"])
def test_elementary_functions(name: str, both: Callable[..., None]) -> None:
    rng = np.random.default_rng(1)
    function = getattr(elementary, name)
    both(function, SPECIAL)
    for scale in (1e-300, 1e-3, 1.0, 300.0, 2e6):
        x = scale * rng.standard_normal(20_001)
        both(function, x)
    any_bits = rng.integers(0, 2**63, 20_001).view(float)
    both(function, any_bits)
    both(function, -any_bits)


def test_arctan2(both: Callable[..., None]) -> None:
    y, x = (a.ravel() for a in np.meshgrid(SPECIAL, SPECIAL))
    both(elementary.arctan2, y, x)
    rng = np.random.default_rng(2)
    for scale in (1e-9, 0.03, 1.0, 1e9):
        a, b = rng.standard_normal((2, 20_001))
        both(elementary.arctan2, scale * a, b)


@pytest.mark.parametrize("sensor", ["scalar", "position", "position and velocity"])
@pytest.mark.parametrize("runs", [1, 50, 700])
def test_all_steps_of_a_kalman_filter(sensor: str, runs: int, both: Callable[..., None]) -> None:
    # Four measured components are left to the steps, one by one.
    model = Model(ConstantVelocity(q=0.3).sampled(0.7), _SENSORS[sensor])
    rng = np.random.default_rng(runs)
    z = rng.normal(scale=100.0, size=(len(model.sensor.components), 30, runs))
    gappy = z.copy()  # steps without a measurement, the last among them, and one without its first
    gappy[:, [0, 7, 8, 29]], gappy[0, 20] = np.nan, np.nan
    singular = np.diag([4.0, 0.0, 1e-9, 0.0])
    for cov in (np.eye(4), singular, np.zeros((4, 4))):
        prior = Gaussian(rng.normal(size=(4, runs)), cov)
        both(lambda prior=prior: _filtered(KF(), model, prior, z))
        both(lambda prior=prior: _filtered(KF(), model, prior, gappy))
        both(lambda prior=prior: _filtered(KF(smooth=True), model, prior, z))


def test_what_all_steps_leaves_to_single_steps() -> None:
    model = Model(ConstantVelocity(q=0.3).sampled(1.0), _SENSORS["position"])
    rng, z = np.random.default_rng(1), np.zeros((2, 3, 5))
    state = KF().init(model, Gaussian(np.zeros((4, 5)), np.eye(4)), rng)
    assert _steps_of(KF().all_steps(model, state, z, 1)) == 3
    missing = np.where(np.arange(5) == 2, np.nan, z)
    huge = np.full(z.shape, 1e308)  # its square is beyond the numbers, but nothing is NaN
    assert KF().all_steps(model, state, missing, 1) is None
    assert _steps_of(KF().all_steps(model, state, np.full(z.shape, np.nan), 1)) == 3
    assert _steps_of(KF().all_steps(model, state, huge, 1)) == 3
    assert KF().all_steps(model, state, huge * np.array([[[1.0]] * 3, [[np.inf]] * 3]), 1) is None
    for other in (KF(gate=0.99), KF(fading=1.1), KF(form="square-root"), _OtherKF()):
        assert other.all_steps(model, state, z, 1) is None
    F, Q = np.asfortranarray(model.motion.F), np.asfortranarray(model.motion.Q)
    turned = Model(replace(model.motion, F=F, Q=Q), model.sensor)
    columns, rows = (KF().all_steps(m, state, z, 1) for m in (turned, model))
    assert columns
    assert rows
    assert columns.estimate.mean.tobytes() == rows.estimate.mean.tobytes()
    per_run = KF().init(model, Gaussian(np.zeros((4, 5)), np.ones((4, 4, 5))), rng)
    assert KF().all_steps(model, per_run, z, 1) is None


def _steps_of(steps: Steps | None) -> int:
    return 0 if steps is None else steps.estimate.mean.shape[1]


class _OtherKF(KF):
    """A filter of a user's, whose `update` must be called."""


_SENSORS = {
    "scalar": ScalarSensor(sigma=2.0),
    "position": PositionSensor(sigma=3.0),
    "position and velocity": StackedSensor((PositionSensor(sigma=3.0), VelocitySensor(sigma=1.0))),
}


def _filtered(tracker: KF, model: Model, prior: Gaussian, z: np.ndarray) -> list[np.ndarray]:
    """Arrays of every state, by all steps at once where the filter can, else one by one."""
    rng = np.random.default_rng(1)
    states = [tracker.init(model, prior, rng)]
    known = tracker.all_steps(model, states[0], z, 1)
    for k in range(z.shape[1]):
        after = known.state(k) if known else tracker.step(model, states[-1], z[:, k], k + 1, rng)
        states.append(after)
    if tracker.smooths:
        states = tracker.smoothed(model, states, 0, rng)
    return [
        a
        for s in states[1:]
        for a in (s.posterior.mean, s.posterior.cov, s.nis, s.innovation.nu, s.innovation.S)
    ]


@pytest.mark.parametrize("size", [1, 3, (7, 50), (4, 100, 333), 16_384, 16_385, 40_001])
def test_variates(size: object, both: Callable[..., None]) -> None:
    both(lambda: block_stream(3, 4).standard_normal(size))
    for shape in (1, 2, 3, 8):
        both(lambda shape=shape: NoiseGenerator(SFC64(5)).standard_gamma(shape, size))
        both(_state_after_gamma, shape, size)


def _state_after_gamma(shape: int, size: object) -> np.ndarray:
    rng = NoiseGenerator(SFC64(5))
    rng.standard_gamma(shape, size)
    return rng.bit_generator.state["state"]["state"]


@pytest.mark.parametrize("runs", [1, 2, 50, 1000])
def test_sums_over_windows_in_pieces(runs: int, both: Callable[..., None]) -> None:
    rows = np.random.default_rng(runs).normal(size=(40, runs))
    rows[:5, 0] = -0.0
    with_gaps = np.where(rows > 1.0, np.nan, rows)
    for values in (rows, with_gaps, -np.zeros((40, runs)), np.full((40, runs), np.inf)):
        both(_in_pieces, values, [40])
        both(_in_pieces, values, [0, 1, 3, 40])
    whole, pieces = _in_pieces(with_gaps, [40]), _in_pieces(with_gaps, [1, 2, 17, 40])
    assert whole[0].tobytes() == pieces[0].tobytes()
    np.testing.assert_array_equal(whole[1][0], (~np.isnan(with_gaps)).sum(axis=0))
    np.testing.assert_array_equal(whole[1][2], (~np.isnan(with_gaps[::3])).sum(axis=0))


def _in_pieces(rows: np.ndarray, ends: list[int]) -> list[np.ndarray]:
    k = np.arange(40)
    sums = WindowSums(np.stack([k >= 0, (k > 1) & (k < 30), k % 3 == 0]), rows.shape[1])
    for first, end in zip([0, *ends], ends, strict=False):
        sums.add(rows[first:end], first)
    return [sums.total, sums.number]


def test_distances_with_a_covariance_for_each_step(both: Callable[..., None]) -> None:
    rng = np.random.default_rng(3)
    for n in (1, 2, 4, 6):
        A, e = rng.normal(size=(2, n, n, 7)), rng.normal(size=(n, 7, 600))
        P = np.einsum("ijs,kjs->iks", A[0], A[0])
        P[..., 0], P[..., 1], P[0, 0, 2] = np.eye(n), 0.0, np.nan
        e[0, 3, 4], e[-1, 0, 5], e[0, 0, 6] = np.nan, np.inf, -0.0
        both(linalg.distance, e, P[..., None])
        both(linalg.distance, e[:, 1:3], P[..., 1:3, None])
        # Each step alone has the same distances.
        together = linalg.distance(e, P[..., None])
        for i in range(1, 7):
            alone = linalg.distance(e[:, i : i + 1], P[..., i : i + 1, None])
            assert together[i].tobytes() == alone.tobytes()


@pytest.mark.parametrize("n", [0, 1, 2, 7, 100, 127, 255, 256, 300, 4095, 4096, 5000, 10_001])
def test_sums(n: int, both: Callable[..., None]) -> None:
    rng = np.random.default_rng(n)
    a, w = rng.standard_normal((3, 21, n)), rng.random((21, n))
    both(sums.total, a)
    both(sums.total, a[0, 0])
    both(sums.total, -0.0 * w)
    both(sums.dot, a, w)
    both(sums.dot, w, a)
    both(sums.dot, w[::2], w[1::2][:1])
    both(sums.dot, w, w)
    both(sums.total, np.where(w > 0.9999, np.inf, w))


@pytest.mark.parametrize("N", [1, 7, 8, 9, 10, 63, 64, 300, *EDGES])
def test_weights_and_resampling(N: int, both: Callable[..., None]) -> None:
    rng = np.random.default_rng(N)
    log_w = 30.0 * rng.standard_normal((9, N))
    log_w[1], log_w[2, -1], log_w[3, 0], log_w[4, :-1] = -np.inf, np.nan, np.inf, -1e5
    both(particle_weights.normalize, log_w)
    w = particle_weights.normalize(log_w).w
    x = rng.standard_normal((4, 9, N))
    both(lambda: particles.Particles(x, w).moments())
    both(lambda: particles.Particles(x, particle_weights.equal_weights(9, N)).moments())
    for size in (None, 1, 2 * N):
        both(lambda size=size: resampling.ancestors(w, block_stream(1, 2), size=size))
    index = resampling.ancestors(w, block_stream(1, 2))
    both(resampling.select, x, index)
    both(resampling.select, x[:, ::-1], index)


@pytest.mark.parametrize("N", [1, 2, 9, *EDGES])
@pytest.mark.parametrize("special", [False, True])
def test_moves_of_particles(N: int, special: bool, both: Callable[..., None]) -> None:
    rng = np.random.default_rng(N)
    draw = draws_of(rng, 0.3 * special)
    x, a, azimuth = draw(4, 3, N), draw(4, 4, 3), draw(3)
    singles = rng.standard_normal(x.shape).astype(np.float32)
    # Kernel smoothing of all particles and of two modes; also of masks that the kernel cannot use.
    covs = [linalg.sandwich(a, np.eye(4)), np.zeros((4, 4, 3)), draw(4, 4, 3)]
    up, share = x[1] > 0.0, np.array([0.2, 0.0, 0.9])
    modes = [Mode(up, share, covs[0]), Mode(~up, 1.0 - share, covs[2])]
    broadcast = [Mode(up[:, :1], share, covs[0]), Mode((2 * up).astype(int), share, covs[0])]
    for kernel in ("gaussian", "epanechnikov"):
        both(lambda k=kernel: regularization.kernel_draws(k, x.shape, block_stream(1, 2)))
        for cov in covs:
            both(lambda k=kernel, c=cov: regularization.jitter(x, c, k, block_stream(1, 2)))
        for part in (modes, broadcast):
            both(lambda k=kernel, m=part: jitter_modes(x, m, k, block_stream(1, 2)))
        both(lambda k=kernel: jitter_modes(x[::2], [Mode(None, None, a[:2, :2])], k, _runs(3)))
    # Positions in the frame of a line of sight.
    for px, py in ((x[0], x[2]), (x[0, :, ::-1], x[2]), (singles[0], x[2])):
        both(along_line_of_sight, azimuth, px, py)
    both(along_line_of_sight, azimuth, x[0, :1], x[2, :1])
    both(along_line_of_sight, azimuth[:1], x[0], x[2])
    for particle_states in (x, x[:, ::-1], singles):
        both(displaced, particle_states, 0.7, particle_states[:2], 0.3)


def _runs(count: int) -> SomeRuns:
    return SomeRuns(block_stream(1, 2), 5, range(count))


@pytest.mark.parametrize("batch", [(1,), (5,), (50,), (3, 401)])
def test_matrices(batch: tuple[int, ...], both: Callable[..., None]) -> None:
    rng = np.random.default_rng(len(batch))
    A, B = rng.standard_normal((2, 4, 4, *batch))
    F = np.array([[1.0, 2.0, 0.0, 0.0], [0, 1, 0, 0], [0, 0, 0, 0], [0.5, -0.0, 3, np.e]])
    P = linalg.sandwich(A, np.eye(4)) + 0.0
    P[:, :, ..., 0] = 0.0
    P[1, 1, ..., -1] = -1.0
    x = rng.standard_normal((4, *batch))
    for M in (A, F, A[:3], F[1:3]):
        both(linalg.matvec, M, x)
        both(linalg.matmul, M, B)
        both(linalg.matmul, M, linalg.transpose(B))
        both(linalg.sandwich, M, P)
    both(linalg.matmul, A, F)
    both(linalg.sandwich, A, F @ F.T)
    both(linalg.matvec, F, np.where(x > 1.0, np.inf, x))
    both(lambda: linalg.matvec(F, x.astype(int)))
    both(linalg.cholesky, P)
    both(linalg.root, P)
    both(lambda: linalg.whiten(linalg.cholesky(P), x))
    both(linalg.whiten, np.linalg.cholesky(F @ F.T + np.eye(4)), x)
    both(linalg.mahalanobis, x, P)
    both(linalg.inverse, P[:3, :3])
    if len(batch) == 1:
        cloud = rng.standard_normal((4, *batch, 30))
        both(linalg.lower_product, A, cloud)
    points = sigma_points.Unscented(0.5, 2.0, 0.0).points(Gaussian(x, P))
    both(points.moments, np.cos(points.x))
    both(points.cross, points.x, x, np.cos(points.x[:2]), x[1:3])
    both(lambda: sigma_points.Unscented(0.5, 2.0, 0.0).points(Gaussian(x, F @ F.T)))
    both(lambda: sigma_points.Unscented(1.0, 0.0, 2.0).points(Gaussian(x[:, ..., 0], F @ F.T)))


@pytest.mark.parametrize("special", [0.0, 0.05])
@pytest.mark.parametrize("n", [9, 10, 23])
def test_large_matrices_run_by_run(n: int, special: float, both: Callable[..., None]) -> None:
    draw = draws_of(np.random.default_rng(n), special)
    cloud = draw(n, 3, 40)
    both(linalg.matvec, draw(n, n, 3, 1), cloud)
    both(linalg.matvec, draw(2 * n, n, 3, 1), cloud)
    both(linalg.matvec, draw(n, n, 3, 1), draw(40, 3, n).T)
    root = np.where(np.tri(n, dtype=bool)[:, :, None], draw(n, n, 3), 0.0)
    both(linalg.whiten, root[..., None], cloud)
    with np.errstate(all="ignore"):
        S = linalg.matmul(root, linalg.transpose(root))
    S[-1, -1, 0] = -1.0
    both(linalg.inverse, S)
    both(linalg.inverse, np.where(np.eye(n, dtype=bool)[..., None], S, 0.0))


def test_large_matrices_go_to_the_kernels_run_by_run(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    A = rng.standard_normal((23, 23, 3, 1))
    calls = []

    class Counted:
        def __getattr__(self, name: str) -> Callable[..., bool]:
            calls.append(name)
            return getattr(compiled_kernels, name)

    compiled_kernels = compiled.kernels
    monkeypatch.setattr(compiled, "kernels", Counted())
    linalg.matvec(A, rng.standard_normal((23, 3, 40)))
    assert calls.count("product") == 1 + 3
    linalg.inverse(linalg.matmul(A[..., 0], linalg.transpose(A[..., 0])))
    assert calls.count("whiten") == 3


@pytest.mark.parametrize("batch", [(), (1,), (50,), (3, 401)])
@pytest.mark.parametrize("n_z", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 7, 9])
@pytest.mark.parametrize("special", [False, True])
def test_kalman_updates(
    batch: tuple[int, ...], n_z: int, n: int, special: bool, both: Callable[..., None]
) -> None:
    rng = np.random.default_rng(100 * n + n_z)
    draw = draws_of(rng, 0.2 * special)

    def spread(size: int, *shape: int) -> np.ndarray:
        values = draw(size, size, *shape)
        return values if special else linalg.matmul(values, linalg.transpose(values))

    P, K = spread(n, *batch), draw(n, n_z, *batch)
    sparse = np.where(rng.random((n_z, n)) < 0.5, 0.0, draw(n_z, n))
    # The functions themselves, without the cache of `once`.
    gain, joseph = inspect.unwrap(kalman.gain), inspect.unwrap(kalman._joseph)
    for H in (draw(n_z, n, *batch), sparse, np.eye(n_z, n)):
        for R in (spread(n_z, *batch), spread(n_z), np.diag([0.5, -0.0, 2.0][:n_z])):
            both(gain, P, H, R)
            both(joseph, P, K, H, R)
            both(gain, linalg.transpose(P), H, linalg.transpose(R))


@pytest.mark.parametrize("batch", [(1,), (50,), (3, 401)])
@pytest.mark.parametrize("special", [False, True])
def test_updates_by_points(
    batch: tuple[int, ...], special: bool, both: Callable[..., None]
) -> None:
    draw = draws_of(np.random.default_rng(7), 1.0 * special)
    for n in (1, 2, 4, 7):
        for n_z in (1, 2, 3):
            m, nu, C = draw(n, *batch), draw(n_z, *batch), draw(n, n_z, *batch)
            P, S = np.abs(draw(n, n, *batch)), np.abs(draw(n_z, n_z, *batch))
            state = Gaussian(m, P)
            both(kalman.condition, state, nu, C, S)
            turned = linalg.transpose(np.ascontiguousarray(linalg.transpose(C)))
            both(kalman.condition, state, nu, turned, S)


@pytest.mark.parametrize("special", [False, True])
@pytest.mark.parametrize("batch", [(7,), (40, 30)])
def test_steps_by_points_of_scalars(
    batch: tuple[int, ...], special: bool, both: Callable[..., None]
) -> None:
    rng = np.random.default_rng(8)
    model, rule = merwe().model, sigma_points.Unscented(1.0, 0.0, 2.0)

    def step(state: Gaussian, z: np.ndarray, k: int, noise: AssumedNoise) -> tuple[object, ...]:
        posterior, innovation = augmented_step(model, state, z, k, noise, rule)
        return posterior.mean, posterior.cov, innovation.nu, innovation.S

    for _ in range(20):
        x, P = rng.standard_normal((1, *batch)), rng.standard_normal((1, 1, *batch)) ** 2
        z = rng.standard_normal((1, batch[0]))
        if special:
            arrays_of_both = ((a, rng.choice(SPECIAL, a.shape)) for a in (x, P, z))
            x, P, z = (np.where(rng.random(a.shape) < 0.5, a, s) for a, s in arrays_of_both)
        for k in (3, 40):
            for noise in (AssumedNoise(), AssumedNoise(Q=0.7, R=2.0, noise_mean=False)):
                both(lambda x=x, P=P, z=z, k=k, noise=noise: step(Gaussian(x, P), z, k, noise))


@pytest.mark.parametrize("returned", [np.int64, np.float32, "noise of the state", "one for all"])
def test_steps_by_points_of_a_sensor_of_other_arrays(
    returned: type | str, both: Callable[..., None]
) -> None:
    rng = np.random.default_rng(9)
    model = Model(merwe().model.motion, _Other(returned))
    state = Gaussian(rng.normal(size=(1, 7)), np.ones((1, 1, 7)))
    rule = sigma_points.Unscented(1.0, 0.0, 2.0)
    z, noise = np.zeros((1, 7)), AssumedNoise()
    both(lambda: augmented_step(model, state, z, 3, noise, rule)[0])
    if returned != "one for all":
        both(lambda: additive_step(model, state, z, 3, noise, rule)[0])
        return
    with pytest.raises(IndexError):  # of numpy, not what stands behind the array
        additive_step(model, state, z, 3, noise, rule)


@pytest.mark.parametrize("dtype", [np.int64, np.float32])
def test_particles_of_other_numbers(dtype: type, both: Callable[..., None]) -> None:
    rng = np.random.default_rng(10)
    x = (10 * rng.standard_normal((2, 5, 80))).astype(dtype)
    both(lambda: particle_weights.normalize(x[0]).w)
    both(lambda: particles.Particles(x, particle_weights.equal_weights(5, 80)).moments())
    L = np.tril(np.abs(x[:, :, :2].swapaxes(1, 2)))
    both(linalg.lower_product, L, x)
    w = np.abs(x[0]) / np.abs(x[0]).sum(axis=1, keepdims=True)
    both(lambda: resampling.ancestors(w, block_stream(1, 1)))
    both(lambda: elementary.exp(0.01 * x, out=np.empty(x.shape, dtype=np.float32)))


@dataclass(frozen=True, kw_only=True)
class _Other(SensorBase):
    """A sensor of a plugin, whose measurement has another type of number or no batch."""

    returned: type | str
    components = ("z",)

    def __init__(self, returned: type | str) -> None:
        object.__setattr__(self, "returned", returned)

    def measurement(self, x: np.ndarray, k: int) -> Gaussian:
        if self.returned == "noise of the state":
            return Gaussian(np.sin(x), 1.0 + np.square(x)[None])
        mean = np.zeros((1, 1, 1)) if isinstance(self.returned, str) else x.astype(self.returned)
        return Gaussian(mean, np.ones((1, 1)))


@pytest.mark.parametrize("runs", [1, 50, 700])
@pytest.mark.parametrize("special", [False, True])
def test_mixtures_and_distances(runs: int, special: bool, both: Callable[..., None]) -> None:
    draw = draws_of(np.random.default_rng(runs), 1.0 * special)
    for n in (1, 2, 4, 7):
        w = np.abs(draw(3, 3, runs))
        states = [Gaussian(draw(n, runs), draw(n, n, runs)) for _ in range(3)]
        shared = [Gaussian(s.mean[::-1], s.cov[..., 0]) for s in states]
        mixed = [states[0], shared[1], Gaussian(states[2].mean, states[2].cov[:, ::-1])]
        for each in (states, shared, mixed):
            both(mixtures.combine, each, w[:, 1])
            both(mixtures.combine, each, w[..., 0, ::-1], [[0], [], []])
        for L in (states[0].cov, shared[0].cov, linalg.transpose(states[0].cov)):
            both(linalg.mahalanobis, states[1].mean, L, L)
        both(linalg.mahalanobis, states[0].mean, states[0].cov)


@pytest.mark.parametrize("batch", [(1,), (50,), (3, 401)])
@pytest.mark.parametrize("special", [False, True])
def test_log_densities(batch: tuple[int, ...], special: bool, both: Callable[..., None]) -> None:
    draw = draws_of(np.random.default_rng(9), 0.4 * special, decades=3)
    for n in (1, 2, 4, 7):
        e = draw(n, *batch)
        for L in (draw(n, n, *batch), draw(n, n), np.eye(n), -np.eye(n, dtype=int)):
            both(zero_mean_log_prob, e, L, L)
            both(lambda L=L, e=e: zero_mean_log_prob(e, L, L.swapaxes(0, 1)))
        P = np.abs(draw(n, n, *batch))
        both(zero_mean_log_prob, e, P)
        both(zero_mean_log_prob, e[..., ::-1], P)
    for gamma in (Gamma(3.0, 2.0), Gamma(0.7, 1e-3), Gamma(1.0, 5.0)):
        for v in (draw(*batch), draw(2, *batch).T, SPECIAL):
            both(gamma.log_density, v)


def test_nan_is_found(both: Callable[..., None]) -> None:
    for a in (
        SPECIAL,
        SPECIAL[:-15],
        SPECIAL[::2],
        *np.array([[1.0, np.inf], [-np.inf, 2.0], [np.nan, 0.0], [1e308, -0.0]]),
        np.array([1.0, np.nan], dtype=np.float32),
        np.zeros((0, 3)),
        np.arange(3),
        np.nan * SPECIAL,
    ):
        both(arrays.any_nan, a)
        both(arrays.any_nan, a[None, :, None].T)
        both(arrays.all_finite, a)
        both(arrays.all_finite, a[None, :, None].T)
        assert arrays.all_finite(a) == np.isfinite(a).all()
        assert arrays.any_nan(a) == np.isnan(a).any()


def test_choices_and_pairs(both: Callable[..., None]) -> None:
    rng = np.random.default_rng(11)
    a, b = rng.choice(SPECIAL, (2, 3, 8, 40))
    mask = rng.random((8, 40)) < 0.5
    for yes, no in ((a, b), (a[0], b[0]), (a[:, ::-1], b), (a, b[:1]), (a, (2 * mask).astype(int))):
        both(arrays.choose, mask, yes, no)
    both(arrays.choose, mask[:, :1], a, b)
    both(arrays.choose, mask[:, :0], a[..., :0], b[..., :0])
    for N in (3, 10, 300):
        both(lambda N=N: differential_evolution.distinct_pairs(7, N, block_stream(3, N)))


def test_roots_of_one_variance(both: Callable[..., None]) -> None:
    for P in (SPECIAL[None, None], np.tile(SPECIAL, (1, 1, 3, 60)), SPECIAL[None, None, ::-1]):
        both(linalg.cholesky, P)
        both(linalg.root, P)


def test_constant_matrices(both: Callable[..., None]) -> None:
    rng = np.random.default_rng(1)
    for n in (1, 2, 4, 7):
        for A in (rng.standard_normal((n, 4)), rng.choice(SPECIAL, (n, 4)), -np.zeros((n, 4))):
            for B in (
                rng.standard_normal((4, 4)),
                rng.choice(SPECIAL, (4, 4)),
                np.eye(4, dtype=int),
            ):
                both(linalg.matmul, A, B)
                both(linalg.matmul, A[:, ::2], B[::-2].T[::2].T)
                both(linalg.sandwich, A, B)
                both(lambda A=A, B=B: linalg.sandwich(A, linalg.symmetrize(B)))
    for n in (8, 9, 16):  # numpy adds eight terms by the layout
        A, B = rng.standard_normal((2, n, n))
        both(linalg.matmul, A, B.T)
        both(linalg.sandwich, A, B)


def test_matrices_that_do_not_fit_are_errors() -> None:
    P, wide, narrow = np.ones((4, 4, 50)), np.ones((2, 5)), np.ones((2, 3))
    for call in (
        lambda: linalg.matmul(wide, P),
        lambda: linalg.sandwich(wide, P),
        lambda: kalman.gain(P, wide, np.eye(2)),
        lambda: linalg.matmul(narrow, P[..., 0]),
        lambda: kalman.gain(P[..., 0], narrow, np.eye(2)),
    ):
        with pytest.raises((ValueError, IndexError)):
            call()


@pytest.mark.parametrize("batch", [(), (1,), (3,), (48,), (2, 301), (0,)])
def test_eigenvalues(batch: tuple[int, ...], both: Callable[..., None]) -> None:
    rng = np.random.default_rng(len(batch))
    for n in (1, 2, 5, 28):
        A = rng.standard_normal((n, n, *batch))
        whole = linalg.symmetrize(A)
        strided, column = linalg.transpose(whole), A[:, :1]
        singular = linalg.matmul(column, linalg.transpose(column))
        nearly_diagonal = np.eye(n) + 1e-9 * np.eye(n)[::-1]
        whole_numbers = np.arange(n * n).reshape(n, n) * np.eye(n, dtype=int)
        for matrix in (whole, strided, singular, nearly_diagonal, whole_numbers):
            both(linalg.eigen, matrix)
        if batch == (48,):
            # Members without a rotation, and with numbers that are no numbers.
            for i, value in enumerate((0.0, -0.0, np.inf, -np.inf, np.nan, 1e300, 1e-310)):
                whole[:, :, i] = value
                whole[0, :, i + 10] = whole[:, 0, i + 10] = value
            whole[..., 20] = np.eye(n)
            both(linalg.eigen, whole)


def test_they_can_be_turned_off_and_a_stale_file_is_not_used() -> None:
    say = "from trackbench.core import compiled; print(compiled.kernels is None)"
    stale = say.replace(
        "import compiled;",
        "import _compiled; _compiled.source = ''; from trackbench.core import compiled;",
    )
    for command, environment in ((say, {"TRACKBENCH_COMPILED": "0"}), (stale, {})):
        done = subprocess.run(
            [sys.executable, "-c", command],
            env=os.environ | environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == "True\n"


def test_wrong_arguments_are_errors() -> None:
    assert compiled.kernels is not None
    locked = read_only.fixed(np.zeros((4, 4)))
    for name, given, error in (
        ("exp", [np.zeros(1)] * 3, TypeError),
        ("sandwich", [np.eye(1)] * 2, TypeError),
        ("select", [np.zeros(3), np.array([3]), np.zeros(1)], IndexError),
        ("select", [np.zeros(3), np.array([-1]), np.zeros(1)], IndexError),
        ("total", [np.zeros((4, 4)).T[:, ::2], np.zeros(4), 2], ValueError),
        ("total", [np.zeros(4), locked[0], 1], (ValueError, BufferError)),
        ("sandwich", [np.eye(4), np.ones((4, 4, 1)), locked[..., None]], (ValueError, BufferError)),
    ):
        with pytest.raises(error, match=r"few|range|contiguous|read-only|writable"):
            getattr(compiled.kernels, name)(*given)


M = 8
TAKEN: dict[str, list[tuple[int, ...]]] = {
    "product": [(2, 3), (3, 2, M), (2, 2, M)],
    "sandwich": [(2, 4), (4, 4, M), (2, 2, M)],
    "gain": [(4, 4, M), (2, 4), (2, 2), (2, 2, M), (4, 2, M)],
    "mahalanobis": [(2, 2, M), (2, M), (M,)],
    "mix": [(M,), (2, M), (2, 2, M), (2, M), (2, 2, M)],
    "condition": [(4, M), (4, 4, M), (2, M), (4, 2, M), (2, 2, M), (4, M), (4, 4, M)],
}
REFUSED: dict[str, list[dict[int, tuple[int, ...]]]] = {
    "product": [
        *({0: (2, 4)}, {0: (2, 3, M - 1)}, {0: (2, 3, 2, 4)}, {0: (8, 8), 1: (8, 8), 2: (8, 8)}),
        {0: (2, 3, M), 1: (3, 2, M, 1), 2: (2, 2, M, 1)},
    ],
    "sandwich": [
        *({0: (2, 3)}, {1: (4, 3, M)}, {0: (2, 4, M - 1)}, {0: (10, 4), 2: (10, 10, M)}),
    ],
    "gain": [
        *({1: (2, 3)}, {2: (2, 2, M - 1)}, {1: (3, 4), 2: (3, 3), 3: (3, 3, M), 4: (4, 3, M)}),
    ],
    "mahalanobis": [{0: (2, 3, M)}, {0: (2, 2, M - 1)}, {0: (37, 37, M), 1: (37, M)}],
    "condition": [
        *({1: (3, 4, M)}, {1: (4, 3, M)}, {2: (3, M)}, {3: (3, 2, M)}, {3: (4, 3, M)}),
        *({4: (2, 3, M)}, {4: (2, 2, M - 1)}, {2: (3, M), 3: (4, 3, M), 4: (3, 3, M)}),
    ],
    "mix": [{0: (M - 1,)}, {2: (3, 2, M)}, {2: (2, 3, M)}, {2: (2, 2, M - 1)}],
}
"""Shapes by number of the argument, which differ from those that are taken."""


@pytest.mark.parametrize("name", TAKEN)
def test_a_kernel_refuses_other_shapes_numbers_and_memory(name: str) -> None:
    """It would read or write beyond an array; numpy takes what is refused, or raises."""
    rule, more = getattr(compiled.kernels, name), [0] * (name == "product")
    for shapes in ({}, *REFUSED[name]):
        given = [np.ones(shapes.get(i, shape)) for i, shape in enumerate(TAKEN[name])]
        assert rule(*given, *more) == (not shapes), shapes
    given = [np.ones(shape) for shape in TAKEN[name]]
    for i, a in enumerate(given[:-1]):
        others = [a.astype(np.float32), a.astype(">f8")]
        others += [np.repeat(a, 2, axis=-1)[..., ::2]] * (a.shape[-1] == M)
        for other in others:
            assert not rule(*given[:i], other, *given[i + 1 :], *more), (i, other.strides)


def test_nothing_is_built_twice() -> None:
    from trackbench.core import build_compiled

    before = BUILT.stat().st_mtime_ns
    assert build_compiled.build()
    assert BUILT.stat().st_mtime_ns == before
