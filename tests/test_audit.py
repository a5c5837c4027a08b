"""The page on other packages' filters says what benchmarks/audit/results.csv has."""

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.audit import nonlinear
from benchmarks.audit.__main__ import FOLDER, stored
from benchmarks.audit.judge import TOLERANCE
from tests.conftest import ROOT, make_filter

PAGE = (ROOT / "docs" / "findings" / "audit.md").read_text(encoding="utf-8")
FAULTS = sorted((FOLDER / "faults").glob("*.py"))
REPORTS = {
    path.stem: path.read_text(encoding="utf-8") for path in (FOLDER / "reports").glob("*.md")
}
_PACKAGES = "bayesfilter|filterpy|kalbee|nfoursid|norfair|pykalman"
WITHOUT_ROW = {"filterpy_cubature_shape", "kalbee_angles"}
"""Faults of a call and of a kind of problem that no adapter makes."""


def _is_bad(row: dict[str, str]) -> bool:
    off = max(float(row["mean_off"]), float(row["covariance_off"]))
    nonlinear_off = float(row["nonlinear_off"] or 0.0)
    is_off = not off <= TOLERANCE or not nonlinear_off <= nonlinear.TOLERANCE
    return int(row["bad"]) > 0 or is_off


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
    assert names == set(re.findall(rf"`((?:{_PACKAGES})_\w+)`", PAGE))


def test_a_nonlinear_filter_is_judged_by_nonlinear_problems() -> None:
    names = re.compile("Extended|Unscented|Cubature|Iterated|UKF|CKF|unscented|extended")
    judged = {(row["package"], row["filter"]) for row in stored() if row["nonlinear_off"]}
    named = {(row["package"], row["filter"]) for row in stored() if names.search(row["filter"])}
    assert named
    assert named <= judged


class _PredictedJacobian(nonlinear.Extended):
    """The mistake of an EKF that moves its state first."""

    def steps(self, of: Any, x: Any, P: Any, z: Any) -> Iterator[nonlinear.State]:
        for row in z:
            x = of.f(x)
            P = of.F(x) @ P @ of.F(x).T + of.Q
            if not np.isnan(row).all():
                x, P = self.updated(of, x, P, row)
            yield x, P


def test_the_formulas_are_those_of_the_filters() -> None:
    """Filters of the package, whose code the formulas do not use, equal them; wrong ones do not."""
    for name in nonlinear.FORMULAS:
        for kind, rule in (("ekf", nonlinear.EXTENDED), ("ckf", nonlinear.CUBATURE)):
            assert nonlinear.off_the_formulas(make_filter(kind), rule, name) < 1e-10
        for wrong in (nonlinear.CUBATURE, _PredictedJacobian()):
            is_same = name == "nonlinear sensor" and isinstance(wrong, _PredictedJacobian)
            off = nonlinear.off_the_formulas(make_filter("ekf"), wrong, name)
            assert is_same == (off < nonlinear.TOLERANCE)


def test_reports_have_the_programs_of_the_faults() -> None:
    programs = {fault.read_text(encoding="utf-8").strip(): fault.stem for fault in FAULTS}
    reported = set()
    for text in REPORTS.values():
        for block in re.findall(r"```python\n(.*?)\n```", text, re.DOTALL):
            reported.add(programs[block])
    newest = {row["package"]: row["version"] for row in reversed(stored())}
    bad = [row for row in stored() if row["shown by"] and row["version"] == newest[row["package"]]]
    assert {row["package"] for row in bad} == {*REPORTS} - {"README"}
    assert {row["shown by"] for row in bad} <= reported


def test_every_release_is_pinned() -> None:
    pinned = "\n".join(
        (FOLDER / name).read_text(encoding="utf-8") for name in ("requirements.txt", "releases.txt")
    )
    for row in stored():
        assert f"{row['package']}=={row['version']}\n" in pinned
