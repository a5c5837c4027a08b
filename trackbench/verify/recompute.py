"""The first runs of a stored experiment computed again, and held against what is stored of them."""

import tempfile
from collections.abc import Collection, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.config.experiment import Experiment
from trackbench.core.arrays import Array
from trackbench.evaluation.intervals import holm
from trackbench.evaluation.metric_expression import TIME_MEAN, measured
from trackbench.evaluation.statistics import mean
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import cpu_count, engine
from trackbench.execution.plan import check_memory, make_plan
from trackbench.execution.runner import execute
from trackbench.report.results import Results
from trackbench.results.write import write_results
from trackbench.verify.compare import same_arrays, same_rows
from trackbench.verify.findings import Finding, changed, rounding
from trackbench.verify.rounding import (
    FALSE_ALARM,
    ROUNDING,
    differences,
    p_of_chance,
    relative,
    usual,
)

ColumnKey: TypeAlias = tuple[Any, ...]
"""Values of the grid's paths, filter, metric."""


class Column(NamedTuple):
    """A metric of a filter over the runs (M,): as stored, computed again, and how far apart."""

    key: ColumnKey
    stored: Array
    again: Array
    off: Array

    @property
    def label(self) -> str:
        """The filter."""
        return str(self.key[-2])

    @property
    def name(self) -> str:
        """The metric, and where on the grid."""
        *point, _, metric = self.key
        return f"{metric} at {', '.join(map(str, point))}" if point else str(metric)

    @property
    def is_far(self) -> bool:
        """Whether any run is further off than rounding alone may bring it."""
        return bool((self.off > ROUNDING).any())


def computed_again(results: Results, experiment: Experiment, runs: int) -> Iterator[Finding]:
    """What differs in the first runs; in everything else, too, if those are all there are."""
    runs = min(runs, experiment.settings.runs)
    if _stored_runs(results) != experiment.settings.runs:
        return  # a finding already, and as many runs as the config says may take for ever
    with tempfile.TemporaryDirectory() as temporary:
        again = Results(Path(temporary))
        if min(experiment.shown_runs, experiment.settings.runs) > runs:
            experiment = replace(experiment, figures={})
        tracks = (results.folder / "tracks.npz").is_file()
        _compute(experiment, again.folder, runs, tracks)
        whole = runs == experiment.settings.runs
        stored, now = _values(results, runs, whole), _values(again, runs, whole)
        odd = [k for k in {**stored, **now} if len(stored.get(k, ())) != len(now.get(k, ()))]
        if odd:
            first = ", ".join(map(str, odd[0]))
            what = "metrics are stored or computed again only; the first is"
            yield changed(f"per_run.csv: {len(odd)} {what} {first}")
        columns = [_column(key, stored[key], now[key]) for key in stored if key not in odd]
        yield from _judged(columns, _drawing(experiment))
        steady = {c.label for c in columns} - {c.label for c in columns if c.is_far}
        if experiment.shown_runs:
            yield from same_arrays(results, again, "shown.npz", steady)
        if tracks:
            yield from same_arrays(results, again, "tracks.npz", steady)
        if runs < experiment.settings.runs:
            steady = set()
        yield from same_rows(results, again, {*steady, experiment.settings.bound})


def _stored_runs(results: Results) -> int:
    every = (len(x) for point in results.points() for x in results.runs(point).values())
    return max(every, default=results.config["runs"])


def _compute(experiment: Experiment, out: Path, runs: int, tracks: bool) -> None:
    """The first runs, in blocks as wide as all runs had them: `block: fit` follows their number."""
    plan = make_plan(experiment, tracks).first(runs)
    workers = min(cpu_count(), len(plan.unique))
    check_memory(experiment, workers, tracks)
    fewer = replace(experiment, settings=replace(experiment.settings, runs=runs))
    store, opened = BlockStore(cache_folder()), engine("processes", workers)
    with closing(execute([plan], store, opened, workers, fresh=True, progress=False)) as outcomes:
        write_results(out, fewer, next(outcomes), tracks)


def _values(results: Results, runs: int, whole: bool) -> dict[ColumnKey, Array]:
    """Values of the first runs; shares of an average over time depend on all runs, as a summary does."""
    return {
        (*point.values(), *key): values[:runs]
        for point in results.points()
        for key, values in results.runs(point).items()
        if whole or measured(key[1]).statistic != TIME_MEAN
    }


def _column(key: ColumnKey, stored: Array, again: Array) -> Column:
    return Column(key, stored, again, relative(stored, again, usual(stored)))


def _drawing(experiment: Experiment) -> set[str]:
    """The filters that draw: each has a number of particles."""
    return {
        label for p in experiment.points for label, f in p.filters.items() if f.particle_count > 1
    }


def _judged(columns: list[Column], drawing: Collection[str]) -> Iterator[Finding]:
    """A finding for each filter of which any value differs."""
    tested = [c for c in columns if c.label in drawing and c.is_far]
    chances = holm(np.array([p_of_chance(differences(c.stored, c.again)) for c in tested]))
    p = {c.key: float(chance) for c, chance in zip(tested, chances, strict=True)}
    for label in dict.fromkeys(c.label for c in columns if c.off.any()):
        yield _of_filter(label, [c for c in columns if c.label == label], p, label in drawing)


def _of_filter(label: str, mine: list[Column], p: dict[ColumnKey, float], draws: bool) -> Finding:
    off = np.concatenate([c.off for c in mine])
    worst = max(mine, key=lambda c: c.off.max())
    begin = f"per_run.csv: {label}: {np.count_nonzero(off)} of {off.size} values differ"
    begin += f" in the first {len(worst.off)} runs"
    if off.max() <= ROUNDING:
        digits = int(-np.log10(off.max()))
        return rounding(f"{begin}, by {off.max():.1e} at most: they agree in {digits} digits")
    if not draws:
        run = int(worst.off.argmax())
        values = f"{worst.stored[run]:.7g}, computed again {worst.again[run]:.7g}"
        return changed(f"{begin}, by more than rounding: {worst.name} of run {run} is {values}")
    least = min((c for c in mine if c.key in p), key=lambda c: p[c.key])
    if p[least.key] >= FALSE_ALARM:
        what = "it draws, so that rounding grows, and no mean differs beyond chance"
        return rounding(f"{begin}, by up to {off.max():.1%}: {what}")
    value, stderr = mean(differences(least.stored, least.again))
    by = f"{least.name} by {value:.3g} ± {stderr:.2g}, p = {p[least.key]:.1g}"
    return changed(f"{begin}, on average beyond chance: {by}")
