"""What filters say, before anything runs, of scenarios and keys with which they cannot work."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import make_filter
from tests.papers import banana, maneuver, merwe
from trackbench.config.checks import check_fit
from trackbench.config.load import load
from trackbench.errors import Problem, UserError
from trackbench.models.base import Motion
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.models.motions.nonlinear import MapMotion
from trackbench.models.motions.scalar import Autoregressive
from trackbench.models.sensors.base import Assume
from trackbench.scenarios.score import Score
from trackbench.scenarios.starts.without_scans import GivenStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.measured import Measured
from trackbench.yaml_source import Source

FROM_TWO_SCANS: list[tuple[str, dict[str, Any], str]] = [
    ("conversion", {}, ""),
    ("mpf", {}, ""),
    ("los-rbpf", {}, ""),
    ("ekf", {"start": "mucm"}, "start"),
]


def refusals(tracker: Any, scenario: Any) -> list[Problem]:
    """What a config with this filter on this scenario is told."""
    source = Source({"f": {}})
    check_fit(source, ("f",), tracker, scenario)
    return source.problems


@pytest.mark.parametrize(("kind", "keys", "key"), FROM_TWO_SCANS)
def test_two_scans_are_asked_for_where_a_gaussian_is(
    kind: str, keys: dict[str, Any], key: str, tmp_path: Path
) -> None:
    seen = tmp_path / "m.csv"
    seen.write_text("run,step,range,azimuth\n0,3,2700000,1.2\n")
    simulated = banana(scans=4)
    scenario = replace(
        simulated,
        first=0,
        last=None,
        target=Measured(measurements=str(seen)),
        start=GivenStart(mean=(1.0e6, 0.0, 2.5e6, 0.0), sigma=(5e3, 1e2, 5e3, 1e2)),
        assume=Assume(motion=simulated.target.own_motion),
        score=Score(),
    )
    tracker: Any = make_filter(kind, **keys)
    (refused,) = refusals(tracker, scenario)
    assert "two scans" in refused.what
    assert refused.path == ("f." + key).rstrip(".")
    assert refusals(tracker, banana(scans=4)) == []


def test_the_line_of_sight_is_that_of_the_scans() -> None:
    radar = banana(scans=4)
    elsewhere = Assume(sensor=replace(radar.sensor, at=(1e3, 0.0)))
    (refused,) = refusals(make_filter("los-rbpf"), radar.with_assumptions(elsewhere))
    assert "needs a radar at the origin" in refused.what


@pytest.mark.parametrize("kind", ["epf", "upf", "pfde", "hdepf"])
def test_a_density_is_asked_for_where_the_noise_is_singular(kind: str) -> None:
    scenario = maneuver()
    tracker: Any = make_filter(kind)
    assert "singular" in tracker.conflicts(scenario)[""]
    assert tracker.conflicts(merwe()) == {}


@pytest.mark.parametrize(
    ("kind", "keys", "key"),
    [
        ("upf", {"transition_density": "increment"}, "transition_density"),
        ("los-rbpf", {"weights": "naive"}, "weights"),
    ],
)
def test_keys_that_mean_nothing_here_are_refused(kind: str, keys: dict[str, Any], key: str) -> None:
    tracker: Any = make_filter(kind, **keys)
    assert key in tracker.conflicts(banana(scans=4))


def imm(larger: Motion, kind: str, **keys: Any) -> Any:
    motions = (ConstantVelocity(q=1.0), larger)
    filter_ = make_filter(kind, **keys)
    return make_filter("imm", filter=filter_, motions=motions, transition=((0.9, 0.1), (0.1, 0.9)))


@pytest.mark.parametrize("kind", ["cmkf", "mcaekf"])
def test_an_imm_needs_the_sensor_that_its_models_filter_needs(kind: str) -> None:
    tracker = imm(ConstantVelocity(q=0.0), kind)
    (refused,) = refusals(tracker, maneuver())
    assert "`imm` works only with a sensor of range and azimuth" in refused.what
    assert refusals(tracker, banana(scans=4)) == []


@pytest.mark.parametrize(
    ("kind", "keys", "key"),
    [
        ("ekf", {"R": 1.0}, "filter.R"),
        ("ckf", {"start": "mucm"}, "filter.start"),
        ("ukf", {"noise": "additive", "kappa": -5.0}, "filter.kappa"),
        ("ghkf", {"order": 6}, "filter.order"),
    ],
)
def test_an_imm_refuses_what_its_models_filter_does(
    kind: str, keys: dict[str, Any], key: str
) -> None:
    """Also of the larger model alone: 6^6 points are too many, 6^4 are not."""
    (refused,) = refusals(imm(ConstantAcceleration(q=1.0), kind, **keys), maneuver())
    assert refused.path == f"f.{key}"
    assert refusals(imm(ConstantAcceleration(q=1.0), kind), maneuver()) == []


@pytest.mark.parametrize("kind", ["imm", "mmpf"])
def test_motions_are_of_the_target(kind: str) -> None:
    two = ((0.9, 0.1), (0.1, 0.9))
    good: tuple[Motion, ...] = (ConstantVelocity(q=0.1), ConstantAcceleration(q=0.1))
    assert refusals(make_filter(kind, motions=good, transition=two), maneuver()) == []
    mixed = make_filter(kind, motions=(good[0], Autoregressive(q=1.0)), transition=two)
    (refused,) = refusals(mixed, maneuver())
    assert (refused.path, refused.what) == ("f.motions.1", "a motion of x for px, vx, py, vy")
    names = ("a", "b", "c", "d")
    other = MapMotion(components=names, next={n: n for n in names}, Q=1.0)
    (refused,) = refusals(make_filter(kind, motions=(good[0], other), transition=two), maneuver())
    assert refused.what == "a motion of a, b, c, d for px, vx, py, vy"
    walk = Autoregressive(q=1.0)
    scalar = replace(merwe(), target=Driven(motion=walk), assume=Assume(motion=walk))
    (refused,) = refusals(mixed, scalar)
    assert refused.what == "a motion of positions and velocities for x"
    assert refused.path == "f.motions.0"
    assert refusals(make_filter(kind, motions=(walk, walk), transition=two), scalar) == []


def test_a_motion_that_does_not_fit_has_its_place(tmp_path: Path) -> None:
    motions = "motions:\n      - {kind: cwna, q: 0.1}\n      - {kind: ar1, q: 1}\n"
    (tmp_path / "c.yaml").write_text(
        "name: own\nscenario:\n  kind: tracking\n  last: 8\n"
        "  target: {kind: driven, motion: {kind: cv, q: 1}}\n  sensor: {kind: position, sigma: 2}\n"
        "  start: {kind: gaussian, sigma: [2, 1, 2, 1]}\n"
        f"filters:\n  IMM:\n    kind: imm\n    transition: [[0.9, 0.1], [0.1, 0.9]]\n    {motions}"
    )
    with pytest.raises(UserError) as caught:
        load(tmp_path / "c.yaml")
    assert "c.yaml:14:9: filters.IMM.motions.1: a motion of x for" in str(caught.value)
