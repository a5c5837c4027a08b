"""Keys of a suite file: its groups, their rosters, and problems."""

from dataclasses import dataclass, field

from trackbench.config.experiment_keys import Label, Name
from trackbench.field_types import Count, Natural


@dataclass(frozen=True, kw_only=True)
class SuiteProblem:
    """A problem of a suite: the scenario of an experiment, with changes."""

    class_: str
    """class of the problem in tables and figures: linear, bearings, chaotic"""
    use: str | None = None
    """name of a shipped experiment, or path of an experiment file; default: the problem's name"""
    title: str = ""
    """one line for people; default: the title of the experiment"""
    runs: Count | None = None
    """Monte Carlo runs; default: those of the suite"""
    quick: bool = True
    """whether `--quick` runs it, too; a problem that takes long may be left out"""
    set: dict[str, object] = field(default_factory=dict)
    """changes of the experiment, by path: {scenario.last: 100}"""
    score: str | None = None
    """what filters are ranked by, such as rms(rmse_state); default: the rms of the first error"""
    reference: Label | None = None
    """filter of the experiment, or its bound, that errors are compared with beside the best"""
    filters: dict[Label, object] = field(default_factory=dict)
    """filters that only this problem has, or other keys for filters of the roster"""
    tune: dict[Label, dict[str, object]] = field(default_factory=dict)
    """keys that are tuned on this problem, by filter, as in an experiment"""


@dataclass(frozen=True, kw_only=True)
class SuiteGroup:
    """Problems with one roster of filters: one matrix of problems and filters."""

    title: str
    """one line for people"""
    filters: dict[Label, object]
    """the roster, as the filters of an experiment"""
    smoothed: list[Label] = field(default_factory=list)
    """filters whose smoothers run beside them; smoothers are ranked apart"""
    tune: dict[Label, dict[str, object]] = field(default_factory=dict)
    """keys that are tuned on each problem, by filter; the tuned filter takes the original's place"""
    tuning: dict[str, object] = field(default_factory=dict)
    """number of trials and of training runs, as in an experiment"""
    problems: dict[Name, SuiteProblem]
    """problems by name"""


@dataclass(frozen=True, kw_only=True)
class SuiteSettings:
    """The top level of a suite file."""

    name: Name
    """name of the suite, and of its folder under results/"""
    title: str = ""
    """one line for people"""
    version: Count = 1
    """version, raised with every change that moves a number"""
    seed: Natural | None = None
    """seed of every problem; default: that of its experiment"""
    runs: Count = 50
    """Monte Carlo runs of each problem; a recording has its own number"""
    plugins: list[str] = field(default_factory=list)
    """Python files with kinds of filters or other components of your own, which all problems may use;
    paths count from the suite's file, and the code runs only with --allow-plugins"""
    groups: dict[Name, SuiteGroup]
    """groups of problems by name"""
