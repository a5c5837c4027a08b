"""The maneuvering target: where the paper's track goes, and how onsets are counted."""

import numpy as np
import pytest

from tests.papers import maneuver
from trackbench.core.random_streams import RunStreams
from trackbench.errors import UserError
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.targets.legs import Leg
from trackbench.scenarios.targets.maneuver_detection import Onsets


def test_corrected_track_turns_by_ninety_degrees_each_time() -> None:
    """Section 4: from -y to +x, +y, -x, -y, +x, at 15 m/s."""
    t = np.array([0.0, 400.0, 600.0, 670.0, 1200.0, 1255.0, 1655.0, 1700.0])
    _, vx, _, vy = maneuver().target.states(t)
    directions = [(0, -1), (0, -1), (1, 0), (0, 1), (-1, 0), (0, -1), (1, 0), (1, 0)]
    np.testing.assert_allclose(np.stack([vx, vy], axis=1), 15.0 * np.array(directions), atol=1e-9)


def test_as_printed_track_does_not() -> None:
    t = np.array([0.0, 1255.0])
    _, vx, _, vy = maneuver(truth="as-printed").target.states(t)
    assert (vx[0], vy[0]) == (-15.0, 0.0)
    assert np.hypot(vx[1], vy[1]) > 20.0


def test_path_agrees_with_step_by_step_integration() -> None:
    scenario = maneuver()
    dt = 0.01
    t = np.arange(0.0, 1700.0, dt)
    a = np.zeros((2, len(t)))
    for leg in scenario.target.legs:
        during = (t >= leg.start - 1e-9) & (t < leg.end - 1e-9)
        a[:, during] += np.array([[leg.ax], [leg.ay]])
    v = np.array([[0.0], [-15.0]]) + np.cumsum(a, axis=1) * dt
    v = np.hstack([[[0.0], [-15.0]], v])
    p = np.array([[2000.0], [10_000.0]]) + np.cumsum((v[:, :-1] + v[:, 1:]) / 2, axis=1) * dt
    end = scenario.target.states(np.array([1700.0]))
    np.testing.assert_allclose(end[[0, 2], 0], p[:, -1], rtol=1e-6)
    np.testing.assert_allclose(end[[1, 3], 0], v[:, -1], atol=1e-8)


def test_prior_is_the_two_point_difference_and_consistent() -> None:
    """NEES of the prior is chi-square with four degrees of freedom."""
    scenario, runs = maneuver(duration=10.0, legs=(), score_from=0.0), 4000
    data = scenario.simulate(RunStreams(3, range(runs)), runs)
    assert data.truth.shape == (4, 10, runs)
    assert data.measurements.shape == (2, 9, runs)
    e = data.prior.mean - data.truth[:, 0]
    nees = np.einsum("im,ij,jm->m", e, np.linalg.inv(data.prior.cov), e)
    assert abs(nees.mean() - 4.0) < 4.0 * np.sqrt(8.0 / runs)
    noise = data.measurements - data.truth[[0, 2], 1:]
    assert abs(noise.std() / 100.0 - 1.0) < 4.0 / np.sqrt(2.0 * noise.size)


def test_windows_cover_turns_and_settled_flight() -> None:
    windows, t = maneuver().windows, maneuver().times
    assert t[windows[""]].min() == 20.0
    np.testing.assert_array_equal(t[windows["leg 2"]][[0, -1]], [621.0, 670.0])
    assert windows["turns"].sum() == 200 + 50 + 200 + 50 + 200
    assert not (windows["turns"] & windows["quiet"]).any()
    quiet = t[windows["quiet"]]
    assert quiet[quiet > 400].min() == 771.0  # 100 s after the second leg, which follows the first


def test_a_longer_sampling_time_flies_the_same_path() -> None:
    fine, coarse = maneuver(), maneuver(T=10.0)
    np.testing.assert_allclose(
        coarse.target.states(coarse.times), fine.target.states(fine.times)[:, 9::10]
    )
    assert len(coarse.steps) == 170


def test_starts_of_turns_and_the_flight_before_them() -> None:
    windows, t = maneuver().windows, maneuver().times
    np.testing.assert_array_equal(t[windows["before"]][[0, -1]], [20.0, 400.0])
    np.testing.assert_array_equal(t[windows["start 1"]][[0, -1]], [401.0, 450.0])
    np.testing.assert_array_equal(windows["start 2"], windows["leg 2"])  # 50 s long
    short = maneuver(edge=10.0).windows
    np.testing.assert_array_equal(t[short["start 4"]], np.arange(1206.0, 1216.0))
    assert short["starts"].sum() == 5 * 10
    assert not {"before", "starts", "turns"} & set(maneuver(legs=()).windows)


def test_peaks_of_windows_and_runs_that_strayed() -> None:
    scenario = maneuver(sigma=10.0)
    error = np.ones((1700, 2))
    error[630, :] = 30.0  # in the second leg
    error[1300, :] = 100.0, 100.5  # between turns: at the limit, and beyond it
    error[5, :] = 900.0  # before anything is scored
    got = scenario.run_metrics({"squared_position": np.square(error)})
    np.testing.assert_allclose(got["peak_position"], [100.0, 100.5])
    np.testing.assert_allclose(got["peak_position[turns]"], 30.0)
    np.testing.assert_allclose(got["peak_position[start 2]"], 30.0)
    np.testing.assert_allclose(got["peak_position[leg 1]"], 1.0)
    np.testing.assert_array_equal(got["beyond_10_sigma"], [0.0, 1.0])


def test_overshoot_is_along_the_acceleration_until_the_next_turn() -> None:
    """A filter that goes on turning for ever is ahead by a t^2 / 2 after so many seconds."""
    first = Leg(start=100, end=150, ax=0.3, ay=-0.4)
    second = Leg(start=160, end=200, ax=-1.0, ay=0.0)
    scenario = maneuver(duration=300.0, legs=(first, second), edge=20.0)
    since = np.maximum(scenario.times - first.end, 0.0)
    ahead = 0.5 * np.square(since)[:, None]  # its acceleration is 0.5 m/s^2
    x, y = 0.6 * ahead * 0.5, -0.8 * ahead * 0.5
    got = scenario.run_metrics({"squared_position": x * x, "error_x": x, "error_y": y})
    t = np.arange(1.0, 11.0)  # the second turn begins after ten
    np.testing.assert_allclose(got["overshoot_m[leg 1]"], 0.25 * np.mean(t * t))
    t = np.arange(51.0, 71.0)
    np.testing.assert_allclose(got["overshoot_m[leg 2]"], -0.6 * 0.25 * np.mean(t * t))


def test_settling_by_hand() -> None:
    """Five runs: at once, after the second excess, never, up to the next turn, without an error."""
    legs = (Leg(start=10, end=20, ax=0.3, ay=0.0), Leg(start=30, end=40, ax=-0.3, ay=0.0))
    scenario = maneuver(duration=50.0, legs=legs, settled_error=9.0)
    error = np.ones((len(scenario.times), 5))
    at = {time: row for row, time in enumerate(scenario.times.tolist())}
    error[at[20] : at[23], 1] = error[at[25], 1] = 9.1
    error[at[30], 2] = 10.0
    error[at[31] : at[39], 3] = 99.0
    error[at[22], 4] = np.nan
    got = scenario.run_metrics({"squared_position": np.square(error)})
    np.testing.assert_array_equal(got["settling_s[leg 1]"], [0.0, 6.0, np.nan, 0.0, np.nan])
    np.testing.assert_array_equal(got["not_settled[leg 1]"], [0.0, 0.0, 1.0, 0.0, np.nan])
    np.testing.assert_array_equal(got["settling_s[leg 2]"], np.zeros(5))


def test_onsets_by_hand() -> None:
    """Two legs, four runs: met late, met at once, missed, and on from before."""
    times = np.arange(1.0, 11.0)
    inside = np.array([(times > 3) & (times <= 6), (times > 8) & (times <= 9)])
    quiet = (times <= 3) | (times > 9)
    mode = np.zeros((10, 4))
    mode[5:7, 0] = 1.0  # on at 6 and 7 s
    mode[3, 1] = 1.0  # on at 4 s
    mode[2:9, 3] = 1.0  # on from 3 s, in quiet: a false alarm, and no detection of either leg
    got = Onsets(times, (3.0, 8.0), inside, quiet).metrics(mode, None)
    np.testing.assert_array_equal(got["detection_delay_s[leg 1]"], [3.0, 1.0, np.nan, np.nan])
    np.testing.assert_array_equal(got["missed_maneuvers[leg 1]"], [0, 0, 1, 0])
    np.testing.assert_array_equal(got["already_maneuvering[leg 1]"], [0, 0, 0, 1])
    np.testing.assert_array_equal(got["missed_maneuvers[leg 2]"], [1, 1, 1, 0])
    # Quiet are 1, 2, 3 and 10 s; run 4 is still on at 9 s, so that 10 s is no chance of an alarm.
    np.testing.assert_allclose(got["false_maneuvers_per_1000"], [0, 0, 0, 1000.0 / 3.0])


def test_onset_errors_by_hand() -> None:
    """The onset believed where the mode goes on is that of the last alarm, once it is confirmed."""
    times = np.arange(1.0, 11.0)
    inside = np.array([(times > 4) & (times <= 9)])
    mode, age = np.zeros((10, 4)), np.full((10, 4), np.nan)
    age[2, 0], age[5, 0], mode[5:, 0] = (
        1.0,
        3.0,
        1.0,
    )  # a denied alarm at 3 s, one at 6 s: since 3 s
    age[6, 1], mode[8:, 1] = 0.5, 1.0  # alarm at 7 s, since 6.5 s, confirmed at 9 s
    age[5, 2] = 2.0  # an alarm that is denied
    age[1, 3], mode[1:, 3] = 1.0, 1.0  # on before the turn
    got = Onsets(times, (4.0,), inside, ~inside[0]).metrics(mode, (age > 0).astype(float), age)
    np.testing.assert_array_equal(got["onset_error_s[leg 1]"], [-1.0, 2.5, np.nan, np.nan])
    np.testing.assert_array_equal(got["onset_abs_error_s[leg 1]"], [1.0, 2.5, np.nan, np.nan])
    np.testing.assert_array_equal(got["onset_age_s[leg 1]"], [3.0, 2.5, np.nan, np.nan])
    np.testing.assert_array_equal(got["detection_delay_s[leg 1]"], [2.0, 5.0, np.nan, np.nan])
    without = Onsets(times, (4.0,), inside, ~inside[0]).metrics(mode, None)
    assert not any(name.startswith("onset") for name in without)


def test_a_delay_counts_from_the_onset_between_two_samples() -> None:
    leg = Leg(start=409.0, end=800.0, ax=0.1, ay=0.0)
    scenario = maneuver(T=10.0, launch=Launch(), legs=(leg,))
    mode = np.where(scenario.times == 430.0, 1.0, 0.0)[:, None]
    got = scenario.run_metrics({"squared_position": np.ones_like(mode), "mode": mode})
    assert got["detection_delay_s[leg 1]"][0] == 21.0


def test_the_last_scored_step_is_the_last_there_is() -> None:
    maneuver(duration=20.0, score_from=20.0, legs=())
    with pytest.raises(UserError, match=r"\[21, 20\] is not within steps 1 to 20"):
        maneuver(duration=20.0, score_from=21.0, legs=())


def test_alarms_are_counted_where_the_filter_reports_them() -> None:
    times = np.arange(1.0, 6.0)
    alarm = np.array([[np.nan], [1.0], [0.0], [1.0], [0.0]])
    got = Onsets(times, (), np.zeros((0, 5), dtype=bool), np.ones(5, dtype=bool)).metrics(
        np.zeros((5, 1)), alarm
    )
    assert got["false_maneuvers_per_1000"][0] == pytest.approx(400.0)


def test_a_leg_shorter_than_the_sampling_time_is_not_scored() -> None:
    scenario = maneuver(
        T=10.0, duration=100.0, launch=Launch(), legs=(Leg(start=42, end=44, ax=1.0, ay=0.0),)
    )
    assert "leg 1" not in scenario.windows
    mode = np.zeros((10, 2))
    values = {"squared_position": np.ones((10, 2)), "mode": mode}
    assert "detection_delay_s[leg 1]" not in scenario.run_metrics(values)
