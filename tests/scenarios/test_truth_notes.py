"""Notes on landmarks and inputs of a robot that its recorded truth contradicts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.config.load import load

STEPS = 2400
INTERVAL = 0.05
TAGS = {1: (-3.5, 6.2), 3: (2.1, 10.4), 4: (6.6, 2.1)}
SIGMA_RANGE = 0.1
SIGMA_BEARING = 0.035
CONFIG = """
name: robot
scenario:
  kind: tracking
  target:
    kind: measured
    measurements: tags.csv
    input_file: wheels.csv
    truth: truth.csv
    input: {{v: v, w: w}}
    state: [px, py, heading]
    angles: [heading]
    sensors: [1, 3, 4]
  sensor:
{sensors}
  start: {{kind: given, mean: [0, 0, 0], sigma: [0.1, 0.1, 0.1]}}
  assume:
    motion:
      kind: map
      components: [px, py, heading]
      input: [v, w]
      where: {{c: cos(heading + w*T/2), s: sin(heading + w*T/2)}}
      next: {{px: px + v*T*c, py: py + v*T*s, heading: heading + w*T}}
      Q: {{px: 1e-4, py: 1e-4, heading: 1e-4}}
filters:
  EKF: {{kind: ekf}}
"""


def notes(
    folder: Path,
    places: dict[int, tuple[float, float]] = TAGS,
    sigmas: str = "sigma_range: 0.1, sigma_bearing_mrad: 35",
    scale: float = 1.0,
    sign: float = 1.0,
    wheels: tuple[float, float] = (1.0, 1.0),
    late: int = 0,
    tags_late: float = 0.0,
    factors: dict[str, float] | None = None,
    exchanged: bool = False,
) -> tuple[str, ...]:
    """Write a log, and return the notes on it.

    ``scale`` multiplies the errors of the tags, ``sign`` their bearings, ``wheels`` the inputs v and w,
    which are ``late`` by so many rows. The tags are ``tags_late`` by so many seconds. The ``factors``
    multiply the written range, bearing, px (with py) and heading. The columns of the inputs may be
    ``exchanged``.
    """
    factor = {"range": 1.0, "bearing": 1.0, "px": 1.0, "heading": 1.0} | (factors or {})
    rng = np.random.default_rng(5)
    t = INTERVAL * np.arange(STEPS)
    v = 0.5 + 0.15 * np.sin(2.0 * np.pi * t / 13.0)
    w = 0.16 + 0.3 * np.sin(2.0 * np.pi * t / 11.0)
    heading = np.concatenate([[0.0], np.cumsum(w[1:] * INTERVAL)])
    middle = heading[:-1] + 0.5 * w[1:] * INTERVAL
    px = np.concatenate([[0.0], np.cumsum(v[1:] * INTERVAL * np.cos(middle))])
    py = np.concatenate([[0.0], np.cumsum(v[1:] * INTERVAL * np.sin(middle))])
    tags = ["time,sensor,range,bearing"]
    # Each tag is seen at every 60th step: fewer than ten times among 200 steps of the run.
    for row in range(0, STEPS, 20):
        name = [*TAGS][row // 20 % 3]
        dx, dy = TAGS[name][0] - px[row], TAGS[name][1] - py[row]
        r = np.hypot(dx, dy) + scale * SIGMA_RANGE * rng.normal()
        b = np.arctan2(dy, dx) - heading[row] + scale * SIGMA_BEARING * rng.normal()
        if rng.random() < 0.1:
            r += 2.0
        b = sign * ((b + np.pi) % (2.0 * np.pi) - np.pi)
        written = f"{factor['range'] * r:.4f},{factor['bearing'] * b:.7f}"
        tags.append(f"{t[row] + tags_late:.3f},{name},{written}")
    shown_v = wheels[0] * np.roll(v + 0.04 * rng.normal(size=STEPS), late)
    shown_w = wheels[1] * np.roll(w + 0.03 * rng.normal(size=STEPS), late)
    if exchanged:
        shown_v, shown_w = shown_w, shown_v
    inputs = zip(t, shown_v, shown_w, strict=True)
    turned = (heading + np.pi) % (2.0 * np.pi) - np.pi
    truth = zip(t, factor["px"] * px, factor["px"] * py, factor["heading"] * turned, strict=True)
    files: dict[str, Any] = {
        "tags.csv": tags,
        "wheels.csv": ["time,v,w", *(f"{a:.3f},{b},{c}" for a, b, c in inputs)],
        "truth.csv": ["time,px,py,heading", *(f"{a:.3f},{b},{c},{d}" for a, b, c, d in truth)],
    }
    for name, lines in files.items():
        if "bearing" not in sigmas and name == "tags.csv":
            lines = [line.rpartition(",")[0] for line in lines]
        (folder / name).write_text("\n".join(lines))
    sensors = [f"    - {{kind: landmark, at: [{x}, {y}], {sigmas}}}" for x, y in places.values()]
    path = folder / "robot.yaml"
    path.write_text(CONFIG.format(sensors="\n".join(sensors)))
    return load(path).points[0].scenario.cautions


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_right_places_and_inputs_have_no_note(tmp_path: Path, scale: float) -> None:
    assert notes(tmp_path, scale=scale) == ()


@pytest.mark.parametrize("sigmas", ["sigma_range: 0.1, sigma_bearing_mrad: 35", "sigma_range: 0.1"])
def test_two_tags_exchanged_are_both_named_with_their_places(tmp_path: Path, sigmas: str) -> None:
    first, second = notes(tmp_path, {1: TAGS[1], 3: TAGS[4], 4: TAGS[3]}, sigmas)
    for note, name, place in ((first, "sensor 2 (3)", TAGS[3]), (second, "sensor 3 (4)", TAGS[4])):
        assert f" of {name} " in note
        assert note.endswith("]: check `at`")
        x, y = (float(number) for number in note.rpartition("[")[2].partition("]")[0].split(","))
        assert np.hypot(x - place[0], y - place[1]) < 0.15


def test_a_tag_that_is_slightly_off_is_named(tmp_path: Path) -> None:
    (note,) = notes(tmp_path, {**TAGS, 1: (-3.5, 6.8)})
    assert "the truth and the measurements of sensor 1 disagree" in note
    assert "they agree if it is at [-3." in note


def test_all_tags_off_ask_for_the_origin_too(tmp_path: Path) -> None:
    moved = {name: (x + 3.0, y) for name, (x, y) in TAGS.items()}
    found = notes(tmp_path, moved)
    assert len(found) == 4
    assert found[-1] == "no landmark is where the truth says: or check the truth's origin and clock"


def test_bearings_that_count_clockwise_are_said_in_one_note(tmp_path: Path) -> None:
    (note,) = notes(tmp_path, sign=-1.0)
    assert "of sensor 1, sensor 2 (3) and sensor 3 (4) disagrees with the truth (medians: " in note
    assert note.endswith(
        "if its bearing counts from the heading clockwise: say `clockwise: [bearing]` in the target"
    )


@pytest.mark.parametrize(
    ("wheels", "words"),
    [
        ((1.0, 180.0 / np.pi), ("input w", "multiplied by 0.017: are deg and rad mixed up?")),
        ((1.0, -1.0), ("input w", "of the other sign: write `-w` in the equations")),
        ((1000.0, 1.0), ("input v", ": are mm and m mixed up?")),
        ((3.6, 1.0), ("input v", "are km/h and m/s mixed up?")),
        ((0.2, 1.0), ("input v", "check its unit, `units`")),
        ((1.0, -180.0 / np.pi), ("input w", "of the other sign and multiplied by 0.017")),
    ],
)
def test_an_input_in_another_unit_or_of_the_other_sign(
    tmp_path: Path, wheels: tuple[float, float], words: tuple[str, ...]
) -> None:
    (note,) = notes(tmp_path, wheels=wheels)
    for each in words:
        assert each in note


@pytest.mark.parametrize("scale", [0.93, 1.1])
def test_a_scale_error_is_no_wrong_unit(tmp_path: Path, scale: float) -> None:
    assert notes(tmp_path, wheels=(scale, scale)) == ()


def test_an_input_that_is_late(tmp_path: Path) -> None:
    found = notes(tmp_path, late=24)
    assert any(
        note.startswith("the input w is some 1.2 s behind the truth: check") for note in found
    )


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_detections_that_are_late(tmp_path: Path, scale: float) -> None:
    """Those of all tags have one clock."""
    sigmas = "sigma_range: 0.3, sigma_bearing_mrad: 100"
    # A row that comes after the last inputs is left out, with a note.
    *_, note = notes(tmp_path, sigmas=sigmas, tags_late=0.4 * scale)
    assert note.startswith(
        "the measurements of sensor 1, sensor 2 (3) and sensor 3 (4) seem to be some "
    )
    assert note.endswith(" s behind the truth: check the clocks of both")
    delay = float(note.partition("some ")[2].partition(" s ")[0])
    assert delay == pytest.approx(0.4 * scale, abs=0.1)


@pytest.mark.parametrize("factor", [1000.0, 0.001, 100.0])
def test_places_in_another_unit_have_one_note(tmp_path: Path, factor: float) -> None:
    places = {name: (factor * x, factor * y) for name, (x, y) in TAGS.items()}
    (note,) = notes(tmp_path, places)
    unit = "cm" if factor == 100.0 else "mm"
    words = f"if its place `at` is multiplied by {1.0 / factor:g}: are {unit} and m"
    assert words in note


@pytest.mark.parametrize(
    ("quantity", "factor", "words"),
    [
        (
            "range",
            1000.0,
            "if its range is multiplied by 0.001: are mm and m, or m and km, mixed up?",
        ),
        ("bearing", np.pi / 180.0, "if its bearing is multiplied by 57: are deg and rad mixed up?"),
        ("px", 100.0, "if px and py of the truth are multiplied by 0.01: are cm and m mixed up?"),
        ("heading", np.pi / 180.0, "if heading of the truth is multiplied by 57: are deg and rad"),
    ],
)
def test_measurements_and_a_truth_in_another_unit(
    tmp_path: Path, quantity: str, factor: float, words: str
) -> None:
    found = notes(tmp_path, factors={quantity: factor})
    assert words in found[0]
    # A truth in another unit contradicts the inputs, too.
    assert all("the input " in note for note in found[1:])


def test_exchanged_columns_of_the_inputs(tmp_path: Path) -> None:
    assert notes(tmp_path, exchanged=True) == (
        "the inputs v and w fit the truth if they are exchanged: check their columns under `input`",
    )


def test_headings_of_a_compass_are_explained(tmp_path: Path) -> None:
    """The truth's heading counts clockwise from north, as the key `clockwise` of the truth says."""
    notes(tmp_path)
    lines = (tmp_path / "truth.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    column = lines[0].split(",").index("heading")
    for row in rows:
        row[column] = f"{0.5 * np.pi - float(row[column]):.9f}"
    (tmp_path / "truth.csv").write_text("\n".join([lines[0], *map(",".join, rows)]))
    first, *_ = load(tmp_path / "robot.yaml").points[0].scenario.cautions
    assert first.endswith(
        "they agree if heading of the truth counts from north clockwise: say `truth_naming: "
        "{clockwise: [heading]}`"
    )
    text = (tmp_path / "robot.yaml").read_text()
    key = "    truth: truth.csv\n    truth_naming: {clockwise: [heading]}\n"
    (tmp_path / "robot.yaml").write_text(text.replace("    truth: truth.csv\n", key))
    assert load(tmp_path / "robot.yaml").points[0].scenario.cautions == ()


def test_bearings_that_do_not_count_from_the_heading_are_explained(tmp_path: Path) -> None:
    notes(tmp_path)
    truth = np.loadtxt(tmp_path / "truth.csv", delimiter=",", skiprows=1)
    names, *lines = (tmp_path / "tags.csv").read_text().splitlines()
    columns = names.split(",")
    rows = [line.split(",") for line in lines]
    for row in rows:
        time = float(row[columns.index("time")])
        heading = truth[np.abs(truth[:, 0] - time).argmin(), 3]
        bearing = columns.index("bearing")
        row[bearing] = f"{float(row[bearing]) + heading:.7f}"
    (tmp_path / "tags.csv").write_text("\n".join([names, *map(",".join, rows)]))
    first, *_ = load(tmp_path / "robot.yaml").points[0].scenario.cautions
    assert first.endswith(
        "if its bearing counts from the axis x, and not from the heading: subtract the heading from it"
    )
