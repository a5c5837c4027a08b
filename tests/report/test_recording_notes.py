"""Notes below the ranking of one recording: ANIS outside its band, closed gates, costly steps."""

from pathlib import Path

import numpy as np
import pytest

from trackbench import api
from trackbench.config.experiment import cautions
from trackbench.report.findings.ranking_table import ranking_tables
from trackbench.statistics.consistency_bands import largest_anees_of_one_run

STEPS = 600
CONFIG = """
name: notes
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: m.csv}
  sensor: {kind: position, sigma: 1}
  start: {kind: one-scan, sigma_velocity: 20}
  assume: {motion: {kind: cwna, q: 0.01}}
filters:
  KF: {kind: kf}
  Gated: {kind: kf, gate: 0.999}
figures: {}
"""


def notes(folder: Path, x: np.ndarray, y: np.ndarray, text: str = CONFIG) -> list[str]:
    """Run both filters on measured positions (K,), and return the notes on their ranking."""
    rng = np.random.default_rng(3)
    x = x + rng.normal(size=len(x))
    y = y + rng.normal(size=len(x))
    lines = [f"{k},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(zip(x, y, strict=True))]
    (folder / "m.csv").write_text("\n".join(["time,x,y", *lines]))
    (folder / "notes.yaml").write_text(text)
    out = folder / "out"
    report = api.run(folder / "notes.yaml", out=out, engine="serial", quiet=True, formats=())
    (table,) = ranking_tables(report.results)
    kinds = ("ANIS", "The gate", "A few")
    return [note for note in table.notes if note.startswith(kinds)]


TIME = np.arange(float(STEPS))
STRAIGHT = 10.0 * TIME
ZERO = np.zeros(STEPS)


def test_a_right_filter_has_none(tmp_path: Path) -> None:
    # The motion is random, as the filters assume it.
    velocity = 0.1 * np.cumsum(np.random.default_rng(4).normal(size=(2, STEPS)), axis=1)
    x, y = np.cumsum(velocity, axis=1)
    assert notes(tmp_path, x, y) == []


def test_a_gate_that_loses_the_target_is_named_with_the_step(tmp_path: Path) -> None:
    turning = np.where(TIME < 60, 0.0, 0.3 * (TIME - 60) ** 2)
    y = np.where(TIME < 120, turning, 1080.0 + 36.0 * (TIME - 120))
    found = notes(tmp_path, STRAIGHT, y)
    (gate,) = [note for note in found if note.startswith("The gate")]
    assert gate.startswith("The gate of Gated rejected 8")
    assert 60 < _last_used_step(gate) < 75
    anis = [note for note in found if note.startswith("ANIS above")]
    assert "KF " in anis[0]


def _last_used_step(gate: str) -> int:
    """Read the step after which all measurements are rejected from a note on a gate."""
    return int(gate.partition(", among them all those after step ")[2].partition(":")[0])


def test_a_gate_that_rejects_outliers_and_then_all_has_both_in_its_share(tmp_path: Path) -> None:
    x = STRAIGHT.copy()
    x[10:40:2] += 300.0  # 15 outliers
    y = np.where(TIME < 300, 0.0, 0.3 * (TIME - 300) ** 2)
    found = notes(tmp_path, x, y)
    (gate,) = [note for note in found if note.startswith("The gate")]
    step = _last_used_step(gate)
    assert 300 < step < 315
    # Of 599 steps all later ones are rejected, and the outliers before.
    rejected = STEPS - 1 - step + 15
    assert gate.startswith(f"The gate of Gated rejected {100 * rejected / (STEPS - 1):.0f} % of")


def test_a_few_outliers_are_named_with_their_cost(tmp_path: Path) -> None:
    x = STRAIGHT.copy()
    x[[50, 200, 310, 400]] += 300.0
    found = notes(tmp_path, x, ZERO)
    (few,) = [note for note in found if note.startswith("A few")]
    nats = float(few.partition("Gated by ")[2].partition(" nats (4 of 599 steps)")[0])
    # Four times half of (300 m)^2 over the predicted variance of some 1.5 m^2, of 599 steps.
    assert nats == pytest.approx(4 * 0.5 * 300.0**2 / 1.5 / 599, rel=0.3)
    assert "What a gate rejects counts in this score, too." in few
    assert any("ANIS above the 95 % band of a consistent filter (0.92" in note for note in found)


def test_an_outlier_that_is_held_out_is_named_with_its_step(tmp_path: Path) -> None:
    """Of 120 steps every fifth measurement is held out, such as that of step 60: 23 have a score."""
    config = CONFIG.replace("figures: {}", "figures: {}\nhold_out: 5")
    for column in ("log_score", "held_log_score"):
        # The first column of the first table ranks the filters, and the note comes with either.
        text = f"{config}\ntables: {{t: {{kind: metrics, columns: {{A: mean({column})}}}}}}"
        for far, number in ((0.0, 0), (300.0, 1)):
            x = STRAIGHT[:120].copy()
            x[60] += far
            found = [note for note in notes(tmp_path, x, ZERO[:120], text) if "A few" in note]
            assert len(found) == number
    (few,) = found
    assert few.startswith("A few held-out steps lower mean held-out log scores: ")
    assert "(1 of 23 steps); the worst is step 60. " in few


def test_notes_on_the_data_stay_with_the_results(tmp_path: Path) -> None:
    """The manifest has what `run` prints about the data, and a page that is written again, too."""
    kept_notes = {}
    for name, sign in (("good", 1.0), ("mirrored", -1.0)):
        folder = tmp_path / name
        folder.mkdir()
        lines = [f"{k},{10.0 * k},{3.0 * k}" for k in range(100)]
        (folder / "m.csv").write_text("\n".join(["time,x,y", *lines]))
        lines = [f"{k},{10.0 * k},{sign * 3.0 * k}" for k in range(100)]
        (folder / "t.csv").write_text("\n".join(["time,x,y", *lines]))
        text = CONFIG.replace("measurements: m.csv", "measurements: m.csv, truth: t.csv")
        (folder / "notes.yaml").write_text(text)
        out = folder / "out"
        report = api.run(folder / "notes.yaml", out=out, engine="serial", quiet=True, formats=())
        kept_notes[name] = report.manifest.get("data_notes")
        if kept_notes[name] is not None:
            assert kept_notes[name] == cautions(
                api.prepare(folder / "notes.yaml", api.Options()).points
            )
            (note,) = kept_notes[name]
            assert f"Note on the data: {note}" in report._repr_html_()
            assert f"Note on the data: {note}" in (out / "report.html").read_text()
            (out / "report.html").unlink()
            api.report(out)
            assert f"Note on the data: {note}" in (out / "report.html").read_text()
    assert kept_notes["good"] is None
    assert "they agree if the truth is mirrored at the x axis" in str(kept_notes["mirrored"])


@pytest.mark.parametrize(("offset", "sigma"), [(0.0, 1.0), (10.0, 1.0), (0.0, 0.1)])
def test_with_a_truth_an_inconsistent_filter_is_named_by_both_squares(
    tmp_path: Path, offset: float, sigma: float
) -> None:
    """A wrong truth shows in the ANEES alone, and a wrong sigma in the ANIS, too."""
    rng = np.random.default_rng(4)
    truth = np.cumsum(0.1 * np.cumsum(rng.normal(size=(2, 200)), axis=1), axis=1)
    for name, path in (("m", truth + rng.normal(size=truth.shape)), ("t", truth + offset)):
        lines = [f"{k},{x:.4f},{y:.4f}" for k, (x, y) in enumerate(path.T)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["time,x,y", *lines]))
    text = CONFIG.replace("m.csv", "m.csv, truth: t.csv")
    text = text.replace("sigma: 1}", f"sigma: {sigma}}}")
    text += "metrics: [rmse_position, nees_position, anis, innovations]\n"
    text = text.replace("  start", "  score: {marginals: [position]}\n  start")
    (tmp_path / "notes.yaml").write_text(text)
    out = tmp_path / "out"
    report = api.run(tmp_path / "notes.yaml", out=out, engine="serial", quiet=True, formats=())
    (table,) = ranking_tables(report.results)
    anees = [note for note in table.notes if note.startswith("ANEES of the position above what")]
    anis = [note for note in table.notes if note.startswith("ANIS above")]
    assert len(anees) == int(offset > 0.0 or sigma < 1.0)
    assert bool(anis) == (sigma < 1.0)


@pytest.mark.parametrize("n_x", [1, 2, 4])
def test_the_limit_of_an_anees_holds_for_any_dependence(n_x: int) -> None:
    """It is the mean of the largest hundredth, which equal errors at all steps exceed rarely."""
    squares = np.random.default_rng(5).chisquare(n_x, 200_000) / n_x
    limit = largest_anees_of_one_run(n_x, 0.01)
    assert (squares > limit).mean() < 0.01
    assert limit == pytest.approx(np.sort(squares)[-2000:].mean(), rel=0.02)


def test_the_page_of_one_recording_has_the_rules_of_its_steps(tmp_path: Path) -> None:
    """No sentence is about several runs: neither on the test, nor on standard errors."""
    rng = np.random.default_rng(3)
    pages = {}
    for number in (1, 2):
        lines = ["time,run,x,y"]
        for run in range(number):
            for k, (x, y) in enumerate(rng.normal(size=(80, 2))):
                lines.append(f"{k},{run},{10.0 * k + x:.4f},{y:.4f}")
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "m.csv").write_text("\n".join(lines))
        columns = "columns: {time: time, run: run, x: x, y: y}"
        text = CONFIG.replace("m.csv", f"m.csv, {columns}")
        (folder / "notes.yaml").write_text(f"{text}runs: {number}\n")
        out = folder / "out"
        api.run(folder / "notes.yaml", out=out, engine="serial", quiet=True, formats=())
        pages[number] = (out / "report.html").read_text()
    of_runs = ("at least 5 runs", "± standard error over the runs", "on common runs")
    of_steps = ("at least 50 steps", "those of one run, without a standard error")
    for words in of_runs:
        assert words not in pages[1]
        assert words in pages[2]
    for words in of_steps:
        assert words in pages[1]
        assert words not in pages[2]


@pytest.mark.parametrize("number", [2, 6])
def test_a_grid_over_recordings_has_the_notes_on_each(tmp_path: Path, number: int) -> None:
    """All recordings but the first have an outlier. Ships are named by nine digits."""
    rng = np.random.default_rng(3)
    lines = ["time,ship,x,y"]
    for ship in range(number):
        position = rng.normal(size=(80, 2))
        position[:, 0] += 10.0 * np.arange(80)
        if ship:
            position[40] += 300.0
        for k, (x, y) in enumerate(position):
            lines.append(f"{k},{235013375 + ship},{x:.4f},{y:.4f}")
    (tmp_path / "m.csv").write_text("\n".join(lines))
    columns = "columns: {time: time, run: ship, x: x, y: y}"
    points = ", ".join(f"[{235013375 + ship}]" for ship in range(number))
    text = CONFIG.replace("m.csv", f"m.csv, {columns}, runs: [235013375]")
    text += f"grid: {{scenario.target.runs: [{points}]}}\n"
    (tmp_path / "notes.yaml").write_text(text)
    out = tmp_path / "out"
    report = api.run(tmp_path / "notes.yaml", out=out, engine="serial", quiet=True, formats=())
    (table,) = ranking_tables(report.results)
    found = [note for note in table.notes if note.startswith("At ")]
    if number == 2:
        assert any(note.startswith("At runs = 235013376: A few steps lower") for note in found)
        return
    (note,) = [note for note in found if "there are notes on the recording" in note]
    assert "runs = 235013377" in note
