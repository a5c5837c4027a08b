"""Mistakes in the input: one line each, with file and position, reported together."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, order=True)
class Mark:
    """A place in a file; line and column count from 1, or are 0 for a command-line option."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        if self.line == 0:
            return self.file
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Answer:
    """A key of a recording, and its value, that a message proposes."""

    key: str
    value: str
    file: str = ""
    """table that the key is about; empty for a key of the target"""

    @property
    def in_yaml(self) -> str:
        """The key and its value, as the message has them: `columns: {run: ""}` of ``columns.run``."""
        key, point, inner_key = self.key.partition(".")
        if point:
            return f"`{key}: {{{inner_key}: {self.value}}}`"
        return f"`{key}: {self.value}`"


@dataclass(frozen=True, order=True)
class Problem:
    """One mistake: its position, its path in the config, and a description."""

    mark: Mark
    path: str
    message: str
    answer: Answer | None = field(default=None, compare=False)
    """key that the message proposes, for a command that has options in place of keys"""

    def __str__(self) -> str:
        return in_line(": ".join(filter(None, [str(self.mark), self.path, self.message])))


def mistake_as_data(problem: Problem | str) -> dict[str, Any]:
    """Describe a mistake as ``--json`` prints it: by its position, path and text."""
    if isinstance(problem, str):
        return {"file": "", "line": 0, "column": 0, "path": "", "what": problem}
    return {**vars(problem.mark), "path": problem.path, "what": problem.message}


def in_line(text: str) -> str:
    """Write the text in one line.

    Parameters
    ----------
    text
        text that may have line breaks and unprintable characters

    Returns
    -------
    str
        the text with these characters escaped, a line break as a backslash and an n
    """
    characters = []
    for character in text:
        if character.isprintable():
            characters.append(character)
        else:
            characters.append(character.encode("unicode_escape").decode())
    return "".join(characters)


def reason(error: OSError) -> str:
    """Explain why a file cannot be read or written."""
    words = error.strerror or str(error)
    return words[:1].lower() + words[1:]


class UserError(Exception):
    """Bad input: printed as its lines, without a traceback, exit code 2."""

    def __init__(self, *problems: Problem | str) -> None:
        super().__init__("\n".join(str(p) for p in problems))
        self.problems = problems

    def _render_traceback_(self) -> list[str]:
        """Give IPython lines in place of a traceback."""
        return str(self).splitlines()


class RunError(Exception):
    """Failure of a run: one line, exit code 1; finished blocks stay in the cache."""


class WriteError(RunError):
    """A file could not be written."""

    @classmethod
    def from_os_error(cls, path: Path, error: OSError) -> "WriteError":
        """Return the error of a path."""
        return cls(f"cannot write {path}: {reason(error)}")


def linked_errors(error: BaseException) -> Iterator[BaseException]:
    """Yield an error, the error that caused it, and so on, each once: an error may be its own cause.

    Parameters
    ----------
    error
        error that was caught, the first that is yielded

    Yields
    ------
    BaseException
        errors by ``__cause__``, or without one by ``__context__``
    """
    seen: set[int] = set()
    linked: BaseException | None = error
    while linked is not None and id(linked) not in seen:
        yield linked
        seen.add(id(linked))
        linked = linked.__cause__ or linked.__context__


def and_others(number: int, words: str = "as are") -> str:
    """Return a clause on the others of ``number`` mistakes: ``, as are 3 more``; empty for one."""
    if number < 2:
        return ""
    return f", {words} {number - 1} more"


def joined(names: Iterable[str]) -> str:
    """Return ``A, B and C``; there must be a name."""
    *first, last = names
    if not first:
        return last
    return f"{', '.join(first)} and {last}"


def first_names(names: Sequence[str], most: int) -> str:
    """Return names with commas; of more than ``most`` the first ones: ``A, B and 3 more``."""
    text = ", ".join(names[:most])
    if len(names) > most:
        text += f" and {len(names) - most} more"
    return text


def counted(number: int, word: str) -> str:
    """Write ``1 block``, ``2 blocks``."""
    if number == 1:
        return f"1 {word}"
    return f"{number} {word}s"


def form_for(number: int, singular: str, plural: str) -> str:
    """Return the form of a word for a number: ``has`` for 1, ``have`` for 2."""
    return singular if number == 1 else plural


def counted_with_verb(number: int, word: str, singular: str = "was", plural: str = "were") -> str:
    """Write ``1 block was`` or ``2 blocks were``, or with another verb, such as has and have."""
    return f"{counted(number, word)} {form_for(number, singular, plural)}"
