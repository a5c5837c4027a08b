"""Options of a run, as Python takes them by keyword and the command line by name."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, get_args

from trackbench.commands.unknown_keywords import check_keywords
from trackbench.errors import Mark, Problem, UserError
from trackbench.execution.engines import Engine, cpu_count

_LISTS = ("set", "only", "grid", "formats", "filters")
FORMATS = ("png", "svg", "pdf", "tex")
"""Formats of figure and table files."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a run. Those from `out` on, but `filters`, change no number."""

    set: Sequence[str] = ()
    """values for keys of the config, each as `PATH=VALUE`"""
    only: Sequence[str] = ()
    """labels of the filters that run; default: all"""
    measurements: Any = None
    """recorded measurements, in place of those in a file: a data frame, a mapping of columns, an array
    `(steps, n_z)` or `(runs, steps, n_z)`, or a list with one of these for each sensor"""
    truth: Any = None
    """true states that belong to `measurements`: a data frame, a mapping of columns, or an array
    `(steps, n_x)` or `(runs, steps, n_x)`"""
    runs: int | None = None
    """number of Monte Carlo runs; default: that of the config"""
    quick: bool = False
    """20 runs, or all recordings if there are fewer; `runs` sets another number"""
    seed: int | None = None
    """seed of all random numbers; default: that of the config"""
    grid: Sequence[str] = ()
    """values of keys, each as `PATH=V1,V2,...`, `PATH=a..b:n` or `PATH=log:a..b:n`; the experiment runs
    at all of them; an error if the config has the key `tune`"""
    product: bool = False
    """if `grid` has keys of several filters, run every combination of their values; by default the
    filters vary one after the other, while each other filter keeps the first of its values"""
    out: Path | str | None = None
    """results folder, by default `results/NAME`, and of `sweep` `results/NAME-sweep`; if several
    experiments run, the folder in which each of them gets a results folder"""
    engine: Engine = "processes"
    """where blocks are computed: `processes`, `serial` or `dask`"""
    workers: int | None = None
    """number of worker processes; default: one for each processor"""
    scheduler: str | None = None
    """address of a dask cluster, `tcp://host:port`"""
    fresh: bool = False
    """compute and draw everything again, in place of reading it from the cache"""
    times: bool = True
    """measure CPU times again after the runs, with the filters in turns; this is done only if a table, a
    figure, a published number or a claim needs CPU times; with `False` the CPU times are those measured
    while the blocks were computed"""
    save_tracks: bool = False
    """write the truth, measurements and estimates of every run to `tracks.npz`"""
    formats: Sequence[str] = ("png", "svg")
    """formats of figures and tables: `png`, `svg`, `pdf`, `tex`"""
    allow_plugins: bool = False
    """run the code of the config's plugins"""
    filters: Sequence[Path | str] = ()
    """Python files whose filters run beside those of the config, each labelled with the
    `kind` that its class registers; you permit the code of these files to run, even without
    `allow_plugins`"""
    quiet: bool = False
    """print no progress and no notes"""
    spare: bool = False
    """if the results folder has results of more runs, keep them and write to `NAME-quick/` beside it"""
    shard: str = ""
    """`i/n`: compute the i-th of n parts of the blocks into the cache, and write no results; only for
    `run_all`"""

    def __new__(cls, **options: Any) -> "Options":
        """Return options to initialize; raises UserError for a wrong name."""
        check_keywords("Options", options, [field.name for field in fields(cls)])
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Take whole numbers of numpy; raise UserError for values that no option has."""
        for name in ("runs", "seed", "workers"):
            value = getattr(self, name)
            if not isinstance(value, bool | int) and hasattr(value, "__index__"):
                object.__setattr__(self, name, value.__index__())
        for name in _LISTS:
            check_list(name, getattr(self, name))
            object.__setattr__(self, name, tuple(getattr(self, name)))
        check_formats(self.formats)
        if self.engine not in get_args(Engine):
            message = f"{self.engine!r} is not one of {', '.join(get_args(Engine))}"
            raise UserError(Problem(Mark("engine="), "", message))
        workers = self.workers
        is_number = isinstance(workers, int) and not isinstance(workers, bool)
        if workers is not None and not (is_number and workers >= 1):
            message = f"{workers!r} is no number of processes; write a whole number from 1 on"
            raise UserError(Problem(Mark("workers="), "", message))

    def changed(self, changes: Mapping[str, Any]) -> "Options":
        """Return the options with changes by name; raises UserError for a wrong name."""
        return replace(self, **changes)


def check_list(name: str, value: object) -> None:
    """Raise UserError for one text or a mapping as the option ``name``, where a list is needed."""
    if isinstance(value, str | Path):
        message = f"{str(value)!r} is one word; write a list: {name}=[{str(value)!r}]"
        raise UserError(Problem(Mark(f"{name}="), "", message))
    if isinstance(value, Mapping) or not isinstance(value, Iterable):
        message = f"is of the type {type(value).__name__}; write a list of words"
        if name in ("set", "grid"):
            message += f": {name}=['PATH=VALUE']"
        raise UserError(Problem(Mark(f"{name}="), "", message))


def check_formats(formats: Iterable[str]) -> None:
    """Raise UserError for a format of files that does not exist."""
    for word in formats:
        if word not in FORMATS:
            message = f"{word!r} is not one of {', '.join(FORMATS)}"
            raise UserError(Problem(Mark("formats="), "", message))


OPTION_NAMES = tuple(field.name for field in fields(Options))
"""Names of the options, which Python functions take as keywords."""


def most_workers(options: Options) -> int:
    """Return the largest number of worker processes: the option, or one for each processor."""
    if options.engine == "serial":
        return 1
    return options.workers or cpu_count()


def say(text: str, options: Options) -> None:
    """Print a line for the user unless ``quiet``."""
    if not options.quiet:
        print(text, file=sys.stderr)
