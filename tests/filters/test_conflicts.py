"""What filters say, before anything runs, of scenarios and keys with which they cannot work."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import make_filter
from tests.papers import banana, maneuver, merwe
from trackbench.config.filter_requirements import check_fit
from trackbench.errors import Problem
from trackbench.models.assume import Assume
from trackbench.scenarios.score import Score
from trackbench.scenarios.starts.given import GivenStart
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
    assert "two scans" in refused.message
    assert refused.path == ("f." + key).rstrip(".")
    assert refusals(tracker, banana(scans=4)) == []


def test_the_line_of_sight_is_that_of_the_scans() -> None:
    radar = banana(scans=4)
    elsewhere = Assume(sensor=replace(radar.sensor, at=(1e3, 0.0)))
    (refused,) = refusals(make_filter("los-rbpf"), radar.with_assumptions(elsewhere))
    assert "needs a radar at the origin" in refused.message


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
