"""Metrics and statistics, in general and of one experiment, as text."""

import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from trackbench.metrics import METRICS, Metric, metric_of, unit_of

_PURE_NUMBERS = ("nees", "anees", "nis", "anis", "lost", "zeta")
"""Metrics without a unit in tables and figures, which are pure numbers."""
_BETTER = {"zero": "nearer 0 is better", "one": "nearer 1 is better"}
JsonRow: TypeAlias = dict[str, Any]
"""A row that `list` or `describe` prints as JSON."""
WRITTEN = """\
how it is written:
  mean(rmse[turns])         a statistic over the runs, here of a window of steps
  rmse@20, rmse@last        a metric at a step
  gain(mean(rmse), PF)      percent below the filter PF; ratio(...) to it, minus(...) it
  win_rate(rmse, PF)           share of the runs in which it is better than PF's
  controlled(rms(rmse), KF)    with a filter of the key `exact` as control variate"""


def metrics() -> str:
    """List every declared metric with its text, the most used ones first."""
    common_names = common_metrics()
    further_names = [name for name in METRICS if name not in common_names]
    rows = []
    for name in [*common_names, *further_names]:
        metric = METRICS[name]
        form = f"{metric.name}[_quantity]" if metric.is_family else metric.name
        rows.append((form, _unit_and_direction(metric, metric.unit), metric.help))
    # The columns of both lists are aligned.
    lines = list(columns(rows))
    number = len(common_names)
    return "\n".join(["metrics:", *lines[:number], "\nfurther metrics:", *lines[number:]])


def common_metrics() -> list[str]:
    """Return the twenty metrics that experiments use most."""
    return _COMMON.split()


_COMMON = """rmse mae bias std peak anees nees anis nis lost diverged outside_region log_score crps
    coverage detection_delay_s missed_maneuvers false_maneuvers_per_1000 mode ess"""


def statistics() -> str:
    """List every statistic; explain how to write an expression."""
    rows = columns((name, "", text) for name, text in statistics_known().items())
    return "\n".join(["statistics:", *rows, "", WRITTEN])


def described(word: str) -> str | None:
    """Return the text of `describe` on a metric or a statistic; None if unknown."""
    if word in statistics_known():
        return f"{word} (statistic)\n\n{statistics_known()[word]}\n\n{WRITTEN}"
    metric, _ = metric_of(word)
    if not metric.help:  # every known metric has one
        return None
    # A family such as `rmse` has no unit of its own, but that of its quantity.
    details = _unit_and_direction(metric, unit_of(word) or metric.unit)
    return f"{word} (metric)\n\n{metric.help}\n{details}".rstrip()


def facts(word: str) -> JsonRow | None:
    """Describe a metric or a statistic as a row of JSON; None if unknown."""
    if word in statistics_known():
        return {"group": "statistics", "kind": word, "text": statistics_known()[word]}
    metric, _ = metric_of(word)
    if not metric.help:  # every known metric has one
        return None
    return {
        "group": "metrics",
        "kind": word,
        "text": metric.help,
        # A family such as `rmse` has no unit of its own, but that of its quantity.
        "unit": _unit_as_data(metric, unit_of(word) or metric.unit),
        "better": metric.better,
    }


def metrics_of_config(path: Path, allow_plugins: bool = False) -> str:
    """List the metrics, windows and numbers that tables and figures of the experiment may use.

    ``path`` is a config file or the name of a shipped experiment.
    """
    names: dict[str, list[str]] = defaultdict(list)
    rows = []
    for row in rows_of_config(path, allow_plugins):
        names[row["group"]].append(row["kind"])
        if row["group"] == "metrics":
            # The files that store the metric, per run or per step.
            files = "not kept"
            if row["kept"]:
                files = ", ".join(word for word in ("run", "step") if row[f"per_{word}"])
            metric, _ = metric_of(row["kind"])
            details = _unit_and_direction(metric, row["unit"])
            rows.append((row["kind"], files, details, row["text"]))
    lines = [
        f"metrics of {path}, per run or per step:",
        *columns(rows),
        f"\nwindows of steps: {', '.join(names['windows']) or 'none but the whole'}",
        f"statistics: {', '.join(names['statistics'])}",
        f"numbers beside them: {', '.join(names['numbers'])}\n",
        WRITTEN,
    ]
    return "\n".join(lines)


def rows_of_config(path: Path, allow_plugins: bool = False) -> Iterator[JsonRow]:
    """Yield what tables and figures of an experiment may name, as rows of JSON.

    These are metrics, windows of steps, statistics and numbers of filters. ``path`` is a config file or
    the name of a shipped experiment. A row has the keys ``group`` and ``kind``, which is the name.
    ``kept`` is True for a metric that is stored in the results folder.
    """
    from trackbench.config.available_metrics import names_of
    from trackbench.config.load import load
    from trackbench.config.shipped_experiments import located
    from trackbench.config.stored_metrics import is_stored, stored_metrics
    from trackbench.config.validate_experiment import UnknownNamesError
    from trackbench.evaluation.metric_expression import measured

    print_note = partial(print, file=sys.stderr)
    try:
        experiment = load(located(path, print_note), allow_plugins=allow_plugins)
    except UnknownNamesError as error:
        # Only names of metrics are wrong: the list then shows the right ones.
        experiment = error.experiment
        print_note(error)
    settings = experiment.settings
    names = names_of(settings, experiment.points, experiment.left_out, with_diagnostics=True)
    stored = stored_metrics(settings, "summary.csv")
    # Names of metrics without window, by the file that has them. `is_row` leaves out expressions.
    measures_per_run = [measured(name) for name in names.per_run]
    per_run = {measure.metric for measure in measures_per_run if measure.is_row}
    measures_per_step = [measured(name) for name in names.per_step]
    per_step = {measure.metric for measure in measures_per_step if measure.is_row}
    for name in sorted(per_run | per_step):
        metric, _ = metric_of(name)
        yield {
            "group": "metrics",
            "kind": name,
            "text": metric.help,
            "unit": _unit_as_data(metric, unit_of(name)),
            "better": metric.better,
            "per_run": name in per_run,
            "per_step": name in per_step,
            "kept": is_stored(stored, measured(name).base),
        }
    for name in sorted(names.windows):
        if name:
            yield {"group": "windows", "kind": name}
    for name, text in statistics_known().items():
        yield {"group": "statistics", "kind": name, "text": text}
    for name in sorted(names.filter_numbers):
        yield {"group": "numbers", "kind": name}


def statistics_known() -> dict[str, str]:
    """Return every statistic with its text."""
    from trackbench.evaluation.metric_expression import TIME_MEAN
    from trackbench.statistics.sample_statistics import STATISTICS

    texts = {name: statistic.help for name, statistic in STATISTICS.items()}
    texts[TIME_MEAN] = "mean over a window's steps of the RMSE over runs"
    return texts


def _unit_as_data(metric: Metric, unit: str) -> str | None:
    """Return a metric's unit for programs: 1 for a pure number, None for an unknown unit.

    ``unit`` is that of the metric with its quantity. It is empty for pure numbers, scores and unknown
    units, which this function distinguishes.
    """
    if unit:
        return unit
    if metric.is_score:
        return "nats"
    if metric.name in _PURE_NUMBERS:
        return "1"
    return None


def _unit_and_direction(metric: Metric, unit: str) -> str:
    """Write the unit of a metric and whether lower or higher is better; may be empty."""
    words = []
    if unit == "quantity":  # a family, such as `rmse`
        words.append("unit of the quantity")
    elif unit and unit != "1":
        words.append(unit)
    if metric.better:
        words.append(_BETTER.get(metric.better, f"{metric.better} is better"))
    return ", ".join(words)


def columns(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    """Yield rows as indented lines with aligned columns; empty columns are left out."""
    table = list(rows)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        cells = []
        for cell, width in zip(row, widths, strict=True):
            if width:
                cells.append(f"{cell:<{width}}")
        yield f"  {'  '.join(cells)}".rstrip()
