"""The scenario of the banana paper: its first state, errors and noise."""

import numpy as np
import pytest

from tests.conftest import make_filter, per_run
from tests.papers import banana
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.lost_runs import TOO_FAR


def test_the_printed_position() -> None:
    """(1050, 2500) km gives the printed range and azimuth."""
    scenario = banana()
    truth = scenario.simulate(RunStreams(0, range(3)), 3).truth
    start = scenario.target.start(scenario._timeline)
    np.testing.assert_allclose(start[[0, 2]], [1.05e6, 2.5e6], rtol=2e-6)
    assert start[[1, 3]] @ start[[0, 2]] == pytest.approx(0.0, abs=1e-3 * 2.7e6)
    assert np.hypot(*start[[1, 3]]) == pytest.approx(5000.0)
    assert truth.shape == (4, 99, 3)


def test_errors_by_name(rng: np.random.Generator) -> None:
    scenario = banana(azimuth_deg=180.0)
    truth = scenario.target.start(scenario._timeline)[:, None]
    u = np.array([[-1.0], [0.0]])
    w = np.array([[0.0], [-1.0]])
    mean = truth.copy()
    mean[0::2] += 3.0 * u + 4.0 * w
    errors = scenario.errors(mean, truth)
    assert np.sqrt(np.square(errors["position"]).sum()) == pytest.approx(5.0)
    assert errors["radial"][0, 0] == pytest.approx(3.0)
    assert errors["cross"][0, 0] == pytest.approx(4.0)
    assert errors["range"][0, 0] == pytest.approx(3.0, abs=1e-5)
    assert errors["azimuth_deg"][0, 0] == pytest.approx(np.rad2deg(4.0 / 2.7e6), rel=0.01)


def test_noise_of_a_simulation_has_the_stated_size() -> None:
    runs = 400
    scenario = banana(scans=20)
    data = scenario.simulate(RunStreams(5, range(runs)), runs)
    sensor = scenario.model.sensor
    noise = sensor.innovation(data.measurements, sensor.polar(data.truth[:, 1:]))
    n = noise[0].size
    for rows, sigma in zip(noise, (0.2, 2e-3), strict=True):
        assert abs(rows.std() / sigma - 1) < 4 / np.sqrt(2 * n)
    steps = data.truth[:, 1:] - np.einsum(
        "ij,jtm->itm", scenario.model.motion.F, data.truth[:, :-1]
    )
    assert abs(steps[1].var() / 1e-3 - 1) < 4 * np.sqrt(2 / n)


def test_a_run_is_lost_beyond_so_many_deviations_of_an_azimuth() -> None:
    assert banana(range_km=50.0).lost_beyond == pytest.approx(10 * 50e3 * 2e-3)
    assert banana(range_km=50.0, lost_sigmas=None).lost_beyond is None
    never = per_run(banana(lost_sigmas=None), make_filter("ekf"), 100, "lost")
    lost = per_run(banana(), make_filter("ekf"), 100, "lost")
    far = per_run(banana(lost_sigmas=None), make_filter("ekf"), 100, "rmse_position") > 54_231
    assert not never.any()
    assert 0 < far.sum() <= (lost == TOO_FAR).sum() < 100


def test_a_run_has_diverged_that_ends_ten_scans_outside_its_own_region() -> None:
    """Plain resampling leaves the target within some twenty scans and says that it has not."""
    scenario = banana(velocity_cross=1000.0, scans=40)
    share = per_run(scenario, make_filter("pf", N=1000), 40, "diverged")
    assert np.nanmean(share) > 0.8  # of those that are not lost
    assert not per_run(scenario, make_filter("gaussian-sum"), 40, "diverged").any()
    outside = np.ones((39, 2))
    outside[-10, 1] = 0.0
    assert scenario.run_metrics({"outside_region": outside})["diverged"].tolist() == [1.0, 0.0]


def test_a_window_of_earlier_scans_is_what_fewer_scans_give() -> None:
    fewer = per_run(banana(scans=30), make_filter("mcaekf"), 8, "rmse_position")
    more = banana(scans=50, until=(30,))
    np.testing.assert_array_equal(
        per_run(more, make_filter("mcaekf"), 8, "rmse_position[k<=30]"), fewer
    )
