"""Figure kinds: ranks and cliques by hand, every kind drawn, hostile labels, drawing one again."""

import numpy as np
import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.evaluation.measure import measure
from trackbench.experiment.problems import UserError
from trackbench.report import style
from trackbench.report.expressions import Expressions
from trackbench.report.figures.bars import Bars
from trackbench.report.figures.ranks import cliques, critical_difference, mean_ranks
from trackbench.report.results import Results
from trackbench.report.terms import Term

GRID = """
name: g
runs: 4
scenario: MERWE
filters: {PF: {kind: pf, N: 5}}
grid: {scenario.sensor.R: [1, 2]}
published: [n.csv]
""".replace("MERWE", merwe_text(T=5))


def test_mean_ranks_share_ties_and_put_lost_runs_last():
    values = np.array([[1.0, 1.0, np.nan], [2.0, 1.0, 5.0], [3.0, 4.0, 6.0]])
    np.testing.assert_allclose(mean_ranks(values), [(1 + 1.5 + 3) / 3, (2 + 1.5 + 1) / 3, 8 / 3])


def test_critical_difference_of_the_source():
    # Demsar 2006, section 3.3: 4 classifiers on 14 data sets at 0.05: 2.569 sqrt(4 * 5 / (6 * 14))
    assert critical_difference(4, 14, 0.05) == pytest.approx(1.25, abs=0.005)


def test_cliques_are_the_largest_groups():
    assert cliques(np.array([3.0, 1.0, 1.5, 2.2]), 0.8) == [(1.0, 1.5), (1.5, 2.2), (2.2, 3.0)]
    assert cliques(np.array([1.0, 1.5, 1.6]), 2.0) == [(1.0, 1.6)]
    assert cliques(np.array([1.0, 2.0]), 0.5) == []


def test_every_kind_is_drawn_and_the_same_twice(folder):
    before = {p.name: p.read_bytes() for p in (folder / "figures").iterdir()}
    assert sorted(before) == [
        *("bars.svg", "estimates.svg", "pairs.svg", "ranks.svg", "runs.svg", "time.svg")
    ]
    api.plot(folder, ["svg"])
    assert {p.name: p.read_bytes() for p in (folder / "figures").iterdir()} == before


def test_only_draws_a_figure_by_name_or_by_kind(folder):
    assert [p.name for p in api.plot(folder, ["svg"], ["time"])] == ["time.svg"]
    assert [p.name for p in api.plot(folder, ["svg"], ["rmse-vs-time"])] == ["time.svg"]
    with pytest.raises(UserError, match="did you mean bars"):
        api.plot(folder, ["svg"], ["barz"])


def test_floor_and_baseline_have_a_look_of_their_own(made):
    spec = Results(made).parts("figures")["time"]
    looks = dict(spec.labels(Results(made)))
    assert looks["Exact"] == style.FLOOR
    assert looks["No data"] == style.BASELINE
    assert looks["PF"] == style.line(0)


@pytest.mark.parametrize(("level", "deviations"), [(0.6827, 1.0), (0.9545, 2.0), (0.9973, 3.0)])
def test_the_interval_of_an_expression_has_its_level(made, level, deviations):
    expressions = Expressions(Results(made), {})
    term = expressions.term(measure("rmse@5").of("PF"))
    value, low, high = Bars(metric=measure("rmse@5"), level=level)._value(expressions, "PF")
    assert value == term.value
    assert (low, high) == term.interval(level)
    plain = Term(1.0, 0.1, None, 400).interval(level)  # as of rmse@5 where no run has a share
    assert plain == pytest.approx((1.0 - 0.1 * deviations, 1.0 + 0.1 * deviations), rel=1e-4)


def test_a_published_number_stands_at_its_point(tmp_path):
    (tmp_path / "c.yaml").write_text(GRID)
    (tmp_path / "n.csv").write_text(
        "paper,table,filter,metric,value,label,expression,point\n"
        "p,t,f,m,1.5,PF,mean(rmse),scenario.sensor.R=2\n"
        "p,t,f,m,2.5,PF,mean(rmse),scenario.sensor.R=3\n"
        "p,t,f,m,3.5,PF,mean(rmse),\n"
    )
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "o", formats=())
    results = api.run(tmp_path / "c.yaml", options).results
    figure = Bars().draw(results)
    shown = [
        [line.get_xdata()[0] for line in ax.lines if line.get_label() == "Published"]
        for ax in figure.axes
    ]
    assert shown == [[3.5], [1.5]]
    style.close(figure)


def test_a_point_in_words():
    point = {"scenario.sensor.R": 0.1, "filters.A.q & filters.B.r": "low", "filters.A.fast": True}
    assert style.heading(point) == "R = 0.1, q = low, fast = True"


def test_a_dollar_or_a_long_label_is_only_text():
    assert style.words("a $x_$ b") == r"a \$x_\$ b"
    assert max(map(len, style.words("word " * 16).split("\n"))) <= 24
