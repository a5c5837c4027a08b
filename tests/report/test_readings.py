"""The table of readings: distances by hand, readings that are the same, readings that are lost."""

from dataclasses import replace
from math import isinf, log, nan, sqrt

import numpy as np
import pytest

from tests.commands import ran
from tests.papers import merwe_text
from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measure
from trackbench.report.tables.readings import RankedReading, _notes
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import compare
from trackbench.report.verdicts.distance_from_printed_numbers import Distance, Number, distance
from trackbench.report.verdicts.verdict_files import markdown
from trackbench.report.verdicts.ways_to_measure import ways_to_measure
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.sample_statistics import mean

CONFIG = """
name: search
seed: 3
runs: 40
scenario: MERWE
published: [numbers.csv, claims.csv]
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
  ways: {kind: readings, of: two ways, statistics: [mean, median], rows: 8}
  fitted: {kind: readings, of: fitted, chosen: {"PF: Mean": the weights}}
  claims: {kind: claim-readings, of: original, rows: 3}
  none-claimed: {kind: claim-readings, of: nowhere}
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
p,1,PF,Error,0.5,4,100,two ways,PF,mean(rmse),,
p,1,PF,Error,0.5,4,100,two ways,PF,mean(rmse[k<=6]),,
p,2,PF,Mean,0.5,4,100,fitted,PF,mean(rmse),,
p,2,APF,Mean,0.5,4,100,fitted,APF,mean(rmse),,
"""

CLAIMS = """\
paper,claim,experiment,left,expression,relation,factor,right,right_expression,tolerance,point,source,note
p,PF is not lost,original,PF,mean(rmse),<,1000,,,,,,
p,PF is lost,original,PF,mean(rmse),>,1000,,,,,,
p,An EKF is better,original,EKF,mean(rmse),<,1,PF,,,,,
p,PF is fast,original,PF,cpu_s_per_run,<,1000,,,,,,
p,PF estimates a delay,original,PF,mean(detection_delay_s),<,1,,,,,,
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    home = tmp_path_factory.mktemp("search")
    (home / "numbers.csv").write_text(NUMBERS)
    (home / "claims.csv").write_text(CLAIMS)
    return ran(home, CONFIG).results


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


def test_statistics_and_ways_to_measure_are_readings(results: Results) -> None:
    table = results.tables["ways"]
    assert table.key_headers == ["Rank", "weights", "statistic", "Error"]
    assert table.notes[0].startswith("8 readings, 0 of which")
    assert "; 1 printed number." in table.notes[0]
    points = {
        point["filters.PF.weights & filters.APF.weights"]: point for point in results.points()
    }
    statistics = {"mean": np.mean, "median": np.median}
    for (_, weights, statistic, metric), cells in zip(table.keys, table.cells, strict=True):
        values = results.runs(points[weights])["PF", metric]
        expected = abs(log(statistics[statistic](values) / 0.5))
        assert cells[0].estimate.value == pytest.approx(expected)
    found = [cells[0].estimate.value for cells in table.cells]
    assert found == sorted(found)
    assert len({tuple(keys[1:]) for keys in table.keys}) == 8


def test_a_number_is_measured_one_way_at_a_time_and_a_variance_stays_one() -> None:
    def row(metric: str, expression: str, table: str = "1") -> PublishedNumber:
        where = {"paper": "p", "table": table, "filter": "A", "metric": metric}
        return PublishedNumber(**where, value=1.0, label="A", expression=measure(expression))

    numbers = [
        row("Range", "mean(rmse_range)"),
        row("Range", "mean(rmse_mean_range)"),
        row("Range", "mean(rmse_range)", table="2"),
        row("Range", "mean(rmse_mean_range)", table="2"),
        row("Spread", "variance(rmse)"),
        row("Last", "rmse@20"),
    ]
    heads, ways = ways_to_measure(numbers, ("rms",))
    assert heads == ["statistic", "Range"]
    assert [words for words, _ in ways] == [["rms", "rmse_range"], ["rms", "rmse_mean_range"]]
    for (_, metric), kept in ways:
        expected = [f"rms({metric})", f"rms({metric})", "variance(rmse)", "rmse@20"]
        assert [str(n.expression) for n in kept] == expected
    assert ways_to_measure(numbers[4:]) == ([], [([], numbers[4:])])


def test_a_way_keeps_the_numbers_of_other_filters() -> None:
    """KF's error is measured by one expression, PF's by two; that of the EKF by two others."""

    def row(label: str, expression: str) -> PublishedNumber:
        where = {"paper": "p", "table": "1", "filter": label, "metric": "Error"}
        return PublishedNumber(**where, value=1.0, label=label, expression=measure(expression))

    numbers = [row("KF", "mean(rmse)"), row("PF", "rmse@20"), row("PF", "rmse@last")]
    heads, ways = ways_to_measure(numbers)
    assert heads == ["Error"]
    assert [words for words, _ in ways] == [["rmse@20"], ["rmse@last"]]
    assert [kept for _, kept in ways] == [numbers[:2], [numbers[0], numbers[2]]]
    heads, ways = ways_to_measure([*numbers, row("EKF", "rmse@3"), row("EKF", "rmse@4")])
    assert heads == ["Error of PF", "Error of EKF"]
    assert len(ways) == 4
    for _, kept in ways:
        assert [number.label for number in kept] == ["KF", "PF", "EKF"]


def test_each_choice_has_a_heading_of_its_own() -> None:
    def choice(table: str, row: str, *expressions: str, paper: str = "p") -> list[PublishedNumber]:
        where = {
            "paper": paper,
            "table": table,
            "row": row,
            "filter": "PF, tuned",
            "metric": "Error",
        }
        return [
            PublishedNumber(**where, value=1.0, label="PF, tuned", expression=measure(e))
            for e in expressions
        ]

    in_table_1 = choice("Table 1", "", "rmse@20", "rmse@last")
    in_table_2 = choice("Table 2", "x", "rmse@3", "rmse@4")
    heads, ways = ways_to_measure([*in_table_1, *in_table_2])
    assert heads == ["Error of “PF, tuned” / Table 1", "Error of “PF, tuned” / Table 2"]
    assert len(ways) == 4
    # Two rows of one table, and two papers that have this table.
    in_other_row = choice("Table 2", "y", "rmse@5", "rmse@6")
    heads, _ = ways_to_measure([*in_table_2, *in_other_row])
    assert heads == ["Error of “PF, tuned” / Table 2 / x", "Error of “PF, tuned” / Table 2 / y"]
    in_other_paper = choice("Table 2", "x", "rmse@5", "rmse@6", paper="q")
    heads, _ = ways_to_measure([*in_table_2, *in_other_paper])
    assert [head.rpartition(" / ")[2] for head in heads] == ["p", "q"]


def test_each_way_to_measure_has_a_name_of_its_own() -> None:
    def rows(*expressions: str) -> list[PublishedNumber]:
        where = {"paper": "p", "table": "1", "filter": "A", "metric": "Error", "value": 1.0}
        return [PublishedNumber(**where, label="A", expression=measure(e)) for e in expressions]

    heads, ways = ways_to_measure(rows("mean(rmse)", "rms(rmse)", "mean(rmse_range)"))
    assert heads == ["Error"]
    assert [words for words, _ in ways] == [["mean(rmse)"], ["rms(rmse)"], ["rmse_range"]]
    # One statistic for all errors leaves one expression: no two readings are equal.
    heads, ways = ways_to_measure(rows("mean(rmse)", "rms(rmse)"), ("mean", "median"))
    assert heads == ["statistic"]
    assert [words for words, _ in ways] == [["mean"], ["median"]]
    for (statistic,), numbers in ways:
        assert [str(number.expression) for number in numbers] == [f"{statistic}(rmse)"]


def test_a_reading_is_infinitely_far_for_its_own_reason() -> None:
    def number(value: float, printed: float = 1.0, lost: int = 0) -> Number:
        term = RunEstimate(value, 0.1, influences=np.zeros(10), runs=10 - lost, lost=lost)
        return Number("PF", printed, term)

    numbers = [
        number(1.0),
        number(nan),
        number(-1.0),
        number(1.0, printed=0.0),
        number(1.0, lost=6),
        number(nan, lost=10),
    ]
    distances = [distance([number(1.0), n]) for n in numbers]
    assert [d.loses_most for d in distances] == [False, False, False, False, True, True]
    assert [isinf(d.estimate.value) for d in distances] == [False, True, True, True, True, True]
    readings = [RankedReading(["a"], d, []) for d in distances]
    assert _notes(["weights"], readings, 2)[0] == (
        "6 readings, 2 of which lose most runs of a filter, and 3 have a number that is missing, "
        "infinite or not positive; 2 printed numbers."
    )


def test_a_printed_number_counts_under_the_best_reading_of_a_search(results: Results) -> None:
    """Of the two readings of PF's mean the nearer one counts."""
    numbers = {n.best.published.printed_at[1:5]: n for n in compare(results).numbers}
    # The EKF, which this experiment lacks, has no verdict.
    metrics = ("Mean", "Variance", "Gain", "Bias", "Error")
    expected = {("1", "", "PF", metric) for metric in metrics}
    expected |= {("1", "", "APF", "Mean"), ("2", "", "PF", "Mean"), ("2", "", "APF", "Mean")}
    assert {*numbers} == expected
    of_pf, of_apf = numbers["1", "", "PF", "Mean"], numbers["1", "", "APF", "Mean"]
    assert (of_pf.readings, of_apf.readings, numbers["1", "", "PF", "Gain"].readings) == (2, 4, 4)
    assert numbers["1", "", "PF", "Error"].readings == 8  # two points, statistics and expressions
    values = [results.runs(point)["PF", "rmse"].mean() for point in results.points()]
    nearest = min(values, key=lambda value: abs(value - 0.5))
    assert of_pf.best.measured.value == pytest.approx(nearest)
    assert of_pf.best.note.startswith("best of 2 readings searched; weights ")
    assert "(best of 2)" in markdown(results, compare(results))


def test_a_setting_that_was_fitted_to_a_number_decides_nothing_in_a_search(
    results: Results,
) -> None:
    numbers = {n.best.published.printed_at[1:5]: n for n in compare(results).numbers}
    best = numbers["2", "", "PF", "Mean"].best
    assert best.verdict.word == "inconclusive"
    assert "chosen for this number: the weights" in best.note
    assert numbers["2", "", "APF", "Mean"].best.published.chosen == ""


def test_a_fitted_number_that_is_not_printed_is_an_error(results: Results) -> None:
    table = replace(results.parts("tables")["fitted"], chosen={"PF: Maen": "the weights"})
    with pytest.raises(UserError, match="no printed number of fitted; did you mean PF: Mean"):
        table.table(results)


def test_claims_are_counted_at_every_reading(results: Results) -> None:
    """Of five claims two can be judged: one holds everywhere, one fails everywhere."""
    table = results.tables["claims"]
    assert table.key_headers == ["Rank", "weights", "first_stage", "kappa"]
    assert table.value_headers == ["Holds", "Fails", "Inconclusive"]
    assert [[cell.estimate.value for cell in cells] for cells in table.cells] == [[1, 1, 0]] * 3
    assert table.notes[0].startswith("8 readings, 2 claims. Most hold at weights log")
    assert table.notes[0].endswith(": 1; as many at 8 of the readings.")
    assert table.notes[1:] == [
        "PF is not lost: holds at 8, fails at 0 of the readings.",
        "PF is lost: holds at 0, fails at 8 of the readings.",
    ]


def test_nothing_claimed_is_said(results: Results) -> None:
    nothing = results.tables["none-claimed"]
    assert nothing.keys == []
    assert nothing.notes == ["Nothing is claimed in nowhere that these filters measure."]


def test_standard_error_is_that_of_many_repetitions(rng: np.random.Generator) -> None:
    """Delta method on dependent means and a variance, against 400 repetitions of 100 runs."""
    values, errors = [], []
    for _ in range(400):
        a = rng.gamma(16.0, 1.0 / 16.0, 100)
        b = 0.5 * a + rng.gamma(4.0, 1.0 / 4.0, 100)
        squares = np.square(b - b.mean())
        found = distance(
            [
                Number("A", 0.7, RunEstimate(a.mean(), 0.0, a - a.mean(), 100)),
                Number("B", 1.0, RunEstimate(b.mean(), 0.0, b - b.mean(), 100)),
                Number(
                    "B",
                    0.2,
                    RunEstimate(squares.mean(), 0.0, squares - squares.mean(), 100),
                    True,
                ),
            ]
        )
        values.append(found.estimate.value)
        errors.append(found.estimate.stderr)
    assert np.mean(errors) == pytest.approx(np.std(values), rel=5 / sqrt(2 * 400))


def test_a_reading_that_is_lost_is_infinitely_far() -> None:
    good = Number("A", 1.0, RunEstimate(1.0, 0.1, np.zeros(10), 10))
    gone = Number("A", 1.0, RunEstimate(1.0, 0.1, np.zeros(10), 4, lost=6))
    nothing = Number("A", 1.0, RunEstimate(np.nan, np.nan, None, 0, lost=10))
    assert distance([good]).estimate.value == 0.0
    assert distance([good, gone]).estimate.value == np.inf
    assert distance([good, nothing]).estimate.value == np.inf


def test_a_gain_is_that_of_its_column(results: Results) -> None:
    table = results.tables["gains"]
    runs = results.runs(results.points()[0])
    apf, pf = runs["APF", "rmse"], runs["PF", "rmse"]
    mean, rms = (cell.estimate.value for cell in table.cells[1])
    assert mean == pytest.approx(100 * (1 - apf.mean() / pf.mean()))
    assert rms == pytest.approx(100 * (1 - np.sqrt((apf**2).mean() / (pf**2).mean())))


def reading(name: str, value: float, near: int, off: np.ndarray) -> RankedReading:
    estimate = RunEstimate(value, mean(off).stderr, off, len(off))
    return RankedReading([name], Distance(estimate, near), filter_distances=[])


def test_the_reading_that_meets_most_numbers_is_named_beside_the_nearest() -> None:
    """One number far off makes a reading with all others at the printed ones the farther one."""
    found = [
        reading("100", 0.2, 1, np.full(4, 0.2)),
        reading("200", 0.3, 3, np.full(4, 0.3)),
    ]
    assert _notes(["scans"], found, 4)[-1] == "Most numbers within 10 %: scans 200; 3 of 4."
    assert len(_notes(["scans"], found[:1], 4)) == 2


def test_readings_differ_by_the_rule_for_filters(rng: np.random.Generator) -> None:
    """Of ten readings one is nearer than the others in every run; then four runs of them."""
    noise = [0.1 * rng.standard_normal(200) for _ in range(10)]
    for runs, alike in ((200, 1), (4, 10)):
        offs = [x[:runs] - x[:runs].mean() for x in noise]
        found = [reading(str(i), 0.2 + 0.1 * (i > 0), 1, x) for i, x in enumerate(offs)]
        assert _notes(["scans"], found, 4)[1].endswith(f"itself counted: {alike}.")
