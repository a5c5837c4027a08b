"""What can be measured, for people: metrics, statistics, and what an experiment has of them."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from trackbench.metrics import METRICS, Metric, metric_of, unit_of

_BETTER = {"zero": "nearer 0 is better", "one": "nearer 1 is better"}
WRITTEN = """\
how it is written:
  mean(rmse[turns])         a statistic over the runs, here of a window of steps
  rmse@20, rmse@last        a metric at a step
  gain(mean(rmse), PF)      percent below the filter PF; ratio(...) to it, minus(...) it
  below(rmse, PF)           share of the runs in which it is less than PF's"""


def metrics() -> str:
    """Every metric of which something is known."""
    rows = [(f"{m.name}[_quantity]" if m.is_family else m.name, m) for m in METRICS.values()]
    return "\n".join(["metrics:", *_columns((name, _facts(m, m.unit), m.help) for name, m in rows)])


def statistics() -> str:
    """Every statistic, and how one writes what is measured."""
    rows = _columns((name, "", text) for name, text in _statistics().items())
    return "\n".join(["statistics:", *rows, "", WRITTEN])


def described(word: str) -> str | None:
    """A metric or a statistic; None if there is none of this name."""
    if word in _statistics():
        return f"{word} (statistic)\n\n{_statistics()[word]}\n\n{WRITTEN}"
    found, _ = metric_of(word)
    if not found.help:
        return None
    return f"{word} (metric)\n\n{found.help}\n{_facts(found, unit_of(word) or found.unit)}".rstrip()


def metrics_of_config(path: Path, allow_plugins: bool = False) -> str:
    """Metrics, windows and numbers that tables and figures of an experiment may name."""
    from trackbench.evaluation.measure import measured
    from trackbench.experiment.reading.config import load
    from trackbench.experiment.reading.metric_names import kept_metrics, names_of

    experiment = load(path, allow_plugins=allow_plugins)
    settings = experiment.settings
    names = names_of(settings, experiment.points, experiment.left_out, noted=True)
    kept = kept_metrics(settings, "summary.csv")
    per_run, per_step = (
        {m.metric for m in map(measured, there) if m.is_row}
        for there in (names.per_run, names.per_step)
    )
    rows = []
    for name in sorted(per_run | per_step):
        files = [word for word, there in (("run", per_run), ("step", per_step)) if name in there]
        files = files if kept is None or measured(name).base in kept else ["not kept"]
        found, _ = metric_of(name)
        rows.append((name, ", ".join(files), _facts(found, unit_of(name)), found.help))
    own = sorted(name for name in names.windows if name)
    parts = [
        f"metrics of {path}, per run or per step:",
        *_columns(rows),
        f"\nwindows of steps: {', '.join(own) or 'none but the whole'}",
        f"statistics: {', '.join(_statistics())}",
        f"numbers beside them: {', '.join(sorted(names.given))}\n",
        WRITTEN,
    ]
    return "\n".join(parts)


def _statistics() -> dict[str, str]:
    from trackbench.evaluation.measure import TIME_MEAN
    from trackbench.evaluation.statistics import STATISTICS

    over_time = "mean over a window's steps of the RMSE over runs"
    return {name: s.help for name, s in STATISTICS.items()} | {TIME_MEAN: over_time}


def _facts(metric: Metric, unit: str) -> str:
    """Unit, and which way is better."""
    better = _BETTER.get(metric.better, f"{metric.better} is better" if metric.better else "")
    unit = {"1": "", "quantity": "unit of the quantity"}.get(unit, unit)
    return ", ".join(filter(None, [unit, better]))


def _columns(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    found = list(rows)
    widths = [max(map(len, column)) for column in zip(*found, strict=True)]
    for row in found:
        cells = (f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True) if width)
        yield f"  {'  '.join(cells)}".rstrip()
