"""Likelihoods that clouds estimate: unbiased, and close to quadrature and the Kalman filter."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.filters.test_log_likelihood import told
from tests.linear_problem import LINEAR
from tests.papers import banana, merwe
from trackbench.core.arrays import Array
from trackbench.filters.grid import Grid
from trackbench.filters.kf import KF
from trackbench.models.motions.kinematic import WhiteAcceleration

SCALAR = merwe(T=4, R=0.1)
RUNS = 300
UNBIASED: dict[str, Any] = {
    "bootstrap": make_filter("pf", N=100),
    "now and then": make_filter("pf", N=100, ess_threshold=0.5),
    "residual": make_filter("pf", N=100, resampling="residual"),
    "rpf": make_filter("rpf", N=100, bandwidth_scale=0.0),
    "epf": make_filter("epf", N=100, defensive=0.3),
    "upf": make_filter("upf", N=100, defensive=0.3),
    "boosted": make_filter("pf", N=50, boost=4, boost_scans=2),
}


@cache
def exact(runs: int) -> Array:
    """Of the scalar model by quadrature (T, M): the first runs are the same whatever their number."""
    return told(SCALAR, Grid(), runs)


def off(ratio: Array) -> float:
    """By how many standard errors the mean of estimated over exact likelihoods is not one."""
    return float((ratio.mean() - 1.0) / (ratio.std(ddof=1) / np.sqrt(len(ratio))))


@pytest.mark.parametrize("name", UNBIASED)
def test_on_a_scalar_it_is_unbiased(name: str) -> None:
    """E[estimate] = p(z_1..T) of given data (Del Moral 2004, section 7.4), whatever N is."""
    found = told(SCALAR, UNBIASED[name], RUNS)
    assert abs(off(np.exp((found - exact(RUNS)).sum(axis=0)))) < 4.0


@pytest.mark.parametrize("name", ["pfde", "hdepf"])
def test_the_first_likelihood_of_an_evolving_cloud_is_unbiased(name: str) -> None:
    tracker = make_filter(name, N=100, G=1, **({"defensive": 0.3} if name == "hdepf" else {}))
    found = told(SCALAR, tracker, RUNS)
    assert abs(off(np.exp((found - exact(RUNS))[0]))) < 4.0


@pytest.mark.parametrize("kind", ["pf", "rpf", "upf"])
def test_a_large_cloud_comes_close_to_quadrature(kind: str) -> None:
    tracker = make_filter(kind, N=100_000)
    found = told(SCALAR, tracker, 3)
    # The relative error of a mean of N weights is their spread over sqrt(N); theirs is some 20 at most.
    np.testing.assert_allclose(found, exact(3), atol=0.1)


@pytest.mark.parametrize(
    "tracker",
    [
        make_filter("pf", N=500),
        make_filter("apf", N=500),
        make_filter("apf", N=500, first_stage="sample"),
        make_filter("apf", N=500, carried="float64"),
        make_filter("apf", N=500, stages=2),
    ],
    ids=["pf", "apf", "sample", "float64", "two stages"],
)
def test_on_a_linear_model_it_is_the_kalman_filters(tracker: Any) -> None:
    """There the ratios that an auxiliary filter weighs by have a variance."""
    known, found = told(LINEAR, KF(), 300), told(LINEAR, tracker, 300)
    assert abs(off(np.exp((found - known).sum(axis=0)))) < 4.0


@pytest.mark.parametrize("kind", ["enkf", "edh", "gpf"])
def test_a_large_ensemble_comes_close_to_the_kalman_filter(kind: str) -> None:
    """Moments of N draws are off by a share of 1 / sqrt(N), and so are innovations and their S."""
    known, found = told(LINEAR, KF(), 4), told(LINEAR, make_filter(kind, N=50_000), 4)
    np.testing.assert_allclose(found, known, atol=0.05)


def test_a_cloud_of_one_motion_twice_scores_as_that_motion() -> None:
    """What the particles carry beside the state must not enter the weights."""
    motions = (WhiteAcceleration(q=1.0),) * 2
    tracker = make_filter(
        "mmpf", N=500, motions=motions, transition=((0.9, 0.1), (0.2, 0.8)), bandwidth_scale=0.0
    )
    known, found = told(LINEAR, KF(), 300), told(LINEAR, tracker, 300)
    assert abs(off(np.exp((found - known).sum(axis=0)))) < 4.0


def test_of_a_measurement_that_is_missing_there_is_none() -> None:
    scenario = replace(LINEAR, sensor=replace(LINEAR.sensor, detection=0.6))
    found, known = told(scenario, make_filter("rpf", N=20_000), 5), told(scenario, KF(), 5)
    assert np.isnan(known).any()
    np.testing.assert_allclose(found, known, atol=0.2)


def test_weights_that_are_no_densities_score_nothing() -> None:
    demo = make_filter("upf", "merwe-demo", N=10)
    assert np.isnan(told(SCALAR, demo, 3)).all()


def test_marginalized_clouds_and_sums_agree_with_a_plain_cloud() -> None:
    """All draw both first azimuths; the sharp range leaves some thousand of 300 000 particles."""
    scenario = banana(scans=5)
    plain = told(scenario, make_filter("pf", N=300_000), 4)
    for tracker, steps in (
        (make_filter("los-rbpf", N=20_000), 2),
        (make_filter("mpf", N=200_000), 1),
        (make_filter("gaussian-sum", split=41, kept=1000, merge_within=0.0), 1),
    ):
        found = told(scenario, tracker, 4)
        np.testing.assert_allclose(found[:steps], plain[:steps], atol=0.2)
