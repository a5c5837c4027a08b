"""The page on sensors says what its experiments with a fault and with late measurements give."""

import csv
from pathlib import Path

import pytest

from docs.site.blocks import blocks
from tests.conftest import ROOT
from trackbench import api

PAGE = (ROOT / "docs" / "your-radar.md").read_text(encoding="utf-8")
WORDS = " ".join(PAGE.split())


def test_the_numbers_of_the_fault_are_those_of_its_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (errors,) = _tables(tmp_path, monkeypatch, "fault.yaml", "errors")
    for label, cells in errors.items():
        assert f"| {' | '.join(['Filter', *cells])} |" in PAGE
        assert f"| {' | '.join([label, *cells.values()])} |" in PAGE
    rmse = {label: _value(cells["RMSE (m)"]) for label, cells in errors.items()}
    assert sorted(rmse, key=rmse.__getitem__)[:2] == ["Gated", "Student"]
    larger = 100 * (rmse["Student"] / rmse["Gated"] - 1)
    assert f"That of `student-t` is {larger:.0f} % larger" in WORDS


def test_the_numbers_of_late_measurements_are_those_of_their_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (late,) = _tables(tmp_path, monkeypatch, "late.yaml", "late")
    for label, cells in late.items():
        assert f"| {label} | {cells['RMSE']} | {cells['ANEES']} |" in PAGE
    rmse = {label: _value(cells["RMSE"]) for label, cells in late.items()}
    assert max(rmse, key=rmse.__getitem__) == "Apply"
    larger = 100 * (rmse["Short memory"] / rmse["Refilter"] - 1)
    assert f"`Short memory` is only {larger:.0f} % larger than that of `Refilter`" in WORDS


def test_the_advice_on_outliers_is_that_of_the_stored_burst() -> None:
    with (ROOT / "results" / "fault-burst" / "summary.csv").open(encoding="utf-8") as file:
        rows = [*csv.DictReader(file)]
    remedies = {"Gate 0.999", "Student-t", "IMM", "Huber"}

    def values(share: str, metric: str) -> dict[str, float]:
        return {
            row["filter"]: float(row["value"])
            for row in rows
            if row["scenario.faults.0.share"] == share and row["metric"] == metric
        }

    half = values("0.5", "mean(rmse_position)")
    assert {*sorted(remedies, key=half.__getitem__)[:2]} == {"Gate 0.999", "Student-t"}
    gate, student = (f"{half[label]:.1f} m" for label in ("Gate 0.999", "Student-t"))
    assert f"{gate} with a gate and {student} with `student-t`" in WORDS
    whole = values("1", "mean(rmse_position)")
    assert min(remedies, key=whole.__getitem__) == "IMM"
    assert 0.2 < values("1", "mean(not_recovered[burst])")["Gate 0.999"] < 0.3
    before = values("1", "mean(rmse_position[before])")
    assert f"EKF is {before['EKF']:.1f} m. With `huber` it is {before['Huber']:.1f} m" in WORDS
    assert f"with `student-t` it is {before['Student-t']:.1f} m" in WORDS


def _tables(
    folder: Path, monkeypatch: pytest.MonkeyPatch, config: str, *names: str
) -> list[dict[str, dict[str, str]]]:
    """Run a config of the page; return the cells of tables by filter and column."""
    monkeypatch.chdir(folder)
    (text,) = (block.text for block in blocks(PAGE) if block.title == config)
    (folder / config).write_text(text)
    report = api.run(config, engine="serial", quiet=True, formats=(), set=["figures={}"])
    tables = []
    for name in names:
        lines = (report.folder / "tables" / f"{name}.md").read_text().splitlines()
        rows = [[cell.strip(" *") for cell in x.strip("|").split("|")] for x in lines if "|" in x]
        columns, _, *body = rows
        tables.append({row[0]: dict(zip(columns[1:], row[1:], strict=True)) for row in body})
    return tables


def _value(cell: str) -> float:
    """Return the number before the standard error."""
    return float(cell.split(" ± ")[0])
