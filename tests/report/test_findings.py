"""The answer in words: what it says holds in the files, and it says nothing that chance decides."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.stats import norm

from tests.commands import ran
from tests.conftest import EXPERIMENT_FILES
from tests.papers import merwe_text
from trackbench import api
from trackbench.report.findings.best_filter_sentences import answer
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.ranking import ranking_of, rankings
from trackbench.report.findings.ranking_table import ranking_tables
from trackbench.report.markdown_table import Text
from trackbench.report.tables_and_figures import Results
from trackbench.results.file_names import COLUMNS
from trackbench.results.points_json import PointFacts
from trackbench.statistics.comparison import Sample
from trackbench.yaml_source import read

SHIPPED = {  # each for something that no other has
    "air-traffic": "a bound",
    "banana-short": "the root mean square first, lost runs",
    "calibration": "a reference filter, a first table without errors",
    "car-track": "one recorded run",
    "lorenz63-wiljes": "the median first",
    "nile": "a log score, of which more is better",
}
M = 200


def folder(
    at: Path, errors: dict, times: dict | None = None, nees: dict | None = None, **config: object
) -> Results:
    """A results folder of errors per run, NaN where lost, CPU seconds of a run, and NEES."""
    labels, runs = list(errors), len(next(iter(errors.values())))
    whole = {
        "name": "s",
        "title": "",
        "runs": runs,
        "filters": {b: {} for b in labels},
        "grid": {},
        "tables": {"t": {"kind": "metrics", "columns": {"Error": "mean(rmse_position)"}}},
    }
    (at / "config.yaml").write_text(yaml.safe_dump(whole | config, sort_keys=False))
    rows = [
        (label, run, metric, value)
        for label, values in errors.items()
        for metric, column in (("lost", np.isnan(values)), ("rmse_position", values))
        for run, value in enumerate(column.astype(float))
    ]
    rows += [
        (b, run, "nees", x) for b, column in (nees or {}).items() for run, x in enumerate(column)
    ]
    frame = pd.DataFrame(rows, columns=["filter", "run", "metric", "value"])
    frame.to_csv(at / "per_run.csv", index=False, na_rep="nan")
    pd.DataFrame(columns=COLUMNS["summary.csv"]).to_csv(at / "summary.csv", index=False)
    timing = pd.DataFrame((times or {}).items(), columns=["filter", "cpu_s_per_run"])
    timing = timing.reindex(columns=COLUMNS["timing.csv"], fill_value=1)
    (at / "run").mkdir(exist_ok=True)
    timing.to_csv(at / "run" / "timing.csv", index=False, na_rep="nan")
    two = PointFacts({}, {}, {}, [], [], {"": 2}, [])
    return Results(at, run_facts={"failed": []}, point_facts=(two,))


@pytest.fixture
def A(rng: np.random.Generator) -> np.ndarray:
    return 10.0 + rng.standard_normal(M)


def ranked(results: Results) -> dict[str, dict[str, str]]:
    """The rows of the ranking by filter, cells by heading, the best first."""
    (table,) = ranking_tables(results)
    return {
        row[0].text: {h: c.text for h, c in zip(table.heads, row, strict=True)}
        for row in table.rows
    }


RATIO, NATS = "Ratio to the best (95 %)", "Below the best (nats)"
BY = "Mean position RMSE (m)"


def test_the_best_filter_stands_first_and_the_others_beside_it(tmp_path, rng, A) -> None:
    apart = rng.standard_normal(M)
    apart -= apart.mean() - 0.001
    C = A + 1.0 + 0.1 * rng.standard_normal(M)
    rows = ranked(folder(tmp_path, {"C": C, "A": A, "B": A + apart}))
    assert [*rows] == ["A", "B", "C"]
    value, error = map(float, rows["A"][BY].split(" ± "))
    assert value == pytest.approx(A.mean(), abs=0.006)
    assert error == pytest.approx(A.std(ddof=1) / M**0.5, rel=0.05)
    assert rows["A"][RATIO] == "1"
    tie = re.fullmatch(r"(\S+) x \((\S+) to (\S+)\) n\.s\.", rows["B"][RATIO])
    assert tie is not None
    high = 0.001 + 1.972 * apart.std(ddof=1) / M**0.5  # Student's t, 199 degrees of freedom
    assert float(tie[1]) == pytest.approx(1.0 + 0.001 / A.mean(), abs=1e-3)
    assert float(tie[3]) - 1.0 == pytest.approx(high / A.mean(), rel=0.3)
    worse = re.fullmatch(r"(\S+) x \((\S+) to (\S+)\)", rows["C"][RATIO])
    assert worse is not None
    assert float(worse[1]) == pytest.approx(C.mean() / A.mean(), abs=1e-3)
    # The ratio without each run in turn gives its error.
    left_out = [np.delete(C, i).mean() / np.delete(A, i).mean() for i in range(M)]
    error = np.sqrt((M - 1) * np.var(left_out))
    width = float(worse[3]) - float(worse[2])
    assert width == pytest.approx(2 * 1.972 * error, abs=1.1e-3)


def test_how_much_smaller_a_score_may_be_is_in_nats(tmp_path, rng, A) -> None:
    less = 0.1 * rng.standard_normal(M)
    less -= less.mean() - 0.001
    results = folder(tmp_path, {"A": A, "B": A - less})
    path = tmp_path / "per_run.csv"
    path.write_text(path.read_text().replace("rmse_position", "log_score"))
    rows = ranked(results)
    assert [*rows] == ["A", "B"]
    assert rows["A"][NATS] == "0"
    by = re.fullmatch(r"(\S+) \((\S+) to (\S+)\) n\.s\.", rows["B"][NATS])
    assert by is not None
    half = 1.972 * less.std(ddof=1) / M**0.5
    ends = (0.001, 0.001 - half, 0.001 + half)
    assert tuple(map(float, by.groups())) == pytest.approx(ends, rel=0.06)


def test_equal_filters(tmp_path, A) -> None:
    assert ranked(folder(tmp_path, {"A": A, "B": A.copy()}))["B"][RATIO] == "equal"


def test_a_filter_that_loses_more_is_not_the_best(tmp_path, A) -> None:
    B = 0.5 * A
    B[:1] = np.nan
    rows = ranked(folder(tmp_path, {"A": A, "B": B}))
    assert [*rows] == ["B", "A"]
    assert [row["Lost runs"] for row in rows.values()] == ["1 of 200", "0"]
    B[:40] = np.nan
    rows = ranked(folder(tmp_path, {"A": A, "B": B}))
    assert [*rows] == ["A", "B"]
    assert rows["B"][RATIO] == "unranked: loses more"
    assert rows["B"]["Lost runs"] == "40 of 200"


@pytest.mark.parametrize("ranks_settings", [False, True])
def test_values_with_which_more_runs_are_lost_are_not_the_best(A, ranks_settings) -> None:
    lost = (np.arange(M) < 40).astype(float)
    few = Candidate("A", {}, lost, Sample(np.where(lost > 0, np.nan, 0.5 * A)), {"N": 2})
    many = Candidate("A", {}, 0.0 * lost, Sample(A), {"N": 400})
    standing = ranking_of([few, many], "rmse", ranks_settings=ranks_settings)
    assert standing.best is many
    assert (few in standing.losing) == ranks_settings


def test_all_lost(tmp_path, A) -> None:
    lost = np.full(M, np.nan)
    rows = ranked(folder(tmp_path, {"A": lost, "B": lost}))
    assert {row[BY] for row in rows.values()} == {"–"}
    assert {row["Lost runs"] for row in rows.values()} == {"200 of 200"}
    rows = ranked(folder(tmp_path, {"A": A[:3], "B": lost[:3]}))  # too few for a sign test
    assert [(row[RATIO], row["Lost runs"]) for row in rows.values()] == [
        ("1", "0"),
        ("unranked: loses more", "3 of 3"),
    ]


def test_one_filter_and_one_run(tmp_path, A) -> None:
    results = folder(tmp_path, {"A": A})
    assert ranked(results)["A"][RATIO] == "1"
    assert answer(results) == []
    results = folder(tmp_path, {"A": A[:1], "B": A[:1] + 1.0})
    assert ranked(results)["B"][RATIO] == f"{1.0 + 1.0 / A[0]:.3g} x"
    assert answer(results) == ["1 run cannot decide which filter is best; at least 5 are needed."]


def test_a_filter_that_is_better_by_another_metric_is_named_with_the_ratio(
    tmp_path, rng, A
) -> None:
    """Unless the difference is tiny: below 1 % of the error, or below the key `matters`."""
    noise = 1e-6 * rng.standard_normal(M)
    position = {"A": A, "B": A + 1.0 + 0.1 * rng.standard_normal(M)}
    for ratio, config, sentence in (
        (1.24, {}, "But by velocity RMSE (1.240 x) B is better than A."),
        (1.24, {"matters": "30%"}, ""),
        (1.000006, {}, ""),
        (1.000006, {"matters": "0.0001%"}, "But by velocity RMSE (1.000 x) B is better than A."),
    ):
        results = folder(tmp_path, position, **config)
        velocity = {"A": ratio * A, "B": A * (1.0 + noise)}
        with (tmp_path / "per_run.csv").open("a") as file:
            for label, values in velocity.items():
                for run, value in enumerate(values):
                    file.write(f"{label},{run},rmse_velocity,{value}\n")
        assert answer(results) == ([sentence] if sentence else [])


def test_the_reference_is_no_rival(tmp_path, rng, A) -> None:
    B = 1.5 * A + 0.01 * rng.standard_normal(M)
    results = folder(tmp_path, {"Exact": A, "B": B, "C": 2.0 * A}, reference="Exact")
    rows = ranked(results)
    assert [*rows] == ["Exact (reference)", "B", "C"]
    assert rows["C"][RATIO].startswith("1.33")
    assert rows["Exact (reference)"][RATIO].startswith("0.66")


def test_a_filter_without_the_error_has_a_row(tmp_path, A) -> None:
    results = folder(tmp_path, {"A": A, "B": A + 1.0, "C": A})
    path = tmp_path / "per_run.csv"
    path.write_text(re.sub(r"(?m)^(C,\d+),rmse_position", r"\1,nees", path.read_text()))
    rows = ranked(results)
    assert [*rows] == ["A", "B", "C"]
    assert rows["C"][RATIO] == "has no position RMSE"


def test_a_contradiction_is_no_answer(tmp_path, rng) -> None:
    """B is better in every run that both keep; A's mean is smaller, for it loses the hardest ones."""
    hard = np.r_[np.full(4, 100.0), 10.0 + rng.random(M - 4)]
    A, B = hard + 0.1 + 0.01 * rng.random(M), hard
    A[:4] = np.nan
    (line,) = answer(folder(tmp_path, {"A": A, "B": B}))
    assert line.endswith(
        "A leads over all runs that it keeps, but over the 196 runs that both keep B is better."
    )
    A[:], B[:] = np.nan, B
    A[:4], B[:4] = 1.0 + rng.random(4), np.nan
    assert ranked(folder(tmp_path, {"A": A, "B": B}))["A"][RATIO] == "unranked: loses more"


def test_the_statistic_is_that_of_the_first_table(tmp_path, rng) -> None:
    """B has the smaller mean and A the smaller root mean square, as each table has it."""
    A, B = 10.0 + 0.1 * rng.standard_normal(M), 0.2 + 0.1 * rng.standard_normal(M)
    B[::2] += 18.0
    for statistic, best in (("mean", "B"), ("rms", "A")):
        columns = {"Late": "rms(rmse_position[end])", "Error": f"{statistic}(rmse_position)"}
        table = {"kind": "metrics", "columns": columns}
        results = folder(tmp_path, {"A": A, "B": B}, tables={"t": table})
        rows = ranked(results)
        assert next(iter(rows)) == best
        assert (BY in rows["A"]) == (statistic == "mean")

    # sqrt(mean B^2) - sqrt(mean A^2), and its error by leaving out each run in turn
    def apart(keep: np.ndarray) -> float:
        return float(np.sqrt(np.mean(B[keep] ** 2)) - np.sqrt(np.mean(A[keep] ** 2)))

    left_out = [apart(np.arange(M) != m) for m in range(M)]
    error = np.sqrt((M - 1) / M * np.sum((np.array(left_out) - np.mean(left_out)) ** 2))
    by = rows["B"][RATIO].split()[0]
    assert float(by) == pytest.approx(np.sqrt(np.mean(B**2) / np.mean(A**2)), abs=0.006)
    (found,) = rankings(results)
    difference = found.rivals[0].difference
    assert difference.value == pytest.approx(apart(np.arange(M)))
    assert difference.stderr == pytest.approx(error, rel=0.01)


@pytest.mark.parametrize(("matters", "word"), [(None, True), ("5%", True), (0.0001, False)])
def test_a_tiny_difference_is_called_so(tmp_path, rng, A, matters, word) -> None:
    B = A + 0.01 + 0.001 * rng.standard_normal(M)
    ratio = ranked(folder(tmp_path, {"A": A, "B": B}, matters=matters))["B"][RATIO]
    assert ratio.startswith("1.001")
    assert ratio.endswith("tiny") == word


def test_the_runs_that_would_decide_do(tmp_path, rng) -> None:
    """A difference of z = 1 at 100 runs needs 2.576^2 times as many, for a p-value of 1 %."""
    apart = rng.standard_normal(100)
    apart = (apart - apart.mean()) / apart.std(ddof=1) + 0.1
    A = 50.0 + rng.random(100)
    (table,) = ranking_tables(folder(tmp_path, {"A": A, "B": A + apart}))
    needed = re.search(r"; (\d+) runs would decide differences of this size", table.notes[0])
    assert needed is not None
    assert float(needed[1]) == pytest.approx(100 * 2.576**2, rel=0.1)


def test_a_tuned_filter_beside_untuned_ones_is_named(tmp_path, A) -> None:
    errors = {"A": A, "A (tuned)": 0.9 * A, "B": 1.1 * A}
    lines = answer(folder(tmp_path, errors, tune={"A": {"q": "1..2"}}))
    assert lines[0] == "A (tuned) is tuned, B is not: tuning may be the difference."


def test_times_have_two_digits_and_a_unit(tmp_path, A) -> None:
    errors = dict.fromkeys("ABC", A)
    rows = ranked(folder(tmp_path, errors, {"A": 4.13e-3, "B": 2.0, "C": 1.3e-5}))
    assert [row["CPU per run"] for row in rows.values()] == ["4.1 ms", "2 s", "13 µs"]


def test_calibration_in_a_word(tmp_path, rng, A) -> None:
    """Of two components: chi-square of two degrees of freedom per step, here means of fifty."""
    consistent = rng.chisquare(2.0, (M, 50)).mean(axis=1)
    nees = {"A": consistent, "B": 1.5 * consistent, "C": 0.5 * consistent}
    nees["D"] = 1.1 * np.r_[consistent[:3], np.full(M - 3, np.nan)]  # three runs decide nothing
    nees["E"] = np.r_[np.full(3, 1e9), consistent[3:]]
    nees["F"] = np.full(M, 1e9)
    rows = ranked(folder(tmp_path, dict.fromkeys(nees, A), nees=nees))
    assert {label: row["ANEES"] for label, row in rows.items()} == {
        "A": "calibrated",
        "B": "overconfident",
        "C": "underconfident",
        "D": "undecided",
        "E": "collapsed in 3 of 200",
        "F": "collapsed in all",
    }


def test_the_word_on_consistency_belongs_to_all_filters_of_the_table(tmp_path, rng, A) -> None:
    """Of six exact filters one or more had a word in a fourth of such tables; at 1 % in a hundredth."""
    tables, wrong = 60, 0
    errors = dict.fromkeys("ABCDEF", A)
    for _ in range(tables):
        nees = {label: rng.chisquare(2.0, M) for label in errors}
        rows = ranked(folder(tmp_path, errors, nees=nees))
        wrong += any("confident" in row.get("ANEES", "") for row in rows.values())
    assert wrong <= 4
    # One that is too certain by four standard errors has the word among many.
    nees["A"] += 2.0 + 4.4 * np.sqrt(4.0 / M) - nees["A"].mean()
    rows = ranked(folder(tmp_path, errors, nees=nees))
    assert [label for label, row in rows.items() if row["ANEES"] == "overconfident"] == ["A"]


def test_a_word_that_depends_on_the_other_filters_is_noted(tmp_path, rng, A) -> None:
    """A is too certain by three standard errors, which a test of A alone shows, and one of ten not."""
    exact = rng.standard_normal((10, M))
    exact = 2.0 + (exact - exact.mean(axis=1, keepdims=True)) / exact.std(axis=1, keepdims=True)
    nees = dict(zip("ABCDEFGHIJ", exact, strict=True))
    nees["A"] = 2.0 + 2.0 * (nees["A"] - 2.0) + 3.0 * 2.0 / np.sqrt(M)
    few = {label: nees[label] for label in "A"}
    texts = {}
    for name, nees_of_table in {"few": few, "many": nees}.items():
        (tmp_path / name).mkdir()
        results = folder(tmp_path / name, dict.fromkeys(nees_of_table, A), nees=nees_of_table)
        (table,) = ranking_tables(results)
        notes = [note for note in table.notes if note.startswith("undecided: ")]
        texts[name] = (ranked(results)["A"]["ANEES"], notes)
    assert texts["few"] == ("overconfident", [])
    word, (note,) = texts["many"]
    assert word == "undecided"
    assert note.startswith("undecided: A (overconfident) is decided by a test of one filter alone.")
    # A label with a comma is quoted, as in every list of labels in a sentence.
    nees["A, tuned"] = nees.pop("A")
    (tmp_path / "comma").mkdir()
    (table,) = ranking_tables(folder(tmp_path / "comma", dict.fromkeys(nees, A), nees=nees))
    assert any("undecided: \u201cA, tuned\u201d (overconfident) is" in note for note in table.notes)


@pytest.mark.parametrize(("filters", "settings"), [(6, 1), (2, 10)])
def test_equal_filters_differ_in_one_experiment_of_a_hundred(rng, filters, settings) -> None:
    """The correction is for all that was tried, also where each filter is at the best of settings."""
    wrong, experiments, most = 0, 300, 0.02  # the level of skewed differences of 40 runs
    for _ in range(experiments):
        errors = rng.gamma(4.0, size=(filters * settings, 40))
        found = [
            Candidate(str(i % filters), {}, np.zeros(40), Sample(x), {"k": i})
            for i, x in enumerate(errors)
        ]
        standing = ranking_of(found, "rmse")
        assert standing.chosen == (settings > 1)
        wrong += bool(standing.worse)
    assert wrong < experiments * most + 3.0 * (experiments * most) ** 0.5


def test_runs_that_are_lost_by_chance_take_no_filter_out(rng) -> None:
    wrong, experiments = 0, 150
    for _ in range(experiments):
        lost = rng.random((6, 100)) < 0.1
        errors = np.where(lost, np.nan, 1.0 + rng.random((6, 100)))
        found = [
            Candidate(str(i), {}, gone.astype(float), Sample(x))
            for i, (gone, x) in enumerate(zip(lost, errors, strict=True))
        ]
        wrong += bool(ranking_of(found, "rmse").losing)
    assert wrong < experiments * 0.05 + 3 * (experiments * 0.05 * 0.95) ** 0.5


@pytest.mark.parametrize("name", SHIPPED)
def test_what_is_said_of_shipped_results_is_in_their_files(name: str, tmp_path: Path) -> None:
    """Compare the sentences with paired.csv and per_run.csv, as pandas reads them."""
    path = EXPERIMENT_FILES[name]
    few = 12 if read(path).data.get("runs", 1) > 12 else None
    keys = ["block=fit", "figures={}", "key_figure=null"]
    options = api.Options(engine="serial", quiet=True, out=tmp_path, formats=(), set=keys)
    results = api.run(path, options, runs=few, times=False).results
    (found,), rows = rankings(results), ranked(results)
    _check_marks(results)
    if found.best is None:  # of one run
        assert results.config["runs"] == 1
        assert len(answer(results)) == 1
        return
    metric, best = str(found.metric), found.best.label
    beside = re.compile(r", exact|\((reference|bound|rms)")
    assert next(label for label in rows if not beside.search(label)) == best
    not_significant = {label for label, row in rows.items() if "n.s." in row.get(RATIO, "")}
    tested = {
        rival.filter.label
        for rival in found.not_worse
        if rival.comparison.is_tested and not rival.comparison.is_equal
    }
    assert not_significant - tested <= {f"{results.config.get('reference')} (reference)"}
    assert tested <= not_significant or NATS in rows[best]
    runs = pd.read_csv(
        results.folder / "per_run.csv", keep_default_na=False, na_values={"value": ["nan"]}
    )
    values, rms = runs[runs["metric"] == metric], found.best.sample.statistic == "rms"
    power = 2 if rms else 1
    mine = (values["value"] ** power).groupby(values["filter"]).mean()
    others = [rival.filter.label for rival in found.rivals]
    sign = -1.0 if found.metric.definition.more_is_better else 1.0
    assert sign * mine[best] == (sign * mine[[best, *others]]).min()
    pairs = pd.read_csv(results.folder / "paired.csv", keep_default_na=False)
    pairs = pairs[pairs["metric"] == (f"rms({metric})" if rms else metric)]
    # Holm by hand: the smallest p times the number of pairs, the next times one less, ...
    p = 2.0 * norm.sf(pairs["z"].astype(float).abs())
    order, tests = np.argsort(p), int((~np.isnan(p)).sum())
    stepped = np.maximum.accumulate(p[order] * np.arange(tests, tests - len(p), -1))
    pairs.loc[pairs.index[order], "significant"] = stepped < 0.01
    for rival in found.rivals:
        (row,) = pairs[
            ((pairs["filter_a"] == best) & (pairs["filter_b"] == rival.filter.label))
            | ((pairs["filter_b"] == best) & (pairs["filter_a"] == rival.filter.label))
        ].to_dict("records")
        assert (rival in found.worse) == row["significant"]
        if rival in found.worse:
            assert (sign * row["difference"] < 0) == (row["filter_a"] == best)
    lost = runs[runs["metric"] == "lost"].assign(value=lambda f: f["value"] > 0)
    losses = lost.groupby("filter")["value"].sum()
    for c in found.losing:
        assert losses[c.label] > losses.min()


def _check_marks(results: Results) -> None:
    """No marked value is worse than one without a mark, in any column of any table of metrics."""
    no_rivals = {results.config.get("bound"), results.config.get("reference"), *results.exact}
    for name, table in results.tables.items():
        spec = results.config["tables"].get(name) or {"kind": "metrics"}
        if spec["kind"] != "metrics" or results.grid:
            continue
        for column in {j for _, j in table.best}:
            score = "score" in str([*spec.get("columns", {}).values()][column : column + 1])
            values = {
                i: (-1.0 if score else 1.0) * cells[column].estimate.value
                for i, (keys, cells) in enumerate(zip(table.keys, table.cells, strict=True))
                if keys[-1] not in no_rivals and keys[-1] in results.filters
            }
            marked = [values[i] for i, j in table.best if j == column]
            losing = {c.label for c in rankings(results)[0].losing}
            others = [
                x
                for i, x in values.items()
                if (i, column) not in table.best and table.keys[i][-1] not in losing
            ]
            assert max(marked) <= min([x for x in others if np.isfinite(x)], default=np.inf)


CONFIG = """
name: g
runs: 40
scenario: MERWE
filters:
  PF: {kind: pf, N: 5}
  PF (N=60): {kind: pf, N: 60}
grid: {scenario.sensor.R: [0.1, 1.0]}
""".replace("MERWE", merwe_text(T=12, R=0.1))


def test_a_grid_of_scenarios_and_where_it_is_shown(tmp_path, capsys) -> None:
    report = ran(tmp_path, CONFIG)
    ranks = report.per_run.query("metric == 'rmse'").groupby(["scenario.sensor.R", "filter"])
    assert (ranks["value"].mean().unstack().idxmin(axis=1) == "PF (N=60)").all()
    summary, numbers = report.ranking(numbers=True)
    assert summary.title.startswith("Ranking over 2 values of R by RMSE")
    assert [row[0].text for row in summary.rows] == ["PF (N=60)", "PF"]
    assert summary.rows[0][1] == Text("at 2 of 2", 2)
    assert summary.rows[0][3] == Text("1 x")
    rms = report.summary.query("metric == 'rms(rmse)'").set_index(["scenario.sensor.R", "filter"])
    for R, row in zip((0.1, 1.0), numbers.rows, strict=True):
        assert row[0].text == f"{R:g}"
        assert [c.number for c in row[1:]] == pytest.approx(
            [rms["value"][R, label] for label in ("PF", "PF (N=60)")], rel=1e-6
        )
        assert [c.best for c in row[1:]] == [False, True]
    # The summary has the errors of both scenes, too.
    assert summary.heads[2] == "RMSE"
    best = [float(f"{rms['value'][R, 'PF (N=60)']:.4g}") for R in (0.1, 1.0)]
    assert summary.rows[0][2].text == f"{min(best):g} to {max(best):g}"
    assert summary.title in (report.folder / "report.html").read_text()


@pytest.mark.parametrize(
    ("shifts", "spread", "marked"),
    [
        ((0.0, 0.01, 3.0), 0.1, "01"),  # the third is worse
        ((0.0, 0.01, 0.02), 0.1, "012"),  # no one is, and all are near
        ((0.0, 0.5, 1.0), 40.0, ""),  # too few runs to decide
    ],
)
def test_marks_of_filters_that_are_near_the_best(rng, shifts, spread, marked) -> None:
    """A tie that could be more than twice the best has no mark; nor has any filter if all are ties."""
    errors = [1.0 + shift + spread * rng.random(20) ** 8 for shift in shifts]
    found = [Candidate(str(i), {}, np.zeros(20), Sample(x)) for i, x in enumerate(errors)]
    ranking = ranking_of(found, "rmse")
    assert {c.label for c in ranking.marked} == {*marked}
    assert ranking.best is not None


def test_an_undecided_filter_before_a_worse_one_has_no_mark(rng) -> None:
    heavy = np.where(np.arange(20) < 2, 60.0, 1.0)
    samples = {"A": 1.0 + 0.1 * rng.random(20), "B": heavy, "C": 50.0 + rng.random(20)}
    found = [Candidate(label, {}, np.zeros(20), Sample(x)) for label, x in samples.items()]
    ranking = ranking_of(found, "rmse")
    assert [tie.filter.label for tie in ranking.ties] == ["B"]
    assert [c.label for c in ranking.marked] == ["A"]


def test_a_ratio_has_the_interval_of_its_test(tmp_path, rng) -> None:
    """A best filter with a few bad runs had intervals from zero on, of 5 times 3.9 to 8.1."""
    A = np.exp(rng.standard_normal(50))
    rows = ranked(folder(tmp_path, {"A": A, "B": 5.0 + 0.5 * rng.standard_normal(50)}))
    found = re.fullmatch(r"(\S+) x \((\S+) to (\S+)\)", rows["B"][RATIO])
    assert found is not None
    runs = rng.integers(0, 50, (4000, 50))
    resampled = 5.0 / A[runs].mean(axis=1)
    low, high = np.quantile(resampled, [0.025, 0.975])
    assert 0.6 * low < float(found[2]) < float(found[1])
    assert float(found[3]) == pytest.approx(high, rel=0.3)


def test_an_interval_agrees_with_the_mark_beside_it(tmp_path, rng) -> None:
    """One pair of ten is beyond 95 % by itself: that shows nothing, nor does an interval."""
    apart = rng.standard_normal(M)
    apart = (apart - apart.mean()) / apart.std(ddof=1)
    A = 50.0 + rng.random(M)
    for metric, column in (("rmse_position", RATIO), ("log_score", NATS)):
        sign = 1.0 if metric == "rmse_position" else -1.0
        errors = {f"B{z}": A + sign * (apart + z / M**0.5) for z in (1.0, 2.3, 2.9, 8.0)}
        results = folder(tmp_path, {"A": A} | errors)
        path = tmp_path / "per_run.csv"
        path.write_text(path.read_text().replace("rmse_position", metric))
        rows = ranked(results)
        assert re.fullmatch(r"\S+( x)? \(\S+ to \S+\) n\.s\.", rows["B1.0"][column])
        assert re.fullmatch(r"\S+( x)? n\.s\.", rows["B2.3"][column])
        assert re.fullmatch(r"\S+( x)? n\.s\.", rows["B2.9"][column])
        assert re.fullmatch(r"\S+( x)? \(\S+ to \S+\)( tiny)?", rows["B8.0"][column])


def test_a_ratio_without_an_upper_end_and_one_of_many_digits(tmp_path, rng) -> None:
    A = np.full(8, 0.01)
    A[0] = 6.0
    rows = ranked(folder(tmp_path, {"A": A, "B": 5.0 + 0.1 * rng.standard_normal(8)}))
    assert re.fullmatch(r"\S+ x \(more than 0\.\d+\) n\.s\.", rows["B"][RATIO])
    A = 1.0 + 0.1 * rng.standard_normal(M)
    results = folder(tmp_path, {"A": A, "B": 2.65e39 * A * (1.0 + 0.01 * rng.standard_normal(M))})
    (table,) = ranking_tables(results)
    assert re.fullmatch(r"2\.6e\+39 x \(2\.6e\+39 to 2\.7e\+39\)", table.rows[1][2].text)
    # No run counts as lost, and that is no praise.
    assert "lost" not in table.title
    (note,) = (note for note in table.notes if "lost" in note)
    assert note.startswith("B: more than 1000 times the error of the best")


def test_a_score_far_below_the_best_has_no_mark(tmp_path, rng) -> None:
    """B is within 0.69 nats, D significantly worse; C is not, and may be 30 nats below."""
    A = rng.standard_normal(M)
    C = A - 33.0 * (rng.random(M) < 0.02)
    scores = {"A": A, "B": A - 0.1 * rng.standard_normal(M), "C": C, "D": A - 40.0 - rng.random(M)}
    results = folder(tmp_path, scores)
    path = tmp_path / "per_run.csv"
    path.write_text(path.read_text().replace("rmse_position", "log_score"))
    (found,) = rankings(results)
    marked = {c.label for c in found.marked}
    assert "A" in marked
    assert "B" in marked
    assert not {"C", "D"} & marked


def test_a_number_that_is_zero_in_every_run_has_no_mark(tmp_path, rng) -> None:
    A = rng.random(M)
    assert folder(tmp_path, {"A": A, "B": A + 1.0 + A * A}).tables["t"].best == {(0, 0)}
    assert folder(tmp_path, {"A": 0.0 * A, "B": A}).tables["t"].best == set()


def test_a_smoother_below_the_bound_of_filters_is_named(tmp_path) -> None:
    text = """
name: below
runs: 10
bound: PCRLB
smoothed: [KF]
scenario:
  kind: tracking
  last: 20
  target: {kind: driven, motion: {kind: cwna, q: 0.1}, launch: {x: 0, y: 0, vx: 1, vy: 1}}
  sensor: {kind: position, sigma: 5}
  start: {kind: gaussian, sigma: [5, 1, 5, 1]}
filters:
  KF: {kind: kf}
  Lag: {kind: kf, smooth: {lag: 5}}
"""
    ran(tmp_path, text)
    (table,) = ranking_tables(Results(tmp_path / "out"))
    (note,) = [note for note in table.notes if note.startswith("The bound is that of filters")]
    assert "KF, smoothed" in note
    assert "Lag" in note


def test_a_smoother_is_below_the_bound_only_by_its_root_mean_square(tmp_path: Path) -> None:
    """The bound is of mean squares; the mean of the errors is smaller than their rms."""
    spread = np.array([0.0, 2.0] * 20)  # mean 1, rms 1.41
    results = folder(
        tmp_path, {"KF": spread + 3.0, "KF, smoothed": spread}, smoothed=["KF"], bound="B"
    )
    for bound, below in ((1.3, []), (1.5, ["KF, smoothed"])):
        row = dict.fromkeys(COLUMNS["summary.csv"], 0)
        row |= {"filter": "B", "metric": "rms(rmse_position)", "value": bound}
        pd.DataFrame([row]).to_csv(tmp_path / "summary.csv", index=False)
        results = Results(tmp_path, run_facts={"failed": []}, point_facts=results.point_facts)
        (table,) = ranking_tables(results)
        notes = [note for note in table.notes if note.startswith("The bound is that of filters")]
        assert len(notes) == len(below)
        assert all("\u201cKF, smoothed\u201d may lie below it" in note for note in notes)
