"""Figure kinds: ranks and cliques by hand, every kind drawn, hostile labels, drawing one again."""

import numpy as np
import pytest

from trackbench import api
from trackbench.experiment.problems import UserError
from trackbench.report import style
from trackbench.report.figures.ranks import cliques, critical_difference, mean_ranks
from trackbench.report.results import Results


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


def test_a_dollar_or_a_long_label_is_only_text():
    assert style.words("a $x_$ b") == r"a \$x_\$ b"
    assert max(map(len, style.words("word " * 16).split("\n"))) <= 24
