"""What the command line does, for notebooks and scripts: one code path for both."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from trackbench.evaluation.metrics import LOST_BECAUSE
from trackbench.experiment.config import Experiment, load
from trackbench.experiment.engines import Engine, cpu_count, open_engine
from trackbench.experiment.plan import cautions, check_memory, describe, make_plan
from trackbench.experiment.runner import Outcome, execute
from trackbench.experiment.store import write_results
from trackbench.report.comparison import summary_lines, write_comparison, write_paired
from trackbench.report.ledger import write_overview
from trackbench.report.page import write_report
from trackbench.report.render import render, write_figures
from trackbench.report.results import Results, open_results
from trackbench.report.table import Table
from trackbench.report.verdicts import Comparison
from trackbench.report.verdicts import compare as hold_against_published


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to run an experiment; nothing here changes a number in a CSV but runs and seed."""

    set: Sequence[str] = ()
    only: Sequence[str] = ()
    runs: int | None = None
    seed: int | None = None
    out: Path | None = None
    engine: Engine = "processes"
    workers: int | None = None
    save_tracks: bool = False
    formats: Sequence[str] = ("png", "svg")
    quiet: bool = False


@dataclass
class Report:
    """Where the results are, the tables, and what went wrong."""

    folder: Path
    tables: dict[str, Table]
    comparison: Comparison
    notes: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    @property
    def results(self) -> Results:
        """The folder's files as data frames."""
        return Results(self.folder)


def prepare(config: Path, options: Options) -> Experiment:
    """Read and validate a config with the options' overrides."""
    return load(config, list(options.set), list(options.only), options.runs, options.seed)


def run(config: Path | str, options: Options | None = None) -> Report:
    """Run an experiment and write its results folder; raises UserError for bad input."""
    options = options or Options()
    experiment = prepare(Path(config), options)
    plan = make_plan(experiment, options.save_tracks)
    workers = min(options.workers or cpu_count(), len(plan.unique))
    needed = check_memory(plan, workers)
    _say(describe(experiment, plan, workers, needed), options)
    for text in dict.fromkeys(c for point in experiment.points for c in cautions(point)):
        _say(f"note: {text}", options)
    with open_engine(options.engine, workers) as executor:
        outcome = execute(plan, executor, workers, progress=not options.quiet)
    folder = options.out or Path("results") / experiment.settings.name
    write_results(folder, experiment, outcome, options.save_tracks)
    results = Results(folder)
    tables, comparison = render(results, options.formats)
    write_report(results, comparison)
    notes = _lost(outcome) + summary_lines(comparison)
    return Report(folder, tables, comparison, notes, _failed(outcome))


def compare(folder: Path | str) -> Comparison:
    """Hold a results folder against what is published again; writes comparison and paired.csv."""
    results = open_results(Path(folder))
    comparison = hold_against_published(results)
    write_comparison(results, comparison)
    write_paired(results)
    return comparison


def plot(
    folder: Path | str, formats: Sequence[str] = ("png", "svg"), only: Sequence[str] = ()
) -> list[Path]:
    """Draw the figures of a results folder again; returns the files written."""
    return write_figures(open_results(Path(folder)), formats, only)


def report(folder: Path | str) -> list[Path]:
    """Write report.html of a results folder, or index.html and the ledger over a folder of them."""
    folder = Path(folder)
    if (folder / "config.yaml").is_file():
        return [write_report(open_results(folder))]
    return write_overview(folder)


def preview(config: Path | str, options: Options) -> str:
    """What `run` would do, in one line."""
    experiment = prepare(Path(config), options)
    plan = make_plan(experiment, options.save_tracks)
    workers = min(options.workers or cpu_count(), len(plan.unique))
    return describe(experiment, plan, workers, check_memory(plan, workers))


def _say(text: str, options: Options) -> None:
    if not options.quiet:
        print(text, file=sys.stderr)


def _lost(outcome: Outcome) -> list[str]:
    notes = []
    for (_, label), result in outcome.results.items():
        codes = result.per_run["lost"]
        why = [
            f"{int((codes == code).sum())} because {reason}"
            for code, reason in LOST_BECAUSE.items()
            if (codes == code).any()
        ]
        if why:
            notes.append(
                f"{label}: {int((codes > 0).sum())} of {len(codes)} runs lost, {', '.join(why)}"
            )
    return notes


def _failed(outcome: Outcome) -> list[str]:
    return [f"{label} failed: {why}" for (_, label), why in outcome.failures.items()]
