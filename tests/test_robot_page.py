"""The page on robots says what comes out of its config."""

import re
from pathlib import Path

import pytest

from docs.site.blocks import blocks
from tests.commands import trackbench
from tests.conftest import ROOT
from trackbench import api
from trackbench.report.findings.ranking import rankings
from trackbench.report.findings.ranking_table import ranking_tables

PAGE = (ROOT / "docs" / "your-robot.md").read_text(encoding="utf-8")
PROSE = " ".join(PAGE.split())


def test_the_numbers_are_those_of_the_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "experiments").symlink_to(ROOT / "experiments")
    (text,) = (block.text for block in blocks(PAGE) if block.title == "robot.yaml")
    (tmp_path / "robot.yaml").write_text(text)
    report = api.run("robot.yaml", engine="serial", quiet=True, formats=())
    table = (report.folder / "tables" / "errors.md").read_text()
    section = PAGE.split("## 4. Check it, and run it")[1]
    assert _rows(table) == _rows(section)[: len(_rows(table))]
    errors = {row[0]: [float(cell) for cell in row[1:]] for row in _rows(table)[1:]}
    position = {label: values[0] for label, values in errors.items()}
    assert f"the EKF is off by {position['EKF']:.2f} m" in PROSE
    assert f"and the wheels alone by {position['Odometry']:.1f} m" in PROSE
    assert f"position is {position['Odometry'] / position['EKF']:.0f} times as accurate" in PROSE
    assert f"the EKF has {errors['EKF'][2]:.2f}" in PROSE
    # The UKF and the particle filter are no better, and the ranking is by the position.
    (ranking,) = rankings(report.results)
    assert ranking.metric.metric == "rmse_position"
    assert min(position, key=position.__getitem__) == "EKF"


def test_the_tables_of_topics_need_the_two_commands_that_the_page_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    section = PAGE.split("## A file for each topic")[1].split("## 1.")[0]
    (block,) = (block for block in blocks(section) if block.commands)
    new, _ = block.commands
    monkeypatch.chdir(tmp_path)
    (tmp_path / "experiments").symlink_to(ROOT / "experiments")
    done = trackbench(*new.split()[1:], cwd=tmp_path)
    assert done.stdout in block.text
    report = api.run("topics.yaml", engine="serial", quiet=True, formats=())
    table = (report.folder / "tables" / "errors.md").read_text()
    rows = _rows(table)
    known = _rows(section)
    begin = known.index(rows[0])
    assert known[begin : begin + len(rows)] == rows


def test_exchanged_tags_lead_to_the_note_that_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "experiments").symlink_to(ROOT / "experiments")
    (text,) = (block.text for block in blocks(PAGE) if block.title == "robot.yaml")
    (added,) = re.findall(r"filters:\n(  EKF with gate: .*\n)", PAGE)
    # Without the truth and what needs it, with one filter and the gate of the page.
    text = re.sub(r"    truth.*\n", "", text).partition("filters:")[0]
    text += f"filters:\n  EKF: {{kind: ekf}}\n{added}tables: {{}}\nfigures: {{}}\n"
    Path("robot.yaml").write_text(text.replace("plant, desk", "desk, plant"))
    report = api.run("robot.yaml", engine="serial", quiet=True, formats=())
    (table,) = ranking_tables(report.results)
    (note,) = (note for note in table.notes if note.startswith("The gate of"))
    (shown,) = re.findall(r"\nThe gate of .*\n", PAGE)
    assert note.startswith(shown.strip())


@pytest.mark.parametrize("has_gate", [False, True])
def test_a_landmark_off_by_two_meters_is_named_by_the_gate_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_gate: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "experiments").symlink_to(ROOT / "experiments")
    (text,) = (block.text for block in blocks(PAGE) if block.title == "robot.yaml")
    (added,) = re.findall(r"filters:\n(  EKF with gate: .*\n)", PAGE)
    (place,) = re.findall(r"write `(\[.*?\])` as the place of `desk`", PROSE)
    assert "at: [3.5, -9.5]" in text
    text = re.sub(r"    truth.*\n", "", text).replace("at: [3.5, -9.5]", f"at: {place}")
    text = text.partition("tables:")[0] + added * has_gate + "tables: {}\nfigures: {}\n"
    Path("robot.yaml").write_text(text)
    report = api.run("robot.yaml", engine="serial", quiet=True, formats=())
    (table,) = ranking_tables(report.results)
    named = [note for note in table.notes if "desk" in note or "landmark" in note]
    assert len(named) == has_gate
    assert all("most measurements of sensor 4 (desk) (100 %), and" in note for note in named)


def test_the_log_begins_as_the_page_shows() -> None:
    log = (ROOT / "experiments" / "data" / "robot-log.csv").read_text().splitlines()[:6]
    assert "\n".join(f"    {line}" for line in log) in PAGE


def _rows(text: str) -> list[list[str]]:
    """The cells of the rows of a page's tables, without the lines below headings."""
    lines = (line for line in text.splitlines() if line.startswith("| "))
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in rows if not re.fullmatch(r"[-: ]+", row[0])]
