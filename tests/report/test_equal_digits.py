"""Printed numbers of many digits, compared digit by digit."""

import csv
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import EXPERIMENT_FILES
from tests.report.forging import reseal
from trackbench import api
from trackbench.report.folder_check import open_results
from trackbench.report.folder_comparison.numbers_and_pairing import compare_folders
from trackbench.report.verdicts.all_verdicts import compare
from trackbench.report.verdicts.number_verdicts import FEWER_STORED

QUIET: dict[str, Any] = {"engine": "serial", "quiet": True, "formats": ()}
pytestmark = pytest.mark.usefixtures("no_report")


@pytest.mark.parametrize("name", ["car-track", "nile", "nile-diffuse", "nile-models", "pendulum"])
def test_equal_numbers_round_to_all_printed_digits(tmp_path: Path, name: str) -> None:
    """As an independent reading of per_run.csv says; a folder of seven digits does not show them."""
    folder = api.run(EXPERIMENT_FILES[name], out=tmp_path / "old", **QUIET).folder
    verdicts = compare(open_results(folder)).rows
    assert {row.verdict.word for row in verdicts} == {"equal"}
    with (folder / "per_run.csv").open() as file:
        values = list(csv.reader(file))[1:]
    for row in verdicts:
        printed, metric = row.published, str(row.published.expression)[len("mean(") : -1]
        found = [float(x) for *_, label, _, m, x in values if (label, m) == (row.label, metric)]
        rounded = {f"{printed.factor * x:.{printed.digits}f}" for x in found}
        assert f"{printed.value:.{printed.digits}f}" in rounded
    # The same folder as an older version wrote it, which is no other folder.
    shutil.copytree(folder, tmp_path / "new")
    path = folder / "per_run.csv"
    lines = [line.rpartition(",") for line in path.read_text().splitlines()]
    old = [f"{head},{float(x):.7g}" for head, _, x in lines[1:]]
    path.write_text("\n".join(["".join(lines[0]), *old, ""]))
    reseal(folder)
    for row in compare(open_results(folder)).rows:
        is_long = row.published.significant_digits > 7
        assert row.verdict.word == ("agrees" if is_long else "equal")
        assert (FEWER_STORED in row.note) == is_long
    rows, _ = compare_folders(open_results(folder), open_results(tmp_path / "new"))
    deterministic = open_results(folder).deterministic
    assert {row.verdict for row in rows if row.filter in deterministic} == {"equal"}
