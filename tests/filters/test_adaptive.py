"""The adaptive filter against what the paper claims of it, and against its own other readings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.conftest import make_filter, per_run, track
from tests.papers import maneuver
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.filters.adaptive_kf.adaptive_kf_and_vdf import (
    BOTH,
    VDF,
    AdaptiveKF,
    Mode,
    _second_decision,
)
from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import (
    Detector,
    Exit,
    SecondDecision,
    tail,
)
from trackbench.filters.adaptive_kf.per_axis import axis_step
from trackbench.filters.imm import IMM
from trackbench.filters.input_estimation import InputEstimation
from trackbench.filters.kf import KF
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.scenarios.targets.legs import Leg

QUIET_CV, STILL_CA = ConstantVelocity(q=0.0), ConstantAcceleration(q=0.0)
CV, CA = ConstantVelocity(q=0.0), ConstantAcceleration(q=1e-4)
TURN = maneuver(duration=260.0, legs=(Leg(start=100, end=160, ax=0.3, ay=-0.3),), settle=40.0)
STRAIGHT = maneuver(duration=800.0, legs=())
SECONDS = AdaptiveKF(
    nmf=CV,
    mf=CA,
    **{"detector": Detector(eta=20.0, window_s=60.0, min_window_s=15.0), "exit": Exit(hold_s=30.0)},
)


def adaptive(preset: str, q: float = 0.0) -> AdaptiveKF:
    """A preset as a config makes it."""
    keys = AdaptiveKF.presets[preset]
    parts = {"detector": Detector, "exit": Exit}
    made = {name: parts[name](**value) for name, value in keys.items()}
    return AdaptiveKF(nmf=ConstantVelocity(q=q), mf=CA, **made)


@pytest.mark.parametrize("window_s", [10.0, 40.0])
@pytest.mark.parametrize("kind", ["ie", "fading-ie"])
def test_both_augmented_starts_agree_without_process_noise(kind: str, window_s: float) -> None:
    """Same onset, q = q_m = 0: input estimation and refiltering are one estimate."""
    tracker = AdaptiveKF(
        nmf=QUIET_CV,
        mf=STILL_CA,
        detector=Detector(kind=kind, eta=18.0, window_s=window_s),
        exit=Exit(hold_s=5.0),
    )
    added = track(TURN, tracker, 8)
    refiltered = track(TURN, replace(tracker, initialize="barshalom"), 8)
    assert added.diagnostics["mode"][1:].any(axis=0).all()
    np.testing.assert_array_equal(added.diagnostics["mode"], refiltered.diagnostics["mode"])
    np.testing.assert_allclose(added.mean, refiltered.mean, atol=1e-6)


def test_vdf_is_the_adaptive_filter_with_the_window_s_start_as_onset() -> None:
    """Without process noise, where data refiltered and an input added are one estimate."""
    vdf = VDF(nmf=QUIET_CV, mf=STILL_CA, eta=18.0)
    own = AdaptiveKF(nmf=QUIET_CV, mf=STILL_CA, detector=Detector(kind="fading", eta=18.0))
    refiltering, adding = track(TURN, vdf, 8), track(TURN, own, 8)
    assert refiltering.diagnostics["mode"][1:].any(axis=0).all()
    np.testing.assert_array_equal(refiltering.diagnostics["mode"], adding.diagnostics["mode"])
    np.testing.assert_allclose(refiltering.mean, adding.mean, atol=1e-6)


def test_a_filter_that_never_alarms_is_the_kalman_filter() -> None:
    never = AdaptiveKF(nmf=CV, mf=CA, detector=Detector(eta=1e9))
    kf, own = track(TURN, KF(), 5), track(TURN, never, 5)
    np.testing.assert_allclose(own.mean, kf.mean, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(own.nees, kf.nees, rtol=1e-7)
    np.testing.assert_allclose(own.diagnostics["nis"], kf.diagnostics["nis"], rtol=1e-9)


@pytest.fixture(scope="module")
def main_track() -> dict[str, dict[str, np.ndarray]]:
    """Numbers per run of the paper's filters at small Q on the first track."""
    runs, filters = 30, {"kf": KF(), "seconds": SECONDS}
    filters |= {name: adaptive(name) for name in ("paper-eta35", "paper-eta20")}
    return {
        name: run_block(BlockTask(maneuver(), tracker, 5, 0, runs, runs)).per_run
        for name, tracker in filters.items()
    }


def test_without_noise_the_kalman_filter_loses_the_target_and_the_adaptive_does_not(
    main_track: dict[str, dict[str, np.ndarray]],
) -> None:
    raw = 100.0 * np.sqrt(2.0)  # the error of a single measurement
    assert (main_track["kf"]["rmse_position[turns]"] > 10.0 * raw).all()
    for name in ("paper-eta35", "paper-eta20", "seconds"):
        values = main_track[name]["rmse_position[turns]"]
        assert values.mean() + 3.0 * values.std() / np.sqrt(len(values)) < raw


def test_lower_threshold_is_better_at_small_q(
    main_track: dict[str, dict[str, np.ndarray]],
) -> None:
    for metric in ("rmse_position", "rmse_position[turns]"):
        gain = main_track["paper-eta35"][metric] - main_track["paper-eta20"][metric]
        assert gain.mean() > 3.0 * gain.std(ddof=1) / np.sqrt(len(gain))


def test_maneuvering_mode_is_left_in_quiet_flight(
    main_track: dict[str, dict[str, np.ndarray]],
) -> None:
    for name in ("paper-eta35", "paper-eta20", "seconds"):
        share = main_track[name]
        assert share["mode[quiet]"].mean() < 0.05
        assert share["mode[turns]"].mean() > 0.2
        assert np.mean([share[f"missed_maneuvers[leg {n}]"].mean() for n in range(1, 6)]) < 0.05


def test_a_filter_without_noise_of_its_own_is_latched() -> None:
    """mf.q = 0: it never comes back from its first turn, and says so before."""
    latched = replace(adaptive("paper-eta35"), mf=STILL_CA)
    assert per_run(maneuver(), latched, 5, "mode[quiet]").mean() > 0.4
    assert any("mf.q = 0" in text for text in latched.cautions(maneuver()))


def test_cautions_speak_of_the_smallest_turn_only_where_it_is_insignificant() -> None:
    slow = replace(SECONDS, mf=ConstantAcceleration(q=1e-6))
    quick = replace(SECONDS, mf=ConstantAcceleration(q=1e-2))
    assert not slow.cautions(maneuver())
    assert any("0.106" in text for text in quick.cautions(maneuver()))


def test_steady_acceleration_variance_is_where_the_filter_goes() -> None:
    from trackbench.core.distributions import Gaussian
    from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import (
        steady_acceleration_variance,
    )

    R = np.array([[1e4]])
    state = Gaussian(np.zeros((3, 2, 1)), np.broadcast_to(np.eye(3)[..., None, None], (3, 3, 1, 1)))
    for _ in range(1500):
        state, _ = axis_step(state, CA.axis(1.0), np.zeros((2, 1)), R)
    expected = steady_acceleration_variance(CA, 1.0, R)
    assert state.cov[2, 2, 0, 0] == pytest.approx(expected, rel=1e-6)


def test_the_thresholds_of_all_presets_are_explained() -> None:
    """By the hypo-exponential tail and the chi-square one of two degrees of freedom."""
    etas = {keys["detector"]["eta"] for keys in AdaptiveKF.presets.values()}
    told = AdaptiveKF.explain().splitlines()[1:]
    assert sorted(told) == [
        f"  eta = {eta:g}: P(rho > eta) = {tail(eta, 0.8):.2g} per sample at gamma = 0.8, "
        f"P(zeta > eta) = {chi2.sf(eta, 2):.2g} per onset"
        for eta in sorted(etas)
    ]


def test_false_alarm_rate_of_rho_is_the_tail_s() -> None:
    """In straight flight with a consistent filter; rho's exceedances depend on each other."""
    runs, eta = 400, 15.0
    tracker = AdaptiveKF(
        nmf=CV, mf=CA, detector=Detector(kind="fading", eta=eta), dlw=SecondDecision(n=10**6)
    )
    # The second decision never comes, so the first alarm of a run is its only one.
    found = track(STRAIGHT, tracker, runs).diagnostics["alarm"][1:]
    first = np.where(found.any(axis=0), found.argmax(axis=0), len(found))
    at_risk = np.minimum(first - 18, len(found) - 18)
    hazard = found.sum() / at_risk.sum()
    # An alarm is the beginning of a cluster of exceedances: rarer than they, not by much.
    assert 0.1 * tail(eta, 0.8) < hazard < 1.1 * tail(eta, 0.8)


def test_rho_itself_has_the_hypo_exponential_tail() -> None:
    runs, eta = 3000, 15.0
    scenario = maneuver(duration=80.0, legs=())
    tracker = AdaptiveKF(nmf=CV, mf=CA, detector=Detector(kind="fading", eta=1e9))
    data = scenario.simulate(RunStreams(2, range(runs)), runs)
    rng = block_stream(2, 0)
    state = tracker.init(scenario.model, data.prior, rng)
    for i, k in enumerate(scenario.steps[1:]):
        state = tracker.step(scenario.model, state, data.measurements[:, i], int(k), rng)
    p = tail(eta, 0.8)
    assert abs((state.detector.rho > eta).mean() - p) < 3.5 * np.sqrt(p * (1 - p) / runs)
    assert abs(state.detector.rho.mean() - 10.0) < 3.5 * np.sqrt(4.0 / (1.0 - 0.64) / runs)


def test_second_decision_denies_false_alarms() -> None:
    eager = AdaptiveKF(nmf=CV, mf=CA, detector=Detector(eta=8.0, window_s=20.0))
    careful = replace(eager, dlw=SecondDecision(n=20))
    believed = per_run(STRAIGHT, eager, 20, "mode").mean()
    denied = per_run(STRAIGHT, careful, 20, "mode").mean()
    assert per_run(STRAIGHT, careful, 20, "alarm").mean() > 1.0
    assert denied < 0.5 * believed
    assert per_run(TURN, careful, 20, "mode[turns]").mean() > 0.2


def test_evidence_of_the_second_decision_is_the_summed_log_likelihood_ratio() -> None:
    tracker = AdaptiveKF(
        nmf=CV, mf=CA, detector=Detector(eta=15.0, window_s=20.0), dlw=SecondDecision(n=10**6)
    )
    runs, R = 6, np.array([[1e4]])
    data, rng = TURN.simulate(RunStreams(1, range(runs)), runs), block_stream(1, 0)
    state = tracker.init(TURN.model, data.prior, rng)
    expected = np.zeros(runs)
    for i, k in enumerate(TURN.steps[1:]):
        z, before = data.measurements[:, i], state
        state = tracker.step(TURN.model, state, z, int(k), rng)
        _, quiet = axis_step(before.nmf, CV.axis(1.0), z, R)
        _, turning = axis_step(before.mf, CA.axis(1.0), z, R)
        ratio = (turning.log_likelihood - quiet.log_likelihood).sum(axis=0)
        expected += np.where(before.mode.active == BOTH, ratio, 0.0)
    assert (state.mode.active == BOTH).any()
    np.testing.assert_allclose(state.mode.evidence, expected, rtol=1e-9, atol=1e-9)


def test_the_second_decision_believes_what_is_more_likely_than_not() -> None:
    """After n steps of both filters, by the sign of the log-likelihood ratio."""
    logic = AdaptiveKF(
        nmf=CV, mf=CA, detector=Detector(eta=15.0), dlw=SecondDecision(n=5)
    ).parameters
    mode = Mode(np.full(4, BOTH), np.array([3, 3, 3, 4]), np.array([-0.1, 0.1, 2.0, 2.0]))
    believed, decided = _second_decision(logic, mode, np.zeros(4, bool), 8)
    np.testing.assert_array_equal(believed, [False, True, True, False])
    np.testing.assert_array_equal(decided, [True, True, True, False])


def test_the_maneuvering_filter_stays_as_long_as_it_must() -> None:
    def shortest_stay(hold_s: float) -> float:
        detector = Detector(kind="fading-ie", eta=14.0)
        tracker = AdaptiveKF(nmf=CV, mf=CA, detector=detector, exit=Exit(hold_s=hold_s))
        mode = track(STRAIGHT, tracker, 4).diagnostics["mode"][1:]
        edges = np.diff(np.vstack([np.zeros((1, 4)), mode]), axis=0)
        stays = []
        for on, off in zip((edges == 1).T, (edges == -1).T, strict=True):
            ends = np.flatnonzero(off)
            stays += list(ends - np.flatnonzero(on)[: len(ends)])
        return min(stays)

    assert shortest_stay(0.0) < 10
    assert shortest_stay(25.0) == 25


@pytest.mark.parametrize("start", [20, 60])
def test_no_alarm_before_the_detector_is_switched_on(start: int) -> None:
    nervous = AdaptiveKF(nmf=CV, mf=CA, detector=Detector(kind="fading-ie", eta=8.0, start=start))
    alarm = track(STRAIGHT, nervous, 10).diagnostics["alarm"]
    first = STRAIGHT.steps[np.flatnonzero((alarm > 0).any(axis=1))[0]]
    assert start <= first < start + 20


def test_the_least_onset_postpones_the_switch() -> None:
    early = AdaptiveKF(nmf=CV, mf=CA, detector=Detector(eta=25.0, window_s=60.0))
    late = replace(early, detector=Detector(eta=25.0, window_s=60.0, min_window_s=25.0))
    metric = "detection_delay_s[leg 1]"
    delays = [per_run(TURN, tracker, 20, metric) for tracker in (early, late)]
    assert np.nanmean(delays[1]) > np.nanmean(delays[0])


def test_onset_is_estimated_near_the_truth() -> None:
    """A strong turn: the first alarm's onset is within ten seconds of it on average."""
    strong = maneuver(duration=160.0, legs=(Leg(start=100, end=150, ax=2.0, ay=2.0),))
    detector = Detector(eta=30.0, window_s=40.0, min_window_s=15.0)
    for tracker in (
        AdaptiveKF(nmf=CV, mf=CA, detector=detector),
        InputEstimation(motion=CV, eta=30.0, window_s=40.0, min_window_s=15.0),
    ):
        found = run_block(BlockTask(strong, tracker, 4, 0, 20, 20)).per_run
        error = found["onset_error_s[leg 1]"]
        assert np.isfinite(error).all()
        assert abs(error.mean()) < 10.0
        assert (found["onset_age_s[leg 1]"] >= 15.0).all()
        total = found["onset_age_s[leg 1]"] + error
        np.testing.assert_allclose(total, found["detection_delay_s[leg 1]"])


def test_the_variable_dimension_filter_takes_the_window_for_the_onset() -> None:
    """Or its restart, if that is nearer."""
    found = track(TURN, VDF(nmf=CV, mf=CA, eta=18.0), 8).diagnostics
    age, alarm = found["alarm_age_s"][1:], found["alarm"][1:] > 0.0
    np.testing.assert_array_equal(np.isnan(age), ~alarm)
    first = alarm.argmax(axis=0)[alarm.any(axis=0)]
    np.testing.assert_array_equal(age[first, alarm.any(axis=0)], 5.0)
    assert np.nanmax(age) == 5.0


@pytest.mark.parametrize("window_s", [5.0, 40.0])
def test_zeta_of_the_oldest_onset_is_chi_square_in_straight_flight(window_s: float) -> None:
    """Independent runs at the last of 90 steps: mean 2, variance 4, a tenth above the 10 % point."""
    runs, straight = 3000, maneuver(duration=90.0, legs=())
    never = AdaptiveKF(nmf=CV, mf=CA, detector=Detector(eta=1e9, window_s=window_s))
    found = track(straight, never, runs).diagnostics
    zeta, beyond = found["zeta"][-1], found["zeta_beyond"][-1]
    assert abs(zeta.mean() - 2.0) < 3.5 * np.sqrt(4.0 / runs)
    assert abs(zeta.var() - 4.0) < 3.5 * np.sqrt(128.0 / runs)  # mu_4 - mu_2^2 = 144 - 16
    assert abs(beyond.mean() - 0.1) < 3.5 * np.sqrt(0.09 / runs)


def test_input_estimation_follows_the_turn_and_is_a_kalman_filter_without_alarms() -> None:
    never = InputEstimation(motion=CV, eta=1e9)
    kf = track(TURN, KF(), 5)
    np.testing.assert_allclose(track(TURN, never, 5).mean, kf.mean, rtol=1e-9, atol=1e-6)
    corrected = per_run(TURN, InputEstimation(motion=CV), 20, "rmse_position[turns]")
    assert corrected.mean() < 0.5 * per_run(TURN, KF(), 20, "rmse_position[turns]").mean()


FILTERS = {
    "ie": SECONDS,
    "fading-ie": adaptive("paper-eta20"),
    "barshalom": replace(SECONDS, initialize="barshalom"),
    "paper onset": AdaptiveKF(nmf=CV, mf=CA, detector=Detector(kind="ie", eta=15.0, onset="paper")),
    "dlw": replace(SECONDS, dlw=SecondDecision(n=5)),
    "vdf": VDF(nmf=CV, mf=CA, alpha=1e-3),
    "input estimation": InputEstimation(motion=CV),
    "imm": make_filter("imm", motions=(CV, CA), transition=((0.99, 0.01), (0.01, 0.99))),
    "alpha-beta": make_filter("alpha-beta", q=0.3),
}


@pytest.mark.parametrize("tracker", FILTERS.values(), ids=FILTERS.keys())
def test_runs_are_independent_and_gaps_are_predicted_over(tracker: object) -> None:
    """Switches are per run: three of four runs have the same estimates alone."""
    data, rng = TURN.simulate(RunStreams(1, range(4)), 4), block_stream(1, 0)
    z = data.measurements.copy()
    z[:, 110:118, 1] = np.nan
    z[0, 130, 2] = np.nan
    state = tracker.init(TURN.model, data.prior, rng)
    fewer = tracker.init(TURN.model, TURN.simulate(RunStreams(1, range(3)), 3).prior, rng)
    for i, k in enumerate(TURN.steps[1:]):
        state = tracker.step(TURN.model, state, z[:, i], int(k), rng)
        fewer = tracker.step(TURN.model, fewer, z[:, i, :3], int(k), rng)
        found, alone = tracker.estimate(state), tracker.estimate(fewer)
        np.testing.assert_allclose(found.mean[:, :3], alone.mean, rtol=1e-12, atol=1e-9)
        assert np.isfinite(found.mean).all()
        cov = found.cov if found.cov.ndim == 3 else found.cov[..., None]
        assert (np.linalg.eigvalsh(np.moveaxis(cov, -1, 0)) > 0).all()
        nis = tracker.diagnostics(state)["nis"]
        # Half a sample is a measurement to a Kalman filter, and none to those that treat the axes alike.
        missing = np.isnan(z[:, i])
        missing = missing.all(axis=0) if isinstance(tracker, IMM) else missing.any(axis=0)
        np.testing.assert_array_equal(np.isnan(nis), missing)
