"""A gate for continuous integration: is a filter worse than stored, or than at a git revision?"""

import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from trackbench.commands.compare_new_with_stored import Limit, Verdict, compare_results
from trackbench.commands.git_revision import checked_out
from trackbench.commands.read_experiment import file_of, prepare
from trackbench.commands.run_experiment import run_all
from trackbench.commands.run_options import Options
from trackbench.errors import Mark, Problem, UserError
from trackbench.report.folder_check import open_results
from trackbench.report.tables_and_figures import Results

_LIMIT = re.compile(r"(\d+(?:\.\d+)?)sigma(?:,(\d+(?:\.\d+)?)%)?")
_DEFAULT_PERCENT = "0.01"
"""Percent of a value that matters, of a limit without one."""


def limit_of(text: str) -> Limit:
    """Parse the limit of a gate, ``3sigma`` or ``3sigma,1%``; raises UserError for another text.

    The first number is a rate of false alarms, as standard deviations of a normal tail. The second is
    the share of a value that a difference must exceed.
    """
    match = _LIMIT.fullmatch(text.replace(" ", ""))
    if match is None:
        message = "is no limit such as 3sigma, or 3sigma,1% (both must be exceeded)"
        raise UserError(Problem(Mark(f"--worse {text}"), "", message))
    sigmas, percent = match.groups(default=_DEFAULT_PERCENT)  # only the percent may be missing
    return Limit(sigmas=float(sigmas), share=float(percent) / 100.0)


def gate(
    config: Path, options: Options, limit: Limit, against: Path | None = None, ref: str = "",
    file: Path | None = None, cost: float = 0.0, allow_removed: bool = False,
) -> Verdict:  # fmt: skip
    """Run a config and compare it with stored results, or with the config at a git revision.

    Results of runs go into a temporary folder; nothing else is written but the cache.

    Parameters
    ----------
    config
        the config to run; with ``file``, a Python file, its filters run beside the config's
    options
        options of both runs
    limit
        false alarm rate, and the share of a value that matters
    against, ref
        the stored results, or the git revision to compare with; the caller names one of the two
    cost
        largest ratio of new to old costs, which are CPU times and numbers of evaluations; 0 compares
        none
    allow_removed
        filters, points and numbers that are gone are a note and not a failure
    """
    # The path of a shipped experiment, if the config names one. `file_of` returns no path only for a
    # config that is none; `str` is for the type alone.
    config = Path(str(file_of(config, options)))
    # CPU times are measured only to compare them; no formats: figures are not drawn.
    options = replace(options, times=cost > 0.0, formats=())
    new_options = replace(options, filters=[file] if file else [])
    name = prepare(config, new_options).settings.name
    with TemporaryDirectory() as home:
        if against is not None:
            # The folder is one of results, or contains those of several experiments.
            folder_of_config = against / name
            has_results = (folder_of_config / "config.yaml").is_file()
            stored = open_results(folder_of_config if has_results else against)
        else:
            with checked_out(ref, config, file, Path(home)) as (old_config, old_files):
                old_options = replace(options, filters=old_files)
                # The results of the revision take the place of stored ones.
                stored = _run(old_config, old_options, Path(home, "old"))
        new = _run(config, new_options, Path(home, "new"))
        verdict = compare_results(stored, new, limit, cost)
    if not allow_removed or not verdict.removed:
        return verdict
    notes = verdict.notes + [f"{removed}: removed" for removed in verdict.removed]
    return verdict._replace(removed=[], notes=notes)


def _run(config: Path, options: Options, folder: Path) -> Results:
    """Run a config without its figures into ``folder``; return its results."""
    overrides = ("figures={}", "key_figure=null", *options.set)
    # One config gives one report.
    (report,) = run_all([config], replace(options, set=overrides, out=folder))
    return report.results
