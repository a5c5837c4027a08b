"""The quick suite leaves out tests that exist, and not too many."""

import ast

from tests.conftest import ROOT
from tests.slow import LIST, slow_tests


def _tests() -> set[str]:
    return {
        f"{path.relative_to(ROOT)}::{node.name}"
        for path in (ROOT / "tests").rglob("test_*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


def test_every_slow_test_exists() -> None:
    assert set(LIST.read_text(encoding="utf-8").split()) - _tests() == set()


def test_most_tests_are_quick() -> None:
    assert 3 * len(LIST.read_text(encoding="utf-8").split()) < 2 * len(_tests())


def test_a_tests_cases_count_together() -> None:
    report = [
        "0.15s call     tests/a.py::test_one[x]",
        "0.15s setup    tests/a.py::test_one[y]",
        "0.18s call     tests/a.py::test_two",
    ]
    assert slow_tests(report) == ["tests/a.py::test_one"]
