"""Several results folders together: results/index.html, and results/README.md as the ledger."""

import os
from pathlib import Path

from trackbench.experiment.files import write_text
from trackbench.experiment.problems import Problem, UserError
from trackbench.report.comparison import LEGEND, summary_lines
from trackbench.report.index import together, write_index
from trackbench.report.opening import open_with_notes
from trackbench.report.page import verdict_tables
from trackbench.report.results import Results
from trackbench.report.verdicts import Comparison, compare

_HEAD = """# What reproduces

Every number and claim of the papers that an experiment here measures, with its verdict. Written by
`trackbench report results`; `make check-results` fails if a verdict does not come out again.
"""


def write_overview(folder: Path) -> list[Path]:
    """Write index.html and README.md over the results folders in ``folder``."""
    found = [(results, compare(results)) for results in _opened(folder)]
    index = write_index(folder, found)
    ledger = folder / "README.md"
    write_text(ledger, _ledger(folder, found))
    return [index, ledger]


def _opened(folder: Path) -> list[Results]:
    if not os.path.isdir(folder):
        raise UserError(f"{folder}: there is no such folder")
    candidates = sorted(p.parent for p in folder.glob("*/config.yaml"))
    if not candidates:
        raise UserError(f"{folder}: has neither a config.yaml nor results folders in it")
    opened: list[Results] = []
    problems: list[Problem | str] = []
    for candidate in candidates:
        try:
            opened.append(open_with_notes(candidate))
        except UserError as error:
            problems += error.problems
    if problems:
        raise UserError(*problems)
    return opened


def _ledger(folder: Path, found: list[tuple[Results, Comparison]]) -> str:
    lines = [f"- {line}" for line in summary_lines(together([c for _, c in found]))]
    parts = [_HEAD.rstrip(), "\n".join(lines) or "Nothing is published about these experiments."]
    for results, comparison in found:
        title = results.title
        name = results.folder.relative_to(folder).as_posix()
        parts.append(f"## [{results.config['name']}]({name}/): {title}")
        parts += [f"- {line}" for line in summary_lines(comparison)]
        parts += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    return "\n\n".join([*parts, LEGEND]) + "\n"
