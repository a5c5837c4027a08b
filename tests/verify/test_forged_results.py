"""A number edited in any file that can be made again is found, the manifest made to agree with it."""

import csv

import numpy as np
import pytest

from tests.commands import ran
from tests.papers import merwe_text
from tests.report.forging import edit, reseal
from trackbench.verify.verify_folder import verify


@pytest.fixture
def nothing_computed(monkeypatch):
    """Only what follows from the stored runs."""
    monkeypatch.setattr("trackbench.verify.verify_folder.recompute", lambda *_: None)
    monkeypatch.setattr("trackbench.verify.verify_folder.compare_first_runs", lambda *_: [])


def change(folder, name, wanted, column, by):
    """Another number in the first row that has these words in it."""
    path = folder / name
    head, *rows = csv.reader(path.read_text().splitlines())
    row = next(row for row in rows if set(wanted) <= set(row))
    i = head.index(column)
    row[i] = str(by(float(row[i]))) if callable(by) else by
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows])
    reseal(folder)


MORE = {"more": lambda x: float(f"{1.0001 * x:.7g}"), "one more": lambda x: int(x) + 1}
CHANGES = """\
tables/table1.csv; PF; Mean; more; tables/table1.csv: 1 row
comparison.csv; PF50; published; 2.0; comparison.csv: 1 row
comparison.csv; PF50; measured; more; comparison.csv: 1 row
claims.csv; PF equals itself; z; more; claims.csv: 1 row
paired.csv; PF, Exact; z; 0.2; paired.csv: 1 row
summary.csv; PF, mean(rmse); value; more; summary.csv: PF: 1 of
summary.csv; PF, median(rmse); stderr; more; summary.csv: PF: 1 of
summary.csv; PF, rms(rmse); runs; one more; summary.csv: has other rows
summary.csv; PF, time-mean(rmse); value; more; summary.csv: PF: 1 of
per_run.csv; PF, rmse, 377; value; more; per_run.csv: PF: 1 of
per_step.csv; PF, rmse, 5; value; more; per_step.csv: PF: 1 of
per_step.csv; PF, rmse, 5; stderr; more; per_step.csv: PF: 1 of
summary.csv; PF, anees; metric; mean(no); summary.csv:
summary.csv; PF, anees; filter; Exact; summary.csv:
per_step.csv; PF, rmse, 5; filter; UKF; per_step.csv:
"""
"""File, words of a row, column, its new value; the line. Names are found by one run."""


@pytest.mark.parametrize("line", CHANGES.splitlines())
def test_an_edited_number_or_name_is_found(folder, line, request):
    name, words, column, new, begin = line.split("; ")
    follows = not name.startswith(("summary", "per_"))
    if follows:
        request.getfixturevalue("nothing_computed")
    change(folder, name, words.split(", "), column, MORE.get(new, new))
    lines = verify(folder, 1 if follows or column in ("metric", "filter") else 400)
    assert [line for line in lines if line.startswith(begin)], lines


@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        ("tables/table1.md", "| PF | 0.", "| PF | 1.", "tables/table1.md: 1 row "),
        ("comparison.md", "plainly wrong", "right", "comparison.md: 1 row "),
        ("comparison.csv", ",compatible,", ",agrees,", "comparison.csv: 1 row does not follow"),
        ("claims.csv", "better,fails", "better,holds", "claims.csv: 1 row does not follow"),
        ("claims.csv", ",no\n", ",no", "claims.csv: has "),
        ("published/claims.csv", "Fewer particles", "Less", "claims.csv: 1 row "),
        ("manifest.json", '"seed": ', '"seed": 1', "manifest.json: seed is 1"),
        ("manifest.json", '"steps": ', '"steps": 1', "manifest.json: steps is 1"),
        ("config.yaml", "floor: Exact", "floor: PF", None),
        ("config.yaml", "runs: 400", "runs: 399", "per_run.csv: has not as many runs"),
    ],
)
@pytest.mark.usefixtures("nothing_computed")
def test_an_edited_word_is_found(folder, name, old, new, line):
    edit(folder, name, old, new)
    lines = verify(folder, 1)
    assert [text for text in lines if text.startswith(line)] if line else lines == []


@pytest.mark.usefixtures("nothing_computed")
def test_a_removed_table_is_found_and_one_of_somebody_else_is_not_looked_at(folder):
    (folder / "tables" / "own.csv").write_text("a,b\n")
    assert verify(folder, 1) == []
    (folder / "tables" / "table1.md").unlink()
    assert verify(folder, 1) == [
        f"{folder}: tables/table1.md is missing: run the experiment again",
        "tables/table1.md: is not there",
    ]


CONFIG = """
name: all
runs: 12
scenario: MERWE
filters: {PF: {kind: pf, N: 50}, UKF: {kind: ukf}}
medians: [nees]
figures: {t: {kind: estimates, run: 2}}
""".replace("MERWE", merwe_text(T=6))
WHOLE = {
    "an error": (["UKF", "anees", "5"], "stderr"),
    "a spread": (["UKF", "std", "5"], "value"),
    "a median": (["UKF", "median(nees)", "5"], "value"),
}


@pytest.fixture
def small(tmp_path):
    return ran(tmp_path, CONFIG, save_tracks=True).folder


@pytest.mark.parametrize("case", WHOLE)
def test_all_steps_are_looked_at_where_all_runs_are_computed(small, case):
    assert verify(small, 12) == []
    wanted, column = WHOLE[case]
    change(small, "per_step.csv", wanted, column, lambda x: 1.01 * x)
    assert verify(small, 11) == []
    (line,) = verify(small, 12)
    assert line.startswith("per_step.csv: UKF: 1 of ")


@pytest.mark.parametrize("name", ["shown.npz", "tracks.npz"])
def test_tracks_are_looked_at(small, name):
    with np.load(small / name) as arrays:
        tracks = dict(arrays)
    tracks["mean/UKF"][0, 3, 1] += 0.01
    np.savez(small / name, **tracks)
    reseal(small)
    (line,) = verify(small, 2)
    assert line == f"{name}: mean/UKF: 1 of 12 numbers differs, by 2.4e-03 of the value at most"
