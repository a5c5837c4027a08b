"""The page on other packages' filters says what benchmarks/audit/results.csv has."""

import re
from collections import defaultdict

from benchmarks.audit.__main__ import FOLDER, stored
from benchmarks.audit.judge import TOLERANCE
from tests.conftest import ROOT

PAGE = (ROOT / "docs" / "findings" / "audit.md").read_text(encoding="utf-8")
FAULTS = sorted((FOLDER / "faults").glob("*.py"))
WITHOUT_ROW = {"filterpy_cubature_shape", "kalbee_angles"}
"""Faults of a call and of a kind of problem that no adapter makes."""


def _is_bad(row: dict[str, str]) -> bool:
    off = max(float(row["mean_off"]), float(row["covariance_off"]))
    return int(row["bad"]) > 0 or not off <= TOLERANCE


def test_the_table_is_that_of_the_results() -> None:
    by_release: dict[tuple[str, str], list[dict[str, str]]] = defaultdict(list)
    for row in stored():
        by_release[row["package"], row["version"]].append(row)
    expected = []
    for (package, version), rows in by_release.items():
        bad = [row for row in rows if _is_bad(row)]
        shown = ", ".join(f"`{name}`" for name in sorted({row["shown by"] for row in bad}))
        good = len(rows) - len(bad)
        expected.append([package, version, str(len(rows)), str(good), shown])
    lines = re.findall(r"^\| (?!package)(.+) \|$", PAGE, re.MULTILINE)
    assert [[cell.strip() for cell in line.split("|")] for line in lines] == expected


def test_a_bad_filter_has_a_program_and_a_good_one_has_none() -> None:
    names = {fault.stem for fault in FAULTS}
    for row in stored():
        assert bool(row["shown by"]) == _is_bad(row), row
    shown = {row["shown by"] for row in stored()} - {""}
    assert shown | WITHOUT_ROW == names
    assert names == set(re.findall(r"`((?:filterpy|kalbee|nfoursid|norfair|pykalman)_\w+)`", PAGE))


def test_every_release_is_pinned() -> None:
    pinned = "\n".join(
        (FOLDER / name).read_text(encoding="utf-8") for name in ("requirements.txt", "releases.txt")
    )
    for row in stored():
        assert f"{row['package']}=={row['version']}\n" in pinned
