"""Every mistake of a user is a line with its place: exit code 2, no traceback, nothing written, soon.

Each text file of this folder has a good experiment, then the mistakes that are made in it, one by one:

    -- c.yaml --                a file of the experiment, which ends where the next line with -- begins
    -- mistakes --
    N: 10 -> N: 0               an edit: the words on the left become those on the right
    ! 7:8: filters.PF.N: 0 is less than 2

A mistake ends with the lines that trackbench prints, each after an exclamation mark. In them `...`
stands for any words, and a place is in `c.yaml` if no other file is named. Above stand, in any number,

- edits; a line without an arrow continues the edit above, `...` on the left is anything in a line;
- words that are appended to a file: `m.csv -> words`;
- new files: `-- m.csv --` and its lines;
- `$ words`, which are added to `trackbench check c.yaml`; a first word without dashes replaces `check`.

A file that begins with `$ words` has them added to each of its commands.

Between `<<` and `>>` stands Python code, whose value is put in its place: `N: <<"9" * 400>>`.
"""

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.commands import trackbench

MAIN = "c.yaml"
FOLDER = Path(__file__).parent


@dataclass
class Mistake:
    """Files with a mistake, the words of the command line, and the lines that trackbench prints."""

    files: dict[str, Any]
    words: list[str] = field(default_factory=list)
    printed: list[str] = field(default_factory=list)

    def edit(self, old: str, new: str) -> None:
        """Replace words of the first file that has them, or append to a file."""
        if old in self.files:
            self.files[old] += new + "\n"
            return
        pattern = re.escape(old).replace(r"\.\.\.", ".*")
        for name, text in self.files.items():
            edited, number = re.subn(pattern, lambda _: new, text, count=1)
            if number:
                self.files[name] = edited
                return
        raise ValueError(f"no file has {old!r}")


def good_files(text: str) -> dict[str, str]:
    """Return the files of the experiment before the mistakes."""
    good, _, _ = text.partition("-- mistakes --\n")
    return dict(re.findall(r"^-- (.+) --\n((?:(?!-- ).*\n)*)", good, re.MULTILINE))


def common_words(text: str) -> list[str]:
    """Return the words that are added to all commands of a text."""
    return shlex.split(text[2:].partition("\n")[0]) if text.startswith("$ ") else []


def mistakes(text: str) -> list[Mistake]:
    """Return the mistakes that are made in the experiment."""
    _, _, rest = text.partition("-- mistakes --\n")
    blocks = re.findall(r"((?:(?!! ).*\n)*)((?:! .*\n)+)\n*", rest)
    made = [mistake(good_files(text), *block) for block in blocks]
    for one in made:
        one.words += common_words(text)
    return made


def mistake(files: dict[str, str], changes: str, printed: str) -> Mistake:
    """Return the mistake of a block of changes and of the lines that it prints."""
    made = Mistake(files, printed=re.findall(r"^! (.*)", printed, re.MULTILINE))
    changes = re.sub(r"<<(.+?)>>", lambda match: str(eval(match[1])), changes)
    for part in re.split(r"^(?=-- |\$ |.* ->(?: |$))", changes, flags=re.MULTILINE):
        if head := re.match(r"-- (.+) --\n", part):
            made.files[head[1]] = part[head.end() :]
        elif part.startswith("$ "):
            made.words += shlex.split(part[2:])
        elif part.strip():
            old, _, new = part.removesuffix("\n").partition(" ->")
            made.edit(old, new.removeprefix(" "))
    return made


def refused(folder: Path, made: Mistake) -> list[str]:
    """Return the lines that trackbench prints of files that it must refuse, writing nothing."""
    for name, content in made.files.items():
        as_bytes = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(as_bytes)
    command, words = "check", made.words
    if words and not words[0].startswith("-"):
        command, *words = words
    done = trackbench(command, MAIN, *words, cwd=folder)
    assert done.returncode == 2, done
    assert "Traceback" not in done.stdout + done.stderr
    assert "pydantic." not in done.stderr
    assert {path.name for path in folder.iterdir()} == {*made.files}
    printed = done.stderr.replace(f"{folder}/", "")
    return [line.removeprefix(f"{MAIN}:") for line in printed.splitlines()]


LISTS = {path.stem: path.read_text() for path in sorted(FOLDER.glob("*.txt"))}
ALL = [
    pytest.param(made, id=f"{stem}-{number}")
    for stem, text in LISTS.items()
    for number, made in enumerate(mistakes(text), 1)
]


@pytest.mark.parametrize("stem", LISTS)
def test_without_its_mistakes_it_is_good(tmp_path: Path, stem: str) -> None:
    for name, text in good_files(LISTS[stem]).items():
        (tmp_path / name).write_text(text)
    done = trackbench("check", MAIN, *common_words(LISTS[stem]), cwd=tmp_path)
    assert done.returncode == 0, done


@pytest.mark.parametrize("made", ALL)
def test_a_mistake_is_a_line(tmp_path: Path, made: Mistake) -> None:
    lines = refused(tmp_path, made)
    patterns = [re.escape(line).replace(r"\.\.\.", ".*") for line in made.printed]
    assert len(lines) == len(patterns), lines
    for line, pattern in zip(lines, patterns, strict=True):
        assert re.fullmatch(pattern, line), (line, pattern)
