"""Tables and figures of a results folder, as the experiment asked for them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from trackbench.experiment.config import Experiment
from trackbench.experiment.files import write_bytes, write_csv, write_text
from trackbench.report import style
from trackbench.report.results import Results
from trackbench.report.table import Table


def render(folder: Path, experiment: Experiment, formats: Iterable[str]) -> dict[str, Table]:
    """Write ``tables/`` and ``figures/``; returns the tables by name."""
    results = Results(folder)
    tables = {name: spec.table(results) for name, spec in experiment.tables.items()}
    _write_tables(folder / "tables", tables)
    _write_figures(folder / "figures", experiment.figures, results, formats)
    return tables


def _write_tables(folder: Path, tables: dict[str, Table]) -> None:
    if tables:
        folder.mkdir(exist_ok=True)
    for name, table in tables.items():
        write_csv(folder / f"{name}.csv", table.csv_header, table.csv_rows())
        write_text(folder / f"{name}.md", table.markdown())


def _write_figures(
    folder: Path, figures: dict[str, Any], results: Results, formats: Iterable[str]
) -> None:
    if figures:
        folder.mkdir(exist_ok=True)
    for name, spec in figures.items():
        figure = spec.draw(results)
        for form in formats:
            write_bytes(folder / f"{name}.{form}", style.content(figure, form))
        style.close(figure)
