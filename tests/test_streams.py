"""A stdout that cannot be written ends a command with one line; a terminal gets no escape codes."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

from tests.commands import trackbench
from tests.conftest import PLANE
from trackbench import api

PROGRAM = "import sys; from trackbench.__main__ import main; sys.exit(main())"
FULL = Path("/dev/full")
CODES = ("\x1b[31m", "\x9b31m", "\x07")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two results folders of one experiment."""
    home = tmp_path_factory.mktemp("streams")
    text = f"name: c\nruns: 3\n{PLANE}filters:\n  KF: {{kind: kf}}\n  PF: {{kind: pf, N: 9}}\n"
    (home / "c.yaml").write_text(text)
    for name in "ab":
        options: dict[str, Any] = {"quiet": True, "engine": "serial", "formats": ()}
        api.run(home / "c.yaml", out=home / name, **options)
    return home / "a", home / "b"


@pytest.mark.skipif(not FULL.exists(), reason="no device that is always full")
@pytest.mark.parametrize(
    ("words", "closed"),
    [
        ("list filters", True),
        ("compare A B", False),
        ("compare A B --json", True),
        ("report A", False),
    ],
)
def test_a_stdout_that_cannot_be_written_is_one_line(
    words: str, closed: bool, folders: tuple[Path, Path]
) -> None:
    names = {"A": str(folders[0]), "B": str(folders[1])}
    command = [sys.executable, "-c", PROGRAM, *(names.get(w, w) for w in words.split())]
    with FULL.open("w") as full:
        done = subprocess.run(
            command,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            preexec_fn=(lambda: os.close(1)) if closed else None,
        )
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    what = "stdout is closed" if closed else "stdout: no space left on device"
    assert len(lines) == 1
    assert lines[0].startswith(f"error: {what}")
    assert "Traceback" not in done.stderr


def _texts(content: Any, change: Callable[[str], str]) -> Iterator[Any]:
    """Yield copies of a JSON content in each of which one text, or name of a key, is changed."""
    if isinstance(content, str):
        yield change(content)
    elif isinstance(content, list):
        for i, inner in enumerate(content):
            yield from ([*content[:i], other, *content[i + 1 :]] for other in _texts(inner, change))
    elif isinstance(content, dict):
        for key, inner in content.items():
            rest = {k: v for k, v in content.items() if k != key}
            yield {**rest, change(key): inner}
            yield from ({**rest, key: other} for other in _texts(inner, change))


@pytest.mark.parametrize("name", ["manifest.json", "run/machine.json"])
def test_no_escape_code_of_a_manifest_reaches_the_terminal(
    name: str, folders: tuple[Path, Path]
) -> None:
    """Each text has one of three codes."""
    folder, other = folders
    whole, codes = (folder / name).read_text(), cycle(CODES)
    try:
        for content in _texts(json.loads(whole), lambda text: f"{text}{next(codes)}"):
            (folder / name).write_text(json.dumps(content))
            done = trackbench("compare", folder, other)
            assert done.returncode != 0
            assert not any(code in done.stdout + done.stderr for code in CODES)
    finally:
        (folder / name).write_text(whole)


def test_values_beside_texts_are_no_place_for_codes(folders: tuple[Path, Path]) -> None:
    """Where a number is expected there may be a text."""
    folder, other = folders
    whole = (folder / "manifest.json").read_text()
    try:
        for key in json.loads(whole):
            content = json.loads(whole) | {key: "\x1b[31m"}
            (folder / "manifest.json").write_text(json.dumps(content))
            for words in (("compare", folder, other), ("report", folder), ("codecheck", folder)):
                done = trackbench(*words, cwd=folder.parent)
                assert "\x1b" not in done.stdout + done.stderr
    finally:
        (folder / "manifest.json").write_text(whole)
