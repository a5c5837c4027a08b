"""Tables ready to be shown: as Markdown, as LaTeX, as cells of a page."""

import re
import unicodedata
from dataclasses import dataclass, field
from typing import NamedTuple


class Text(NamedTuple):
    """Shown text of a cell, and the number it sorts by; words sort alphabetically."""

    text: str
    number: float | None = None
    tex: str | None = None
    """how LaTeX writes it, if not as it is"""
    best: bool = False
    """whether it is the best of its column"""


@dataclass
class TextTable:
    """A table ready to be shown."""

    title: str
    heads: list[str]
    rows: list[list[Text]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def markdown(self) -> str:
        """Return a Markdown table with a bold caption."""
        lines = [_line(list(map(_escaped, self.heads))), _line(["---"] * len(self.heads))]
        lines += [_line([_escaped(cell.text) for cell in row]) for row in self.rows]
        caption = f"**{_escaped(self.title)}**\n\n" if self.title else ""
        notes = "".join(f"\n{_escaped(note)}\n" for note in self.notes)
        return caption + "\n".join(lines) + "\n" + notes

    def aligned(self) -> str:
        """Return the table for a terminal: numbers to the right, words to the left."""
        lines = [self.heads, *([cell.text for cell in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        lines.insert(1, ["-" * width for width in widths])
        sides = ["<" if self._words(i) else ">" for i in range(len(widths))]
        rows = ("  ".join(map("{:{}{}}".format, line, sides, widths)).rstrip() for line in lines)
        return "\n".join([*filter(None, [self.title]), *(rows if self.rows else ()), *self.notes])

    def tex(self, name: str = "") -> str:
        """Return a LaTeX table for booktabs, graphicx and siunitx (3); ``name`` is its label."""
        columns = "".join("l" if self._words(i) else "r" for i in range(len(self.heads)))
        rows = [
            " & ".join(cell.tex or _tex(cell.text) for cell in row) + r" \\" for row in self.rows
        ]
        notes = [f"\n{_tex(note)}\\par" for note in self.notes]
        return "\n".join(
            [
                r"\begin{table}",
                r"\sisetup{separate-uncertainty=true, mode=match, reset-text-series=false}",
                r"\centering",
                rf"\caption{{{_tex(_NUMBERED.sub('', self.title))}}}",
                *([rf"\label{{tab:{name}}}"] if name else []),
                _AS_WIDE_AS_THERE_IS_ROOM,
                rf"\begin{{tabular}}{{{columns}}}",
                r"\toprule",
                " & ".join(map(_tex, self.heads)) + r" \\",
                r"\midrule",
                *rows,
                r"\bottomrule",
                r"\end{tabular}}",
                *notes,
                r"\end{table}",
                "",
            ]
        )

    def _words(self, column: int) -> bool:
        return all(row[column].number is None for row in self.rows)


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


_AS_WIDE_AS_THERE_IS_ROOM = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"
_NUMBERED = re.compile(r"^Table \w+[.:]\s*(?=\S)")
"""What LaTeX writes before a caption by itself."""
_TEX = {
    **{c: f"\\{c}" for c in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "±": r"$\pm$",
    "–": "--",
    "µ": r"$\mu$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
}


def _tex(text: str) -> str:
    return "".join(_TEX.get(c) or _greek(c) for c in text)


def _greek(c: str) -> str:
    """Return a small Greek letter as a formula, since pdflatex has it in no font of text."""
    head, _, letter = unicodedata.name(c, "").partition("GREEK SMALL LETTER ")
    return rf"$\{letter.lower().replace('lamda', 'lambda')}$" if letter and not head else c


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")
