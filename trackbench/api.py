"""Python functions for notebooks and scripts; the command line runs the same code.

``trackbench.run("config.yaml", runs=50).per_run`` is a data frame; ``trackbench.load(folder)`` returns
the same class for the results of an earlier run.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from trackbench.commands.dry_run import preview
from trackbench.commands.notebook_report import Report
from trackbench.commands.read_and_rewrite_stored_results import compare, load, plot, report
from trackbench.commands.read_experiment import file_of, prepare
from trackbench.commands.run_experiment import run_all, run_each
from trackbench.commands.run_options import OPTION_NAMES, Options
from trackbench.commands.unknown_keywords import with_known_keywords
from trackbench.errors import Mark, Problem, UserError
from trackbench.yaml_source import Config

__all__ = [
    "Options",
    "Report",
    "UserError",
    "compare",
    "load",
    "plot",
    "prepare",
    "preview",
    "report",
    "run",
    "run_all",
    "sweep",
    "tune",
]


@with_known_keywords(*OPTION_NAMES)
def run(config: Config, options: Options | None = None, **changes: Any) -> Report:
    """Run an experiment and write its results folder.

    Parameters
    ----------
    config
        path of a config, name of a shipped experiment, or a mapping with the content of a config
    options
        options of the run; None means the defaults of `Options`
    **changes
        fields of `Options` that differ from ``options``, as in ``run("config.yaml", runs=50,
        workers=2)``

    Returns
    -------
    Report
        tables, figures, verdicts and data frames of the results

    Raises
    ------
    UserError
        for bad input, with one line per mistake, and for the option ``shard``, which computes blocks and
        makes no report
    """
    options = (options or Options()).changed(changes)
    check_has_report(options)
    (report,) = run_all([config], options)
    return report


@with_known_keywords(*OPTION_NAMES)
def sweep(config: Config, options: Options | None = None, **changes: Any) -> Report:
    """Run the values of ``grid``; also write ``sweep.csv``, best values and figures.

    Keys of several filters vary one filter after the other. With the option ``product`` every
    combination runs. The results go to ``results/<name>-sweep/``, so the experiment's own results stay.

    Parameters
    ----------
    config
        path of a config, name of a shipped experiment, or a mapping with the content of a config
    options
        options of the run; None means the defaults of `Options`
    **changes
        fields of `Options` that differ from ``options``, as in ``grid=["filters.KF.motion.q=0.1,1"]``

    Returns
    -------
    Report
        tables, figures and data frames of the results at all points of the grid

    Raises
    ------
    UserError
        for bad input, with one line per mistake, and for the option ``shard``
    """
    options = (options or Options()).changed(changes)
    check_has_report(options)  # raises UserError for the option `shard`
    # A folder beside that of the experiment's own results.
    if options.out is None:
        config = file_of(config, options)
        name = prepare(config, options).settings.name
        options = replace(options, out=Path("results") / f"{name}-sweep")
    (report,) = run_each([config], options, sweep=True)
    return report


@with_known_keywords(*OPTION_NAMES)
def tune(config: Config, options: Options | None = None, **changes: Any) -> Report:
    """Tune the filters that the config's ``tune`` names, and run them beside the originals.

    `run` does the same, but also accepts a config that has nothing to tune.

    Parameters
    ----------
    config
        path of a config, name of a shipped experiment, or a mapping with the content of a config
    options
        options of the run; None means the defaults of `Options`
    **changes
        fields of `Options` that differ from ``options``

    Returns
    -------
    Report
        tables, figures and data frames of the results, with the tuned filters

    Raises
    ------
    UserError
        for bad input, with one line per mistake, and for a config that tunes no filter of the run
    """
    options = (options or Options()).changed(changes)
    check_tuned([config], options)  # raises UserError if the config tunes no filter
    return run(config, options)


def check_has_report(options: Options) -> None:
    """Reject the option ``shard``, which writes no results that a report could have.

    Parameters
    ----------
    options
        options of the run

    Raises
    ------
    UserError
        if ``shard`` is set
    """
    if options.shard:
        message = (
            f'a shard has no report: compute it by list(run_all([config], shard="{options.shard}"))'
        )
        raise UserError(Problem(Mark("shard="), "", message))


def check_tuned(configs: Sequence[Config], options: Options) -> None:
    """Check that each config tunes a filter of the run.

    Parameters
    ----------
    configs
        configs, each a path, a name or a mapping
    options
        options of the run; with ``only`` just the named filters count

    Raises
    ------
    UserError
        for the first config that tunes no filter of the run
    """
    for config in configs:
        experiment = prepare(config, options)
        if not experiment.tuned:
            message = "names no filter to be tuned: tune: {LABEL: {KEY: log:1e-6..10}}"
            raise UserError(experiment.source.problem(("tune",), message))
