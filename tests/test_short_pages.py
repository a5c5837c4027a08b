"""The pages on precision, further keys and a fair comparison show what appears when one follows them."""

import csv
import re
from pathlib import Path

import pytest
import yaml

from docs.site.blocks import Block, blocks
from tests.commands import BARE, trackbench
from tests.conftest import ROOT
from tests.pages import TURN


def _blocks(page: str) -> list[Block]:
    return blocks((ROOT / "docs" / page).read_text(encoding="utf-8"))


def _lines(text: str) -> list[str]:
    """Lines with single spaces, without rules, CPU times and the number of workers."""
    lines = [" ".join(line.split()) for line in text.splitlines() if "──" not in line]
    return [re.sub(r" (\S+ µs|–|on \d+ workers?)$", "", line) for line in lines if line]


@pytest.mark.parametrize(
    ("page", "more"),
    [
        ("precision.md", (("--all",), ("--set", "until.anees=0.02"))),
        ("what-else.md", ((),)),
    ],
)
def test_the_page_shows_what_appears(
    page: str, more: tuple[tuple[str, ...], ...], tmp_path: Path
) -> None:
    found = _blocks(page)
    (config,) = (block for block in found if block.title.endswith(".yaml"))
    (tmp_path / config.title).write_text(config.text)
    appeared = []
    for words in more:
        done = trackbench("run", config.title, *words, "--workers", "1", *BARE, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        appeared += _lines(done.stderr + done.stdout)
    shown = [line for block in found if block.language == "text" for line in _lines(block.text)]
    assert shown
    assert [line for line in shown if line not in appeared] == []


def test_the_lines_for_a_fair_comparison_are_one_experiment(tmp_path: Path) -> None:
    """Its claims and differences are between tuned filters alone; runs and verdicts are as shown."""
    found = _blocks("fair-comparison.md")
    config = yaml.safe_load(TURN)
    for block in found:
        if block.language == "yaml":
            lines = yaml.safe_load(block.text)
            assert not {*lines} & {*config} - {"runs", "tables"}
            config |= lines
    assert {*config["tune"]} == {*config["filters"]}
    assert config["tables"]["better"]["against"].endswith(" (tuned)")
    (claims,) = (block for block in found if block.title == "claims.csv")
    (tmp_path / claims.title).write_text(claims.text)
    for row in csv.DictReader(claims.text.splitlines()):
        assert row["left"].endswith(" (tuned)")
        assert row["right"].endswith(" (tuned)")
    del config["tables"]["errors"]["columns"]["CPU time per run (s)"]  # measured 15 times
    (tmp_path / "turn.yaml").write_text(yaml.safe_dump(config))
    done = trackbench("run", "turn.yaml", "--workers", "1", *BARE, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    page = (ROOT / "docs" / "fair-comparison.md").read_text(encoding="utf-8")
    runs = re.search(r"^(\d+) of at most 5000 runs: every number", done.stderr, re.MULTILINE)
    assert runs is not None
    assert f"and here {runs[1]} are enough" in " ".join(page.split())
    results = tmp_path / "results" / "turn"
    verdicts = [
        line for line in (results / "comparison.md").read_text().splitlines() if "mine" in line
    ]
    shown = [line for line in page.splitlines() if "| holds |" in line]
    assert [line.split(" | ")[:3] for line in verdicts] == [
        line.removesuffix(" |").split(" | ") for line in shown
    ]
