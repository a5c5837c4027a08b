"""Read a suite with the options of a run, and the options of its experiments."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trackbench.commands.output_folder import suite_folder
from trackbench.commands.run_options import Options
from trackbench.config.quick_run import FIT
from trackbench.config.suite import Suite, load_suite
from trackbench.errors import Mark, Problem, UserError

_UNUSED = ("measurements", "truth", "grid", "product")
"""Options of experiments that a suite does not have."""


def prepare_suite(file: Path, options: Options, problems: Sequence[str] = ()) -> Suite:
    """Read and validate a suite with the options' overrides; ``problems`` names those to run.

    Raises UserError for mistakes in the suite, and for options that only experiments have.
    """
    for name in _UNUSED:  # options of experiments that a suite does not have
        if getattr(options, name):
            message = "`trackbench suite` has no such option; use `trackbench run`"
            raise UserError(Problem(Mark(f"--{name}"), "", message))
    # On the command line --quick adds the override FIT, block=fit. A suite has no such key, and each of
    # its problems has this value anyway.
    overrides = [text for text in options.set if text != FIT]
    return load_suite(
        file,
        overrides=overrides,
        only=options.only,
        chosen_problems=problems,
        runs=options.runs,
        seed=options.seed,
        quick=options.quick,
        filter_files=[Path(path) for path in options.filters],
        allow_plugins=options.allow_plugins,
    )


def options_of_jobs(suite: Suite, options: Options) -> Options:
    """Return the options with which the suite's experiments are run.

    Options that change a config, such as ``filters``, are reset: the suite has put them into the
    experiments' configs. So is ``spare``, which would keep results of more runs and write to another
    folder.
    """
    folder = suite_folder(suite, options)
    # `choose_folder` adds each experiment's name to the folder of several, but not to that of a single
    # one.
    if len(suite.problems) == 1:
        folder = folder / suite.problems[0].name
    return replace(
        options,
        set=(),
        only=(),
        runs=None,
        seed=None,
        quick=False,
        spare=False,
        filters=(),
        out=folder,
    )
