"""LaTeX of a table, for booktabs and siunitx (3); a file of it also compiles alone."""

import re
import unicodedata
from collections.abc import Sequence
from typing import Protocol

_ALONE = r"""% In a paper: \usepackage{booktabs, siunitx}, siunitx of version 3, and \input of this file.
% Alone: the next lines make it a document, as \begin{document} has not been read.
\expandafter\ifx\csname @nodocument\endcsname\relax\else
  \documentclass{article}
  \usepackage[a4paper, landscape, margin=1cm]{geometry}
  \usepackage{booktabs, siunitx}
  \pagestyle{empty}
  \begin{document}
  \def\trackbenchalone{\end{document}}
\fi"""
"""Lines that compile a table alone: LaTeX forgets ``\\@nodocument`` at the begin of a document."""
_ALONE_END = r"\csname trackbenchalone\endcsname"
_BOLD = r"\bfseries "
"""What LaTeX has before the text of a bold cell."""
_SIUNITX = re.compile(
    r"(?P<sign>-?)(?P<whole>\d+)(\.(?P<places>\d+))?( \+- (?P<error>[\d.]+))?( e(?P<exponent>-?\d+))?"
)
"""A number as `in_tex` writes it."""
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
    "×": r"$\times$",
    "·": r"$\cdot$",
    "→": r"$\to$",
    "≈": r"$\approx$",
    "∞": r"$\infty$",
    "−": "$-$",
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
    "⁴": r"\textsuperscript{4}",
}


_FORMULA = re.compile(r"(\$[^$\s](?:[^$]*[^$\s])?\$)")
"""A formula between dollars, within a column's head."""


class LatexCell(Protocol):
    """Cell of a table: see `trackbench.report.markdown_table.Text`."""

    @property
    def text(self) -> str:
        """Text of the cell."""

    @property
    def number(self) -> float | None:
        """Number that the cell sorts by; None of words."""

    @property
    def tex(self) -> str | None:
        """Text that a column of siunitx has in place of ``text``."""

    @property
    def best(self) -> bool:
        """True if the cell is the best of its column."""


def table_label(experiment: str, table: str, has_cpu_times: bool) -> str:
    """Return the label of a table of an experiment; the names are those of the config.

    LaTeX needs two labels: a table may be in two folders, with CPU times and without.
    """
    label = f"{experiment}-{table}"
    if has_cpu_times:
        label += "-times"
    return label


def latex_table(
    title: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[LatexCell]],
    notes: Sequence[str],
    label: str = "",
) -> str:
    """Return a LaTeX table for booktabs and siunitx (3), which also compiles alone.

    ``rows`` have a cell for each of the ``heads``. ``label`` is the table's name in the paper, after
    ``tab:``.
    """
    # Step 1: the columns. Those of numbers, of type S, are aligned at the decimal marker; siunitx
    # takes any text in braces as it is.
    formats = [_column_format([row[i] for row in rows]) for i in range(len(heads))]
    head_texts = [_head_tex(head) for head in heads]
    row_texts = [[_cell_tex(cell) for cell in row] for row in rows]
    for i, column_format in enumerate(formats):
        if column_format.startswith("S"):
            head_texts[i] = f"{{{head_texts[i]}}}"
            for row in row_texts:
                is_number = _SIUNITX.fullmatch(row[i].removeprefix(_BOLD))
                if not is_number and not row[i].startswith("{"):
                    row[i] = f"{{{row[i]}}}"
    # Step 2: the notes.
    note_texts = [escaped_for_latex(note) for note in notes]
    cells = [cell for row in rows for cell in row if cell.tex]
    # `in_tex` leaves out an error below half of the last digit, which the cell's text has.
    if any("±" in cell.text and "+-" not in (cell.tex or "") for cell in cells):
        note_texts.append("A number without a standard error has one below half of its last digit.")
    # Step 3: the lines. LaTeX numbers the captions by itself. The first and the last lines make the
    # file a document of its own, unless a document includes it.
    lines = [
        _ALONE,
        r"\begin{table}",
        r"\sisetup{separate-uncertainty=true, group-digits=none}",
        r"\sisetup{mode=match, reset-text-series=false}  % bold numbers",
        r"\centering",
        rf"\caption{{{escaped_for_latex(_NUMBERED.sub('', title))}}}",
    ]
    if label:
        lines.append(rf"\label{{tab:{label}}}")
    lines += [
        rf"\begin{{tabular}}{{{' '.join(formats)}}}",
        r"\toprule",
        " & ".join(head_texts) + r" \\",
        r"\midrule",
        *(" & ".join(row) + r" \\" for row in row_texts),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    lines += [rf"\par\smallskip{{\footnotesize {note}\par}}" for note in note_texts]
    return "\n".join([*lines, r"\end{table}", _ALONE_END, ""])


def _column_format(cells: Sequence[LatexCell]) -> str:
    """Return a column's type in LaTeX: ``l`` for words, ``r`` for other texts, ``S`` for numbers.

    An ``S`` has the largest numbers of digits in the column, so that siunitx aligns them. For
    example, ``S[table-format=-2.3(2)e-9]`` has a sign, two digits and three decimals, two digits of
    the error, and an exponent of one digit with a sign.
    """
    numbers = []
    for cell in cells:
        number = _SIUNITX.fullmatch(cell.tex or "")
        if number:
            numbers.append(number)
    if not numbers:
        has_words_only = all(cell.number is None for cell in cells)
        return "l" if has_words_only else "r"

    def longest(group: str) -> int:
        return max(len(number[group] or "") for number in numbers)

    sign = "-" if longest("sign") else ""
    room = f"{sign}{longest('whole')}.{longest('places')}"
    # Digits of an error count from its first that is not zero: two of 0.0080.
    error_digits = max(len((n["error"] or "").replace(".", "").lstrip("0")) for n in numbers)
    if error_digits:
        room += f"({error_digits})"
    if longest("exponent"):
        exponents = [number["exponent"] or "" for number in numbers]
        digits = max(len(exponent.lstrip("-")) for exponent in exponents)
        exponent_sign = "-" if any(exponent.startswith("-") for exponent in exponents) else ""
        room += f"e{exponent_sign}{'9' * digits}"
    return f"S[table-format={room}]"


def escaped_for_latex(text: str) -> str:
    """Write a text for LaTeX, whose special characters are escaped."""
    return "".join(_TEX.get(c) or _greek(c) for c in text)


def _cell_tex(cell: LatexCell) -> str:
    """Write a cell for LaTeX, in bold if it is among the best."""
    text = cell.tex or escaped_for_latex(cell.text)
    if not cell.best:
        return text
    if text.startswith("{"):  # braces around a text that is no number: the command is within them
        return f"{{{_BOLD}{text[1:]}"
    return f"{_BOLD}{text}"


def _head_tex(text: str) -> str:
    """Write a column's head for LaTeX, formulas between $ as they are."""
    parts = []
    # Text and formulas in turns, beginning with a text.
    for i, part in enumerate(_FORMULA.split(text)):
        is_formula = i % 2 == 1
        parts.append(part if is_formula else escaped_for_latex(part))
    return "".join(parts)


def _greek(c: str) -> str:
    """Write a small Greek letter as a formula, ``$\\mu$``, since pdflatex has it in no font of text.

    Any other character stays as it is.
    """
    before, _, letter = unicodedata.name(c, "").partition("GREEK SMALL LETTER ")
    if before or not letter:
        return c
    return rf"$\{letter.lower().replace('lamda', 'lambda')}$"  # Unicode writes it "lamda"
