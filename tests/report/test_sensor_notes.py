"""Notes on landmarks that a recording without a truth contradicts: exchanged tags, and right maps."""

from pathlib import Path

import numpy as np
import pytest

from trackbench import api
from trackbench.report.findings.ranking_table import ranking_tables

STEPS = 800
INTERVAL = 0.1
TAGS = {1: (-3.5, 6.2), 3: (2.1, 10.4), 4: (6.6, 2.1), 7: (-4.0, -1.0)}
EXCHANGED = {1: TAGS[1], 3: TAGS[4], 4: TAGS[3], 7: TAGS[7]}
SCORE = "The log score counts these measurements, so it may rank the wrong filter first."
CONFIG = """
name: robot
seed: 1
scenario:
  kind: tracking
  target:
    kind: measured
    measurements: tags.csv
    input_file: wheels.csv
    input: {{v: v, w: w}}
    state: [px, py, heading]
    angles: [heading]
    sensors: [1, 3, 4, 7]
  sensor:
{sensors}
  start: {{kind: given, mean: [0, 0, 0], sigma: [0.1, 0.1, 0.1]}}
  assume:
    motion:
      kind: map
      components: [px, py, heading]
      input: [v, w]
      parameters: {{sv: {sv}, sw: 0.05}}
      where: {{c: cos(heading + w*T/2), s: sin(heading + w*T/2)}}
      next: {{px: px + v*T*c, py: py + v*T*s, heading: heading + w*T}}
      Q: [[(sv*T*c)**2, (sv*T)**2*c*s, 0], [(sv*T)**2*c*s, (sv*T*s)**2, 0], [0, 0, (sw*T)**2]]
filters:
  EKF: {{kind: ekf}}
{filters}
tables: {{}}
figures: {{}}
"""
GATED = "  Gated: {kind: ekf, gate: 0.999, gate_by: sensor}"


def notes(
    folder: Path,
    places: dict[int, tuple[float, float]],
    filters: str = "",
    at_once: int = 1,
    sigma_v: float = 0.05,
    is_blind: bool = False,
    seed: int = 3,
) -> list[str]:
    """Run filters on a log, and return the notes on single landmarks.

    ``at_once`` tags are seen at a step. The speeds have errors of ``sigma_v``. With ``is_blind`` the
    robot sees nothing for most of the time, and then tag 7 first.
    """
    rng = np.random.default_rng(seed)
    t = INTERVAL * np.arange(STEPS)
    v = 0.5 + 0.15 * np.sin(2.0 * np.pi * t / 13.0)
    w = 0.16 + 0.3 * np.sin(2.0 * np.pi * t / 11.0)
    heading = np.concatenate([[0.0], np.cumsum(w[1:] * INTERVAL)])
    middle = heading[:-1] + 0.5 * w[1:] * INTERVAL
    px = np.concatenate([[0.0], np.cumsum(v[1:] * INTERVAL * np.cos(middle))])
    py = np.concatenate([[0.0], np.cumsum(v[1:] * INTERVAL * np.sin(middle))])
    tags = ["time,sensor,range,bearing"]
    for row in range(0, STEPS, 5):
        names = [[*TAGS][(row // 5 + i) % len(TAGS)] for i in range(at_once)]
        if is_blind:
            cycle = row % 60
            names = {0: [7], 5: [1], 10: [3], 15: [4]}.get(cycle, [])
        for name in names:
            dx, dy = TAGS[name][0] - px[row], TAGS[name][1] - py[row]
            r = np.hypot(dx, dy) + 0.1 * rng.normal()
            b = np.arctan2(dy, dx) - heading[row] + 0.035 * rng.normal()
            b = (b + np.pi) % (2.0 * np.pi) - np.pi
            tags.append(f"{t[row]:.3f},{name},{r:.4f},{b:.5f}")
    v = v + sigma_v * rng.normal(size=STEPS)
    w = w + 0.05 * rng.normal(size=STEPS)
    rows = [f"{a:.3f},{b},{c}" for a, b, c in zip(t, v, w, strict=True)]
    (folder / "tags.csv").write_text("\n".join(tags))
    (folder / "wheels.csv").write_text("\n".join(["time,v,w", *rows]))
    keys = "sigma_range: 0.1, sigma_bearing_mrad: 35"
    sensors = [f"    - {{kind: landmark, at: [{x}, {y}], {keys}}}" for x, y in places.values()]
    text = CONFIG.format(sensors="\n".join(sensors), filters=filters, sv=sigma_v)
    (folder / "robot.yaml").write_text(text)
    out = folder / "out"
    report = api.run(folder / "robot.yaml", out=out, engine="serial", quiet=True, formats=())
    (table,) = ranking_tables(report.results)
    beginnings = ("The gate", "Most measurements", "The landmarks")
    return [note for note in table.notes if note.startswith(beginnings)]


@pytest.mark.parametrize("at_once", [1, 3])
def test_a_gate_that_rejects_exchanged_tags_names_them(tmp_path: Path, at_once: int) -> None:
    (note,) = notes(tmp_path, EXCHANGED, GATED, at_once)
    assert note.startswith("The gate of Gated rejected most measurements of sensor 2 (3) (")
    assert " and sensor 3 (4) (" in note
    shares = [int(word.split("(")[-1]) for word in note.split(" %")[:2]]
    assert min(shares) > 90
    assert int(note.partition(" % of the others")[0].rpartition(" ")[2]) < 10
    assert note.endswith(
        f"the place `at` may be wrong, or two of the landmarks may be exchanged. {SCORE}"
    )


def test_exchanged_tags_are_named_without_a_gate(tmp_path: Path) -> None:
    """A robust filter goes on as if they were not there."""
    (note,) = notes(tmp_path, EXCHANGED, "  T: {kind: ekf, robust: {kind: student-t, df: 4}}")
    assert note.startswith("Most measurements of sensor 2 (3) (")
    assert " sigma) and sensor 3 (4) (" in note
    assert " are far from the predictions of T, and those of the others are within " in note
    assert note.endswith(SCORE)


@pytest.mark.parametrize("first", [1, 4])
def test_a_filter_whose_path_is_bent_blames_no_tag(tmp_path: Path, first: int) -> None:
    """It predicts the right tags badly, too, and a gate shows which are wrong."""
    (note,) = notes(tmp_path, {**TAGS, first: TAGS[3], 3: TAGS[first]})
    assert note.startswith("The landmarks do not fit together: EKF predicts some of them by ")
    assert "sensor " not in note.replace("gate_by: sensor", "")
    assert "Add a filter with `gate: 0.999, gate_by: sensor`: a note then names" in note


@pytest.mark.parametrize("at_once", [1, 3])
def test_a_right_map_has_no_note(tmp_path: Path, at_once: int) -> None:
    assert notes(tmp_path, TAGS, GATED, at_once) == []


def test_a_landmark_seen_after_a_long_drift_has_no_note(tmp_path: Path) -> None:
    """Its errors are large, and so is the filter's covariance."""
    assert notes(tmp_path, TAGS, GATED, sigma_v=3.0, is_blind=True) == []
