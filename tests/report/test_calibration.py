"""Rank histograms and reliability from a results folder, and what is said of keys that are mistaken."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt

from tests.commands import ran
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measure
from trackbench.report.figures.reliability import Reliability
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.kolmogorov_distance import kolmogorov, kolmogorov_band
from trackbench.verify.verify_folder import verify

CONFIG = """
name: calibrated
runs: 300
seed: 2
scenario:
  kind: tracking
  last: 8
  target: {kind: driven, motion: {kind: cwna, q: 1}}
  sensor: {kind: position, sigma: 5}
  start: {kind: gaussian, sigma: [10, 3, 10, 3]}
  score: {windows: [{name: late, first: 5}]}
reference: KF
filters:
  KF: {kind: kf}
  Sure: {kind: kf, assume: {sensor: {kind: position, sigma: 2}}}
  Cloud: {kind: enkf, N: 99}
metrics: [pit_px, pit_nees, coverage_90, likelihood_ratio]
per_step: [likelihood_ratio, coverage_90]
tables:
  ranks: {kind: calibration, rows: {X: pit_px, State: pit_nees@8, Late: "pit_nees[late]"}}
figures:
  ranks: {kind: calibration, columns: {X: pit_px, State: pit_nees@last}}
  one: {kind: reliability}
  all: {kind: reliability, metric: pit_px}
  late: {kind: reliability, metric: "pit_nees[late]"}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("calibration"), CONFIG).folder


def test_the_table_says_who_is_calibrated(folder: Path) -> None:
    table = Results(folder).tables["ranks"]
    assert table.keys[:3] == [["KF", "X"], ["KF", "State"], ["KF", "Late"]]
    found = {tuple(keys): cells for keys, cells in zip(table.keys, table.cells, strict=True)}
    values = Results(folder).runs({})["KF", "pit_nees@8"]
    assert found["KF", "State"][0].estimate.value == pytest.approx(kolmogorov(values))
    assert np.isnan(found["KF", "X"][1].estimate.value)  # steps are not independent
    assert found["Sure", "X"][2].estimate.value < 1e-6
    by = "by 12 tests, 0.01 for all of them (Holm)"
    assert table.notes[0].startswith(f"Not calibrated {by}: Sure in X, State and Late")
    assert "KF" in table.notes[1]


def test_only_what_is_asked_for_is_kept(folder: Path) -> None:
    metrics = {metric for _, metric in Results(folder).runs({})}
    assert {"pit_px", "rank_px_10", "rank_nees_1[late]", "pit_nees@8"} <= metrics
    heads = {re.split(r"[_[]", metric)[0] for metric in metrics}
    assert heads == {"lost", "pit", "rank", "coverage", "likelihood"}
    assert not any("vx" in m for m in metrics)


def test_it_comes_out_again(folder: Path) -> None:
    """A run's likelihood ratio is that of its last step, its coverage the mean over the steps."""
    assert verify(folder, runs=5) == []


def test_a_histogram_of_too_few_runs_has_no_p(tmp_path: Path) -> None:
    results = Results(ran(tmp_path, CONFIG.replace("runs: 300", "runs: 5")).folder)
    figure = results.parts("figures")["ranks"].draw(results)
    assert [ax.get_title() for ax in figure.axes[:2]] == ["X", "State"]
    assert not any("p" in ax.get_title() for ax in figure.axes)
    plt.close(figure)


def test_reliability_is_the_distribution_of_the_ranks(folder: Path) -> None:
    results = Results(folder)
    lines = _lines(Reliability(metric=measure("pit_nees@8")), results)
    values = results.runs({})["Sure", "pit_nees@8"]
    level, share = lines["Sure"]
    np.testing.assert_allclose(share, [(values <= p).mean() for p in level])
    level, share = lines["KF"]
    assert np.abs(share - level).max() < kolmogorov_band(300, 0.999)
    over = _lines(Reliability(metric=measure("pit_px")), results)
    level, share = over["KF"]
    np.testing.assert_allclose(level, np.arange(6) / 5)
    middle = sum(results.runs({})["KF", f"rank_px_{b}"].mean() for b in (4, 5, 6, 7))
    assert share[2] == pytest.approx(middle)


def _lines(figure: Reliability, results: Results) -> dict[str, Any]:
    drawn = figure.draw(results)
    found = {str(line.get_label()): line.get_data() for line in drawn.axes[0].lines}
    plt.close(drawn)
    return found


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("metrics: [pit_px, ", "metrics: [", ["tables.ranks.rows.X: 'pit_px' is not stored"]),
        ("X: pit_px, State: pit_nees@8", "X: pit_q", ["rows.X: 'pit_q' is no metric here"]),
        ("X: pit_px, State: pit_nees@8", "X: anees@3", ["rows.X: 'anees@3' is no PIT, such as"]),
        ("pit_nees@8", "pit_nees@9", ["tables.ranks.rows: pit_nees@9: the steps are 0 to 8"]),
        ("pit_nees@last", "pit_nees@1..last", ["columns.State: 'pit_nees@1..last' is no PIT"]),
        ("{kind: reliability}", "{kind: reliability, metric: pit_px@0..3}", ["is no PIT"]),
        ("{kind: reliability}", "{kind: reliability, metric: pit_px@10}", ["figures.one.metric"]),
        ("[pit_px,", "[pit_px, coverage_95,", ["did you mean coverage_9"]),
        (
            "reference: KF",
            "medians: [likelihood_ratio]",
            ["is relative to an exact filter; name one under"],
        ),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, said: list[str]) -> None:
    path = tmp_path / "c.yaml"
    assert old in CONFIG
    path.write_text(CONFIG.replace(old, new))
    with pytest.raises(UserError) as raised:
        load(path)
    lines = str(raised.value).splitlines()
    assert all(line.startswith(f"{path}:") for line in lines)
    for words in said:
        assert any(words in line for line in lines), lines
