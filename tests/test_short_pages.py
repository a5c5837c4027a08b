"""The pages on precision and on further keys show what appears when one follows them."""

import re
from pathlib import Path

import pytest

from docs.site.blocks import Block, blocks
from tests.commands import BARE, trackbench
from tests.conftest import ROOT


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
