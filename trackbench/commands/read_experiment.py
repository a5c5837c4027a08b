"""Experiment of a config, read with the options of a run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trackbench.commands.run_options import Options, say
from trackbench.config import load as configurations
from trackbench.config.experiment import Experiment
from trackbench.config.python_tables import name_rows, tables_by_key
from trackbench.config.shipped_experiments import located
from trackbench.config.tuned_filters import Chosen
from trackbench.errors import Mark, Problem, UserError
from trackbench.yaml_source import Assembled, Config


def file_of(config: Config, options: Options) -> Path | Mapping[str, Any] | Assembled:
    """Find the path of a config file or of the shipped experiment of this name.

    A config that is a mapping, or was assembled by a suite, is returned as it is.
    """
    if isinstance(config, Mapping | Assembled):
        return config
    if not isinstance(config, str | Path):
        message = f"a config is a path, a name or a mapping, and no {type(config).__name__}"
        raise UserError(Problem(Mark("config"), "", message))
    if "\n" in str(config):
        message = "a config is a path, a name or a mapping; read a text by yaml.safe_load(text)"
        raise UserError(Problem(Mark("config"), "", message))
    return located(Path(config), lambda line: say(line, options))


def prepare(
    config: Config, options: Options, tuned: Mapping[str, Chosen] | None = None
) -> Experiment:
    """Read and validate a config with the options' overrides; raises UserError with its mistakes.

    ``tuned`` are the values that tuning chose for the keys of filters, by label.
    """
    try:
        return configurations.load(
            file_of(config, options),
            overrides=options.set,
            only=options.only,
            runs=options.runs,
            seed=options.seed,
            grid=options.grid,
            product=options.product,
            allow_plugins=options.allow_plugins,
            tuned_values=tuned,
            filter_files=[Path(file) for file in options.filters],
            quick=options.quick,
            tables=tables_by_key(options.measurements, options.truth),
        )
    except UserError as error:
        name_rows(error)  # mistakes in tables from Python have no line of a file
        raise
