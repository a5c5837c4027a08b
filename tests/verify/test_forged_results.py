"""A number edited in any file that can be made again is found, the manifest made to agree with it."""

import csv

import numpy as np
import pytest

from tests.papers import merwe_text
from tests.report.forging import edit, reseal
from trackbench import api
from trackbench.verify import verify

FIELDS = ("filter", "metric", "value", "stderr", "runs", "lost")


@pytest.fixture
def nothing_computed(monkeypatch):
    """Only what follows from the stored runs."""
    monkeypatch.setattr("trackbench.verify.recompute", lambda *_: None)
    monkeypatch.setattr("trackbench.verify.compare_first_runs", lambda *_: [])


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


def more(x):
    return float(f"{1.0001 * x:.7g}")


def one_more(x):
    return int(x) + 1


DERIVED = {
    "a table": (["tables/table1.csv", ["PF"], "Mean", more], "tables/table1.csv: 1 rows "),
    "published": (
        ["comparison.csv", ["PF50"], "published", "2.0"],
        "comparison.csv: 1 rows ",
    ),
    "measured": (["comparison.csv", ["PF50"], "measured", more], "comparison.csv: 1 rows "),
    "a claim": (["claims.csv", ["PF equals itself"], "z", more], "claims.csv: 1 rows "),
    "a pair": (["paired.csv", ["PF", "Exact"], "z", "0.2"], "paired.csv: 1 rows "),
}
COMPUTED = {
    "mean": (["summary.csv", ["PF", "mean(rmse)"], "value", more], "summary.csv: PF: 1 of "),
    "error": (["summary.csv", ["PF", "median(rmse)"], "stderr", more], "summary.csv: PF: 1 of "),
    "runs": (["summary.csv", ["PF", "rms(rmse)"], "runs", one_more], "summary.csv: has other rows"),
    "lost": (["summary.csv", ["PF", "rms(rmse)"], "lost", one_more], "summary.csv: has other rows"),
    "mean over time": (
        ["summary.csv", ["PF", "time-mean(rmse)"], "value", more],
        "summary.csv: PF: 1 of ",
    ),
    "a late run": (
        ["per_run.csv", ["PF", "rmse", "377"], "value", lambda x: 2 * x],
        "per_run.csv: PF: 1 of ",
    ),
    "a step": (["per_step.csv", ["PF", "rmse", "5"], "value", more], "per_step.csv: PF: 1 of "),
    "a bias": (
        ["per_step.csv", ["PF", "bias", "5"], "value", lambda x: x + 0.01],
        "per_step.csv: PF: 1 of ",
    ),
    "a NEES": (
        ["per_step.csv", ["Exact", "anees", "5"], "value", lambda x: x + 0.01],
        "per_step.csv: Exact: 1 of ",
    ),
    "an error of a step": (
        ["per_step.csv", ["PF", "rmse", "5"], "stderr", more],
        "per_step.csv: PF: 1 of ",
    ),
}
NAMES = {
    "a metric": (["summary.csv", ["PF", "anees"], "metric", "mean(no)"], "summary.csv: "),
    "a filter": (["summary.csv", ["PF", "anees"], "filter", "Exact"], "summary.csv: "),
    "a filter of a step": (
        ["per_step.csv", ["PF", "rmse", "5"], "filter", "UKF"],
        "per_step.csv: ",
    ),
}


def check_change(folder, what, begin, runs):
    change(folder, *what)
    lines = verify(folder, runs)
    assert [line for line in lines if line.startswith(begin)], lines


@pytest.mark.parametrize("case", DERIVED)
@pytest.mark.usefixtures("nothing_computed")
def test_an_edited_number_that_follows_from_the_runs_is_found(folder, case):
    check_change(folder, *DERIVED[case], 1)


@pytest.mark.parametrize("case", COMPUTED)
def test_an_edited_number_is_found_where_all_runs_are_computed(folder, case):
    check_change(folder, *COMPUTED[case], 400)


@pytest.mark.parametrize("case", NAMES)
def test_an_edited_name_is_found_by_one_run(folder, case):
    check_change(folder, *NAMES[case], 1)


@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        ("tables/table1.md", "| PF | 0.", "| PF | 1.", "tables/table1.md: 1 rows "),
        ("comparison.md", "plainly wrong", "right", "comparison.md: 1 rows "),
        ("comparison.csv", ",compatible,", ",agrees,", "comparison.csv: 1 rows do not follow"),
        ("claims.csv", "better,fails", "better,holds", "claims.csv: 1 rows do not follow"),
        ("claims.csv", ",no\n", ",no", "claims.csv: has "),
        ("published/claims.csv", "Fewer particles", "Less", "claims.csv: 1 rows "),
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
    (tmp_path / "c.yaml").write_text(CONFIG)
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out", save_tracks=True)
    return api.run(tmp_path / "c.yaml", options).folder


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
    assert line == f"{name}: mean/UKF: 1 of 12 numbers differ, by 2.4e-03 of the value at most"
