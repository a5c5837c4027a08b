"""Tables on a terminal: whole numbers in each row, every column once, best values marked."""

import re

import pytest

from trackbench.cli import screen
from trackbench.report.table import Text, TextTable


def _shown(table: TextTable, width: int) -> list[str]:
    console = screen.Console(highlight=False, width=width, color_system=None)
    with console.capture() as captured:
        screen._show(table, console)
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
    assert "* best, or not significantly worse" in lines
    assert lines[0] == "Title"
    assert lines[-1] == "a note"


def test_signs_of_a_column_stand_below_each_other() -> None:
    first, second = (line for line in _shown(_wide(1), 80) if "±" in line)
    assert first.index("±") == second.index("±")


def test_a_table_without_rows_is_its_head() -> None:
    assert any("Filter" in line for line in _shown(TextTable("", ["Filter"]), 80))
