"""The table of readings: distances by hand, readings that are the same, readings that are lost."""

from math import log, sqrt

import numpy as np
import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.report.expressions import Term
from trackbench.report.results import Results
from trackbench.report.tables.readings import Number, distance

CONFIG = """
name: search
seed: 3
runs: 40
scenario: MERWE
published: [numbers.csv]
filters:
  PF: {kind: pf, N: 10}
  APF: {kind: apf, N: 10}
  UKF: {kind: ukf}
grid:
  filters.PF.weights & filters.APF.weights: [log, naive]
  filters.APF.first_stage: [mean, mode]
  filters.UKF.kappa: [1, 2]
tables:
  joint: {kind: readings, of: original, rows: 3}
  PF: {kind: readings, of: original, filters: [PF]}
  nothing: {kind: readings, of: nowhere}
  gains:
    kind: metrics
    filters: [PF]
    columns: {Mean: mean(rmse), Rms: rms(rmse)}
    gain: {of: APF, over: PF}
""".replace("MERWE", merwe_text(T=12, switch=6))

NUMBERS = """\
paper,table,filter,metric,value,digits,runs,experiment,label,expression,source,note
p,1,PF,Mean,0.5,4,100,original,PF,mean(rmse),,
p,1,PF,Variance,0.02,4,100,original,PF,variance(rmse),,
p,1,APF,Mean,0.4,4,100,original,APF,mean(rmse),,
p,1,PF,Gain,7,1,100,original,PF,"gain(mean(rmse), APF)",,
p,1,PF,Bias,unbiased,0,100,original,PF,mean(bias),,
p,1,EKF,Mean,0.4,4,100,original,EKF,mean(rmse),,
p,1,PF,Mean,99,4,100,another,PF,mean(rmse),,
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    home = tmp_path_factory.mktemp("search")
    (home / "search.yaml").write_text(CONFIG)
    (home / "numbers.csv").write_text(NUMBERS)
    options = api.Options(engine="serial", quiet=True, out=home / "out", formats=())
    return Results(api.run(home / "search.yaml", options).folder)


def by_hand(results: Results, point: dict, labels: tuple[str, ...]) -> float:
    squares = []
    for label, printed, statistic in (
        ("PF", 0.5, np.mean),
        ("PF", sqrt(0.02), lambda x: x.std(ddof=1)),
        ("APF", 0.4, np.mean),
    ):
        if label in labels:
            rmse = results.runs(point)[label, "rmse"]
            squares.append(log(statistic(rmse) / printed) ** 2)
    return sqrt(sum(squares) / len(squares))


def test_distances_are_those_by_hand_and_sorted(results: Results) -> None:
    table = results.tables["joint"]
    # Eight points, of which UKF's kappa makes pairs that are one reading.
    expected = sorted(by_hand(results, point, ("PF", "APF")) for point in results.points()[::2])
    found = [cells[0].estimate.value for cells in table.cells]
    np.testing.assert_allclose(found, expected[:3])
    assert [keys[0] for keys in table.keys] == ["1", "2", "3"]
    assert table.key_headers == ["Rank", "weights", "first_stage"]
    assert table.notes[0].startswith("4 readings, 0 of which")
    assert "3 printed numbers" in table.notes[0]
    assert f"weights {table.keys[0][1]}, first_stage {table.keys[0][2]}" in table.notes[1]


def test_one_filters_readings_are_its_own(results: Results) -> None:
    table = results.tables["PF"]
    assert table.key_headers == ["Rank", "weights"]
    points = {
        point["filters.PF.weights & filters.APF.weights"]: point for point in results.points()
    }
    for keys, cells in zip(table.keys, table.cells, strict=True):
        expected = by_hand(results, points[keys[1]], ("PF",))
        assert cells[0].estimate.value == pytest.approx(expected)
    assert len(table.keys) == 2


def test_nothing_published_is_said(results: Results) -> None:
    assert results.tables["nothing"].notes == [
        "Nothing is published about nowhere that these filters measure."
    ]


def test_standard_error_is_that_of_many_repetitions(rng: np.random.Generator) -> None:
    """Delta method on dependent means and a variance, against 400 repetitions of 100 runs."""
    values, errors = [], []
    for _ in range(400):
        a = rng.gamma(16.0, 1.0 / 16.0, 100)
        b = 0.5 * a + rng.gamma(4.0, 1.0 / 4.0, 100)
        squares = np.square(b - b.mean())
        found = distance(
            [
                Number("A", 0.7, Term(a.mean(), 0.0, a - a.mean(), 100)),
                Number("B", 1.0, Term(b.mean(), 0.0, b - b.mean(), 100)),
                Number("B", 0.2, Term(squares.mean(), 0.0, squares - squares.mean(), 100), True),
            ]
        )
        values.append(found.value)
        errors.append(found.cell.estimate.stderr)
    assert np.mean(errors) == pytest.approx(np.std(values), rel=5 / sqrt(2 * 400))


def test_a_reading_that_is_lost_is_infinitely_far() -> None:
    good = Number("A", 1.0, Term(1.0, 0.1, np.zeros(10), 10))
    gone = Number("A", 1.0, Term(1.0, 0.1, np.zeros(10), 4, lost=6))
    nothing = Number("A", 1.0, Term(np.nan, np.nan, None, 0, lost=10))
    assert distance([good]).value == 0.0
    assert distance([good, gone]).value == np.inf
    assert distance([good, nothing]).value == np.inf


def test_a_gain_is_that_of_its_column(results: Results) -> None:
    table = results.tables["gains"]
    runs = results.runs(results.points()[0])
    apf, pf = runs["APF", "rmse"], runs["PF", "rmse"]
    mean, rms = (cell.estimate.value for cell in table.cells[1])
    assert mean == pytest.approx(100 * (1 - apf.mean() / pf.mean()))
    assert rms == pytest.approx(100 * (1 - np.sqrt((apf**2).mean() / (pf**2).mean())))
