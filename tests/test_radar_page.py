"""The page on sensors says what its experiments with a fault and with late measurements give."""

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
    errors, faults = _tables(tmp_path, monkeypatch, "fault.yaml", "errors", "faults")
    rmse = {label: cells["RMSE"] for label, cells in errors.items()}
    assert f"its RMSE is {rmse['KF']:.0f} m. With a gate it is {rmse['Gated']:.1f} m" in WORDS
    assert f"With `student-t` it is {rmse['Student']:.1f} m" in WORDS
    assert f"The filter that knows the fault has {rmse['Known']:.0f} m" in WORDS
    assert min(rmse, key=rmse.__getitem__) == "Gated"
    seconds = {label: f"{cells['Recovery']:.0f}" for label, cells in faults.items()}
    assert f"the plain filter needs {seconds['KF']} s to recover" in WORDS
    assert seconds["Gated"] == seconds["Student"]
    assert f"the gated one and `student-t` need {seconds['Gated']} s" in WORDS


def test_the_numbers_of_late_measurements_are_those_of_their_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (late,) = _tables(tmp_path, monkeypatch, "late.yaml", "late")
    rmse = {label: f"{cells['RMSE']:.1f}" for label, cells in late.items()}
    assert f"If late measurements are dropped, the RMSE is {rmse['Drop']} m" in WORDS
    assert f"(`Refilter`) has {rmse['Refilter']} m" in WORDS
    assert f"three steps already gives {rmse['Short memory']} m" in WORDS
    assert f"came on time, it would be {rmse['On time']} m" in WORDS
    assert f"This filter has {rmse['Apply']} m, and it is overconfident" in WORDS
    assert late["Apply"]["ANEES"] > 1.1


def _tables(
    folder: Path, monkeypatch: pytest.MonkeyPatch, config: str, *names: str
) -> list[dict[str, dict[str, float]]]:
    """Run a config of the page; return the numbers of tables by filter and column."""
    monkeypatch.chdir(folder)
    (text,) = (block.text for block in blocks(PAGE) if block.title == config)
    (folder / config).write_text(text)
    report = api.run(config, engine="serial", quiet=True, formats=(), set=["figures={}"])
    tables = []
    for name in names:
        lines = (report.folder / "tables" / f"{name}.md").read_text().splitlines()
        rows = [[cell.strip(" *") for cell in x.strip("|").split("|")] for x in lines if "|" in x]
        columns, _, *body = rows
        tables.append({row[0]: _numbers(columns, row) for row in body})
    return tables


def _numbers(columns: list[str], row: list[str]) -> dict[str, float]:
    """Return the value of each cell by its column; cells without a standard error are left out."""
    cells = dict(zip(columns[1:], row[1:], strict=True))
    return {name: float(cell.split(" ± ")[0]) for name, cell in cells.items() if " ± " in cell}
