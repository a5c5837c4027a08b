"""Declared metrics: the series each is made of, its unit, and the better direction.

A series is an array (T + 1, M). A metric is made of one over the steps of a run (per_run.csv) and over
the runs at a step (per_step.csv). What nobody registers, such as a note of a filter of one's own, is
the mean of the series of its own name.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

from trackbench.units_of_components import UNITS_OF_QUANTITIES, without_unit
from trackbench.units_of_components import quantity as quantity

Better = Literal["lower", "higher", "zero", "one", ""]


@dataclass(frozen=True)
class Metric:
    """A metric, or a family with a member for each quantity: ``rmse_position``."""

    name: str
    """as in the files, without quantity and window"""
    help: str = ""
    """one line for people"""
    unit: str = ""
    """its unit; `quantity` is that of the quantity that follows the name"""
    better: Better = ""
    """lower, higher, nearer zero, nearer one; nothing if it only describes"""
    series: str = ""
    """head of the series of errors that it is made of; a note is its own series"""
    over_steps: Literal["mean", "rms", "root", "sum", "last", ""] = "mean"
    """what a run's number is of the steps' values; nothing if it has none"""
    over_runs: Literal["mean", "rms", "std", ""] = "mean"
    """what a step's number is of the runs' values; nothing if it has none"""
    per_component: bool = False
    """whether it is divided by the number of components"""
    on_request: bool = False
    """whether it is stored only where `metrics` names it"""
    is_event: bool = False
    """whether a run has it or has not, so that the mean is a share of the runs"""

    @property
    def more_is_better(self) -> bool:
        """True if the larger of two values is the better one."""
        return self.better == "higher"

    @property
    def is_score(self) -> bool:
        """True if the metric is an average of logarithms, so that ratios are meaningless."""
        return self.series.endswith("log_likelihood")

    @property
    def is_family(self) -> bool:
        """True if a quantity may follow the name."""
        return self.unit == "quantity" or self.series in _FAMILIES


METRICS: dict[str, Metric] = {}
"""Every metric of which something is known."""


def metric(name: str, help: str, unit: str = "", better: Better = "") -> None:
    """Declare a metric of a plugin: a filter's diagnostic or a scenario's run metric.

    Parameters
    ----------
    name
        name of the metric in the files, without window
    help
        one line for people
    unit
        unit of the metric, such as ``m/s``; empty if it has none
    better
        better direction: ``lower``, ``higher``, nearer ``zero`` or nearer ``one``; empty if the metric
        only describes

    Raises
    ------
    ValueError
        if the name is one of the package's own, or ``better`` is an unknown direction
    """
    if name in _PACKAGE or is_reserved(name):
        raise ValueError(f"there is a metric {name!r} already")
    if better not in get_args(Better):
        known = ", ".join(filter(None, get_args(Better)))
        raise ValueError(f"better={better!r} is none of {known}, or nothing")
    METRICS[name] = Metric(name, help, unit, better)


def joined(prefix: str, quantity: str) -> str:
    """Write ``prefix_quantity``; the prefix alone for a scenario's only, nameless quantity."""
    return f"{prefix}_{quantity}" if quantity else prefix


def in_window(name: str, window: str) -> str:
    """Write ``name[window]``: a metric over a window of steps; the name alone over the whole time."""
    return f"{name}[{window}]" if window else name


def metric_of(name: str) -> tuple[Metric, str]:
    """Split the name of a metric, without window, into its declaration and the quantity.

    ``rmse_position`` is the metric ``rmse`` of the quantity ``position``. The quantity is empty for a
    metric that has none. A name that nobody declares gives a metric without unit and direction.
    """
    # A declared name has no quantity, even if it has an underscore, as `log_score`.
    head, _, quantity = name.partition("_")
    if name not in METRICS and head in METRICS and METRICS[head].is_family:
        return METRICS[head], quantity
    return METRICS.get(name) or Metric(name), ""


def stored_metric(name: str) -> str:
    """Return the name of the stored metric that a metric's number is from.

    It is ``nees`` for ``anees``, and ``pit_x`` for ``rank_x_1``, a bar of the rank histogram of x.

    Parameters
    ----------
    name
        name of a metric without statistic, window and step

    Returns
    -------
    str
        name of the stored metric; ``name`` itself for a metric that is stored as it is
    """
    metric, quantity = metric_of(name)
    # Each bar `rank_x_1` of a histogram is stored under its transform `pit_x`.
    if metric.name == "rank":
        return joined("pit", quantity.rpartition("_")[0])
    # The number of components that a NEES lacks is stored under the name of the NEES.
    if metric.name == "unused":
        return quantity
    # An ANEES is computed from the NEES.
    if metric.per_component:
        return joined(metric.series, quantity)
    return name


def metrics_of(series: str, counts: Collection[str] = ()) -> Iterator[tuple[Metric, str]]:
    """Yield each metric that is computed from a series, and the metric's name with the quantity.

    Parameters
    ----------
    series
        name of a series (T + 1, M) of a filter: of errors, such as ``squared_position``, or a diagnostic
    counts
        names of diagnostics that are summed over the steps of a run in place of averaged

    Yields
    ------
    metric : Metric
        declaration of the metric
    name : str
        name of the metric, such as ``rmse_position``
    """
    # A series of errors (`squared`), of one quantity's errors (`squared_position`), or a diagnostic,
    # which is a metric itself.
    head, _, quantity = series.partition("_")
    if series in _OF_SERIES:
        yield from ((m, m.name) for m in _OF_SERIES[series])
    elif head in _OF_SERIES:
        yield from ((m, joined(m.name, quantity)) for m in _OF_SERIES[head])
    else:
        diagnostic, _ = metric_of(series)
        if series in counts:
            diagnostic = replace(diagnostic, over_steps="sum")
        yield diagnostic, series


def is_reserved(name: str) -> bool:
    """Test whether a diagnostic of this name would be taken for a metric or series of the errors."""
    taken = {word for m in METRICS.values() if m.series for word in (m.name, m.series)}
    return name in taken or name.startswith(tuple(f"{word}_" for word in taken))


NAME_OF_PREDICTION = (
    "as rmse_predicted_x and rmse_held_x are the errors of predictions of x; choose another name"
)
"""Reason why an error against the truth, or a component, cannot have a name."""


def is_of_prediction(quantity: str) -> bool:
    """Test whether a quantity is the prediction error of a measured component: ``predicted_range``.

    A quantity ``held_range`` is that of the held-out measurements.
    """
    return quantity.startswith(("predicted_", "held_"))


def unit_of(name: str) -> str:
    """Look up the unit of a metric.

    Parameters
    ----------
    name
        name of the metric without statistic, window and step, such as ``rmse_position``

    Returns
    -------
    str
        unit of the metric, such as ``m``; empty if none is known
    """
    metric, quantity = metric_of(name)
    # The unit `quantity` stands for the unit of the quantity that the name ends in. A name without a
    # quantity, such as `rmse` alone, then has none.
    if metric.unit != "quantity" or not quantity:
        return metric.unit.replace("quantity", "")
    # `rmse_predicted_range` is of a measured component, and so is `rmse_predicted_2.range`, of the
    # second of several sensors.
    if is_of_prediction(quantity):
        _, _, component = quantity.partition("_")
        quantity = component.rpartition(".")[2]
    _, unit_in_name = without_unit(quantity)
    return UNITS_OF_QUANTITIES.get(quantity) or unit_in_name


_ERROR_METRICS = [
    Metric("rmse", "root mean square length of the error", "quantity", "lower",
           "squared", over_steps="rms", over_runs="rms"),
    Metric("mse", "mean square length of the error", "", "lower", "squared", on_request=True),
    Metric("mae", "mean length of the error (of one component its size)", "quantity", "lower",
           "squared", over_steps="root", over_runs="", on_request=True),
    Metric("rmsd", "root mean square difference from the reference's estimate", "quantity", "lower",
           "rmsd", over_steps="rms", over_runs="rms"),
    Metric("efficiency", "RMSE of the reference over the filter's, by its distance to it", "1", "higher",
           "rmsd", over_steps="", over_runs=""),
    Metric("damage", "mean length of the error less that of the same filter without faults", "quantity",
           "lower", "damage"),
    Metric("bias", "mean signed error, estimate minus truth", "quantity", "zero", "error"),
    Metric("std", "standard deviation of the error over the runs", "quantity", "lower",
           "error", over_steps="", over_runs="std"),
    Metric("nees", "normalized estimation error squared; of n components n if consistent", "", "",
           "nees", over_runs=""),
    Metric("anees", "mean NEES over the number of components", "", "one",
           "nees", over_steps="", per_component=True),
    Metric("unused", "components that a NEES or NIS lacks: known exactly, or not measured", "1", "",
           "unused", over_steps=""),
    Metric("outside_region", "share of steps outside the filter's own 1 - 1e-6 region", "1", "lower",
           "outside_region"),
    Metric("lost", "why a run is lost: 1 estimate or 3 truth not finite, 2 error too far; 0 it is not",
           "", "", "lost", is_event=True),
    Metric("log_score", "mean log-density that measurements were given, nats", "", "higher",
           "log_likelihood"),
    Metric("held_log_score", "the same of measurements that are held out", "", "higher",
           "held_log_likelihood"),
    Metric("anis", "normalized innovation squared over the number of components", "", "one",
           "anis", over_steps=""),
    Metric("innovations", "measured components of a run", "1", "", "innovations", over_steps="sum"),
    Metric("pit", "probability below the truth, uniform if calibrated (of a cloud its rank)", "1", "",
           "pit"),
    Metric("coverage", "share of truths in the region of so many percent", "1", "", "coverage"),
    Metric("nci", "non-credibility index: log of the NEES less its mean if consistent", "dB", "zero",
           "nci"),
    Metric("crps", "continuous ranked probability score of a component", "quantity", "lower", "crps"),
    Metric("likelihood_ratio", "likelihood of all measurements over the reference's", "1",
           "one", "likelihood_ratio", over_steps="last"),
    Metric("rank", "share of truths whose rank is in that tenth", "1", "", "rank"),
    Metric("autocorrelation", "of whitened innovations, by lag", "1", "zero",
           "autocovariance", over_steps="", over_runs=""),
]  # fmt: skip
FIRST_INDEFINITE = "first_indefinite_step"
"""Metric that a filter has if in any run its covariance is not positive definite."""
_NOTED = """
diverged      | 1 | lower  | share of runs whose last ten estimates are outside that region
peak          | quantity | lower | largest error of a run
beyond_10_sigma | 1 | lower  | share of runs off by more than ten sigmas of a measurement
overshoot_m   | m | zero   | mean error along a turn's acceleration after its end
settling_s    | s | lower  | time from a turn's end until the position error stays within the limit
not_settled   | 1 | lower  | share of runs whose error is above the limit as the next turn begins
detection_delay_s       | s | lower  | time from an onset to the maneuvering mode
missed_maneuvers | 1 | lower  | share of legs that went by without the maneuvering mode
already_maneuvering    | 1 | lower  | share of legs before which the maneuvering mode was on
onset_error_s | s | zero   | estimated minus true onset
onset_abs_error_s   | s | lower  | size of the estimated onset's error
onset_age_s   | s |        | time since the estimated onset when it is detected
false_maneuvers_per_1000 | 1 | lower | alarms per 1000 quiet samples
nis           |   |        | normalized innovation squared; of n components that are used n if consistent
gated         | 1 |        | measurements of a run that the gate refused
measurement_weight | 1 | | weight of a measurement in a robust update: 1 as without, 0 if refused
rejected_good | 1 | lower  | share of the measurements without a fault that the gate refused
accepted_bad  | 1 | lower  | share of the measurements with a fault that the gate let in
arrived_late  | 1 |        | measurements of a run that arrive after their step
late_dropped  | 1 | lower  | late measurements of a run that the filter drops
recovery_s    | s | lower  | time from a fault's end until its excess error stays within the limit
not_recovered | 1 | lower  | share of runs whose excess error is above the limit at the end
mode          | 1 |        | weight of the maneuvering mode
alarm         | 1 |        | decisions in a run that a maneuver has begun
alarm_age_s   | s |        | time since the onset that an alarm takes for true
zeta          |   |        | significance of the oldest onset's input; 2 in straight flight
zeta_beyond   | 1 |        | share of steps with zeta beyond its law's 10 % point
first_indefinite_step | 1 | | first step of a run at which the covariance is not positive definite
collapsed_steps    | 1 | lower  | steps of a run at which no particle had a weight
ess           | 1 | higher | effective sample size before resampling, as a share of N
distinct_particles | 1 | higher | share of the particles that are no copies
acceptance_rate | 1 |        | share of the trials that are accepted
spread_ratio  | 1 |        | spread of the cloud after its evolution over that before
"""
_EVENTS = [
    "diverged",
    "not_recovered",
    "not_settled",
    "beyond_10_sigma",
    "missed_maneuvers",
    "already_maneuvering",
]


def _noted() -> Iterator[Metric]:
    for line in _NOTED.strip().splitlines():
        name, unit, better, text = (cell.strip() for cell in line.split("|"))
        yield Metric(name, text, unit, cast(Better, better), is_event=name in _EVENTS)


_FAMILIES = ("squared", "nees", "unused", "autocovariance", "rmsd", "pit", "coverage", "rank")
METRICS.update({m.name: m for m in (*_ERROR_METRICS, *_noted())})
_OF_SERIES: dict[str, list[Metric]] = {}
"""The metrics that a series of errors is made into."""
for _metric in _ERROR_METRICS:
    _OF_SERIES.setdefault(_metric.series, []).append(_metric)
_PACKAGE = frozenset(METRICS)
