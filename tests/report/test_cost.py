"""Accuracy at equal cost: known curves, errors against repeated batches, and a small experiment."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import ran
from tests.conftest import PLANE
from tests.papers import merwe_text
from trackbench import api
from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measure
from trackbench.report.cost_curves import curves, front
from trackbench.report.expressions import Evaluator
from trackbench.report.filter_setting_labels import own_values
from trackbench.report.tables.equal_cost import EqualCost
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.error_at_cpu_time import Curve, Spot, compare_at
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.influential_runs import without_each_batch
from trackbench.statistics.sample_statistics import influence, mean
from trackbench.verify.verify_folder import verify

NOBODY = np.zeros(0)


def exactly(value: float) -> RunEstimate:
    return RunEstimate(value, 0.0, None, 1)


def made(function: Any, sizes: tuple[int, ...]) -> Curve:
    """Sizes whose time is 2 us each, with errors that are a function of it and known exactly."""
    spots = [Spot(n, exactly(2e-6 * n), exactly(function(2e-6 * n)), NOBODY) for n in sizes]
    return Curve("PF", tuple(spots))


def test_a_power_of_the_time_is_interpolated_exactly():
    found = made(lambda c: 3.0 * c**-0.5, (10, 30, 100, 300)).error_at(exactly(2e-6 * 55))
    assert found is not None
    assert np.exp(found.error.value) == pytest.approx(3.0 * (2e-6 * 55) ** -0.5)
    assert found.size == pytest.approx(55)
    assert found.curvature == pytest.approx(0.0, abs=1e-12)


def test_what_a_parabola_is_off_by_is_told_to_the_last_digit():
    curve = made(lambda c: np.exp(0.2 * np.log(c) ** 2), (10, 20, 70, 300))
    for n in (12, 50, 250):
        found = curve.error_at(exactly(2e-6 * n))
        assert found is not None
        left_out = abs(found.error.value - 0.2 * np.log(2e-6 * n) ** 2)
        assert found.curvature == pytest.approx(left_out)
    of_two = made(lambda c: c, (10, 20)).error_at(exactly(3e-5))
    assert of_two is not None
    assert np.isnan(of_two.curvature)


def test_nothing_is_said_beyond_the_sizes_that_there_are():
    curve = made(lambda c: 1.0 / c, (10, 30))
    assert curve.error_at(exactly(1.9e-5)) is None
    assert curve.error_at(exactly(6.1e-5)) is None
    fixed = made(lambda c: 1.0, (10,))
    assert fixed.error_at(exactly(1.9e-5)) is None
    assert fixed.error_at(exactly(1.0)) == (10, exactly(0.0), 0.0, 0.0, NOBODY)


def test_times_that_fall_are_taken_at_the_largest_size():
    """A first block is often slow: what counts is the most particles that the time buys."""
    spots = [
        Spot(n, exactly(c), exactly(e), NOBODY)
        for n, c, e in ((10, 3e-6, 0.4), (30, 2e-6, 0.3), (100, 4e-6, 0.1))
    ]
    found = Curve("PF", tuple(spots)).error_at(exactly(2.5e-6))
    assert found is not None
    assert 30 < found.size < 100


def noisy(rng: np.random.Generator, name: str, slope: float) -> Curve:
    """Three sizes of which errors share their runs; a time is that of four blocks."""
    runs, blocks = 200, 4
    shared = rng.standard_normal(runs)
    spots = []
    for n in (10.0, 30.0, 100.0):
        values = n**slope * np.exp(0.4 * shared + 0.2 * rng.standard_normal(runs) - 0.1)
        times = 2e-6 * n * (1.0 + 0.05 * rng.standard_normal(blocks))
        cost = RunEstimate(times.mean(), mean(times).stderr, None, runs)
        error = RunEstimate(*mean(values), influence("mean", values), runs)
        spots.append(Spot(n, cost, error, np.zeros(runs)))
    return Curve(name, tuple(spots))


def test_the_error_at_a_cost_is_that_of_repeated_batches():
    rng, asked = np.random.default_rng(7), 2e-6 * 50
    found, pairs = [], []
    for _ in range(500):
        a, b = (noisy(rng, "PF", slope) for slope in (-0.5, -0.8))
        times = asked * (1.0 + 0.05 * rng.standard_normal(4))
        cost = RunEstimate(times.mean(), mean(times).stderr, None, 200)
        at, other = a.error_at(cost), b.error_at(cost)
        assert at is not None
        assert other is not None
        found.append((at.error.value, np.hypot(at.error.stderr, at.stderr_of_times)))
        difference = compare_at(at, other).difference
        whole = np.sqrt(difference.stderr**2 + at.stderr_of_times**2 + other.stderr_of_times**2)
        pairs.append((difference.value, whole))
    for rows, known in ((found, -0.5 * np.log(50)), (pairs, 0.3 * np.log(50))):
        values, stderrs = np.array(rows).T
        spread = values.std(ddof=1)
        assert abs(values.mean() - known) < 4.0 * spread / np.sqrt(500) + 0.005
        # Known to 3 % itself; and that of two costs takes the one that is asked for twice.
        assert np.sqrt(np.mean(stderrs**2)) == pytest.approx(spread, rel=0.13)


def test_the_front_is_what_nothing_betters():
    points = [(1, 9), (2, 9), (3, 4), (3, 5), (4, 6), (5, 1)]
    spots = [Spot(i, exactly(c), exactly(e), NOBODY) for i, (c, e) in enumerate(points)]
    assert [spot.size for spot in front(spots)] == [0, 2, 5]
    assert [spot.size for spot in front(spots, higher=True)] == [0]


CONFIG = f"""
name: cost
runs: 60
block: 15
scenario: {merwe_text(T=8)}
reference: Exact
grid:
  filters.PF.N & filters.HDEPF.N: [[10, 5], [40, 8], [160, 12]]
  filters.HDEPF.G: [1, 3]
filters: {{PF: {{kind: pf, N: 9}}, HDEPF: {{kind: hdepf}}, UKF: {{kind: ukf}},
  Exact: {{kind: grid, nodes: 40}}}}
metrics: [rmse, rmsd]
per_step: []
tables:
  equal: {{kind: equal-cost, of: PF}}
  equally-near: {{kind: equal-cost, of: PF, metric: efficiency}}
  efficiency: {{kind: efficiency}}
  metrics: {{kind: metrics, columns: {{E: efficiency, To the PF: "ratio(efficiency, PF)"}}}}
figures:
  cost: {{kind: accuracy-vs-cost}}
  efficient: {{kind: accuracy-vs-cost, metric: efficiency, log: false, filters: [PF, UKF]}}
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cost")
    return ran(folder, CONFIG, formats=("svg",)).results


def test_each_path_takes_its_own_value(results):
    sizes = [(p["filters.PF.N & filters.HDEPF.N"], p["filters.HDEPF.G"]) for p in results.points()]
    assert sizes == [(f"[{a}, {b}]", g) for a, b in ((10, 5), (40, 8), (160, 12)) for g in (1, 3)]
    given = results.facts(results.points()[-1]).filters
    assert (given["PF"]["N"], given["HDEPF"]["N"], given["HDEPF"]["G"]) == (160, 12, 3)


def test_a_sentence_has_a_filters_own_value(results):
    point = results.points()[-1]
    assert own_values(results, point, "PF") == {"filters.PF.N": 160}
    assert own_values(results, point, "HDEPF") == {"filters.HDEPF.N": 12, "filters.HDEPF.G": 3}
    assert own_values(results, point, "UKF") == {}


def test_every_form_of_a_filter_is_a_curve_of_its_own(results):
    found = curves(results, {}, ["PF", "HDEPF", "UKF"], measure("mean(rmse)"), "N")
    assert [(c.name, [s.size for s in c.spots]) for c in found[:3]] == [
        ("PF", [10, 40, 160]),
        ("HDEPF (G = 1)", [5, 8, 12]),
        ("UKF", pytest.approx([np.nan], nan_ok=True)),
    ]
    assert found[3].name == "HDEPF (G = 3)"
    row = results.timing[results.timing["filter"] == "PF"].iloc[0]
    assert found[0].spots[0].cost.value == pytest.approx(row["cpu_s_per_run"] / 7)
    assert found[0].spots[0].cost.stderr == pytest.approx(row["stderr"] / 7)


def test_the_table_at_equal_cost(results):
    table = results.tables["equal"]
    assert table.key_headers == ["At PF's N", "Filter"]
    names = ["PF", "HDEPF (G = 1)", "UKF", "HDEPF (G = 3)"]
    assert table.keys == [[n, name] for n in ("10", "40", "160") for name in names]
    for (_, name), (time, size, error, _, over) in zip(table.keys, table.cells, strict=True):
        assert time.estimate.value > 0.0
        if name == "PF":
            assert over.estimate == (1.0, 0.0)
            assert error.estimate.stderr > 0.0
        if name == "UKF":
            assert np.isnan(size.estimate.value)
    assert len(table.notes) == 3
    assert all(": best " in note for note in table.notes)


def test_at_the_cost_of_a_filter_with_several_forms(results):
    keys = EqualCost(of="HDEPF", filters=("PF", "UKF")).table(results).keys
    sizes = [f"{n} (G = {g})" for g in (1, 3) for n in (5, 8, 12)]
    assert keys == [[size, name] for size in sizes for name in ("PF", "UKF")]


def test_of_efficiencies_the_highest_is_the_best(results):
    table = results.tables["equally-near"]
    assert len(table.notes) == 3
    for i, note in enumerate(table.notes):
        rows = {k[1]: c[2].estimate.value for k, c in zip(table.keys, table.cells, strict=True)
                if k[0] == ("10", "40", "160")[i] and c[1].runs}  # fmt: skip
        best = max(rows, key=rows.__getitem__)
        assert f": best {best}" in note
        mine = {row for row, keys in enumerate(table.keys) if keys[0] == ("10", "40", "160")[i]}
        marked = {table.keys[row][1] for row, _ in table.best if row in mine}
        # Without a mark: times that vary too much leave it open which filter is the best.
        assert best in marked if marked else "no significant difference" in note


def test_efficiency_is_made_of_the_runs(results):
    point = results.points()[2]
    runs = results.runs(point)
    f, d, e = (runs[key] for key in (("Exact", "rmse"), ("PF", "rmsd"), ("PF", "rmse")))
    term = Evaluator(results, point).term(measure("efficiency").of("PF"))
    assert term.value == pytest.approx(np.sqrt((f**2).sum() / (f**2 + d**2).sum()))
    left = [
        np.sqrt(np.delete(f**2, i).sum() / np.delete(f**2 + d**2, i).sum()) for i in range(len(f))
    ]
    jackknife = np.sqrt((len(f) - 1.0) ** 2 / len(f) * np.var(left, ddof=1))
    assert term.stderr == pytest.approx(jackknife, rel=0.1)  # the root by the delta method
    row = results.tables["efficiency"].keys.index(["PF (N = 40)"])
    cells = results.tables["efficiency"].cells[row]
    assert cells[0].estimate == term.estimate
    assert cells[1].estimate.value == pytest.approx(np.sqrt((f**2).sum() / (e**2).sum()))
    assert len(results.tables["efficiency"].keys) == 3 + 6 + 1  # each form once
    exact = Evaluator(results, point).term(measure("efficiency").of("Exact"))
    assert exact.estimate == (1.0, 0.0)
    half = without_each_batch(Evaluator(results, point).term(measure("efficiency").of("PF")), 2)
    assert [t.runs for t in half] == [30, 30]
    late = np.arange(60) >= 30
    assert half[0].value == pytest.approx(
        np.sqrt((f[late] ** 2).sum() / (f[late] ** 2 + d[late] ** 2).sum()),
        abs=0.3 * half[0].stderr,
    )


@pytest.mark.parametrize("runs", [1, 2, 3])
def test_few_runs_have_no_runs_saved(tmp_path, runs):
    text = f"name: few\nruns: {runs}\nscenario: {merwe_text(T=8)}\nreference: Exact\n"
    text += "filters: {UKF: {kind: ukf}, EKF: {kind: ekf}, Exact: {kind: grid, nodes: 40}}\n"
    table = ran(tmp_path, f"{text}tables: {{e: {{kind: efficiency}}}}\n").tables["e"]
    assert not table.notes
    for cells in table.cells:
        assert [table.text(cell) == "–" for cell in cells] == [False, False, True, False]


def test_it_comes_out_again_and_draws_from_the_folder_alone(results):
    assert verify(results.folder, 20) == []
    drawn = api.plot(results.folder, formats=("svg",))
    assert len(drawn) == 2
    text = (results.folder / "run" / "figures" / "cost.svg").read_text()
    for word in ("HDEPF (G = 3)", "Front", "Exact", "CPU time per step"):
        assert word in text
    told = results.parts("figures")["cost"].default_caption(results)
    assert re.search(r" On the front: (.+ with N = [\d, and]+|UKF)(; .+)*\.$", told)
    spent = results.timing.drop_duplicates(["filter", "cpu_s"])["cpu_s"].sum()
    assert results.manifest["cpu_s"] == pytest.approx(spent, abs=2e-3)  # what is shared counts once


MISTAKES = """
of: PF
of: FP
tables.equal.of: 'FP' is not a filter here; did you mean PF?

of: PF
of: UKF
tables.equal.of: N of UKF takes no value over the grid; two are needed

of: PF
of: PF, along: M
tables.equal.of: M of PF takes no value over the grid; two are needed

of: PF
of: PF, metric: median(nees)
tables.equal.metric: 'median(nees)' is no RMSE, distance or efficiency

cost: {kind: accuracy-vs-cost
cost: {kind: accuracy-vs-cost, filters: [UKF]
figures.cost.along: N of UKF takes no value over the grid; two are needed

[[10, 5], [40, 8], [160, 12]]
[9]
tables.equal.of: N of PF takes one value over the grid; two are needed

reference: Exact
#
tables.metrics.columns.E: 'efficiency' compares with the reference filter; name one under `reference`

[rmse, rmsd]
[rmse]
tables.metrics.columns.E: 'efficiency' needs rmsd, not stored; add to `metrics` what is missing

efficiency: {kind: efficiency
efficiency: {kind: efficiency, metric: mean(rmse)
tables.efficiency.metric: 'mean(rmse)' is no efficiency
"""
"""Words of the config, others in their place, the line."""


@pytest.mark.parametrize("mistake", MISTAKES.strip().split("\n\n"))
def test_what_is_mistaken_is_said_in_a_line(tmp_path: Path, mistake: str):
    old, new, line = mistake.splitlines()
    assert old in CONFIG
    (tmp_path / "c.yaml").write_text(CONFIG.replace(old, new, 1))
    with pytest.raises(UserError) as found:
        api.prepare(tmp_path / "c.yaml", api.Options())
    assert any(str(problem).endswith(line) for problem in found.value.problems), found.value


def test_without_a_grid(tmp_path: Path):
    a, b = CONFIG.index("grid:"), CONFIG.index("filters: {PF")
    (tmp_path / "c.yaml").write_text(CONFIG[:a] + CONFIG[b:])
    with pytest.raises(UserError) as found:
        api.prepare(tmp_path / "c.yaml", api.Options())
    lines = [str(problem).partition(": ")[2] for problem in found.value.problems]
    what = "there is no grid: give N of the filters several values"
    places = ("tables.equal", "tables.equally-near", "figures.cost", "figures.efficient")
    assert lines == [f"{place}: {what}" for place in places]


def test_without_times_or_steps(results, tmp_path: Path):
    import shutil

    folder = shutil.copytree(results.folder, tmp_path / "out")
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"steps": "many"}))
    again = "run the experiment again"
    with pytest.raises(UserError, match=rf"manifest.json: does not say how many steps.*{again}"):
        api.plot(folder, formats=("svg",))
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / "run" / "timing.csv").unlink()
    with pytest.raises(UserError, match=f"timing.csv.* missing: {again}"):
        api.plot(folder, formats=("svg",))


FAILS = '''
from dataclasses import dataclass
import numpy as np
from trackbench.core.distributions import Gaussian
from trackbench.registry import register

@register("filters", "sometimes-fails")
@dataclass(frozen=True, kw_only=True)
class Fails:
    """Raises."""

    N: int = 3
    """beyond this nothing works"""

    def init(self, model, prior, rng):
        if self.N > 4:
            raise RuntimeError("too many")
        return prior.sample(rng)

    def step(self, model, state, z, k, rng):
        return state

    def estimate(self, state):
        return Gaussian(state, np.ones((1, 1)))
'''


@pytest.mark.parametrize("sizes", ["[5, 6, 7]", "[3, 4, 7]"])
def test_a_filter_that_fails_at_some_of_its_sizes_or_all(tmp_path: Path, sizes: str):
    (tmp_path / "fails.py").write_text(FAILS)
    text = CONFIG.replace("{kind: pf, N: 9}", "{kind: sometimes-fails}").replace(
        "block: 15", "block: 3"
    )
    a, b = text.index("grid:"), text.index("filters: {PF")
    text = f"plugins: [fails.py]\n{text[:a]}grid: {{filters.PF.N: {sizes}}}\n{text[b:]}"
    text = text.replace("HDEPF: {kind: hdepf}, UKF: {kind: ukf},", "").replace("UKF", "PF")
    text = text.replace("runs: 60", "runs: 6")
    ran(tmp_path, text, formats=("svg",), allow_plugins=True)
    assert len(api.plot(tmp_path / "out", formats=("svg",))) == 2
    table = Results(tmp_path / "out").tables
    assert [keys[0] for keys in table["equal"].keys] == (["3", "4"] if "3" in sizes else [])


def test_lost_runs_are_counted_of_all_runs_beside_a_cpu_time(tmp_path: Path):
    """The block that is timed has more runs than the results, or fewer."""
    columns = "{Error: mean(rmse_position), Time: cpu_s_per_run}"
    for runs, block in ((7, 20), (20, 10)):
        (tmp_path / "lost.yaml").write_text(
            f"name: lost\nruns: {runs}\nblock: {block}\n{PLANE}"
            "filters:\n  KF: {kind: kf}\n"
            "  Far: {kind: kf, assume: {sensor: {kind: position, sigma: 900}}}\n"
            f"tables: {{t: {{kind: metrics, columns: {columns}}}}}\n"
        )
        options = api.Options(engine="serial", quiet=True, set=["scenario.score.lost_beyond=7"])
        api.run(tmp_path / "lost.yaml", options, out=tmp_path / "lost")
        lines = (tmp_path / "lost/run/tables/t.md").read_text().splitlines()
        counts = [line.split(" | ")[-1] for line in lines if line.startswith(("| KF", "| Far"))]
        assert counts[0].startswith(f"0 of {runs} (")
        assert f" of {runs} (" in counts[1]
        assert counts[1][0] != "0"
