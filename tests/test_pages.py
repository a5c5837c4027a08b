"""What stands on the pages is so: commands run, configs are good, programs run, links lead somewhere."""

import csv
import re
from pathlib import Path

import pytest

import trackbench
from docs.site.blocks import blocks, fenced
from docs.site.pages import PAGES
from tests.conftest import ROOT, plugins_forgotten
from tests.pages import BARE, TURN, Sandbox, quickly
from trackbench.yaml_source import parse

PLACES = [
    "README.md",
    "CONTRIBUTING.md",
    *(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md")),
]
_LINK = re.compile(r"\]\(([^)\s]+)(?:\s+\"[^\"]*\")?\)")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results that the pages speak of."""
    folder = tmp_path_factory.mktemp("stored")
    with quickly():
        trackbench.run("hdepf", quiet=True, out=folder / "hdepf")
    with quickly(*BARE):
        trackbench.run("merwe2000", quiet=True, out=folder / "merwe2000")
        trackbench.run(parse(TURN, "turn.yaml").data, quiet=True, out=folder / "turn")
    return folder


@pytest.mark.parametrize("place", [p for p in sorted(PLACES) if p != "docs/tutorial.md"])
def test_a_page_can_be_followed(
    place: str, stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    sandbox = Sandbox(tmp_path, stored, (ROOT / place).read_text(encoding="utf-8"))
    with plugins_forgotten():  # two pages may write a filter of one name
        for block in sandbox.blocks:
            try:
                sandbox.follow(block)
            except Exception as error:
                pytest.fail(f"{place}:{block.first + 1}: {type(error).__name__}: {error}")


def test_the_tutorial_says_what_comes_out(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With as many runs as it says, where it shows what comes out."""
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    sandbox = Sandbox(tmp_path, stored, page)
    tables, rankings = [], []
    for block in sandbox.blocks:
        if "run turn.yaml\n" in block.text:
            report = trackbench.run("turn.yaml", engine="serial", quiet=True, set=BARE)
            rankings.append(_rows(report.ranking()[0].markdown()))
            tables += _rows((tmp_path / "results" / "turn" / "tables" / "errors.md").read_text())
        else:
            sandbox.follow(block)
    verdicts = _rows((tmp_path / "results" / "turn" / "comparison.md").read_text())
    assert [" fragile;" in f" {row[5]}" for row in verdicts[2:]] == [True, False]
    trackbench.run("turn.yaml", runs=400, engine="serial", quiet=True, set=BARE, out="more")
    more = _rows((tmp_path / "more" / "comparison.md").read_text())
    assert [row[:2] for row in more] == [row[:2] for row in verdicts]
    assert not any("fragile" in cell for row in more for cell in row)
    pairs = csv.DictReader((tmp_path / "results" / "turn" / "paired.csv").read_text().splitlines())
    (pair,) = [
        row
        for row in pairs
        if (row["filter_a"], row["filter_b"]) == ("EKF (tuned)", "IMM")
        and row["metric"] == "rms(rmse_position)"
    ]
    difference, stderr, z = (float(pair[key]) for key in ("difference", "stderr", "z"))
    words = " ".join(page.split())
    steps = (tmp_path / "results" / "turn" / "per_step.csv").read_text().splitlines()
    errors = {
        (row["filter"], float(row["time"])): float(row["value"])
        for row in csv.DictReader(steps)
        if row["metric"] == "rmse_position"
    }
    assert f"grow to {10 * round(max(errors.values()) / 10)} m" in words
    # After another 30 s they are as small as the IMM's error. The turn ends at 100 s.
    assert errors["EKF", 130.0] < 1.02 * errors["IMM", 130.0]
    assert f"the tuned EKF's error is {difference:.2f} ± {stderr:.2f} m larger" in words
    assert f"from {difference / stderr:.0f} to {z:.1f}" in words
    shown = _rows(page)
    assert [row for row in shown if len(row) == 4] == [row for row in tables if len(row) == 4]
    # The last column is the CPU time of a machine.
    assert [row[:4] for row in shown if len(row) == 5] == [row[:4] for row in rankings[0]]
    assert [row for row in shown if len(row) == 3] == [row[:3] for row in verdicts]


def _rows(text: str) -> list[list[str]]:
    """The cells of every row of the tables of a page."""
    lines = (line for line in text.splitlines() if line.startswith("| "))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


@pytest.mark.parametrize("place", sorted({*PLACES, *PAGES}))
def test_links_lead_somewhere(place: str) -> None:
    for target in _LINK.findall(_prose(place)):
        if target.startswith(("http", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        there = (ROOT / place).parent / path if path else ROOT / place
        assert there.exists(), f"{place}: {target}"
        if anchor:
            assert anchor in _anchors(there), f"{place}: {target}"


def _prose(place: str | Path) -> str:
    """A page without its code."""
    text = (ROOT / place).read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```$|`[^`\n]*`", "", fenced(text), flags=re.MULTILINE | re.DOTALL)


def _anchors(path: Path) -> set[str]:
    """Of the headings, as GitHub and the site make them."""
    heads = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a\n\n    $ trackbench list   # all\n    filters:\n", [("sh", ["trackbench list"])]),
        ('```yaml title="a.yaml"\na: 1\n```\n', [("yaml", [])]),
        ("- an item\n\n    of two paragraphs\n", []),
        ("    import os\n", [("python", [])]),
        ("    f(x) -> y   what it is\n", [("text", [])]),
        (
            "    trackbench run 'a   b' \\\n      --runs 2   says\n",
            [("sh", ["trackbench run 'a   b' --runs 2"])],
        ),
    ],
)
def test_blocks_are_found(text: str, found: list[tuple[str, list[str]]]) -> None:
    assert [(block.language, block.commands) for block in blocks(text)] == [
        (language, commands) for language, commands in found
    ]
    assert [b.text for b in blocks(fenced(text))] == [b.text for b in blocks(text)]
