"""Compare the tables and verdicts of a results folder with those that follow from its stored runs."""

from collections.abc import Iterator
from pathlib import Path

from trackbench.errors import counted, counted_with_verb
from trackbench.report.sweep_csv import write_sweep
from trackbench.report.table_and_figure_files import write_tables
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import compare
from trackbench.report.verdicts.verdict_files import FILES, write_comparison, write_paired
from trackbench.results.file_names import TIME_VERDICTS


def compare_derived(results: Results, folder: Path) -> Iterator[str]:
    """Yield a line on each table and verdict in a folder that does not follow from ``results``.

    Tables and verdicts are computed again from the results' runs, written to their target, a temporary
    folder, and compared byte for byte.
    """
    write_tables(results, tex=True)
    # A table that cannot be made again is a difference if the folder has it. Its output is "table NAME".
    for output, line in zip(results.unmade, results.unmade_lines, strict=True):
        if (folder / "tables" / f"{output.removeprefix('table ')}.csv").is_file():
            yield line
    write_paired(results)
    write_comparison(results, compare(results))
    if (folder / "sweep.csv").is_file():  # only the command `sweep` writes it
        write_sweep(results)
    written = {p.relative_to(results.target) for p in results.target.rglob("*") if p.is_file()}
    for name in sorted(written):
        stored = folder / name
        computed = results.target / name
        # LaTeX tables and the facts of the run in run/ may be missing.
        is_optional = name.suffix == ".tex" or name.parts[0] == "run"
        if not stored.is_file():
            if not is_optional:
                yield f"{name}: is not there"
        elif stored.read_bytes() != computed.read_bytes():
            yield _first_other_row(name, stored, computed)
    for name in map(Path, (*FILES, TIME_VERDICTS)):
        if (folder / name).is_file() and name not in written:
            yield f"{name}: nothing is published about this experiment"


def _first_other_row(name: Path, stored: Path, computed: Path) -> str:
    """Return a line on two text files whose bytes differ, with their first line that differs."""
    lines = stored.read_text(encoding="utf-8", errors="replace").splitlines()
    lines_again = computed.read_text(encoding="utf-8", errors="replace").splitlines()
    if len(lines) != len(lines_again):
        return f"{name}: has {counted(len(lines), 'line')}, of the stored runs it has {len(lines_again)}"
    pairs = [(a, b) for a, b in zip(lines, lines_again, strict=True) if a != b]
    if not pairs:
        return f"{name}: has other line ends than are written from the stored runs"
    line, expected = pairs[0]
    rows_that_differ = counted_with_verb(len(pairs), "row", "does", "do")
    number = f"{rows_that_differ} not follow from the stored runs"
    return f"{name}: {number}; the first is {line!r}, it should be {expected!r}"
