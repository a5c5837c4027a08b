"""Figure kind `tuning`: the objective over each key that was tuned."""

from dataclasses import dataclass
from math import isfinite, nan
from typing import Any, ClassVar

from trackbench.config.tuning import tuned_label
from trackbench.config.tuning_axes import Axis
from trackbench.config.tuning_objective import objective_label, objective_target
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import measured
from trackbench.registry import register
from trackbench.report.findings import grid_headings, metric_phrases, phrases
from trackbench.report.findings.phrases import joined, named
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_colors, style
from trackbench.report.plotting.panels import add_title_and_legend, panel_grid
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables.tuning import words_of
from trackbench.report.tables_and_figures import Results
from trackbench.tuning.range_of_good_values import values_within_stderr
from trackbench.tuning.record_of_trials import Record

_SPREADS = 3.0
"""Spreads of the best half of the trials above their median, up to which the axis shows trials."""
_NEAR = "Within 1 standard error of the best"
_BARS = 4.0
"""Standard errors above the best trial that the axis shows at least."""


@register("figures", "tuning")
@dataclass(frozen=True, kw_only=True)
class TuningFigure(FigureKind):
    """Every trial of a filter over each of its keys; the best, and what is within its standard error.

    Trials in which runs were lost are crosses. Triangles stand for trials far above the axis.
    """

    label_keys: ClassVar[tuple[str, ...]] = ("filter",)

    filter: str
    """label of the filter that is tuned"""

    def default_caption(self, results: Results) -> str:
        """Return filter, keys, number of trials and of runs, and what shades and marks mean."""
        record = results.tuning.get(self.filter)
        if record is None:
            return ""
        settings = results.config["tuning"]
        keys = joined(axis.key for axis in record.axes)
        trials = f"{counted(len(record.trials), 'trial')} of {counted(settings['runs'], 'run')}"
        metric = words_of(settings["metric"])
        caption = f"{named(self.filter)}: {metric} over {keys} in {trials}."
        caption += " The diamond is the best trial."
        if _has_spread(record):
            caption += " Shaded is what is within its standard error."
        objectives = [x.objective for x in record.trials if isfinite(x.objective)]
        if objectives and max(objectives) > _limit_of_axis(objectives, record.best.stderr):
            caption += " Triangles stand for trials above the axis."
        return caption

    def draw(self, results: Results) -> Figure:
        """Return a panel per key that was tuned; no panel if the filter was not tuned."""
        record = results.tuning.get(self.filter)
        axes = () if record is None else record.axes
        # Rows of 2.4 inches, and 0.5 inches for titles. Blank panels may fill the last row.
        figure, panels = panel_grid(len(axes), 2.4, 0.5)
        for ax, axis in zip(panels, axes, strict=False):
            _draw_panel(ax, results.tuning[self.filter], axis)
            ax.set_xlabel(style.wrap_label(self._label_of_key(results, axis.key), 40))
        figure.supylabel(
            style.wrap_label(axis_of_objective(results.config["tuning"]["metric"]), 32)
        )
        title = self.title or style.wrap_label(f"Tuning of {self.filter}", 80)
        return add_title_and_legend(figure, title)

    def _label_of_key(self, results: Results, key: str) -> str:
        """Return the label of an axis: ``sigma of sensor 1 (m)`` for ``assume.sensor.0.sigma``.

        ``key`` is the path of the key in the filter's entry of the config.
        """
        keys = [int(word) if word.isdigit() else word for word in key.split(".")]
        name, unit = grid_headings.quantity(str(keys[-1]))
        owner = str(keys[-2]) if len(keys) > 1 else ""
        if owner.isdigit():
            owner = f"{str(keys[-3]).removesuffix('s')} {int(owner) + 1}"
        if owner and owner != "assume":
            name = f"{name} of {owner}"
        # The entry of the tuned filter has the model with the key, which the filter may lack.
        label = tuned_label(self.filter)
        if label not in results.config["filters"]:
            label = self.filter
        return metric_phrases.in_unit(name, unit or results.unit_of_key(["filters", label, *keys]))


def _draw_panel(ax: Axes, record: Record, axis: Axis) -> None:
    """Draw the objective of a filter's trials over one of its tuned keys, the ``axis``.

    A trial has a value of every key, the objective with them, and its number of lost runs. The ``axis``
    has the choices of the key, or else the ends of its range.
    """

    def place(value: Any) -> float:
        """Return the place of a key's value on the horizontal axis."""
        if axis.choices:
            return float(axis.choices.index(value))
        return float(value)

    best = record.best
    trials = [trial for trial in record.trials if isfinite(trial.objective)]
    top = _limit_of_axis([trial.objective for trial in trials], best.stderr)
    # Step 1: shade the objectives within a standard error of the best, and the key's values there.
    color = filter_colors.COLORS[4]
    has_spread = _has_spread(record)
    if has_spread:
        highest = best.objective + best.stderr
        ax.axhspan(best.objective, highest, color=color, alpha=0.35, linewidth=0, label=_NEAR)
    # The ends of their range; of a key with choices, the choices.
    near_values = values_within_stderr(record, axis)
    if has_spread and near_values and not axis.choices:
        first = place(near_values[0])
        last = place(near_values[-1])
        ax.axvspan(first, last, color=color, alpha=0.2, linewidth=0, label="Values of these trials")
    # Step 2: a line through the trials that differ from the best in this key alone.
    if not axis.choices:
        line = []
        for trial in record.trials_along(axis):  # with as many lost runs as the best
            height = trial.objective
            if height > top:
                height = nan  # a gap in the line
            line.append((place(trial.values[axis.key]), height))
        line_look: Any = {"color": filter_colors.COLORS[0], "linewidth": 0.6, "alpha": 0.6}
        ax.plot(*zip(*sorted(line), strict=True), label="Only this key changed", **line_look)
    # Step 3: all trials, and the best with its standard error.
    for trial in trials:
        height = min(trial.objective, top)
        marker = "o"
        label = "Trial"
        if trial.objective > top:
            marker = "^"
            label = "Trial above the axis"
        elif trial.lost:
            marker = "x"
            label = "Trial with lost runs"
        # A value at an end of the range is drawn whole, over the edge of the panel.
        mark: Any = {
            "color": filter_colors.COLORS[0],
            "markersize": 3.5,
            "clip_on": False,
            "zorder": 3,
        }
        ax.plot(place(trial.values[axis.key]), height, marker, label=label, linestyle="", **mark)
    if isfinite(best.objective):
        look: Any = {"fmt": "D", "color": filter_colors.COLORS[1], "capsize": 2, "zorder": 4}
        look |= {"clip_on": False, "label": "Best trial"}
        if has_spread:
            look["label"] += ", \N{PLUS-MINUS SIGN} 1 standard error"
        ax.errorbar(place(best.values[axis.key]), best.objective, best.stderr, **look)
    # Step 4: the horizontal axis.
    if axis.log:
        ax.set_xscale("log")
    if axis.choices:
        ax.set_xticks(range(len(axis.choices)), [phrases.number(c) for c in axis.choices])
    else:
        ax.set_xlim(axis.low, axis.high)
        ax.margins(y=0.08)


def _has_spread(record: Record) -> bool:
    """Test whether the best trial has a standard error, as that of a single recording has not."""
    return isfinite(record.best.objective) and record.best.stderr > 0.0


def _limit_of_axis(objectives: list[float], stderr: float) -> float:
    """Return the largest objective that the vertical axis shows; 0 without any.

    The limit keeps trials near the best one distinguishable. It is some spreads of the better half of
    the trials above their median, but at least some standard errors above the best. ``stderr`` is the
    standard error of the best trial.
    """
    if not objectives:
        return 0.0
    ranked = sorted(objectives)
    least = ranked[0]
    middle = ranked[len(ranked) // 2]
    limit = max(middle + _SPREADS * (middle - least), least + _BARS * stderr)
    return min(ranked[-1], limit)


def axis_of_objective(metric: str | dict[str, float]) -> str:
    """Label an axis with the objective: ``Position RMSE (m)``, ``Negative log score (nats)``.

    ``metric`` is that of tuning, or the weights of several metrics by name.
    """
    if isinstance(metric, str):
        return _axis_of_term(metric)
    terms = " + ".join(f"{weight:g} x {_axis_of_term(word)}" for word, weight in metric.items())
    return f"Sum of {terms}"


def _axis_of_term(word: str) -> str:
    """Label an axis with one term of the objective, the metric ``word`` such as ``rmse_position``."""
    words = metric_phrases.axis_of(measured(word))
    # Tuning minimizes the negative of a score, of which more is better. `objective_label` differs then.
    if objective_label(word) != word:
        return f"Negative {words[0].lower()}{words[1:]}"
    # Tuning minimizes the distance from the value that the metric should have, such as 1 of ANEES. It is
    # None for a metric of which less is better.
    target = objective_target(word)
    if target is not None:
        return f"Distance of {words} from {target:g}"
    return words
