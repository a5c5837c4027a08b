"""A gate refuses outliers, counts them, and leaves a clean problem alone."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import track
from trackbench import api
from trackbench.config.experiment import cautions
from trackbench.config.load import load
from trackbench.core.distributions import Gaussian
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.gate_decisions import sensor_rejections
from trackbench.evaluation.per_run_metrics import per_run_metrics
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.series_sums import SeriesSums
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.ekf import EKF
from trackbench.filters.gaussian_base import Tracked
from trackbench.filters.imm import IMM, ModelBank
from trackbench.filters.kf import KF
from trackbench.filters.ukf import CKF
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.base import Outliers
from trackbench.models.sensors.position import PositionSensor, VelocitySensor
from trackbench.report.tables_and_figures import Results
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking
from trackbench.statistics.consistency_bands import AcceptedNis, anees_band, credibility

RUNS = 200
CLEAN = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0)),
    sensor=PositionSensor(sigma=5.0),
    start=GaussianStart(sigma=(5.0, 2.0, 5.0, 2.0)),
    last=40,
)
SPOILT = replace(CLEAN, sensor=replace(CLEAN.sensor, outliers=Outliers(share=0.05, times=30.0)))


def rms(scenario: Any, tracker: Any) -> float:
    found = track(scenario, tracker, RUNS)
    error = found.mean - simulate(scenario, 1, 0, RUNS).truth
    return float(np.sqrt(np.square(error[[0, 2]]).sum(axis=0).mean()))


@pytest.mark.parametrize("kind", [KF, EKF, CKF])
def test_outliers_are_refused(kind: Any) -> None:
    gated = kind(gate=0.999)
    assert rms(SPOILT, gated) < 0.35 * rms(SPOILT, kind())
    share = np.nanmean(track(SPOILT, gated, RUNS).diagnostics["gated"])
    assert share == pytest.approx(0.05, abs=0.01)


STAY = np.array([[0.9, 0.1], [0.3, 0.7]])
NOISE = (0.5, 400.0)
CHI2_99 = (np.inf, 6.634897, 9.210340)
"""0.99 quantiles of the chi-square laws of 0, 1 and 2 degrees of freedom, from printed tables."""


def by_hand(
    means: Any, covs: Any, w: Any, noise: Any, P: Any, z: Any, fading: float
) -> tuple[Any, ...]:
    """Mean, covariance, weights, NIS of one run after one second, and the models that refuse z."""
    H, measured = np.eye(4)[[0, 2]][np.isfinite(z)], z[np.isfinite(z)]
    predicted, updated, nis, like, c = [], [], [], [], P.T @ w
    for j, q in enumerate(noise):
        mu = P[:, j] * w / c[j]
        m = mu @ means
        V = sum(a * (C + np.outer(x - m, x - m)) for a, x, C in zip(mu, means, covs, strict=True))
        F = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
        Q = np.kron(np.eye(2), q * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]))
        m, V = F @ m, fading**2 * F @ V @ F.T + Q
        S, nu = H @ V @ H.T + 25.0 * np.eye(len(H)), measured - H @ m
        K = V @ H.T @ np.linalg.inv(S)
        predicted.append((m, V))
        updated.append((m + K @ nu, V - K @ S @ K.T))
        nis.append(nu @ np.linalg.solve(S, nu))
        like.append(np.exp(-0.5 * nis[-1]) / np.sqrt(np.linalg.det(S)))
    refused = np.array(nis) > CHI2_99[len(H)]
    alone = refused.all() or not len(H)  # no model is updated
    states, w = (predicted, c) if alone else (updated, c * like / (c @ like))
    m = sum(a * x for a, (x, _) in zip(w, states, strict=True))
    V = sum(a * (C + np.outer(x - m, x - m)) for a, (x, C) in zip(w, states, strict=True))
    return m, V, w, np.nan if alone else c @ nis, refused


@pytest.mark.parametrize("fading", [1.0, 1.5])
@pytest.mark.parametrize("models", [1, 2])
def test_the_limit_is_that_of_the_measured_components_and_of_all_models(
    models: int, fading: float, rng: np.random.Generator
) -> None:
    """Measurements with and without gaps about both limits, run by run in plain matrices."""
    noise, P = NOISE[:models], STAY[:models, :models] / STAY[:models, :models].sum(axis=1)
    z = 25.0 * rng.standard_normal((2, 300))
    z[rng.random(z.shape) < 0.25] = np.nan
    means = 3.0 * rng.standard_normal((models, 4, 300))
    covs = np.stack([np.diag([30.0, 9.0, 20.0, 4.0]) * (j + 1) for j in range(models)])
    states = tuple(
        Gaussian(m, C[..., None] * np.ones(300)) for m, C in zip(means, covs, strict=True)
    )
    model = Model(WhiteAcceleration(q=noise[0]).sampled(1.0), PositionSensor(sigma=5.0))
    if models == 1:
        tracker: Any = KF(gate=0.99, fading=fading)
        bank: Any = Tracked(states[0], np.full(300, np.nan))
        assert not tracker.diagnostics(bank)["gated"].any()  # of no measurement
    else:
        tracker = IMM(
            motions=tuple(WhiteAcceleration(q=q) for q in noise),
            transition=tuple(map(tuple, P.tolist())),
            filter=EKF(gate=0.99, fading=fading),
        )
        bank = ModelBank(states, np.full((2, 300), 0.5), np.full(300, np.nan), 4)
    found = tracker.step(model, bank, z, 1, rng)
    got, gates = tracker.estimate(found), []
    for run in range(300):
        first = means[:, :, run], covs, np.full(models, 1 / models)
        m, V, w, nis, refused = by_hand(*first, noise, P, z[:, run], fading)
        np.testing.assert_allclose(got.mean[:, run], m, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(got.cov[..., run], V, rtol=1e-9, atol=1e-9)
        if models == 2:
            np.testing.assert_allclose(found.weights[:, run], w, rtol=1e-8)
            np.testing.assert_allclose(found.nis[run], nis, rtol=1e-9)
        gates.append((np.isfinite(z[:, run]).sum(), refused.sum()))
    kinds = {(n, r) for n in (1, 2) for r in range(models + 1)} | {(0, 0)}
    assert set(gates) == kinds  # each number of components is refused by none, one and all models


# Means of the NIS per component of what a gate accepts, F_{n+2}(q) / F_n(q), by numerical integration.
ACCEPTED = {(2, 0.999): 0.99309, (2, 0.99): 0.95348, (2, 0.95): 0.84233, (2, 0.9): 0.74416}


@pytest.mark.parametrize(("n", "gate"), ACCEPTED)
def test_accepted_measurements_have_a_smaller_nis(n: int, gate: float) -> None:
    law = AcceptedNis(gate, (n,))
    assert law.mean == pytest.approx((ACCEPTED[n, gate],) * 2, abs=2e-5)
    # The band has 95 % of the means of drawn chi-squares below their quantile.
    rng, per_mean = np.random.default_rng(3), 50
    nis = rng.chisquare(n, 400_000)
    nis = nis[nis <= np.quantile(nis, gate)] / n
    means = nis[: len(nis) // per_mean * per_mean].reshape(-1, per_mean).mean(axis=1)
    low, high = law.band(n * per_mean)
    assert ((low <= means) & (means <= high)).mean() == pytest.approx(0.95, abs=0.012)
    assert law.band(n * per_mean, 0.5)[1] < high


def test_the_smaller_nis_of_several_sensors_is_between_two_laws() -> None:
    one, two, both = (AcceptedNis(0.95, (n,)) for n in (1, 2, 3))
    together = AcceptedNis(0.95, (2, 1))
    assert together.mean == (one.mean[0], both.mean[0])
    assert together.band(1000) == (one.band(1000)[0], both.band(1000)[1])
    # With a gate each, sensors that measure at one time have a mean of at most 1.
    each = AcceptedNis(0.95, (2, 2), each=True)
    assert each.mean == (two.mean[0], 1.0)
    assert each.band(1000) == (two.band(1000)[0], anees_band(1, 1000)[1])


@pytest.mark.parametrize("gate_by", ["measurement", "sensor"])
def test_anis_of_two_sensors_is_in_the_band(gate_by: str) -> None:
    """Of filters that are consistent: the motion has so little noise that a refusal costs nothing."""
    quiet = replace(TWO, target=Driven(motion=WhiteAcceleration(q=1e-6)))
    task = BlockTask(
        replace(quiet, start=GaussianStart(sigma=(0.01, 0.01, 0.01, 0.01))),
        KF(gate=0.9, gate_by=gate_by),  # type: ignore[arg-type]
        seed=1,
        index=0,
        width=100,
        runs_used=100,
        predictive_metrics=("prediction",),
    )
    got = run_block(task).per_run
    anis = np.mean(got["anis"])
    law = AcceptedNis(0.9, (2, 2), each=gate_by == "sensor")
    low, high = law.band(got["innovations"].sum())
    assert low < anis < high
    # Four components have the mean .8205 together, two .7442 each.
    assert anis == pytest.approx(0.7442 if gate_by == "sensor" else 0.8205, abs=0.012)


def test_the_band_of_a_gated_filter_is_that_of_its_gate(tmp_path: Path) -> None:
    text = """
    name: gated
    runs: 60
    scenario:
      kind: tracking
      last: 40
      target: {kind: driven, motion: {kind: cwna, q: 0.5}}
      sensor: {kind: position, sigma: 10}
      start: {kind: gaussian, sigma: [10, 1, 10, 1]}
    filters: {KF: {kind: kf}, Gate 95: {kind: kf, gate: 0.95}}
    metrics: [anis, innovations, autocorrelation_1, log_score]
    per_step: [anees, nis, anis, innovations]
    tables: {i: {kind: innovations}, c: {kind: consistency}}
    figures: {n: {kind: nis}}
    """
    (tmp_path / "g.yaml").write_text(text)
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out")
    results = Results(api.run(tmp_path / "g.yaml", options, formats=()).folder)
    runs = results.runs({})
    anis = np.nanmean(runs["Gate 95", "anis"])
    low, high = AcceptedNis(0.95, (2,)).band(np.nansum(runs["Gate 95", "innovations"]))
    assert 0.8 < low < anis < high < 0.9
    notes = " ".join(results.tables["i"].notes)
    assert "Gate 95: 95 % bands of a consistent filter with gate 0.95" in notes
    assert f"ANIS {low:.3f} to {high:.3f}" in notes
    shares = {row[0].text: row[4].text for row in results.tables["c"].texts().rows}
    assert all(float(share) > 0.8 for share in shares.values())
    _, labels = results.figure("n").axes[0].get_legend_handles_labels()
    assert {"95 % band", "95 % band, gate 0.95"} <= set(labels)


def test_the_word_on_a_filter_without_truth_is_by_its_gate() -> None:
    mean = AcceptedNis(0.9, (2,)).mean
    assert credibility(0.73, 0.76, 0, mean) == "calibrated"
    assert credibility(0.73, 0.76, -1) == "underconfident"
    assert credibility(0.95, 1.02, 1, mean) == "overconfident"


TWO = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0)),
    sensor=(PositionSensor(sigma=5.0), VelocitySensor(sigma=0.5)),
    start=GaussianStart(sigma=(5.0, 2.0, 5.0, 2.0)),
    last=30,
)


def _gated_by_hand(z: Any, prior: Any, P: Any) -> tuple[list[Any], list[Any]]:
    """Means and refusals of a run: a gate for position and velocity each, in plain matrices."""
    F = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    Q = np.kron(np.eye(2), [[1 / 3, 1 / 2], [1 / 2, 1.0]])
    H, R = np.eye(4)[[0, 2, 1, 3]], np.diag([25.0, 25.0, 0.25, 0.25])
    x, means, refused = prior, [], []
    for value in z.T:
        x, P = F @ x, F @ P @ F.T + Q
        rows, out = [], []
        for part in ([0, 1], [2, 3]):
            nu = value[part] - H[part] @ x
            S = H[part] @ P @ H[part].T + R[np.ix_(part, part)]
            out.append(nu @ np.linalg.solve(S, nu) > CHI2_99[2])
            rows += [] if out[-1] else part
        if rows:
            S = H[rows] @ P @ H[rows].T + R[np.ix_(rows, rows)]
            K = P @ H[rows].T @ np.linalg.inv(S)
            x, P = x + K @ (value[rows] - H[rows] @ x), P - K @ S @ K.T
        means.append(x)
        refused.append(out)
    return means, refused


@pytest.mark.parametrize("kind", [KF, EKF, CKF, "imm"])
def test_each_sensor_has_a_gate(kind: Any) -> None:
    z = simulate(TWO, 1, 0, 20).measurements.copy()
    z[:2, 10:20] += 100.0  # the first sensor is wrong for a while, the second is not
    data = simulate(TWO, 1, 0, 20)._replace(measurements=z)
    tracker = kind(gate=0.99, gate_by="sensor") if kind != "imm" else _bank_of_two()
    task = BlockTask(TWO, tracker, 1, index=0, width=20, runs_used=20)
    found = run_filter(task, data)
    counts, nis_count = found.diagnostics["gated"], found.diagnostics["unused_nis"]
    for m in range(20):
        prior = data.prior.mean[:, m], np.diag([25.0, 4.0, 25.0, 4.0])
        means, refused = _gated_by_hand(z[..., m], *prior)
        np.testing.assert_allclose(found.mean[:, 1:, m].T, means, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(counts[1:, m], np.sum(refused, axis=1))
        some = np.sum(refused, axis=1) < 2
        np.testing.assert_array_equal(nis_count[1:, m][some], 2.0 * np.sum(refused, axis=1)[some])
    assert counts[11:21].mean() == pytest.approx(1.0, abs=0.1)


def _bank_of_two() -> IMM:
    """Return an IMM of two equal motions, which is one filter."""
    motions = (WhiteAcceleration(q=1.0), WhiteAcceleration(q=1.0))
    return IMM(
        motions=motions,
        transition=((0.9, 0.1), (0.1, 0.9)),
        filter=EKF(gate=0.99, gate_by="sensor"),
    )


def test_shares_of_refused_measurements_count_measurements() -> None:
    """Two sensors: shares of each step, and numbers by which the steps are weighed."""
    z = np.zeros((3, 3, 1))  # the first sensor has two components, the second one
    z[:2, 2] = np.nan
    twin = z.copy()
    twin[0, 0] = 1.0  # the first sensor is bad at the first step
    refused = np.zeros(z.shape, dtype=bool)
    refused[:2, 0] = refused[2, 1] = True
    rows = [slice(0, 2), slice(2, 3)]
    shares, numbers = sensor_rejections(z, twin, refused, rows)
    np.testing.assert_array_equal(shares["rejected_good"][:, 0], [np.nan, 0.0, 0.5, 0.0])
    np.testing.assert_array_equal(numbers["rejected_good"][:, 0], [0, 1, 2, 1])
    np.testing.assert_array_equal(shares["accepted_bad"][:, 0], [np.nan, 0.0, np.nan, np.nan])
    short = replace(CLEAN, last=3)
    values = {"rejected_good": shares["rejected_good"], "squared": np.ones((4, 1))}
    sums = SeriesSums.from_series(values, short.windows, ())
    weights = {"rejected_good": numbers["rejected_good"]}
    got = per_run_metrics(short, values, sums, np.ones(1, dtype=bool), weights=weights)
    assert got["rejected_good"][0] == 0.25  # one of four good measurements


def test_one_gate_for_several_sensors_is_noted(tmp_path: Path) -> None:
    text = """
    name: two
    scenario:
      kind: tracking
      last: 9
      target: {kind: driven, motion: {kind: cwna, q: 1}}
      sensor: [{kind: position, sigma: 5}, {kind: velocity, sigma: 1 MORE}]
      start: {kind: gaussian, sigma: [5, 2, 5, 2]}
    filters: {Gated: {kind: kf, gate: 0.99 KEY}, IMM: BANK}
    """
    bank = "{kind: ekf}"
    for more, key, noted in (
        ("", "", True),
        ("", ", gate_by: sensor", False),
        (", period: 2", "", True),
    ):
        here = text.replace("MORE", more).replace("KEY", key).replace("BANK", bank)
        (tmp_path / "two.yaml").write_text(here)
        notes = cautions(load(tmp_path / "two.yaml").points)
        assert any("one gate judges all sensors" in note for note in notes) == noted
    for wrong, why in (("", "with one sensor"), ("gate: null", "without `gate`")):
        here = text.replace("KEY", ", gate_by: sensor").replace("BANK", bank).replace("MORE", "")
        if wrong:
            here = here.replace("gate: 0.99", wrong)
        else:
            here = here.replace(", {kind: velocity, sigma: 1 }", "")
        (tmp_path / "two.yaml").write_text(here)
        with pytest.raises(UserError, match=why):
            load(tmp_path / "two.yaml")
