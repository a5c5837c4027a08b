"""Readings and presets do what their names say."""

import numpy as np
import pytest

from tests.conftest import make_filter, per_run, track
from tests.linear_problem import LINEAR
from tests.papers import banana, merwe
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.evaluation.simulated_runs import simulate
from trackbench.models.motions.kinematic import WhiteAcceleration


def test_literal_hdepf_is_lost_and_says_why() -> None:
    lost = per_run(merwe(), make_filter("hdepf", preset="literal"), 40, "lost")
    rmse = per_run(merwe(), make_filter("hdepf", preset="literal"), 40)
    assert (lost > 0).mean() > 0.9
    np.testing.assert_array_equal(np.isnan(rmse), lost > 0)


def test_half_of_all_steps_have_no_float64_likelihood_at_ten_particles() -> None:
    dead = per_run(merwe(), make_filter("pf", N=10, weights="naive"), 100, "collapsed_steps")
    assert 0.4 < dead.mean() / 49 < 0.6
    assert not per_run(merwe(), make_filter("pf", N=10), 100, "collapsed_steps").any()


def test_selection_on_a_normalized_fitness_accepts_nearly_everything() -> None:
    accepted = per_run(
        merwe(), make_filter("hdepf", preset="published-level"), 20, "acceptance_rate"
    ).mean()
    assert accepted > 0.92


def test_gamma_scale_would_triple_every_error() -> None:
    """Why the second parameter is read as a rate."""
    rate = per_run(merwe(), make_filter("prior-mean"), 100).mean()
    scale = per_run(merwe(gamma_rate=0.5, lost_beyond=None), make_filter("prior-mean"), 100).mean()
    assert scale > 3 * rate


@pytest.mark.parametrize("keys", [{"sine_index": "old"}, {"first": 0}])
def test_index_readings_are_negligible(keys: dict) -> None:
    base = per_run(merwe(), make_filter("pf", N=10), 300)
    other = per_run(merwe(**keys), make_filter("pf", N=10), 300)
    stderr = np.hypot(base.std(), other.std()) / np.sqrt(300)
    assert abs(base.mean() - other.mean()) < 4 * stderr + 0.02 * base.mean()


def test_a_first_state_that_nobody_knows() -> None:
    """The truth is drawn from the prior, and the grid's posterior is a large cloud's."""
    scenario = merwe(x1=0.0, P1=1.0, T=6, R=0.1)
    first = simulate(scenario, 1, 0, 400).truth[0, 0]
    assert abs(first.mean()) < 4.0 / np.sqrt(400)
    assert abs(first.var() - 1.0) < 4.0 * np.sqrt(2.0 / 400)
    exact = track(scenario, make_filter("grid", nodes=64), 10)
    cloud = track(scenario, make_filter("pf", N=20_000), 10)
    np.testing.assert_allclose(exact.mean[0, 0], 0.0, atol=1e-15)
    off = cloud.mean[0, 1:] - exact.mean[0, 1:]
    assert np.sqrt(np.square(off).mean()) < 0.02
    same = track(scenario, make_filter("grid", nodes=100), 10)
    np.testing.assert_allclose(exact.mean, same.mean, atol=1e-5)


def test_weights_and_copies_are_counted() -> None:
    """One measurement: all N weights and particles can be looked at."""
    scenario = merwe(R=0.1)
    data = scenario.simulate(RunStreams(1, range(5)), 5)
    for kind in ("pf", "apf", "rpf", "epf", "upf", "hdepf"):
        tracker = make_filter(kind, N=12)
        state = tracker.init(scenario.model, data.prior, block_stream(1, 0))
        state = tracker.step(scenario.model, state, data.measurements[:, 0], 2, block_stream(2, 0))
        noted = tracker.diagnostics(state)
        for m in range(5):
            assert noted["ess"][m] == pytest.approx(1.0 / sum(w * w for w in state.w[m]) / 12)
            if "distinct_particles" in noted:
                assert noted["distinct_particles"][m] == len(set(state.particles.x[0, m])) / 12
    # Copies of a cloud clipped to its own limits do not stand side by side.
    tracker = make_filter("hdepf", preset="published-level", N=12)
    state = tracker.init(scenario.model, data.prior, block_stream(1, 0))
    state = tracker.step(scenario.model, state, data.measurements[:, 0], 2, block_stream(2, 0))
    found = [len(set(x)) / 12 for x in state.particles.x[0]]
    np.testing.assert_array_equal(tracker.diagnostics(state)["distinct_particles"], found)
    assert min(found) < 1.0


def test_resampling_schemes_and_threshold_agree_on_the_level() -> None:
    scenario = merwe(R=0.1)
    floor = per_run(scenario, make_filter("grid", nodes=32), 60).mean()
    for keys in (
        {"resampling": "stratified"},
        {"resampling": "residual"},
        {"resampling": "multinomial"},
        {"ess_threshold": 0.5},
    ):
        rmse = per_run(scenario, make_filter("pf", N=2000, **keys), 60).mean()
        assert rmse == pytest.approx(floor, rel=0.02)


def test_defensive_proposal_bounds_what_a_bad_one_costs() -> None:
    """A proposal without the noise's mean misses; prior draws in it keep the filter alive."""
    scenario = merwe(R=0.1)
    bad = {"N": 200, "noise_mean": False, "Q": 0.01, "R": 10.0}
    alone = per_run(scenario, make_filter("upf", **bad), 60).mean()
    mixed = per_run(scenario, make_filter("upf", **bad, defensive=0.3), 60).mean()
    assert mixed < 0.7 * alone


def test_generations_without_end_draw_a_cloud_together() -> None:
    """To its best point: 30 particles lie within half of where they were, wherever that is."""
    scenario = merwe(R=0.1)
    ratio = track(scenario, make_filter("pfde", N=30, G=60), 10).diagnostics["spread_ratio"][1:]
    assert np.median(ratio) < 0.5
    still = track(scenario, make_filter("pfde", N=30, G=0), 10).diagnostics["spread_ratio"]
    np.testing.assert_allclose(still[1:], 1.0)


def test_an_inverted_measurement_has_the_variance_of_its_slope() -> None:
    """R times the squared slope of h^-1, by differences: of the square, and of the line."""
    scenario, tracker, e = merwe(R=0.1), make_filter("inversion"), 1e-5
    data, rng = scenario.simulate(RunStreams(1, range(6)), 6), block_stream(1, 0)
    for k in (2, 40):
        z = np.abs(data.measurements[:, k - 2])
        state = tracker.step(
            scenario.model, tracker.init(scenario.model, data.prior, rng), z, k, rng
        )
        low, high = (scenario.model.sensor.inverse(z + d, k) for d in (-e, e))
        expected = 0.1 * np.square((high - low) / (2 * e))
        np.testing.assert_allclose(tracker.estimate(state).cov[0], expected, rtol=1e-6)
    # A run without a measurement is alone in that.
    z[0, 2] = np.nan
    gap = tracker.step(scenario.model, state, z, 41, rng)
    np.testing.assert_array_equal(gap.mean[0] == state.mean[0], np.arange(6) != 2)
    assert np.isfinite(gap.mean).all()


@pytest.mark.parametrize("scans", [1, 3])
@pytest.mark.parametrize("kind", ["pf", "rpf", "apf", "mpf", "los-rbpf", "mmpf"])
def test_a_boost_lasts_as_many_steps_as_it_says(kind: str, scans: int) -> None:
    """The first state counts: thrice the particles before the first updates, then N."""
    two = {"motions": (WhiteAcceleration(q=1e-3),) * 2, "transition": ((0.9, 0.1), (0.1, 0.9))}
    scenario = banana(scans=6)
    tracker = make_filter(kind, N=50, boost=3, boost_scans=scans, **(two if kind == "mmpf" else {}))
    data, rng, sizes = simulate(scenario, 1, 0, 2), block_stream(1, 0), []
    state = tracker.init(scenario.model, data.prior, rng)
    for k, z in zip(scenario.steps[1:], data.measurements.swapaxes(0, 1), strict=True):
        sizes.append(state.particles.x.shape[-1])
        state = tracker.step(scenario.model, state, z, int(k), rng)
    assert sizes == [150] * scans + [50] * (4 - scans)
    assert (tracker.particle_count, tracker.max_particle_count) == (50, 150)
    assert (make_filter("kf").particle_count, make_filter("kf").max_particle_count) == (1, 1)


def test_particles_follow_the_motions_as_their_chain_says() -> None:
    """Of two equal motions measurements tell nothing: the share of the second is the Markov chain's."""
    chain, N = np.array([[0.9, 0.1], [0.2, 0.8]]), 4000
    motions = (WhiteAcceleration(q=1.0),) * 2
    keys = {"motions": motions, "transition": tuple(map(tuple, chain)), "initial": (0.9, 0.1)}
    tracker = make_filter("mmpf", N=N, **keys)
    found = track(LINEAR, tracker, 20).diagnostics["mode"].mean(axis=1)[1:]
    expected = [
        (np.array([0.9, 0.1]) @ np.linalg.matrix_power(chain, k))[1]
        for k in range(1, len(found) + 1)
    ]
    np.testing.assert_allclose(found, expected, atol=4 * 0.5 / np.sqrt(N))  # of a single cloud
