"""Verdicts on CPU times: the rule by hand-made times, and that they touch no other verdict."""

import csv
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.commands import measured_or_cached_cpu_times as cpu_times
from trackbench.config.published_numbers_and_claims import Claim, Published, PublishedNumber
from trackbench.evaluation import measure_cpu_times as timing
from trackbench.evaluation.metric_expression import measure
from trackbench.report.overview.index_page import write_overview
from trackbench.report.verdicts.cpu_time_verdicts import time_verdicts
from trackbench.report.verdicts.verdict_files import write_time_verdicts
from trackbench.report.verdicts.verdict_tables import time_tables
from trackbench.results.file_names import TIME_VERDICTS, TIMING
from trackbench.results.rows_and_columns import Columns
from trackbench.verify.verify_folder import verify

REPEATS = 30
TIME = measure("cpu_s_per_run")


@dataclass
class Folder:
    """What the verdicts read of a results folder: repeats of seconds by filter."""

    repeats: dict[str, list[float]]
    published: Published
    target: Path = field(default_factory=Path)

    def points(self) -> list[dict[str, Any]]:
        return [{}]

    def columns(self, name: str, point: dict[str, Any]) -> Any:
        assert name == "timing"
        rows = [(b, ";".join(map(str, s)), "10", "-") for b, s in self.repeats.items()]
        columns = np.array(rows, dtype=object).reshape(-1, 4).T
        names = ("filter", "repeats", "likelihoods", "covariances")
        return Columns(dict(zip(names, columns, strict=True)))


def scattered(median: float, rng: np.random.Generator) -> list[float]:
    return (median * rng.lognormal(0.0, 0.05, REPEATS)).tolist()


def verdict(ratio: float, row: Any, more: dict[str, float] | None = None) -> Any:
    rng = np.random.default_rng(5)
    levels = {"A": 1e-3 * ratio, "B": 1e-3} | (more or {})
    repeats = {label: scattered(level, rng) for label, level in levels.items()}
    of_claim = isinstance(row, Claim)
    published = Published([] if of_claim else [row], [row] if of_claim else [])
    (found,) = time_verdicts(Folder(repeats, published))  # type: ignore[arg-type]
    return found


def claim(relation: Any, factor: float = 1.0, **keys: Any) -> Claim:
    given = {"left": "A", "expression": TIME, "right": "B"} | keys
    return Claim(paper="p", claim="c", relation=relation, factor=factor, **given)


def number(value: float, text: str = "ratio(cpu_s_per_run, B)", **keys: Any) -> PublishedNumber:
    given = {"paper": "p", "table": "t", "filter": "A", "metric": "m", "label": "A"} | keys
    return PublishedNumber(value=value, expression=measure(text), **given)


@pytest.mark.parametrize(
    ("ratio", "row", "word"),
    [
        (0.40, claim("<"), "holds"),
        (0.60, claim("<"), "inconclusive"),
        (1.90, claim("<"), "inconclusive"),
        (2.20, claim("<"), "fails"),
        (2.20, claim(">"), "holds"),
        (1.90, claim(">"), "inconclusive"),
        (0.40, claim(">"), "fails"),
        (2.20, claim("<", 1.1), "inconclusive"),  # 2 times within 10 %
        (2.60, claim("<", 1.1), "fails"),
        (1.00, claim("~", tolerance=0.25), "inconclusive"),  # no ratio is known that well
        (3.00, claim("~", tolerance=0.25), "fails"),
        (0.30, claim("~", tolerance=0.25), "fails"),
        (1.00, claim("~", tolerance=5.0), "holds"),
        (2.20, claim("<", right="", expression=measure("ratio(cpu_s_per_run, B)")), "fails"),
        (2.20, claim("<", right="B;C"), "fails"),  # C is not there, but B is enough
        (0.40, claim("<", right="B;C"), "not measured"),
        (2.20, claim("<", expression=measure("minus(cpu_s_per_run, B)")), "inconclusive"),
        (3.00, number(1.6), "compatible"),
        (3.00, number(1.3), "differs"),
        (3.00, number(5.5), "compatible"),
        (3.00, number(7.0), "differs"),
        (3.00, number(7.0, chosen="the machine"), "inconclusive"),
        (0.25, number(70.0, "gain(cpu_s_per_run, B)"), "compatible"),  # 0.3
        (0.25, number(10.0, "gain(cpu_s_per_run, B)"), "differs"),  # 0.9
        (3.00, number(0.002, "cpu_s_per_run"), "compatible"),  # s
        (3.00, number(0.2, "cpu_s_per_run"), "differs"),
        (3.00, number(3.0, label="none"), "not measured"),
        (3.00, number(3.0, label=""), "not measured"),  # no filter here, but one to divide by
    ],
)
def test_the_rule(ratio: float, row: Any, word: str) -> None:
    found = verdict(ratio, row)
    assert found.word == word
    if not np.isnan(found.measured) and row.expression != measure("cpu_s_per_run"):
        assert found.measured == pytest.approx(ratio, rel=0.05)
        assert found.low < found.measured < found.high


def test_a_claim_against_several_is_that_against_the_weakest() -> None:
    found = verdict(2.5, claim(">", right="B;C"), {"C": 2e-3})
    assert (found.word, found.filters) == ("inconclusive", "A / C")
    assert verdict(5.0, claim(">", right="B;C"), {"C": 2e-3}).word == "holds"
    assert verdict(2.5, claim(">", right="B;C"), {"C": 1e-2}).word == "fails"


def test_a_folder_of_an_older_version_has_no_verdicts_on_times() -> None:
    folder = Folder({"A": [], "B": []}, Published([], [claim("<")]))
    (found,) = time_verdicts(folder)  # type: ignore[arg-type]
    assert found.word == "not measured"
    (table,) = time_tables([found])
    (row,) = table.rows
    assert row[table.heads.index("95 %")].text == "–"


def test_tables_say_where_the_ratio_has_to_be() -> None:
    (table,) = time_tables([verdict(3.0, claim("<", 1.1)), verdict(3.0, claim(">"))])
    assert table.title == "CPU times, on this machine"
    assert [row[5].text for row in table.rows] == ["< 1.1", "> 1"]
    assert "A 10 likelihoods, - covariances" in table.rows[0][6].text
    assert verdict(3.0, claim(">")).wanted == (1.0, inf)
    assert time_tables([]) == []


CONFIG = """
name: timed
seed: 7
runs: 40
scenario: MERWE
published: [numbers.csv, claims.csv]
filters:
  PF: {kind: pf, N: 10}
  HDEPF: {kind: hdepf, N: 10}
""".replace("MERWE", merwe_text(T=12, switch=6))
NUMBERS = """paper,table,filter,metric,value,digits,experiment,label,expression
p,Table 1,PF,Mean,0.5,2,timed,PF,mean(rmse)
p,Table 1,HDEPF,Time,2,0,timed,HDEPF,"ratio(cpu_s_per_run, PF)"
"""
CLAIMS = """paper,claim,experiment,left,expression,relation,factor,right
p,HDEPF is better,timed,HDEPF,mean(rmse),<,1,PF
p,HDEPF is dearer,timed,HDEPF,cpu_s_per_run,>,1,PF
"""


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(timing, "REPEATS", 9)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "numbers.csv").write_text(NUMBERS)
    (tmp_path / "claims.csv").write_text(CLAIMS)
    path = tmp_path / "timed.yaml"
    path.write_text(CONFIG)
    return path


def run(config: Path, **keys: Any) -> Path:
    options = {"engine": "serial", "quiet": True, "formats": ()} | keys
    out = config.parent / "results" / "timed"
    return api.run(config, api.Options(out=out, **options)).folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_times_touch_no_other_verdict(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = run(config)
    words = {row["statement"]: row["verdict"] for row in rows(folder / TIME_VERDICTS)}
    assert words == {"HDEPF: Time": "differs", "HDEPF is dearer": "holds"}
    assert [row["claim"] for row in rows(folder / "claims.csv")] == ["HDEPF is better"]
    assert [row["metric"] for row in rows(folder / "comparison.csv")] == ["Mean"]
    others = ("comparison.csv", "comparison.md", "claims.csv", "summary.csv", "per_run.csv")
    before = {name: (folder / name).read_bytes() for name in others}
    measured = cpu_times.measure

    def faster(tasks: Any, guard: Any, tick: Any) -> Any:
        """HDEPF is the second."""
        pf, hdepf = measured(tasks, guard, tick)
        return [pf, hdepf._replace(seconds=[1e-3 * s for s in hdepf.seconds])]

    monkeypatch.setattr(cpu_times, "measure", faster)
    run(config, fresh=True)
    assert {name: (folder / name).read_bytes() for name in others} == before
    words = {row["statement"]: row["verdict"] for row in rows(folder / TIME_VERDICTS)}
    assert words["HDEPF is dearer"] == "fails"


def test_times_stand_in_reports_and_not_in_the_ledger(config: Path) -> None:
    folder = run(config)
    page = (folder / "report.html").read_text()
    assert "CPU times, on this machine" in page
    write_overview(folder.parent)
    index = (folder.parent / "index.html").read_text()
    ledger = (folder.parent / "README.md").read_text()
    assert "HDEPF is dearer" in index
    assert "HDEPF is dearer" not in ledger
    assert "1 claim" in ledger
    assert "2 claims" not in ledger


def test_stored_times_are_not_measured_again_by_verify(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = run(config)
    monkeypatch.setattr(cpu_times, "measure", None)
    assert verify(folder, 5) == []


def test_measured_times_are_kept_until_code_machine_or_filters_change(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[int] = []
    measured = cpu_times.measure

    def counted(tasks: Any, guard: Any, tick: Any) -> Any:
        taken.append(len(tasks))
        return measured(tasks, guard, tick)

    monkeypatch.setattr(cpu_times, "measure", counted)
    first = (run(config) / TIMING).read_text()
    assert (run(config) / TIMING).read_text() == first
    run(config, runs=20)
    assert taken == [2]
    run(config, set=["filters.PF.N=20"])
    monkeypatch.setattr(cpu_times.platform, "node", lambda: "another machine")
    run(config)
    run(config, fresh=True)
    run(config, times=False)
    assert taken == [2, 2, 2, 2]
    for kept in (config.parent / "cache" / "times").iterdir():
        kept.write_text(kept.read_text()[:-20])
    run(config)
    assert taken == [2, 2, 2, 2, 2]


def test_nothing_is_measured_where_nothing_names_times(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cpu_times, "measure", None)
    folder = run(config, set=["published=[]"])
    assert not (folder / TIME_VERDICTS).exists()
    assert [row["repeats"] for row in rows(folder / TIMING)] == ["", ""]


@pytest.mark.parametrize(
    "asked",
    [
        "tables={t: {kind: metrics, columns: {Time: cpu_s_per_run}}}",
        "tables={t: {kind: metrics, columns: {Time: 'ratio(cpu_s_per_run, PF)'}}}",
        "figures={f: {kind: accuracy-vs-cost}}",
        "tables={t: {kind: equal-cost, of: PF}}",
    ],
)
def test_tables_and_figures_that_name_times_have_them(config: Path, asked: str) -> None:
    folder = run(config, set=["published=[]", asked, "grid={filters.PF.N: [10, 20]}"])
    assert all(row["repeats"].count(";") == 8 for row in rows(folder / TIMING))


def test_a_filter_that_fails_when_it_is_timed_has_no_times(
    config: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    measured = timing.operations

    def failing(task: Any) -> Any:
        if task.filter.kind == "hdepf":
            raise SystemExit(3)
        return measured(task)

    monkeypatch.setattr(timing, "operations", failing)
    folder = run(config, quiet=False)
    assert "HDEPF has no measured CPU time" in capsys.readouterr().err
    times = {row["filter"]: row["repeats"] for row in rows(folder / TIMING)}
    assert times["HDEPF"] == ""
    assert times["PF"].count(";") == 8
    assert {row["verdict"] for row in rows(folder / TIME_VERDICTS)} == {"not measured"}
    assert len(rows(folder / "claims.csv")) == 1


def test_an_old_file_goes_when_nothing_is_published_about_times(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / TIME_VERDICTS).write_text("old")
    write_time_verdicts(Folder({}, Published([], []), tmp_path))  # type: ignore[arg-type]
    assert not (tmp_path / TIME_VERDICTS).exists()
