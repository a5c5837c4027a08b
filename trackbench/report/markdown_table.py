"""A table with its numbers written as text: as Markdown, or in aligned columns for a terminal."""

from dataclasses import dataclass, field
from typing import NamedTuple

from trackbench.report.latex_table import latex_table


class Text(NamedTuple):
    """Shown text of a cell, and the number it sorts by; words sort alphabetically."""

    text: str
    number: float | None = None
    tex: str | None = None
    """how a column of LaTeX's siunitx writes it, if not as it is"""
    best: bool = False
    """whether it is the best of its column"""


@dataclass
class TextTable:
    """A table ready to be shown, its numbers written as text."""

    title: str
    heads: list[str]
    rows: list[list[Text]] = field(default_factory=list)
    """one text for each of the heads"""
    notes: list[str] = field(default_factory=list)
    """sentences below the table"""

    def markdown(self) -> str:
        """Return a Markdown table with a bold caption."""
        lines = [
            _line([markdown_text(head) for head in self.heads]),
            _line(["---"] * len(self.heads)),
        ]
        for row in self.rows:
            lines.append(_line([markdown_text(cell.text) for cell in row]))
        caption = f"**{markdown_text(self.title)}**\n\n" if self.title else ""
        notes = "".join(f"\n{markdown_text(note)}\n" for note in self.notes)
        return caption + "\n".join(lines) + "\n" + notes

    def aligned(self) -> str:
        """Return the table for a terminal: numbers to the right, words to the left."""
        lines = [self.heads]
        for row in self.rows:
            lines.append([cell.text for cell in row])
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        lines.insert(1, ["-" * width for width in widths])  # below the heads
        sides = ["<" if self._has_words_only(i) else ">" for i in range(len(widths))]
        shown = [self.title] if self.title else []
        if self.rows:
            for line in lines:
                padded = map("{:{}{}}".format, line, sides, widths)  # such as "{:>12}"
                shown.append("  ".join(padded).rstrip())
        return "\n".join([*shown, *self.notes])

    def tex(self, label: str = "") -> str:
        """Return a LaTeX table for booktabs and siunitx (3), which also compiles alone.

        ``label`` is its name in the paper, after ``tab:``.
        """
        return latex_table(self.title, self.heads, self.rows, self.notes, label)

    def _has_words_only(self, column: int) -> bool:
        """Test whether no cell of a column has a number."""
        return all(row[column].number is None for row in self.rows)


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def markdown_text(text: str) -> str:
    """Write a text so that Markdown shows it as it is: no cell ends in it, and no tag or link begins."""
    text = text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")
    return text.replace("](", "]\\(")
