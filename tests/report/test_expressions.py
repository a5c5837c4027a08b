"""Expressions have a right error each: over all runs, over common ones, over a batch, over blocks."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from trackbench import api
from trackbench.config.published_numbers_and_claims import Claim
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.verdicts.claim_verdicts import judge
from trackbench.results.points_json import PointFacts
from trackbench.results.rows_and_columns import Columns
from trackbench.statistics import sample_statistics as st
from trackbench.statistics import share_of_runs
from trackbench.statistics.influential_runs import with_few_runs_changed, without_each_batch
from trackbench.statistics.limits_of_differences import (
    interval_of_difference,
    of_variances,
    studentized_difference,
)
from trackbench.statistics.skewness_corrected_t_test import studentized

RUNS = 120


@dataclass
class Folder:
    """What expressions read of a results folder."""

    values: dict
    summary: Columns
    timing: Columns

    filters: tuple = ("A", "B")
    labels_without_runs: tuple = ()
    grid_points: tuple = ({},)
    batches: int = 1
    experiment_runs: None = None

    @property
    def config(self):
        return {"runs": RUNS}

    def facts(self, point):
        return PointFacts(point, {}, {"A": {"kind": "none", "N": 4}, "B": {}}, [], [], {}, [])

    def runs(self, point):
        return self.values

    def columns(self, name, point):
        return getattr(self, name)


def table(heads: str, rows: list[tuple]) -> Columns:
    arrays = map(np.array, zip(*rows, strict=True))
    return Columns(dict(zip(heads.split(), arrays, strict=True)))


@pytest.fixture
def folder():
    rng = np.random.default_rng(31)
    common = rng.gamma(3.0, 0.1, RUNS)
    values = {
        ("A", "rmse"): common + rng.gamma(2.0, 0.02, RUNS),
        ("B", "rmse"): 1.2 * common,
        ("A", "rmse@2"): np.abs(rng.standard_normal(RUNS)),
        ("A", "time-mean(rmse)"): common + 0.1,
        ("A", "nees_position"): rng.chisquare(2, RUNS),
    }
    for name in values:
        values[name][[5, 70] if name[0] == "A" else [6]] = np.nan
    nees = st.mean(values["A", "nees_position"][~np.isnan(values["A", "nees_position"])])
    rows = [
        ("A", "mean(nees_position)", *nees, RUNS - 2, 2),
        ("A", "anees_position", nees.value / 2, nees.stderr / 2, RUNS - 2, 2),
    ]
    summary = table("filter metric value stderr runs lost", rows)
    times = [
        ("A", RUNS, 2.0, 0.1),
        ("B", RUNS, 4.0, 0.2),
        ("D", RUNS, 4.0, np.nan),
    ]
    timing = table("filter runs cpu_s_per_run stderr", times)
    return Folder(values, summary, timing)


def found(folder, name):
    return folder.values[name][~np.isnan(folder.values[name])]


def test_a_statistic_and_its_z(folder):
    term = Evaluator(folder, {}).term(measure("variance(rmse)").of("A"))
    x = found(folder, ("A", "rmse"))
    assert term.estimate == st.variance(x)
    assert (term.runs, term.lost, term.has_influences) == (RUNS - 2, 2, True)
    assert term.z(0.002) == studentized(term.value - 0.002, st.influence("variance", x))
    low, high = term.interval()
    assert (low, high) == st.interval("variance", x)


def test_a_difference_of_variances_has_the_limits_of_both(folder):
    e, names = Evaluator(folder, {}), (("A", "rmse"), ("B", "rmse"))
    term = e.term(measure("minus(variance(rmse), B)").of("A"))
    common = ~np.isnan(sum(folder.values[name] for name in names))
    x, y = (folder.values[name][common] for name in names)
    value = st.variance(x).value - st.variance(y).value
    of_x, of_y = (st.influence("variance", values) for values in (x, y))
    sides = of_variances(of_x, of_y)
    assert term.value == pytest.approx(value)
    assert term.z() == pytest.approx(studentized_difference(value, sides))
    assert term.interval() == pytest.approx(interval_of_difference(value, sides))
    assert term.z() != studentized(value, of_x - of_y)
    assert term.stderr == st.mean(of_x - of_y).stderr
    rest, late = without_each_batch(term, 4)[0], common & (np.arange(RUNS) >= 30)
    x, y = (folder.values[name][late] for name in names)
    sides = of_variances(st.influence("variance", x), st.influence("variance", y))
    alone = st.variance(x).value - st.variance(y).value
    assert rest.value == pytest.approx(alone, abs=0.1 * term.stderr)
    assert rest.z() == pytest.approx(studentized_difference(alone, sides), rel=0.1)
    assert e.term(measure("minus(mean(rmse), B)").of("A")).sides is None


def test_shares_and_consistency_have_influences(folder):
    e = Evaluator(folder, {})
    assert e.term(measure("rmse@2").of("A")).estimate == st.rms(found(folder, ("A", "rmse@2")))
    shares = found(folder, ("A", "time-mean(rmse)"))
    assert e.term(measure("time-mean(rmse)").of("A")).estimate == st.mean(shares)
    anees = e.term(measure("anees_position").of("A"))
    assert anees.estimate == pytest.approx(st.mean(found(folder, ("A", "nees_position")) / 2))
    assert all(
        e.term(measure(name).of("A")).has_influences
        for name in ("rmse@2", "time-mean(rmse)", "anees_position")
    )


def test_an_event_is_a_share_whose_error_is_exact(folder):
    """Also of none or all of the runs, where the sample has no spread."""
    folder.values["A", "beyond_10_sigma"] = np.zeros(RUNS)
    folder.values["A", "lost"] = np.where(np.arange(RUNS) < 20, 2.0, 0.0)
    e = Evaluator(folder, {})
    never, lost = (
        e.term(measure(name).of("A")) for name in ("mean(beyond_10_sigma)", "mean(lost)")
    )
    assert never.interval() == share_of_runs.share_interval(0, RUNS)
    assert never.stderr == share_of_runs.share_stderr(0, RUNS) > 0.007
    assert never.z(0.02) == share_of_runs.share_z(0, RUNS, 0.02) > -2
    assert (lost.value, lost.runs, lost.lost) == (20 / RUNS, RUNS, 0)  # of codes the mean is none
    strayed = measure("mean(beyond_10_sigma)")
    claim = Claim(paper="p", claim="c", left="A", expression=strayed, factor=0.01)
    assert judge(claim, e).verdict.word == "inconclusive"


def test_a_difference_of_events_is_never_sure_of_nothing_seen(folder):
    """Where no run differs, or every run does, the sample has no spread."""
    of_a, of_b = (folder.values[label, "rmse"] for label in "AB")
    of_a[:3], of_b[:3] = 1.0, 1.0  # neither is lost there
    for label, strayed in (("A", np.zeros(RUNS)), ("B", np.ones(RUNS)), ("C", np.zeros(RUNS))):
        folder.values[label, "beyond_10_sigma"] = strayed
    few = Evaluator(replace(folder, values={k: x[:3] for k, x in folder.values.items()}), {})
    strayed = measure("mean(beyond_10_sigma)")
    apart, alike = (few.difference(strayed.of("A"), strayed.of(other)) for other in "BC")
    assert (apart.value, apart.runs, alike.value) == (-1.0, 3, 0.0)
    assert apart.z() == pytest.approx(-1.957, abs=1e-3)  # a coin falls so one time in four
    assert apart.interval() == pytest.approx((-1.0, 0.0007), abs=1e-4)
    assert alike.z() == 0.0
    assert alike.interval() == pytest.approx((-0.7076, 0.7076), abs=1e-4)  # as of 0 of 3
    assert alike.stderr > 0.3
    assert with_few_runs_changed(apart) == []
    assert -40.0 < Evaluator(folder, {}).difference(strayed.of("A"), strayed.of("B")).z() < -10.0


def test_an_infinite_consistency_has_no_error(folder):
    folder.values["A", "nees_position"][3] = np.inf
    folder.summary["value"][:], folder.summary["stderr"][:] = np.inf, np.nan
    anees = Evaluator(folder, {}).term(measure("anees_position").of("A"))
    assert (anees.value, anees.runs, anees.lost, anees.has_influences) == (
        np.inf,
        RUNS - 2,
        2,
        False,
    )
    assert np.isnan(anees.stderr)
    assert np.isnan(anees.z(1.0))


@pytest.mark.parametrize("expression", ["mean(rmse)", "minus(mean(rmse), B)", "anees_position"])
def test_parts_are_the_whole_without_a_batch(folder, expression):
    term = Evaluator(folder, {}).term(measure(expression).of("A"))
    parts = without_each_batch(term, 4)
    assert sum(part.runs for part in parts) == 3 * term.runs
    whole = 3.0 * term.value * term.runs
    assert sum(part.value * part.runs for part in parts) == pytest.approx(whole)
    stderr = np.mean([part.stderr for part in parts])
    assert stderr == pytest.approx(np.sqrt(4.0 / 3.0) * term.stderr, rel=0.05)
    assert without_each_batch(term, 1) == []


def test_without_a_batch_a_gain_is_that_of_the_others(folder):
    both = ~np.isnan(folder.values["A", "rmse"] + folder.values["B", "rmse"])
    both &= np.arange(RUNS) < 90
    a, b = (folder.values[label, "rmse"][both] for label in "AB")
    term = without_each_batch(Evaluator(folder, {}).term(measure("gain(rms(rmse), B)").of("A")), 4)[
        3
    ]
    value, stderr = jackknifed_gain(a, b)
    assert term.value == pytest.approx(value, abs=0.1 * stderr)
    assert term.stderr == pytest.approx(stderr, rel=0.05)
    assert term.runs == both.sum()


@pytest.mark.parametrize("relation", ["gain", "ratio", "minus", "win_rate"])
def test_a_difference_of_two_relations_takes_the_runs_that_all_filters_have(folder, relation):
    """The value belongs to the same runs as its error, whichever runs one of the four lost."""
    rng = np.random.default_rng(5)
    folder.values["C", "rmse"] = folder.values["B", "rmse"] + rng.gamma(2.0, 0.03, RUNS)
    folder.values["C", "rmse"][20:60] = np.nan
    left = f"{relation}(mean(rmse), B)" if relation != "win_rate" else "win_rate(rmse, B)"
    right = left.replace("B", "C")
    whole = Evaluator(folder, {}).difference(measure(left).of("A"), measure(right).of("A"))
    every = np.logical_and.reduce([~np.isnan(folder.values[f, "rmse"]) for f in "ABC"])
    for name, values in folder.values.items():
        folder.values[name] = np.where(every, values, np.nan)
    e = Evaluator(folder, {})
    sides = [e.term(measure(side).of("A")) for side in (left, right)]
    assert whole.runs == every.sum()
    assert whole.value == pytest.approx(sides[0].value - sides[1].value, rel=1e-12)
    influences = sides[0].influences - sides[1].influences
    assert whole.influences[every] == pytest.approx(influences[every], rel=1e-9)


def jackknifed_gain(a, b):
    """Percent by which a's rms is below b's, and its error by leaving out each run in turn."""

    def gain(kept):
        return 100.0 * (1.0 - np.sqrt(np.square(a[kept]).sum() / np.square(b[kept]).sum()))

    every = np.arange(len(a))
    left_out = np.array([gain(every != i) for i in every])
    return gain(every >= 0), np.sqrt((len(a) - 1) * np.mean((left_out - left_out.mean()) ** 2))


def test_an_exact_number_leaves_the_influences_alone(folder):
    term = Evaluator(folder, {}).difference(
        measure("mean(rmse)").of("A"), measure("N").of("A"), 0.1
    )
    mean = st.mean(found(folder, ("A", "rmse")))
    assert term.estimate == pytest.approx((mean.value - 0.4, mean.stderr))
    assert term.has_influences


def test_a_number_without_its_farthest_run_and_with_three_more(folder):
    folder.values["A", "rmse"][17] = 9.0
    term = Evaluator(folder, {}).term(measure("mean(rmse)").of("A"))
    x = found(folder, ("A", "rmse"))
    less, more = with_few_runs_changed(term)
    mean = x.mean()
    with_three = np.append(x, [mean + 2.0 * (9.0 - mean)] * 3)
    assert less.estimate == pytest.approx(st.mean(x[x < 9.0]))
    assert more.estimate == pytest.approx(st.mean(with_three))
    assert more.z(mean) == pytest.approx(
        studentized(with_three.mean() - mean, st.influence("mean", with_three))
    )


def test_times_are_no_matter_of_runs(folder):
    e = Evaluator(folder, {})
    time = e.term(measure("cpu_s_per_run").of("A"))
    assert (time.value, time.stderr, time.has_influences) == (2.0, 0.1, False)
    ratio = e.term(measure("ratio(cpu_s_per_run, B)").of("A"))
    assert ratio.value == 0.5
    assert ratio.stderr == pytest.approx(0.5 * np.hypot(0.1 / 2, 0.2 / 4))
    assert np.isnan(e.term(measure("ratio(cpu_s_per_run, D)").of("A")).stderr)


def test_a_ratio_of_measured_times_is_paired_by_repeats(folder):
    times = [
        ("A", RUNS, 2.0, 0.1, "2;4;1"),
        ("B", RUNS, 4.0, 0.2, "4;8;2"),
        ("D", RUNS, 4.0, 0.2, "4"),
    ]
    folder.timing = table("filter runs cpu_s_per_run stderr repeats", times)
    e = Evaluator(folder, {})
    ratio = e.term(measure("ratio(cpu_s_per_run, B)").of("A"))
    assert (ratio.value, ratio.stderr) == (0.5, 0.0)  # in every repeat one half
    gain = e.term(measure("gain(cpu_s_per_run, B)").of("A"))
    assert (gain.value, gain.stderr) == (50.0, 0.0)
    assert e.term(measure("ratio(cpu_s_per_run, D)").of("A")).stderr > 0.0


def test_what_is_not_measured_is_not_fragile(folder):
    """Against a filter that is there the number is fragile; the other is not there."""
    folder.values["A", "rmse"][17] = 30.0
    error, whole = measure("variance(rmse)"), Evaluator(folder, {})
    claim = Claim(paper="p", claim="c", left="A", expression=error, right="B;none")
    found = judge(claim, whole)
    assert (found.verdict.word, found.verdict.fragile) == ("not measured", False)
    assert found.note == "no number of none"


def test_a_ratio_to_an_exact_bound_has_the_error_of_the_filter(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "name: a\nruns: 8\nblock: fit\nscenario:\n  kind: tracking\n  last: 6\n"
        "  target: {kind: driven, motion: {kind: cwna, q: 1}}\n"
        "  sensor: {kind: position, sigma: 10}\n"
        "  start: {kind: gaussian, sigma: [10, 1, 10, 1]}\n"
        "filters: {KF: {kind: kf}}\nbound: B\nfigures: {}\n"
        "tables:\n  t:\n    kind: metrics\n    columns:\n      A: rms(rmse_position)\n"
        "      R: ratio(rms(rmse_position), B)\n      At: rmse_position@5\n"
        "      RAt: ratio(rmse_position@5, B)\n      N: ratio(anees, B)\n"
    )
    done = api.run(tmp_path / "a.yaml", out=tmp_path / "out", quiet=True, workers=1, formats=())
    table = done.results.tables["t"]
    (error, ratio, at_step, ratio_at_step, _), (bound, one, bound_at_step, *_) = table.cells
    for part, whole, result in (
        (error, bound, ratio),
        (at_step, bound_at_step, ratio_at_step),
    ):
        assert result.estimate.value == pytest.approx(part.estimate.value / whole.estimate.value)
        stderr = part.estimate.stderr / whole.estimate.value
        assert result.estimate.stderr == pytest.approx(stderr, rel=0.05)  # by the jackknife
    assert one.estimate[:2] == (1.0, 0.0)
    assert "N is empty, as B has no such number." in table.notes
