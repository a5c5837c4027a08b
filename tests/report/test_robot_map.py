"""A robot's map: the position is what the user calls so, with heading and landmarks; it also ranks."""

from pathlib import Path

import numpy as np
import pytest

from tests.report.test_scenario_picture import lines
from trackbench import api
from trackbench.config.load import load
from trackbench.config.tuning_objective import default_metric
from trackbench.errors import UserError
from trackbench.report.figures.track import Track
from trackbench.report.findings.ranking import rankings

CONFIG = """
name: robot
seed: 1
runs: 3
scenario:
  kind: tracking
  T: 0.5
  last: 40
  target:
    kind: driven
    motion:
      kind: map
      components: [heading, SPEED, px, py]
      angles: [heading]
      next:
        heading: heading + 0.1*T
        SPEED: SPEED
        px: px + SPEED*T*cos(heading)
        py: py + SPEED*T*sin(heading)
      Q: {heading: 1e-4, SPEED: 1e-6}
    initial: {SPEED: 1, px: 1}
  sensor:
    - {kind: landmark, at: [5, 20], sigma_range: 0.1, sigma_bearing_mrad: 30}
    - {kind: landmark, at: [-9, 4], sigma_range: 0.1, sigma_bearing_mrad: 30}
    - {kind: landmark, at: [5000, 4], sigma_range: 0.1, sigma_bearing_mrad: 30}
  start: {kind: gaussian, sigma: {heading: 0.1, px: 0.3, py: 0.3}}
  score: {errors: {place: [px, py]}}
filters:
  EKF: {kind: ekf}
  UKF: {kind: ukf}
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> api.Report:
    folder = tmp_path_factory.mktemp("robot")
    (folder / "robot.yaml").write_text(CONFIG.replace("SPEED", "v"))
    return api.run(folder / "robot.yaml", out=folder / "out", workers=1, quiet=True, formats=())


def test_the_named_error_ranks_and_stands_first_in_the_table(report: api.Report) -> None:
    (ranking,) = rankings(report.results)
    assert ranking.metric.metric == "rmse_place"
    assert report.results.tables["results"].value_headers[0] == "RMSE of place"


def test_tuning_takes_the_named_error_too(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(CONFIG.replace("SPEED", "v"))
    (point,) = load(tmp_path / "robot.yaml").points
    assert default_metric(point.scenario, has_errors=True) == "rms(rmse_place)"


def test_the_map_shows_position_heading_and_landmarks_near_it(report: api.Report) -> None:
    figure = report.results.figure("track")
    (ax,) = figure.axes
    drawn = lines(ax)
    truth = report.results.tracks({})["truth"][:, :, 0]
    np.testing.assert_array_equal(drawn["Truth"], truth[[2, 3]])
    names = [text.get_text() for text in ax.texts if text.get_text()]
    assert names == ["1", "2"]
    # Each arrow begins on the path and has the direction of the heading there.
    arrows = [text for text in ax.texts if not text.get_text()]
    assert len(arrows) == 16
    for arrow in arrows:
        step = int(np.abs(truth[[2, 3]] - np.array(arrow.xyann)[:, None]).sum(axis=0).argmin())
        dx, dy = np.subtract(arrow.xy, arrow.xyann)
        assert np.arctan2(dy, dx) == pytest.approx(np.arctan2(*_sin_cos(truth[0, step])), abs=1e-9)


def _sin_cos(angle: float) -> tuple[float, float]:
    return np.sin(angle), np.cos(angle)


def test_the_error_position_names_the_axes_and_an_own_choice_comes_first(tmp_path: Path) -> None:
    text = CONFIG.replace("SPEED", "v").replace("px", "east").replace("py", "north")
    text = text.replace("kind: landmark, at: [5, 20], sigma_range: 0.1, sigma_bearing_mrad: 30",
                        "kind: function, h: {z: east, y: north}, R: 1")  # fmt: skip
    text = "\n".join(line for line in text.splitlines() if "landmark" not in line)
    text += "\nfigures:\n  map: {kind: track, best: 1}\n"
    config = tmp_path / "robot.yaml"
    config.write_text(text)
    with pytest.raises(UserError, match=r"heading, v, east, north: name its two as `components`"):
        load(config)
    config.write_text(text.replace("place:", "position:"))
    figure = load(config).figures["map"]
    assert figure.shown_components_of(load(config).points[0].scenario) == (2, 3, 0)
    config.write_text(text.replace("best: 1", "components: [north, v]"))
    figure = load(config).figures["map"]
    assert figure.shown_components_of(load(config).points[0].scenario) == (3, 1, 0)
    config.write_text(text.replace("best: 1", "components: [north, up]"))
    with pytest.raises(UserError, match="components: 'up' is no component; known: heading, v"):
        load(config)


STATES = """
name: states
runs: 2
scenario:
  kind: tracking
  T: 1
  last: 10
  target:
    kind: driven
    motion: {kind: map, components: [px, py, wind], next: NEXT, Q: {px: 1, py: 1}}
  sensor: {kind: function, h: {x: px, y: py}, R: 1}
  start: {kind: gaussian, sigma: {px: 1, py: 1}}
grid:
  scenario.target.motion.components & scenario.target.motion.next:
    - [[px, py, wind], NEXT]
    - [[px, py], {px: px, py: py}]
filters: {EKF: {kind: ekf}}
figures: {plane: {kind: track, components: [px, wind]}}
""".replace("NEXT", "{px: px + wind, py: py, wind: wind}")


def test_components_that_another_point_of_the_grid_lacks_are_found_before_the_run(
    tmp_path: Path,
) -> None:
    """The filters ran, and the second point ended with `tuple.index(x): x not in tuple`."""
    (tmp_path / "c.yaml").write_text(STATES)
    with pytest.raises(UserError, match=r"no component at components = px, py, .*known: px, py"):
        load(tmp_path / "c.yaml")


def test_the_map_of_several_filters_shows_the_best_one_too(report: api.Report) -> None:
    best = rankings(report.results)[0].order[0].label
    (other,) = {"EKF", "UKF"} - {best}
    named = Track(filters=(other, other))
    assert named.with_best(report.results).filters == (other, best)
    assert Track(filters=(other,)).with_best(report.results).filters == (other,)


RECORDED = """
name: recorded
seed: 1
scenario:
  kind: tracking
  target:
    kind: measured
    measurements: m.csv
    input: {v: v, w: w}
    state: [px, py, heading]
    angles: [heading]
    sensors: [door, lamp]
  sensor:
    - {kind: landmark, at: [5, 12], sigma_range: 0.1, sigma_bearing_mrad: 30}
    - {kind: landmark, at: [-9, 4], sigma_range: 0.1, sigma_bearing_mrad: 30}
  start: {kind: given, mean: [0, 0, 0], sigma: [0.1, 0.1, 0.1]}
  assume:
    motion:
      kind: map
      components: [px, py, heading]
      input: [v, w]
      next: {px: px + v*T*cos(heading), py: py + v*T*sin(heading), heading: heading + w*T}
      Q: {px: 1e-4, py: 1e-4, heading: 1e-3}
filters:
  EKF: {kind: ekf}
  Odometry: {kind: prior-mean}
figures:
  track: {kind: track, filters: [EKF, Odometry]}
  best: {kind: track, best: 1}
"""


def test_without_a_truth_each_panel_has_its_own_headings(tmp_path: Path) -> None:
    rows = ["time,sensor,range,bearing,v,w"]
    # The robot turns left; its gyro tells three quarters of it.
    for k in range(41):
        heading = 0.1 * k
        x, y = 10.0 * np.sin(heading), 10.0 - 10.0 * np.cos(heading)
        for name, (at_x, at_y) in {"door": (5.0, 12.0), "lamp": (-9.0, 4.0)}.items():
            dx, dy = at_x - x, at_y - y
            bearing = (np.arctan2(dy, dx) - heading + np.pi) % (2.0 * np.pi) - np.pi
            rows.append(f"{k},{name},{np.hypot(dx, dy)},{bearing},1.0,0.075")
    (tmp_path / "m.csv").write_text("\n".join(rows))
    (tmp_path / "recorded.yaml").write_text(RECORDED)
    out = tmp_path / "out"
    report = api.run(tmp_path / "recorded.yaml", out=out, workers=1, quiet=True, formats=())
    # Columns have the names of the recording: "2.range" would be taken for a tag 2.
    headers = report.results.tables["innovations"].value_headers
    for header in ("sensor 1 (door).range", "sensor 2 (lamp).bearing"):
        assert f"Prediction error, {header}" in headers
    tracks = report.results.tracks({})
    panels = zip(report.results.figure("track").axes, ("EKF", "Odometry"), strict=True)
    for ax, label in [*panels, (report.results.figure("best").axes[0], "EKF")]:
        px, py, heading = tracks[f"mean/{label}"][..., 0]
        arrows = [text for text in ax.texts if not text.get_text()]
        assert len(arrows) == 16
        for arrow in arrows:
            x, y = arrow.xyann
            distance = np.hypot(px - x, py - y)
            assert distance.min() < 1e-6
            dx, dy = np.subtract(arrow.xy, arrow.xyann)
            angle = heading[distance.argmin()]
            assert np.arctan2(dy, dx) == pytest.approx(np.arctan2(*_sin_cos(angle)), abs=1e-6)
