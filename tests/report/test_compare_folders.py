"""Two results folders side by side: paired and independent differences, equal bytes, false alarms."""

import json
from math import isinf, isnan
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom, binomtest, norm, t, ttest_rel

from tests.commands import trackbench
from tests.conftest import PLANE
from trackbench import api
from trackbench.commands.compare_new_with_stored import Limit, judge
from trackbench.commands.gate import limit_of
from trackbench.report.folder_comparison.numbers_and_pairing import compare_folders
from trackbench.report.folder_comparison.table_figure_and_sentences import table_of
from trackbench.report.folder_comparison.tests_and_verdicts import Row, judge_rows, rows_of
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.comparison import Sample

CONFIG = f"""
name: plane
seed: 5
runs: 30
block: fit
{PLANE}
filters:
  KF: {{kind: kf}}
  PF: {{kind: pf, N: 50}}
  Loose: {{kind: kf, assume: {{motion: {{kind: cv, q: 30}}}}}}
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Results with these overrides."""
    home = tmp_path_factory.mktemp("plane")
    (home / "plane.yaml").write_text(CONFIG)
    overrides = {
        "first": [],
        "again": [],
        "tight": ["filters.Loose.assume.motion.q=1"],
        "seed": ["seed=6"],
        "fewer": ["runs=20", "block=10"],
        "noisier": ["scenario.sensor.sigma=3"],
    }
    for name, words in overrides.items():
        options = api.Options(engine="serial", quiet=True, formats=(), set=words)
        api.run(home / "plane.yaml", options, out=home / name)
    return {name: home / name for name in overrides}


def row(rows: list[Row], label: str, metric: str) -> Row:
    (found,) = (r for r in rows if (r.filter, r.metric) == (label, metric))
    return found


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def rms_error(x: np.ndarray) -> float:
    """Delete each run in turn: the jackknife's standard error of the root mean square."""
    left_out = np.array([rms(np.delete(x, i)) for i in range(len(x))])
    return float(np.sqrt((len(x) - 1) * left_out.var()))


def values(folder: Path, label: str, metric: str) -> np.ndarray:
    return Results(folder).runs({})[label, metric]


def test_common_runs_are_paired(folders: dict[str, Path]) -> None:
    rows, why = compare_folders(Results(folders["first"]), Results(folders["tight"]))
    assert why == ""
    assert {r.how for r in rows if r.filter != "Loose"} == {"equal"}
    found = row(rows, "Loose", "rms(rmse_position)")  # the statistic of the default table
    a, b = (values(folders[name], "Loose", "rmse_position") for name in ("first", "tight"))
    assert found.difference.value == pytest.approx(rms(b) - rms(a))
    left_out = np.array([rms(np.delete(b, i)) - rms(np.delete(a, i)) for i in range(30)])
    assert found.difference.stderr == pytest.approx(np.sqrt(29 * left_out.var()))
    p = ttest_rel(a, b).pvalue  # of the means, without the corrections for skewness and heavy tails
    assert np.log(2 * norm.sf(abs(found.change.z))) == pytest.approx(np.log(p), rel=0.3)
    assert (found.verdict, found.difference.runs) == ("better", 30)
    size = 4  # of the state
    anees = row(rows, "Loose", "anees")
    assert anees.change.b.value == pytest.approx(
        values(folders["first"], "Loose", "nees").mean() / size
    )


def test_another_seed_or_scenario_has_independent_errors(folders: dict[str, Path]) -> None:
    for name, reason in (
        ("seed", "the seeds differ (5 and 6)"),
        ("noisier", "the scenarios differ"),
    ):
        rows, why = compare_folders(Results(folders["first"]), Results(folders[name]))
        assert why == reason
        found = row(rows, "KF", "rms(rmse_position)")
        a, b = (values(folders[f], "KF", "rmse_position") for f in ("first", name))
        assert found.difference.stderr == pytest.approx(
            np.hypot(rms_error(a), rms_error(b)), rel=0.05
        )
        # Welch's test has at most twice the degrees of freedom.
        T = (rms(b) - rms(a)) / np.hypot(rms_error(a), rms_error(b))
        assert found.change.z == pytest.approx(norm.isf(t.sf(T, 29)), rel=0.1)


def test_a_clone_is_compared_by_its_summary(folders: dict[str, Path], tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    clone.mkdir()
    for name in ("config.yaml", "summary.csv", "points.json", "manifest.json"):
        (clone / name).write_bytes((folders["tight"] / name).read_bytes())
    done = trackbench("compare", folders["first"], clone)
    assert done.returncode == 0, done.stderr
    assert "clone has no per_run.csv: the errors of summary.csv are used" in done.stdout
    # The digits of summary.csv are equal, which says nothing about the bytes of per_run.csv.
    assert "KF, PF: unchanged in all compared numbers." in done.stdout
    assert "byte" not in done.stdout
    rows, _ = compare_folders(Results(folders["first"]), Results(clone))
    paired, _ = compare_folders(Results(folders["first"]), Results(folders["tight"]))
    a, b = (row(of, "Loose", "rms(rmse_position)") for of in (rows, paired))
    assert a.difference.value == pytest.approx(b.difference.value, rel=1e-5)
    assert a.difference.stderr > b.difference.stderr
    assert row(rows, "KF", "anees").how == "equal"


def test_the_share_of_lost_runs_is_of_all_runs(folders: dict[str, Path], tmp_path: Path) -> None:
    """The last row of a filter may be of a metric that few runs measure."""
    clones = []
    for lost in (3, 6):
        clone = tmp_path / f"lost-{lost}"
        clone.mkdir()
        for name in ("config.yaml", "points.json", "manifest.json"):
            (clone / name).write_bytes((folders["first"] / name).read_bytes())
        table = pd.read_csv(folders["first"] / "summary.csv")
        of_filter = table["filter"] == "KF"
        table["lost"] = of_filter * lost
        table.loc[of_filter, "runs"] = 30 - lost
        table.loc[of_filter[of_filter].index[-1], "runs"] = 2
        table.to_csv(clone / "summary.csv", index=False, na_rep="nan")
        clones.append(Results(clone))
    rows, _ = compare_folders(*clones)
    share = row(rows, "KF", "lost")
    assert (share.change.b.value, share.change.a.value) == (0.1, 0.2)
    assert share.difference.runs == 30


def test_more_runs_are_compared_on_the_common_ones(folders: dict[str, Path]) -> None:
    rows, _ = compare_folders(Results(folders["first"]), Results(folders["fewer"]))
    found = row(rows, "KF", "rms(rmse_position)")
    assert (found.difference.runs, found.how) == (20, "equal")
    assert row(rows, "PF", "rms(rmse_position)").how == "paired"  # its noise depends on the block


def test_what_the_command_prints_and_draws(folders: dict[str, Path], tmp_path: Path) -> None:
    picture = tmp_path / "p.svg"
    done = trackbench("compare", folders["first"], folders["tight"], "--out", picture)
    assert "tight against first, paired on 30 common runs" in done.stdout
    assert "KF, PF: unchanged in all compared numbers." in done.stdout
    assert "Better in tight: " in done.stdout
    assert "rms(rmse_position) (m)" in picture.read_text()
    heads, rule, first = done.stdout.splitlines()[1:4]
    ends = [i for i, c in enumerate(rule + " ") if c == " " and rule[i - 1] == "-"]
    assert all(line[i : i + 2].strip() == "" for line in (heads, first) for i in ends[:-1])
    same = trackbench("compare", folders["first"], folders["again"])
    assert same.stdout.splitlines()[-1].startswith("All ")
    assert same.stdout.splitlines()[-1].endswith(" compared numbers are equal.")
    lines = trackbench("compare", folders["first"], folders["tight"], "--json").stdout.splitlines()
    assert {"filter", "metric", "a", "b", "difference", "how"} <= json.loads(lines[0]).keys()
    for words, what in (
        ((folders["first"], tmp_path / "none"), "there is no such folder"),
        ((folders["first"], folders["again"], "--out", "a.txt"), "must end in .png, .svg or .pdf"),
    ):
        wrong = trackbench("compare", *words)
        assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)
        assert what in wrong.stderr


def test_what_only_one_folder_has_is_named(folders: dict[str, Path], tmp_path: Path) -> None:
    """Filters, a value of the grid, and metrics; a copy of a folder has no such line."""
    grid = "grid: {scenario.sensor.sigma: [2, 3]}\n"
    (tmp_path / "plane.yaml").write_text(CONFIG + grid)
    options = api.Options(engine="serial", quiet=True, formats=(), runs=6)
    overrides = {
        "all": [],
        "one-value": ["grid={scenario.sensor.sigma: [2]}"],
        "few": ["metrics=[rmse_position]"],
    }
    for name, words in overrides.items():
        api.run(tmp_path / "plane.yaml", options, out=tmp_path / name, set=words)
    api.run(tmp_path / "plane.yaml", options, out=tmp_path / "KF", only=["KF"])

    def last_lines(*names: str) -> list[str]:
        done = trackbench("compare", *names, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done.stdout.partition(" compared numbers are equal.\n")[2].splitlines()

    assert last_lines("all", "all") == []
    for words in (("all", "KF"), ("KF", "all")):
        assert last_lines(*words) == ["PF: only in all.", "Loose: only in all."]
    assert last_lines("one-value", "all") == ["sigma = 3: only in all."]
    metrics = last_lines("all", "few")
    assert len(metrics) == 3
    assert metrics[0].startswith("KF: rmse_velocity, ")
    assert metrics[0].endswith(" are only in all.")
    nothing = trackbench("compare", "KF", folders["first"], cwd=tmp_path)
    assert "no filter, metric and grid point in common; sigma = 2: only in KF." in nothing.stderr


def test_shares_and_infinities() -> None:
    """A loss by the sign test, and a collapse that no mean shows."""
    zero, six = np.zeros(40), np.repeat([1.0, 0.0], [6, 34])
    (lost,) = rows_of(({}, "A", "lost"), Sample(zero), Sample(six), True, False)
    p = binomtest(6, 6, alternative="greater").pvalue
    assert norm.sf(lost.worse.z) == pytest.approx(p, rel=1e-6)
    (independent,) = rows_of(({}, "A", "lost"), Sample(zero), Sample(six), False, False)
    assert 2.0 < independent.worse.z == independent.change.z
    nees = np.linspace(0.5, 1.5, 40)
    collapsed = np.where(six > 0.0, np.inf, nees)
    infinite, rest = rows_of(({}, "A", "anees"), Sample(nees), Sample(collapsed), True, False)
    assert infinite.metric == "anees infinite"
    assert infinite.worse.z == lost.worse.z
    assert (rest.difference.runs, rest.difference.value) == (34, 0.0)
    assert (rest.how, rest.left_out) == ("equal", 6)


@pytest.mark.parametrize(("lost", "word"), [(10, "worse"), (9, "no significant difference")])
def test_numbers_that_are_equal_in_common_runs_do_not_weaken_the_test_of_lost_runs(
    lost: int, word: str
) -> None:
    """Of ten new losses the sign test has p = 2^-10, below the limit of one test and not of three."""
    kept = np.arange(40) >= lost
    shares = {"lost": (np.zeros(40), (~kept) * 1.0)}
    errors = np.random.default_rng(lost).uniform(1.0, 2.0, 40)
    for metric, values in (("diverged", np.zeros(40)), ("rmse_position", errors)):
        shares[metric] = values, np.where(kept, values, np.nan)
    rows = []
    for metric, (before, now) in shares.items():
        rows += rows_of(({}, "A", metric), Sample(before), Sample(now), True, False)
    judged = {r.metric: r for r in judge(rows, limit_of("3sigma"))}
    assert judged["lost"].verdict == word
    assert judged["lost"].change.p == pytest.approx(2.0**-lost)
    assert {judged[m].verdict for m in ("diverged", "rmse_position")} == {"equal"}
    # The numbers of both sides are over the common runs, which a note says.
    change = judged["rmse_position"].change
    assert change.a.value == change.b.value == pytest.approx(errors[kept].mean())
    table = table_of("", rows, ("before", "now"))
    assert len(table.rows) == 1
    assert table.notes == [
        f"A: {lost} runs with a value on one side only are left out. "
        f"Its numbers on both sides are those of the other {40 - lost} runs."
    ]
    # If both sides lost the runs, nothing is left out. If the runs are other ones, none is common.
    (both,) = rows_of(
        ({}, "A", "rmse_position"), *[Sample(shares["rmse_position"][1])] * 2, True, False
    )
    assert table_of("", [both], ("before", "now")).notes == [
        "A: unchanged in all compared numbers."
    ]
    samples = map(Sample, shares["rmse_position"])
    (independent,) = rows_of(({}, "A", "rmse_position"), *samples, False, False)
    assert (independent.how, independent.left_out) == ("independent", 0)


def test_anees_is_worse_if_further_from_one() -> None:
    rng = np.random.default_rng(3)
    x = rng.chisquare(4, 200)
    x /= x.mean()
    for factor, before, worse in ((0.6, 1.02, True), (1.25, 1.02, True), (0.8, 1.4, False)):
        a, b = Sample(before * x), Sample(factor * before * x * rng.uniform(0.99, 1.01, 200))
        (found,) = rows_of(({}, "A", "anees"), a, b, True, False)
        assert abs(found.worse.z) > 3
        assert (found.worse.z > 0) == worse


def test_one_recording_is_exact_or_untested() -> None:
    """One run has no standard error: a filter without random numbers is compared as it is."""
    one, two = Sample(np.array([2.0])), Sample(np.array([2.1]))
    key = ({}, "A", "rmse_position")
    for first, second, is_exact, limit, word in (
        (one, two, True, 0.0, "worse"),
        (two, one, True, 0.0, "better"),
        (one, two, True, 0.1, "negligible"),
        (one, two, False, 0.0, "untested"),
    ):
        rows = [*rows_of(key, first, second, True, is_exact)]
        assert [r.verdict for r in judge(rows, Limit(3.0, limit))] == [word]


def test_the_p_value_of_a_gate_is_that_of_the_side_of_z() -> None:
    """A number that is better has a small one, too."""
    values = np.random.default_rng(3).uniform(1.0, 2.0, 50)
    noise = np.random.default_rng(4).uniform(0.9, 1.1, 50)
    key = ({}, "A", "rmse_position")
    for factor, word in ((0.5, "better"), (2.0, "worse")):
        rows = rows_of(key, Sample(values), Sample(factor * values * noise), True, False)
        (found,) = judge([*rows], limit_of("3sigma"))
        assert found.verdict == word
        assert found.change.p <= norm.sf(3.0)
        assert found.change.p == pytest.approx(norm.sf(abs(found.worse.z)), rel=1e-6)


@pytest.mark.parametrize(
    ("metric", "numbers", "is_exact", "word"),
    [
        ("rmse_position", (2.0, 2.1), True, "worse"),
        ("rmse_position", (2.1, 2.0), True, "better"),
        ("rmse_position", (2.0, 2.1), False, "untested"),
        ("log_score", (-9.0, -9.1), True, "worse"),
        ("anees", (0.5, 1.5), True, "better"),
        ("bias_x", (0.2, -0.1), True, "better"),
        ("bias_x", (0.2, -0.2), True, "differs"),
        ("nis", (2.0, 1.9), True, "differs"),  # no value of a single NIS is best
    ],
)
def test_an_exact_difference_of_one_run_needs_no_test(
    metric: str, numbers: tuple[float, float], is_exact: bool, word: str
) -> None:
    """Two folders of a recording, as `trackbench compare` judges them."""
    first, second = (Sample(np.array([number])) for number in numbers)
    (found,) = judge_rows([*rows_of(({}, "A", metric), first, second, True, is_exact)])
    assert found.verdict == word
    if is_exact:
        assert found.how == "exact"
        assert found.change.p == 0.0
        assert isinf(found.change.z)
        assert isnan(found.worse.z) == (metric == "nis")


@pytest.mark.parametrize(
    ("share", "words"), [(0.1, ("worse", "worse")), (10.0, ("worse", "negligible"))]
)
def test_lost_runs_count_however_small_their_share_of_a_limit_is(share, words) -> None:
    """40 lost runs in place of 5 are seven times as many; errors as many times larger are negligible."""
    few, many = (np.repeat([1.0, 0.0], [n, 400 - n]) for n in (5, 40))
    rows = []
    for metric in ("lost", "rmse_position"):
        rows += rows_of(({}, "A", metric), Sample(few), Sample(many), True, False)
    assert tuple(r.verdict for r in judge(rows, Limit(3.0, share))) == words


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("3sigma", Limit(3.0, 1e-4)),
        ("2.5sigma,1%", Limit(2.5, 0.01)),
        ("4sigma, 300%", Limit(4.0, 3.0)),
        ("3 sigma, 0.5 %", Limit(3.0, 0.005)),
    ],
)
def test_a_limit_is_standard_deviations_and_percent(text: str, limit: Limit) -> None:
    assert limit_of(text) == pytest.approx(limit)


def false_alarms(
    runs: int, sigmas: float, gates: int, tail: float, seed: int = 1
) -> tuple[int, int]:
    """Return how many of so many gates with 20 metrics of an unchanged filter fail: Holm's, without.

    Both versions have lognormal errors (normal for ``tail`` 0), of which half the variance is common.
    """
    rng = np.random.default_rng(seed)
    corrected = plain = 0
    for _ in range(gates):
        rows: list[Row] = []
        for i, metric in enumerate(["rmse_position"] * 16 + ["anees"] * 2 + ["lost"] * 2):
            z = rng.standard_normal((3, runs))
            a, b = ((z[0] + own) / np.sqrt(2.0) for own in z[1:])
            if metric == "lost":
                a, b = (a > 1.5) * 1.0, (b > 1.5) * 1.0
            else:
                a, b = (np.exp(tail * x) if tail else x + 10.0 for x in (a, b))
            rows += rows_of(({}, f"{metric} {i}", metric), Sample(a), Sample(b), True, False)
        corrected += any(r.verdict == "worse" for r in judge(rows, Limit(sigmas, 0.0)))
        plain += any(r.worse.z > sigmas for r in rows)
    return corrected, plain


@pytest.mark.parametrize("tail", [0.0, 0.7])
def test_a_gate_with_20_metrics_seldom_raises_a_false_alarm(tail: float) -> None:
    """At 2 sigma 2.3 % of all gates at most, where tests without a correction fail a third of them."""
    corrected, plain = false_alarms(60, 2.0, 300, tail)
    assert corrected <= binom.isf(1e-3, 300, norm.sf(2.0))
    assert plain >= binom.isf(1 - 1e-3, 300, 0.2)


if __name__ == "__main__":
    for tail in (0.0, 0.7):
        for runs in (50, 200):
            for sigmas in (2.0, 3.0):
                counts = false_alarms(runs, sigmas, 10_000, tail)
                print(tail, runs, sigmas, *counts, norm.sf(sigmas), flush=True)
