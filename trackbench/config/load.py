"""Load an experiment: read its file, include its parts, override keys, validate.

All mistakes are collected before anything runs. A grid (``grid: {scenario.R: [0.1, 1]}``) makes one
point per combination; without one there is a single point. Paths joined by `` & `` take each value
together, as ``filters.A.q & filters.B.q: [0, 1]``.
"""

import copy
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from trackbench.config.added_filters import add_filters, show_filters
from trackbench.config.check_after_mistakes import (
    with_unread_components,
)
from trackbench.config.chosen_filters import set_only
from trackbench.config.experiment import Experiment
from trackbench.config.experiment_keys import Settings
from trackbench.config.grid_option import add_axis
from trackbench.config.includes import inline_parts
from trackbench.config.number_of_runs import set_runs
from trackbench.config.overrides import check_overridden_parts, override, override_all
from trackbench.config.plugins_of_config import load_plugins
from trackbench.config.python_config import from_mapping
from trackbench.config.python_tables import put_tables
from trackbench.config.smoothed_filters import add_smoothed
from trackbench.config.standard_problem import PROBLEM_KEYS
from trackbench.config.tuned_filters import Chosen, add_tuned
from trackbench.config.validate_experiment import validate
from trackbench.errors import Mark, Problem, UserError
from trackbench.plugins.plugin_errors import (
    unexpected_errors_as_mistakes,
)
from trackbench.yaml_source import Assembled, read

_TABLE_SUFFIXES = {".csv", ".tsv", ".gpx", ".nmea", ".log", ".xlsx", ".xls", ".parquet", ".jsonl"}
"""Endings of files with recorded data, which a new user passes in place of a config."""


def load(
    config: Path | Mapping[str, object] | Assembled,
    overrides: Sequence[str] = (),
    only: Sequence[str] = (),
    runs: int | None = None,
    seed: int | None = None,
    grid: Sequence[str] = (),
    product: bool = False,
    allow_plugins: bool = False,
    tuned_values: Mapping[str, Chosen] | None = None,
    filter_files: Sequence[Path] = (),
    quick: bool = False,
    tables: Mapping[str, object] | None = None,
    chosen: Sequence[Path] = (),
) -> Experiment:
    """Read and validate an experiment.

    Parameters
    ----------
    config
        path of the YAML file, a mapping, or a config put together by trackbench; paths in a file count
        from the file, those in a mapping from the working folder
    overrides
        assignments ``PATH=VALUE`` that replace values of the config
    only
        labels of the filters to run; default: all, or the config's ``only``
    runs, seed
        number of runs and seed; default: those of the config
    grid
        assignments of several values (``filters.HDEPF.F=0.5,0.9``) that add to the config's grid
    product
        if the config has no grid: every combination of the values of ``grid`` is a point
    allow_plugins
        run the code of all plugins and programs that the config names
    tuned_values
        results of tuning, by label and key
    filter_files
        Python files and programs with more filters; their code may run
    quick
        take few runs
    tables
        data from Python, by key of the target
    chosen
        files of the config whose code may run without ``allow_plugins``

    Returns
    -------
    Experiment
        the validated experiment

    Raises
    ------
    UserError
        with every mistake found
    """
    # Step 1: read the config.
    if isinstance(config, Assembled):
        source = copy.deepcopy(config.source)
        home = Path()
        chosen = (*chosen, *config.allowed)
    elif isinstance(config, Mapping):
        source = from_mapping(config)
        home = Path()
    else:
        check_is_config(config)
        source = read(config)
        home = config.parent
    if not isinstance(source.data, dict):
        raise UserError(source.problem((), "an experiment is a mapping of keys to values"))
    if "groups" in source.data and "scenario" not in source.data:
        message = "is a suite of problems, and no experiment; run it by `trackbench suite`"
        raise UserError(Problem(source.mark(("groups",)), "groups", message))
    source.programs = None if allow_plugins else {str(file.absolute()) for file in chosen}
    # Step 2: put it together: files that it includes, then options of the command line. A component
    # whose file cannot be read is an empty mapping from here on, so that the mistakes in the rest are
    # found, too.
    unread = inline_parts(source, home)  # reasons by the component's path
    runs_of_config = source.data.get("runs")
    added_labels = add_filters(source, filter_files)
    overridden = override_all(source, overrides)
    check_overridden_parts(source, overridden)
    for keys in overridden:
        is_of_added_filter = len(keys) > 1 and keys[1] in added_labels
        # With other keys the experiment is no longer the standard problem of its name.
        if keys[0] in PROBLEM_KEYS and not is_of_added_filter:
            source.data.pop("problem", None)
    set_runs(source, runs, seed, quick)
    if grid and not source.data.get("grid") and "product" not in source.data:
        override(source, ("product",), product, Mark("--product"))
    for axis in grid:
        add_axis(source, axis)
        source.data.pop("problem", None)  # a grid is no standard problem either
    set_only(source, only)
    show_filters(source, added_labels)
    add_tuned(source, tuned_values or {})
    add_smoothed(source)
    # Step 3: run the plugins' code, so that their kinds are known, and validate.
    plugins = load_plugins(source, home, allow_plugins, (*filter_files, *chosen))
    try:
        put_tables(source, tables or {})
        with unexpected_errors_as_mistakes(source.mark(()).file):
            experiment = validate(source, home, plugins)
    except UserError as error:
        if not unread:
            raise error from None
        raise with_unread_components(error, unread) from None
    if unread:  # the rest has no mistakes
        raise with_unread_components(UserError(), unread)
    # Step 4: note the number of runs of the config, or its default, if the options take fewer.
    is_recorded = any(p.scenario.recorded_runs is not None for p in experiment.points)
    if runs_of_config is None and not is_recorded:
        runs_of_config = Settings.runs
    if isinstance(runs_of_config, int) and runs_of_config > experiment.settings.runs:
        return replace(experiment, runs_of_config=runs_of_config)
    return experiment


def check_is_config(config: Path) -> None:
    """Raise UserError for a file of recorded data or of Python, and name the command that takes it."""
    if config.suffix.lower() == ".py" and config.is_file():
        name = shlex.quote(str(config))
        message = (
            f"is a Python file and no config; `trackbench check --contract {name}` checks its filters, "
            f"and `--filter {name}` runs them beside those of an experiment"
        )
        raise UserError(Problem(Mark(str(config)), "", message))
    if config.suffix.lower() not in _TABLE_SUFFIXES or not config.is_file():
        return
    command = f"trackbench new experiment --from {shlex.quote(str(config))}"
    message = f"is a file of data and no config; `{command}` writes a config that reads it"
    raise UserError(Problem(Mark(str(config)), "", message))
