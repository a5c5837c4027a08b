"""The code blocks of a page: fenced or indented, and what language they are in."""

import ast
import re
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import yaml

_COMMAND = re.compile(r"(\$ )?(\.venv/bin/)?(trackbench|cc|make|pip|git|python3?) ")
_ITEM = re.compile(r"[-*] |1\. ")
_FENCE = re.compile(r"^(```+) *([\w-]*) *(.*)$")


class Block(NamedTuple):
    """A code block: its first and last line on the page (from 0, fences included), and what it says."""

    first: int
    last: int
    language: str
    title: str
    text: str

    @property
    def commands(self) -> list[str]:
        """The commands of a block of them, without prompts and what is said of them."""
        joined = re.sub(r"\\\n\s*", "", self.text)
        lines = (line.removeprefix("$ ") for line in joined.splitlines())
        return [_without_remark(line) for line in lines if _COMMAND.match(line)]


def blocks(page: str) -> list[Block]:
    """Every code block of a page of Markdown, in order."""
    lines = page.splitlines()
    return [*_found(lines)]


def fenced(page: str) -> str:
    """The page with its indented blocks fenced, in a language where one is found."""
    lines = page.splitlines()
    for block in reversed(blocks(page)):
        if not lines[block.first].startswith("```"):
            inside = block.text.rstrip("\n").split("\n")
            lines[block.first : block.last + 1] = [f"```{block.language}", *inside, "```"]
    return "\n".join(lines) + "\n"


def with_separate_lists(page: str) -> str:
    """Return the page with an empty line before each list, which the site's Markdown needs.

    On GitHub a list may follow the line of a paragraph.
    """
    code = {k for block in blocks(page) for k in range(block.first, block.last + 1)}
    written: list[str] = []
    is_in_list = False
    for i, line in enumerate(page.splitlines()):
        if not line.strip():
            is_in_list = False
        if i not in code and _ITEM.match(line):
            if not is_in_list and written and written[-1].strip():
                written.append("")
            is_in_list = True
        written.append(line)
    return "\n".join(written) + "\n"


def _found(lines: list[str]) -> Iterator[Block]:
    i = 0
    while i < len(lines):
        fence = _FENCE.match(lines[i])
        if fence:
            last = next(k for k in range(i + 1, len(lines)) if lines[k].startswith(fence[1]))
            text = "\n".join(lines[i + 1 : last]) + "\n"
            title = re.search(r'title="([^"]*)"', fence[3])
            yield Block(i, last, fence[2] or _language(text), title[1] if title else "", text)
            i = last + 1
        elif lines[i].startswith("    ") and (i == 0 or not lines[i - 1].strip()):
            last = _end(lines, i)
            # A paragraph of a list's item is no code.
            if not _in_list(lines, i):
                text = "\n".join(line[4:] for line in lines[i : last + 1]) + "\n"
                yield Block(i, last, _language(text), "", text)
            i = last + 1
        else:
            i += 1


def _end(lines: list[str], first: int) -> int:
    """The last line of an indented block."""
    last = first
    for k in range(first, len(lines)):
        if lines[k].startswith("    "):
            last = k
        elif lines[k].strip():
            break
    return last


def _in_list(lines: list[str], first: int) -> bool:
    """Whether the text before the block, at the left margin, is an item of a list."""
    for line in reversed(lines[:first]):
        if line.strip() and not line.startswith("  "):
            return bool(re.match(r"[-*] |\d+\. ", line))
    return False


def _language(text: str) -> str:
    """sh, python, yaml, or text."""
    lines = [line for line in text.splitlines() if line.strip()]
    if any(_COMMAND.match(line) for line in lines):
        return "sh"
    if re.search(r"^(import|from|class|def|for|if) |^\w+(\.\w+)*[(=]", text, re.MULTILINE):
        with suppress(SyntaxError):
            ast.parse(text)
            return "python"
    try:
        return "yaml" if isinstance(yaml.safe_load(text), dict) else "text"
    except yaml.YAMLError:
        return "text"


def _without_remark(line: str) -> str:
    """A command without what stands behind it: a comment, or words after several spaces."""
    quoted = re.compile(r"""'[^']*'|"[^"]*"|\S""")
    i = 0
    while i < len(line):
        if line[i] == "#" and line[i - 1] == " ":
            return line[:i].rstrip()
        if line[i : i + 3] == "   ":
            return line[:i].rstrip()
        found = quoted.match(line, i)
        i = found.end() if found else i + 1
    return line.rstrip()
