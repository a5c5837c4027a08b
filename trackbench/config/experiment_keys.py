"""Settings at the top level of an experiment file: keys, types, defaults and texts."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge
from pydantic import AfterValidator, StringConstraints

from trackbench.config.tuning import Tuning
from trackbench.field_types import LEGEND_LABEL, Count, Natural, is_number
from trackbench.yaml_scalars import scalar

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)]


def _check_error(value: float | str) -> float | str:
    """Check a requested standard error, a number or a share such as ``1%``, and return it unchanged.

    Raises ValueError unless it is above 0 and finite.
    """
    number = 0.0  # a word that is no share is rejected, as 0 is
    if not isinstance(value, str):
        number = value
    elif value.endswith("%"):
        percent = scalar(value.removesuffix("%").strip())
        if is_number(percent):
            number = percent
    if not 0.0 < number < float("inf"):
        raise ValueError("give a number greater than 0, or a share of the value such as 1%")
    return value


Error = Annotated[float | str, AfterValidator(_check_error)]
"""Standard error that a number may have: 0.02, or 1% of the number."""
Share = Annotated[float | str, AfterValidator(_check_error)]
"""A share of a number: 0.05, or 5%."""
_DEFAULT_TUNING = Tuning()
Label = Annotated[str, StringConstraints(pattern=LEGEND_LABEL, max_length=80)]


@dataclass(frozen=True, kw_only=True)
class StandardProblem:
    """Mark of an experiment that is cited by name and version."""

    version: Count
    """version, raised with every change that moves a number"""
    reference: Label | None = None
    """label of the filter or bound that listings compare errors with; default: `reference` or `bound`"""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The top level of an experiment file."""

    name: Name
    """name of the experiment, and of its folder under results/"""
    title: str = ""
    """one line for people; {runs} stands for the number of runs, here and in titles of exhibits"""
    paper: str = ""
    """paper that it reproduces: authors and title"""
    problem: StandardProblem | None = None
    """mark of a standard problem, cited as trackbench/NAME vVERSION: {version: 1}"""
    seed: Natural = 0
    """seed of every random number"""
    runs: Count = 100
    """Monte Carlo runs; with `until` the largest number of runs"""
    until: dict[str, Error] = field(default_factory=dict)
    """standard errors that end the runs once every filter reaches them: {rms(rmse): 1%, anees: 0.02}"""
    min_runs: Count = 1000
    """with `until`: runs before the first check of those errors; fewer may miss a rare far run"""
    verdict_seeds: Count = 4
    """batches of runs, each with its own random streams; a verdict on a published number must hold
    without any one of them"""
    block: Count | Literal["fit"] | None = None
    """runs computed together; default: about 32 000 particles at a time, from each filter's N, whatever
    the number of runs, so that runs can be added later; fit: at most `runs`, in equal blocks"""
    scenario: dict[str, object]
    """simulated scenario: kind and keys, a path, or {use: path, key: value}"""
    filters: dict[Label, dict[str, object]]
    """filters by label, each given as the scenario is"""
    reference: Label | None = None
    """label of the filter that RMS differences are measured from"""
    only: list[Label] = field(default_factory=list)
    """labels of the filters to run, beside the reference; default: all"""
    bound: Label | None = None
    """label of the scenario's lower bounds in tables and figures; default: they are left out"""
    exact: list[Label] = field(default_factory=list)
    """labels of linear filters whose exact errors stand beside the measured ones; default: none"""
    smoothed: list[Label] = field(default_factory=list)
    """labels of filters whose smoothers run beside them, as `EKF, smoothed`; default: none"""
    matters: Share | None = None
    """share of an error below which a significant difference is called tiny, such as 5%; default: 1%"""
    hold_out: Annotated[int, Ge(2)] | None = None
    """hold back every n-th measurement of a run from the filters, and predict it instead, such as 5"""
    medians: list[str] = field(default_factory=list)
    """series whose median per step is computed, such as nees"""
    metrics: list[str] | None = None
    """metrics kept in CSV files, without statistic and window: rmse_position; default: all computed"""
    per_step: list[str] | None = None
    """metrics kept in per_step.csv, such as bias_x; default: as `metrics`"""
    grid: dict[str, list[object]] = field(default_factory=dict)
    """values by path; `a & b` take a value together, or one each of a list [1, 2]"""
    product: bool = True
    """run every combination of the grid's values; else vary the keys of one filter after the other, at
    the first values of the other filters, as a sweep does"""
    tune: dict[Label, dict[str, object]] = field(default_factory=dict)
    """keys that are tuned, by filter: {KF: {assume.motion.q: log:1e-6..10}}; a..b, log:a..b or a list
    of choices. The best values are run as one more filter, `KF (tuned)`"""
    tuning: Tuning = _DEFAULT_TUNING
    """metric of tuning, number of training runs and of evaluations"""
    tables: dict[Name, dict[str, object]] = field(default_factory=dict)
    """tables to write, by name"""
    figures: dict[Name, dict[str, object]] = field(default_factory=dict)
    """figures to draw, by name"""
    key_figure: Name | None = None
    """name of the figure at the top of the report; default: the first"""
    published: list[str] = field(default_factory=list)
    """CSV files of published numbers and claims that the results are checked against"""
    plugins: list[str] = field(default_factory=list)
    """Python files with your filters or scenarios; loaded with --allow-plugins only"""
    files: list[str] = field(default_factory=list)
    """data files and folders that plugins and programs read, such as weights; cached blocks depend on
    them"""
    environment: list[str] = field(default_factory=list)
    """environment variables that plugins and programs read; cached blocks depend on their values"""
