"""Times of a clock that counts seconds since 1970: neighbors differ wherever a time is written."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackbench import api
from trackbench.durations import time_text
from trackbench.errors import UserError
from trackbench.report.plotting import style
from trackbench.report.plotting.time_axis import count_times_from_start, start_of_times
from trackbench.results.write import digits_of_times

START = 1718023412.337
CONFIG = """
name: clock
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: m.csv}
  sensor: {kind: position, sigma: 1}
  start: {kind: given, mean: [0, 1, 0, 1], sigma: [1, 1, 1, 1]}
  assume: {motion: {kind: cv, q: 0.1}}
filters:
  KF: {kind: kf}
figures:
  nis: {kind: nis, x: time}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clock")
    (folder / "clock.yaml").write_text(CONFIG)
    time = START + np.cumsum(np.tile([0.05, 0.003], 20))
    frame = pd.DataFrame({"time": time, "x": time - START, "y": time - START})
    frame.to_csv(folder / "m.csv", index=False, float_format="%.6f")
    return folder


def test_files_and_figures_of_a_clock_show_every_step(folder: Path) -> None:
    report = api.run(folder / "clock.yaml", out=folder / "out", workers=1, quiet=True)
    steps = pd.read_csv(folder / "out" / "per_step.csv")
    times = steps[steps["metric"] == "anis"]["time"].to_numpy()
    expected = pd.read_csv(folder / "m.csv")["time"].to_numpy()
    np.testing.assert_allclose(times, expected[-len(times) :], atol=1e-5, rtol=0.0)
    (ax,) = report.results.figure("nis").axes
    assert ax.get_xlabel() == f"Time (s) after {START:.0f} s"
    labels = [ax.xaxis.get_major_formatter()(tick, None) for tick in ax.get_xticks()]
    assert len({*labels}) == len(labels)
    assert all(len(label) < 6 for label in labels)
    # The page's own axis counts as the labels do.
    svg = (folder / "out" / "figures" / "nis.svg").read_text()
    live = re.search(r'data-live="([^"]+)"', svg)
    assert live is not None
    panel = json.loads(html.unescape(live[1]))["axes"][0]
    low, high = panel["x"]["ends"]
    assert 0.0 < high - low < 2.0
    assert abs(low) < 2.0
    x = panel["curves"][0]["x"]
    assert np.diff(x).min() > 0.0


def test_a_message_names_the_row(folder: Path) -> None:
    config = folder / "twice.yaml"
    config.write_text(CONFIG.replace("m.csv", "twice.csv"))
    text = (folder / "m.csv").read_text().splitlines()
    time = text[5].partition(",")[0]
    (folder / "twice.csv").write_text("\n".join([*text[:6], f"{time},9,9", *text[6:]]))
    words = f"time {time.rstrip('0')} s is there twice"
    with pytest.raises(UserError, match=words):
        api.run(config, out=folder / "no", workers=1, quiet=True)


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (1718023412.337, "1718023412.337"),
        (1718023410.0, "1718023410"),
        (48.211, "48.211"),
        (0.1 + 0.2, "0.3"),
        (-3.0, "-3"),
        (0.0, "0"),
        (2e-9, "2e-09"),
    ],
)
def test_a_time_in_a_message(time: float, text: str) -> None:
    assert time_text(time) == text


def test_usual_times_keep_their_digits() -> None:
    assert digits_of_times(np.arange(100.0), 6) == 6
    assert digits_of_times(0.05 * np.arange(9000.0), 6) == 6
    assert digits_of_times(np.array([0.0]), 6) == 6
    assert digits_of_times(np.array([5.0, 5.0]), 6) == 6
    assert digits_of_times(np.arange(0.0, 2e6, 1e5), 6) == 6
    times = START + 0.05 * np.arange(10.0)
    assert digits_of_times(times, 6) == 15
    assert float(f"{times[3]:.15g}") == pytest.approx(times[3], abs=5e-5, rel=0.0)


def test_only_axes_of_late_times_are_counted_from_a_start() -> None:
    figure, axes = style.subplots(1, 3, 2.0)
    early, late, place = axes.ravel()
    early.plot([0.0, 10.0], [0.0, 1.0])
    late.plot([START, START + 10.0], [0.0, 1.0])
    place.plot([5e6, 5e6 + 10.0], [0.0, 1.0])
    early.set_xlabel("Time (s)")
    late.set_xlabel("Time (s)")
    place.set_xlabel("x (m)")
    count_times_from_start(figure, "Time (s)")
    assert early.get_xlabel() == "Time (s)"
    assert place.get_xlabel() == "x (m)"
    assert start_of_times(early) == start_of_times(place) == 0.0
    assert START - 10.0 < start_of_times(late) <= START
