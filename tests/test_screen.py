"""Tables on a terminal: whole numbers in each row, every column once, best values marked."""

import re

import pytest

from trackbench.cli import terminal_tables
from trackbench.report.markdown_table import Text, TextTable


def _shown(table: TextTable, width: int) -> list[str]:
    console = terminal_tables.Console(highlight=False, width=width, color_system=None)
    with console.capture() as captured:
        terminal_tables._print_table(table, console)
    return captured.get().splitlines()


def _wide(columns: int) -> TextTable:
    heads = ["Filter", *(f"Column {i}" for i in range(columns))]
    rows = [
        [Text(name), *(Text(f"{i}.25 ± 0.{r}1", i + r, best=r == 0) for i in range(columns))]
        for r, name in enumerate(("EKF", "a < b & c"))
    ]
    return TextTable("Title", heads, rows, ["a note"])


@pytest.mark.parametrize("width", [40, 80, 200])
def test_columns_without_room_follow_below(width: int) -> None:
    lines = _shown(_wide(12), width)
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    for i in range(12):
        assert len(re.findall(rf"\*{i}\.25 ± 0\.01", text)) == 1
        assert len(re.findall(rf" {i}\.25 ± 0\.11", text)) == 1
    # Each part names its rows, as they are written.
    parts = sum(line.startswith("Filter") for line in lines)
    assert parts == sum(line.startswith("a < b & c") for line in lines)
    assert (parts == 1) == (width == 200)
    words = re.sub(r"\s+", " ", text)
    assert (
        "* the best, and what is not significantly worse and with 95 % confidence near it" in words
    )
    assert "Where no * stands, the runs decide nothing." in words
    assert lines[0] == "Title"
    assert lines[-2:] == ["a note", ""]


@pytest.mark.parametrize(("width", "whole"), [(90, True), (60, True), (45, False), (20, False)])
def test_words_are_wrapped_before_ratios_and_both_before_columns_move(
    width: int, whole: bool
) -> None:
    ratio, words = "2.4 x (2.1 to 2.8) n.s.", "collapsed in 3 of 40 runs"
    row = [Text("A filter"), Text("0.5", 0.5), Text(ratio), Text(words)]
    lines = _shown(TextTable("", ["Filter", "RMSE", "Ratio to the best", "ANEES"], [row]), width)
    assert max(map(len, lines)) <= width
    assert any(ratio in line for line in lines) == whole
    assert any(words in line for line in lines) == (width == 90)
    assert sum("Filter" in line for line in lines) == (1 if width > 20 else 3)


def test_signs_of_a_column_stand_below_each_other() -> None:
    first, second = (line for line in _shown(_wide(1), 80) if "±" in line)
    assert first.index("±") == second.index("±")


def test_a_table_without_rows_is_its_head() -> None:
    assert any("Filter" in line for line in _shown(TextTable("", ["Filter"]), 80))


@pytest.mark.parametrize("label", ["KF", "A-filter-of-a-name-that-has-no-space"])
def test_no_heading_and_no_name_is_cut(label: str) -> None:
    path = "scenario.target.settled_error"
    numbers = [Text(f"{i}.25 ± 0.01", i) for i in range(8)]
    heads = [path, "Filter", *(f"Column {i}" for i in range(8))]
    lines = _shown(TextTable("", heads, [[Text("30"), Text(label), *numbers]]), 60)
    assert max(map(len, lines)) <= 60
    assert "".join(line.split()[0] for line in lines[:3]) == path
    text = "".join(lines)
    assert "settled_error" in text
    assert label[-5:] in text
    assert "…" not in text
