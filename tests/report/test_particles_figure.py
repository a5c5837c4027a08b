"""The figure `particles`: what it draws of a run is what the filter had."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trackbench
from tests.conftest import PLANE, make_filter, track
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.filters.base import Trajectories
from trackbench.scenarios.base import Scenario

CONFIG = f"""name: cloud
runs: 3
{PLANE}filters:
  PF: {{kind: pf, N: 20}}
  APF: {{kind: apf, N: 20}}
  KF: {{kind: kf}}
figures:
  cloud: {{kind: particles, run: 2, steps: [2, 4]}}
"""


@pytest.fixture(scope="module")
def without_noise(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """A target of constant velocity: a particle is exactly where its parent leads."""
    path = tmp_path_factory.mktemp("config") / "cloud.yaml"
    path.write_text(CONFIG.replace("kind: cv, q: 1", "kind: cwna, q: 0"))
    return load(path).points[0].scenario


def clouds(scenario: Scenario, kind: str, **keys: Any) -> Array:
    """Particles (n_x + 2, 4, N, 2) of two runs, whose weighted means are the estimates."""
    tracker = make_filter(kind, N=20, **keys)
    out = track(scenario, tracker, 3, runs_with_tracks=2, particle_steps=(2, 5))
    assert out.particles is not None
    x, w = np.nan_to_num(out.particles[:4]), np.nan_to_num(out.particles[4])
    np.testing.assert_allclose((x * w).sum(axis=2), out.mean[:, 2:6, :2], rtol=1e-9)
    return out.particles


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("pf", {}),
        ("pf", {"ess_threshold": 0.5}),
        ("pf", {"boost": 3, "boost_scans": 3}),
        ("rpf", {"bandwidth_scale": 0.0}),
        ("jitter-pf", {"bandwidth_scale": 0.0}),
    ],
)
def test_a_particle_is_where_its_parent_leads(
    without_noise: Scenario, kind: str, keys: dict[str, Any]
) -> None:
    every = clouds(without_noise, kind, **keys)
    F = without_noise.model.motion.F  # type: ignore[union-attr]
    for run in range(2):
        for i in range(1, 4):
            before, after = every[:4, i - 1, :, run], every[:, i, :, run]
            after = after[:, np.isfinite(after[4])]
            led = F @ before[:, after[5].astype(int)]
            np.testing.assert_allclose(after[:4], led, rtol=1e-12)
            assert len(np.unique(after[5])) > 1


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("apf", {}),
        ("apf", {"stages": 2}),
        ("pf", {"estimate_from": "resampled"}),
    ],
)
def test_an_unknown_parent_is_none(
    without_noise: Scenario, kind: str, keys: dict[str, Any]
) -> None:
    assert np.isnan(clouds(without_noise, kind, **keys)[5]).all()


@pytest.mark.parametrize("lag", [None, 2])
def test_a_trajectory_goes_on_unless_each_step_has_its_own(tmp_path: Path, lag: int | None) -> None:
    (tmp_path / "cloud.yaml").write_text(CONFIG.replace("kind: cv, q: 1", "kind: cwna, q: 1"))
    scenario = load(tmp_path / "cloud.yaml").points[0].scenario
    every = clouds(scenario, "pf", smooth=Trajectories(trajectories=20, lag=lag))
    if lag is None:
        np.testing.assert_array_equal(every[5, 1:, :, 0], np.tile(np.arange(20.0), (3, 1)))
    else:
        assert np.isnan(every[5]).all()


def test_it_draws_the_filters_that_have_particles(tmp_path: Path) -> None:
    (tmp_path / "cloud.yaml").write_text(CONFIG)
    options: dict[str, Any] = {"quiet": True, "engine": "serial", "formats": ["svg"]}
    results = trackbench.run(tmp_path / "cloud.yaml", out=tmp_path / "out", **options).results
    axes = [ax for ax in results.figure("cloud").axes if ax.get_title()]
    assert [ax.get_title() for ax in axes] == ["PF", "APF"]
    assert [len(ax.lines) for ax in axes] == [2 * 20 + 2, 1]  # to parents, their label, the truth
    tracks = results.tracks({})
    heights = axes[0].collections[0].get_offsets()[:, 1]
    np.testing.assert_array_equal(heights, tracks["particles/PF"][0, :, :, 1].ravel())
    assert (tmp_path / "out" / "figures" / "cloud.svg").exists()


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("steps: [2, 4]", "steps: [2, 40]", "[2, 40] are no steps of 0 to 8"),
        ("run: 2", "filters: [KF]", "no filter here has particles"),
    ],
)
def test_what_it_cannot_draw_is_refused(tmp_path: Path, old: str, new: str, why: str) -> None:
    (tmp_path / "cloud.yaml").write_text(CONFIG.replace(old, new))
    with pytest.raises(trackbench.UserError, match=why.replace("[", r"\[")):
        load(tmp_path / "cloud.yaml")
