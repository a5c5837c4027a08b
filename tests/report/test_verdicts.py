"""Published numbers and claims get the verdict they deserve."""

import csv
import re
from dataclasses import replace
from math import isnan, nan
from types import SimpleNamespace

import numpy as np
import pytest

from tests.commands import trackbench
from tests.simulated import LAWS, decisions, false_of_variances, repeated, z_of
from trackbench import api
from trackbench.config.published_numbers_and_claims import Claim, PublishedNumber
from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.pairs_of_filters import pairs_of
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts, compare
from trackbench.report.verdicts.claim_verdicts import evidence_at, judge
from trackbench.report.verdicts.number_verdicts import Compared, Reproduced, compare_filters
from trackbench.report.verdicts.rank_agreement import rank_agreement
from trackbench.report.verdicts.verdict_counts import bars, summary_lines
from trackbench.report.verdicts.verdict_tables import verdict_tables
from trackbench.statistics.claim_rules import claim_verdict
from trackbench.statistics.comparison import Sample
from trackbench.statistics.estimates import MISSING, RunEstimate
from trackbench.statistics.influential_runs import without_each_batch
from trackbench.statistics.published_number_rules import number_verdict
from trackbench.statistics.verdict_rules import Verdict


def number(value, digits=4, runs=100, **keys):
    return PublishedNumber(
        paper="p", table="t", filter="f", metric="m", value=value, digits=digits, runs=runs, **keys
    )


def verdict(published, *terms):
    found = number_verdict(published, terms[0], terms[1:])
    return found.word, found.z


@pytest.mark.parametrize(
    ("published", "measured", "stderr", "word"),
    [
        (1.0, 1.02, 0.02, "agrees"),  # 0.02 and twice sqrt(2) * 0.02: within a tenth
        (1.0, 1.1, 0.05, "compatible"),  # z = 1.4, but the interval reaches 0.24
        (1.0, 1.05, 0.001, "differs"),  # z = 35, 5 %
        (1.0, 1.2, 0.001, "differs"),
        (1.0, 1.00004, 1e-9, "agrees"),  # the printed digits
        ("biased", 0.5, 0.1, "agrees"),
        ("unbiased", 0.5, 0.1, "differs"),
        ("unbiased", 0.1, 0.1, "inconclusive"),  # there is no room for an error without a margin
        (1.0, nan, nan, "inconclusive"),
        (1.0, 50.0, nan, "inconclusive"),  # of one run, or of a time of one block
    ],
)
def test_verdict_of_a_number(published, measured, stderr, word):
    assert verdict(number(published), RunEstimate(measured, stderr, None, 100))[0] == word


def test_z_has_the_papers_error_from_its_own_number_of_runs_or_its_own_spread():
    measured = RunEstimate(2.0, 0.1, None, 100)
    _, z = verdict(number(1.0, digits=9, runs=25), measured)
    assert z == pytest.approx(1.0 / np.hypot(0.1, 0.2))
    _, z = verdict(number(1.0, digits=9, runs=25, variance=4.0), measured)
    assert z == pytest.approx(1.0 / np.hypot(0.1, 0.4))


def test_parts_on_both_sides_of_the_margin_do_not_unsettle_a_difference():
    """All runs say which word it is; that it differs every part shows."""
    published = number(1.0, digits=9, runs=0)
    parts = [RunEstimate(value, 0.006, None, 300) for value in (1.08, 1.11, 1.12, 1.09)]
    for value in (1.095, 1.105):
        found = number_verdict(published, RunEstimate(value, 0.005, None, 400), parts)
        assert found.word == "differs"


@pytest.mark.parametrize("law", LAWS)
def test_false_decisions_are_rare_and_power_is_kept(law: str) -> None:
    """docs/statistics.md has the table; 3e-4 is 5 % of some 170 verdicts together."""
    R, rng = 10_000, np.random.default_rng(53)
    (_, _, false), *power = decisions(law, 200, R, rng)
    assert false < 3e-4 + 3.0 * np.sqrt(3e-4 / R)
    assert all(new >= old for _, old, new in power)
    found = {z: (old, new) for z, old, new in decisions(law, 800, 1000, rng)}
    (old, new), (_, most) = found[6], found[8]
    assert new > old + 0.5  # the rule of four batches
    assert most > 0.85


def test_the_simulated_z_is_the_packages(rng):
    x = rng.lognormal(size=200)
    sums = np.array([[(x**power).sum()] for power in (1, 2, 3, 4)])
    z = RunEstimate(x.mean(), 0.0, x - x.mean(), 200).z(1.2)
    assert z_of(sums, 200, 1.2)[0] == pytest.approx(z, rel=1e-6)


def test_one_odd_batch_decides_nothing(rng):
    """Three batches know nothing of what the fourth, on another machine say, has."""
    x = rng.standard_normal(400)
    for shift, word in (
        (0.5 * (np.arange(400) >= 0), "holds"),
        (2.0 * (np.arange(400) < 100), "inconclusive"),
    ):
        values = x - x.mean() + shift
        term = RunEstimate(values.mean(), 0.0, values - values.mean(), 400)
        assert term.z() > 7.0
        found = claim_verdict(term.z(), [part.z() for part in without_each_batch(term, 4)])
        assert found.word.startswith(word)


@pytest.mark.parametrize(("law", "statistic", "again"), [
    ("normal", "mean", 0.99), ("lognormal", "mean", 0.95), ("lognormal", "variance", 0.8),
])  # fmt: skip
def test_what_is_not_fragile_comes_out_again(law, statistic, again, rng):
    """Of variances with such tails fewer, since a tail that is not drawn shows nowhere."""
    marked, same, heavy = repeated(law, statistic, 200, 400, rng)
    assert same > again
    assert marked < 0.6
    assert heavy > 0.9 or statistic == "mean"  # by the tail's index nearly all were marked


def test_a_verdict_is_fragile_that_another_seed_or_few_runs_may_turn(rng):
    assert not claim_verdict(7.4).fragile
    assert claim_verdict(7.3).fragile  # 1.64 sqrt(2) above five
    assert claim_verdict(7.4, stressed=[6.0, 4.9]).fragile
    assert not claim_verdict(0.0, stressed=[6.0]).fragile  # nothing is said that could turn
    assert claim_verdict(5.2, equal=True).fragile
    assert not claim_verdict(5.4, equal=True).fragile
    means = rng.uniform(4.0, 12.0, 20_000)
    words = {True: [], False: []}
    for z in means[:, None] + rng.standard_normal((len(means), 2)):
        first, again = map(claim_verdict, z)
        if first.word == "holds":
            words[first.fragile].append((z[0], again.word == "holds"))
    edge = [same for z, same in words[False] if z < 7.7]
    assert np.mean(edge) > 0.95 - 3.0 * np.sqrt(0.05 * 0.95 / len(edge))
    assert np.mean([same for _, same in words[True]]) < 0.85


def test_a_number_that_is_not_fragile_has_its_word_at_another_seed(rng):
    published, words = number(1.0, digits=9, runs=0), {False: [], True: []}
    errors = 10.0 ** rng.uniform(-3.0, -1.0, 6000)
    means = 1.0 + np.where(rng.random(6000) < 0.5, 0.0, rng.uniform(-0.3, 0.3, 6000))
    for true, stderr in zip(means, errors, strict=True):
        seeds = true + stderr * rng.standard_normal(2)
        one, other = (
            number_verdict(published, RunEstimate(x, stderr, None, 100), ()) for x in seeds
        )
        if one.word != "inconclusive":
            words[one.fragile].append((one.word, one.word == other.word))
    for word in ("agrees", "differs"):
        held = [same for w, same in words[False] if w == word]
        assert len(held) > 100
        assert np.mean(held) > 0.95
    assert np.mean([same for _, same in words[True]]) < 0.93


def test_a_number_that_was_chosen_to_come_out_decides_nothing():
    published = number(1.0, chosen="the speed")
    assert verdict(published, RunEstimate(1.0, 0.001, None, 100))[0] == "inconclusive"


def test_every_number_has_a_verdict_and_a_wrong_one_differs(made):
    rows = compare(Results(made)).rows
    found = {
        (r.published.table, r.published.filter, r.published.metric): r.verdict.word for r in rows
    }
    assert found == {
        ("Table 1", "PF", "Mean"): "agrees",
        ("Table 1", "PF50", "Mean"): "compatible",
        ("Table 1", "None", "Mean"): "differs",
        ("Table 1", "Exact", "Mean"): "differs",
        ("Table 1", "PF", "Particles"): "agrees",
        ("Table 2", "PF", "Gain, %"): "agrees",
        ("Table 2", "PF", "Step 5"): found["Table 2", "PF", "Step 5"],
    }


def test_a_factor_multiplies_the_measured_number_and_its_standard_error(folder):
    path = folder / "published" / "numbers.csv"
    before = compare(Results(folder)).rows[0]
    lines = path.read_text().splitlines()
    cells = lines[1].split(",")
    cells[4] = f"{float(cells[4]) / 2:.5f}"
    path.write_text("\n".join([f"{lines[0]},factor", f"{','.join(cells)},0.5"]) + "\n")
    after = compare(Results(folder)).rows[0]
    assert after.measured.estimate == (before.measured.value / 2, before.measured.stderr / 2)
    assert after.verdict.word == before.verdict.word == "agrees"


def test_claims_are_decided_by_paired_z(made):
    judged = compare(Results(made)).claims
    words = [j.verdict.word for j in judged]
    assert words == [*("holds", "fails") * 2, "holds", "not measured"]
    assert all(j.paired and not isnan(j.verdict.z) for j in judged[:5])


def test_the_weakest_comparison_decides_a_claim(made):
    results = Results(made)
    judged = compare(results).claims[0]
    expressions = Evaluator(results, {})
    zs = []
    for other in ("PF", "No data"):
        a, b = (results.runs({})[label, "rmse"] for label in (other, "PF (N=50)"))
        zs.append((a - b).mean() / ((a - b).std(ddof=1) / np.sqrt(len(a))))
    assert 0.6 < judged.verdict.z / min(zs) < 1.1  # the z of Student's t, but for skewness
    assert len(judged.verdict.parts) == 4
    assert "PF (N=50)" in judged.note
    assert (
        expressions.difference(measure("mean(rmse)").of("PF"), measure("mean(rmse)").of("PF")).value
        == 0.0
    )


@pytest.mark.parametrize(("off", "word"), [(-20, "fails"), (0, "holds"), (20, "fails")])
def test_equal_to_a_number_within_a_tolerance(made, off, word):
    results = Results(made)
    measured = Evaluator(results, {}).term(measure("mean(rmse)").of("No data"))
    claim = Claim(
        paper="p",
        claim="c",
        left="No data",
        expression=measure("mean(rmse)"),
        relation="~",
        factor=measured.value + off * measured.stderr,
        tolerance=5 * measured.stderr / measured.value,
    )
    assert judge(claim, evidence_at(results, "")).verdict.word == word


def test_order_of_the_filters_is_compared(made):
    (ranked,) = compare(Results(made)).ranks
    assert (ranked.metric, ranked.filters) == ("Mean", 4)
    assert -1.0 <= ranked.tau < 1.0  # the wrong number spoils the order


def test_gain_is_the_paired_relative_gain(made):
    results = Results(made)
    runs = results.runs({})
    A, B = (np.square(runs[label, "rmse"]) for label in ("PF (N=50)", "PF"))
    gain = 1.0 - np.sqrt(A.mean() / B.mean())
    influence = 0.5 * (1.0 - gain) * (A / A.mean() - B / B.mean())  # delta method on the ratio
    stderr = influence.std(ddof=1) / np.sqrt(len(A))
    found = Evaluator(results, {}).term(measure("gain(rms(rmse), PF)").of("PF (N=50)"))
    assert found.value == pytest.approx(100 * gain)
    assert found.stderr == pytest.approx(100 * stderr, rel=0.2)  # leaves runs out in turn
    ratio = Evaluator(results, {}).term(measure("ratio(rms(rmse), PF)").of("PF (N=50)"))
    assert found.value == pytest.approx(100 * (1 - ratio.value))


def test_steps_times_and_settings_can_be_measured(made):
    expressions = Evaluator(Results(made), {})
    assert expressions.term(measure("rmse@last").of("PF")) == expressions.term(
        measure("rmse@12").of("PF")
    )
    assert expressions.term(measure("cpu_s_per_run").of("PF")).value > 0
    assert expressions.term(measure("N").of("PF (N=50)")).value == 50
    assert isnan(expressions.term(measure("rmse@99").of("PF")).value)
    assert isnan(expressions.term(measure("mean(nonsense)").of("PF")).value)


def test_comparison_files_have_the_promised_columns(made):
    def header(name):
        return (made / name).read_text().splitlines()[0].split(",")

    promised = "table filter metric published measured stderr z verdict note"
    assert header("comparison.csv")[:9] == promised.split()
    assert header("paired.csv") == [
        *("filter_a", "filter_b", "metric", "difference", "stderr", "z", "runs"),
    ]
    assert header("claims.csv")[:3] == ["claim", "verdict", "z"]
    assert "plainly wrong" in (made / "comparison.md").read_text()


def test_paired_csv_has_every_pair_once(made):
    with (made / "paired.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 10  # pairs of 5 filters, one metric
    assert {r["metric"] for r in rows} == {"rmse"}
    assert len({frozenset((r["filter_a"], r["filter_b"])) for r in rows}) == 10


def test_pairs_need_common_runs():
    nan_first, nan_last = np.array([nan, 1.0, nan]), np.array([1.0, nan, nan])
    ones = np.ones(3)
    samples = {"a": Sample(nan_first), "b": Sample(nan_last), "c": Sample(ones)}
    found = pairs_of("rmse", samples)
    runs = [(p.filter_a, p.filter_b, p.comparison.difference.runs) for p in found]
    assert runs == [("a", "c", 1), ("b", "c", 1)]
    assert pairs_of("rmse", {label: samples[label] for label in "ab"}) == []


def test_a_bad_published_file_is_said_with_its_line(folder):
    path = folder / "published" / "numbers.csv"
    text = path.read_text().replace("9.9,1,400", "nine,1,-4").replace("rmse@5", "rmse at 5")
    path.write_text(text)
    done = trackbench("compare", folder)
    assert done.returncode == 2
    assert f"{path}:5:22: value: 'nine' is not" in done.stderr
    assert f"{path}:5:29: runs: -4 is less than 1" in done.stderr
    assert f"{path}:8:40: expression: 'rmse at 5' is no expression" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_missing_published_file_is_said(folder):
    (folder / "published" / "claims.csv").unlink()
    done = trackbench("compare", folder)
    assert done.returncode == 2
    assert "cannot read" in done.stderr


def test_a_label_that_the_experiment_does_not_have_is_said(folder):
    path = folder / "published" / "numbers.csv"
    path.write_text(path.read_text().replace("PF (N=50),mean", "PF50,mean"))
    done = trackbench("check", folder / "config.yaml")
    assert done.returncode == 2
    assert f"{path}:3:43: label: 'PF50' is not a filter here" in done.stderr


def test_a_filter_that_was_left_out_is_not_measured(folder, tmp_path):
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "o", only=["PF"], formats=())
    found = api.run(folder / "config.yaml", options).comparison
    left_out = {row.label: row.verdict.word == "not measured" for row in found.rows}
    assert left_out["PF (N=50)"]
    assert left_out["No data"]
    assert not left_out["PF"]
    assert found.claims[0].verdict.word == "not measured"
    assert not summary_lines(found)[0].endswith("inconclusive")


def test_fewer_runs_than_the_experiment_has_decide_nothing(folder, tmp_path):
    """The screen, comparison.md, the page, a notebook and the data say so alike."""
    config = folder / "config.yaml"
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "o", runs=20, formats=())
    report = api.run(config, options)
    words = {row.verdict.word for row in (*report.comparison.rows, *report.comparison.claims)}
    assert words <= {"too few runs", "not measured"}
    (line,) = summary_lines(report.comparison)
    assert line == "Verdicts on 7 published numbers and 6 claims need all 400 runs."
    page = (report.folder / "report.html").read_text(encoding="utf-8")
    page = re.sub("<(script|style|details)>.*?</\\1>", "", page, flags=re.DOTALL)
    for text in (
        (report.folder / "comparison.md").read_text(encoding="utf-8"),
        page,
        report._repr_html_(),
        "\n".join(summary_lines(api.compare(report.folder))),
    ):
        assert line in text
        assert not re.search(r"\b(holds?|fails?|agrees?|compatible|differs|inconclusive)\b", text)
    again = api.run(config, options.changed({"runs": None, "out": tmp_path / "p"})).comparison
    assert "agrees" in {row.verdict.word for row in again.rows}


def test_a_printed_number_without_a_filter_is_listed_and_has_no_verdict(folder):
    """It is neither inconclusive nor counted among the numbers that were tried."""
    path, before = folder / "published" / "numbers.csv", compare(Results(folder))
    head = path.read_text().splitlines()[0].split(",")
    row = {"paper": "p", "table": "t", "filter": "iEnKS", "metric": "Mean", "value": "0.31"}
    row["note"] = "there is no such filter"
    with path.open("a") as file:
        file.write(",".join(row.get(key, "") for key in head) + "\n")
    found = compare(Results(folder))
    assert [n.filter for n in found.left_out] == ["MCMC", "iEnKS"]
    assert len(found.numbers) == len(before.numbers)
    assert summary_lines(before)[-1] == "1 printed number left out"
    assert summary_lines(found) == [*summary_lines(before)[:-1], "2 printed numbers left out"]
    last = verdict_tables(found)[-1].markdown()
    assert "| p, t | iEnKS | Mean | 0.31 | there is no such filter |" in last


def test_a_point_that_the_grid_does_not_have_is_not_measured(folder):
    for name in ("numbers.csv", "claims.csv"):
        path = folder / "published" / name
        head, *rows = path.read_text().splitlines()
        points = ["scenario.sensor.R=5" if i == 1 else "" for i in range(len(rows))]
        lines = [f"{head},point", *(f"{r},{p}" for r, p in zip(rows, points, strict=True))]
        path.write_text("\n".join(lines) + "\n")
    found = api.compare(folder)
    for judged in (found.rows[1], found.claims[1]):
        assert judged.verdict.word == "not measured"
        assert judged.note.startswith("no results at scenario.sensor.R=5")
    assert found.rows[0].verdict.word == "agrees"


def test_a_point_that_cannot_be_read_is_said(folder):
    path = folder / "published" / "claims.csv"
    head, *rows = path.read_text().splitlines()
    lines = [f"{head},point", f"{rows[0]},R", *(f"{row}," for row in rows[1:])]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(UserError, match="point: 'R' is not path=value; path=value"):
        api.compare(folder)


def test_a_claim_without_a_standard_error_is_not_decided(folder, tmp_path):
    config = folder / "config.yaml"
    config.write_text(config.read_text().replace("\nruns: 400\n", "\nruns: 1\n"))
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "o", formats=())
    judged = api.run(config, options).comparison.claims[0]
    assert judged.verdict.word == "inconclusive"
    assert isnan(judged.verdict.z)
    assert "no standard error" in judged.note


def test_a_variance_that_is_wrongly_decided_is_fragile() -> None:
    """Of 200 runs of HDEPF, which a run in a hundred makes; of lognormal ones none is."""
    rng = np.random.default_rng(54)
    wrong, unmarked = false_of_variances("HDEPF", 200, 600, rng)
    assert 0.01 < wrong < 0.08
    assert unmarked < 3e-4 + 3.0 * np.sqrt(3e-4 / 600)
    assert false_of_variances("lognormal", 200, 300, rng) == (0.0, 0.0)


def test_a_number_differs_only_if_every_reading_does() -> None:
    rows = [
        Compared(number(1.0), "", MISSING, Verdict(word, 0.0), "")
        for word in ("differs", "inconclusive")
    ]
    assert Reproduced(rows).best.verdict.word == "inconclusive"


def test_words_on_a_bias_are_counted_by_themselves() -> None:
    """Their margin is chosen here: they say less than a number does."""
    rows = [
        Compared(number(value, row=str(value)), "", MISSING, Verdict("agrees", 0.0), "")
        for value in (1.0, "biased", "unbiased")
    ]
    assert [bar.words for bar in bars(Verdicts(rows, [], []))] == [
        "1 published number: 1 agrees",
        "2 published words on a bias, by a margin chosen here: 2 agree",
    ]


def _ranked(*values):
    """Rows of one column, of filters of these published and measured values."""
    rows = []
    for i, (printed, value) in enumerate(values):
        published = replace(number(printed), filter=f"F{i}")
        measured = RunEstimate(value, 0.1, None, 100)
        rows.append(Compared(published, f"F{i}", measured, Verdict("agrees", 0.0), ""))
    return list(rank_agreement(rows))


def test_three_filters_have_an_order_and_two_have_none():
    assert _ranked((1.0, 1.0), (2.0, 2.0)) == []
    (found,) = _ranked((1.0, 1.0), (2.0, 3.0), (3.0, 2.0))
    assert (found.filters, found.tau) == (3, pytest.approx(1.0 / 3.0))
    # One whose number is missing does not count.
    assert _ranked((1.0, 1.0), (2.0, 2.0), (3.0, np.nan)) == []


@pytest.mark.parametrize("lost", [0, 3])
def test_an_exact_number_stands_for_the_runs_unless_some_are_lost(lost):
    term = RunEstimate(1.5, 0.01, None, 100, lost)
    evidence = SimpleNamespace(
        term=lambda m: term,
        exact=lambda m: 1.0,
        results=SimpleNamespace(deterministic=[], batches=4, experiment_runs=None),
    )
    published = replace(number(1.0, digits=1), label="A", expression=measure("mean(rmse)"))
    (row,) = compare_filters(published, evidence)
    assert row.measured.value == (1.5 if lost else 1.0)
    assert ("exact, without runs" in row.note) == (not lost)
    assert row.verdict.word == ("differs" if lost else "agrees")
