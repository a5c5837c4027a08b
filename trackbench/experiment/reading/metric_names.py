"""Names of metrics: which of them an experiment has, which it keeps, and what its parts may ask for."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Any, cast

import numpy as np

from trackbench.core.streams import block_stream
from trackbench.evaluation.block import simulate
from trackbench.evaluation.derived import sizes
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.metrics import StepSums, joined, per_run_metrics
from trackbench.evaluation.summary import step_rows, summary_rows
from trackbench.experiment.interrupts import guarded
from trackbench.experiment.problems import Problem
from trackbench.experiment.reading.definition import Exhibit, Point, Settings
from trackbench.experiment.reading.grammar import STATISTIC, STEP, plain
from trackbench.experiment.reading.source import Keys, Source, dotted
from trackbench.filters.base import AnyFilter, Filter, knows_expectations
from trackbench.hooks import Part
from trackbench.registry import Group
from trackbench.scenarios.base import Scenario
from trackbench.tuning.objective import as_expression, bad_terms

_FEW = 10
"""Particles that are enough to see what a filter notes."""
_MOST_NOTED, _MOST_OF_RUNS = 6, 50
"""Series that a filter notes, and metrics of whole runs that a scenario has, such as delays."""
_ANY_STATISTIC = re.compile(r"[a-z-]+\((.+)\)(?:/\d+)?")


def base_name(metric: str) -> str:
    """``rmse_position`` of ``mean(rmse_position[turns])``; ``nees`` of ``anees``, a mean of it."""
    inside = _ANY_STATISTIC.fullmatch(metric)
    name = (inside.group(1) if inside else metric).partition("[")[0].partition("@")[0]
    return name.removeprefix("a") if name.startswith("anees") else name


def kept_metrics(settings: Settings, file: str) -> frozenset[str] | None:
    """Base names of the metrics that a CSV file keeps; None keeps all of them."""
    if file == "per_step.csv" and settings.per_step is not None:
        return frozenset(map(base_name, settings.per_step))
    names = settings.metrics
    return None if names is None else frozenset({"lost", *map(base_name, names)})


def number_per_run(settings: Settings, scenario: Scenario, label: str, tracker: AnyFilter) -> int:
    """How many metrics of a filter per_run.csv holds, rather too many: it is not asked what it notes."""
    wanted = kept_metrics(settings, "per_run.csv")
    if wanted is not None:
        return len(wanted) * len(scenario.windows)
    series = len(set(_series(settings, scenario, label, tracker))) + _MOST_NOTED
    return series * len(scenario.windows) + _MOST_OF_RUNS


@dataclass
class Names:
    """Every name in the files of a results folder."""

    series: set[str] = field(default_factory=set)
    per_run: set[str] = field(default_factory=set)
    per_step: set[str] = field(default_factory=set)
    summary: set[str] = field(default_factory=set)
    given: set[str] = field(default_factory=lambda: {"cpu_s_per_run"})
    """numbers beside them: times, and the filters' keys"""

    def add(
        self, settings: Settings, scenario: Scenario, tracker: AnyFilter, series: set[str]
    ) -> None:
        """Take over the names that a filter's series give."""
        self.series |= series
        values = {name: np.zeros((len(scenario.steps), 1)) for name in series}
        with np.errstate(all="ignore"):
            per_run = per_run_metrics(scenario, values, tracker.counts, np.ones(1, dtype=bool))
            one = StepSums(np.ones(1), np.ones(1), np.ones(1))
            medians = {name: np.ones((1, 1)) for name in settings.medians if name in series}
            result = FilterResult(per_run, dict.fromkeys(sorted(series), one), medians, None, [])
            windows = {name: np.ones(1, dtype=bool) for name in scenario.windows}
            self.per_run |= set(per_run)
            self.per_step |= {row.metric for row in step_rows(result, sizes(scenario))}
            self.summary |= {r.metric for r in summary_rows(result, sizes(scenario), windows)}


@dataclass(frozen=True)
class Asked:
    """A name that a part of the config asks for, where, and what it may be."""

    keys: Keys
    word: str
    role: str
    named: bool = True
    """whether the config names it; what a kind shows by itself need not be there, but be kept"""


def check_metrics(
    source: Source,
    settings: Settings,
    points: list[Point | None],
    parts: dict[Group, dict[str, Exhibit]],
    problems: list[Problem],
) -> None:
    """Every metric that tables, figures and settings name must be one that there is, and is kept.

    Nothing is said of an experiment that is not whole: with a filter left out, mistaken, or unable to
    say what it notes; with recorded data that have no truth.
    """
    there = [p for p in points if p is not None and len(p.filters) == len(settings.filters)]
    whole = there and all(None not in p.filters.values() for p in there)
    if not whole or not all(p.scenario.has_truth for p in there):
        return
    chosen = list({point.scenario: point for point in reversed(there)}.values())
    asked = [*_asked_by_settings(settings), *asked_by_parts(parts)]
    names = _names(settings, chosen, noted=False)
    if any(not a.named or _mistake(a, names, settings) for a in asked):
        names = _names(settings, [*chosen, there[-1]], noted=True)
    for a in asked if names is not None else []:
        what = _mistake(a, names, settings)
        if what is not None:
            problems.append(Problem(source.mark(a.keys), dotted(a.keys), what))


def _asked_by_settings(settings: Settings) -> Iterator[Asked]:
    for i, word in enumerate(settings.medians):
        yield Asked(("medians", i), word, "series")
    for i, word in enumerate(settings.metrics or ()):
        yield Asked(("metrics", i), word, "base")
    for i, word in enumerate(settings.per_step or ()):
        yield Asked(("per_step", i), word, "base")
    metric = settings.tuning.metric if settings.tune else None
    known = {word for word, _ in bad_terms(metric)}
    for word in [metric] if isinstance(metric, str) else metric or ():
        if word in known:  # said elsewhere
            continue
        where = ("tuning", "metric", *([] if isinstance(metric, str) else [word]))
        yield Asked(where, as_expression(word), "expression")


def asked_by_parts(parts: dict[Group, dict[str, Exhibit]]) -> Iterator[Asked]:
    """What tables and figures say of themselves.

    In ``asks`` a key of the config and the role of what it names, in ``needs`` a metric and its role.
    """
    for group, built in parts.items():
        for name, part in built.items():
            for word, role in part.needs.items():
                yield Asked((group, name), word, role, named=False)
            for key, role in part.asks.items():
                value = getattr(part, key)
                if isinstance(value, str):
                    yield Asked((group, name, key), value, role)
                for head, inner in value.items() if isinstance(value, dict) else ():
                    if isinstance(inner, str):
                        yield Asked((group, name, key, head), inner, role)
                    else:
                        yield Asked((group, name, key, head, "metric"), inner.metric, role)


def _names(settings: Settings, points: list[Point], noted: bool) -> Any:
    """The names of all filters at these points; None if one cannot be asked for what it notes."""
    names = Names()
    for point in points:
        done = set()  # filters mostly have the same series
        for label, tracker in point.filters.items():
            series = set(_series(settings, point.scenario, label, tracker))
            names.given |= _keys(tracker)
            try:
                if noted:
                    series |= _noted(settings, point.seen_by(label), tracker)
                alike = frozenset(series), tracker.counts
                if alike not in done:
                    names.add(settings, point.scenario, tracker, series)
                done.add(alike)
            except Exception:  # its own run will say what is wrong
                return None if noted else Names()
    return names


def _series(
    settings: Settings, scenario: Scenario, label: str, tracker: AnyFilter
) -> Iterator[str]:
    nowhere = np.zeros((len(scenario.components), 1))
    for quantity, error in scenario.errors(nowhere, nowhere).items():
        yield joined("squared", quantity)
        if len(error) == 1:
            yield joined("error", quantity)
        if settings.reference is not None and label != settings.reference:
            yield joined("distance", quantity)
    yield from ("nees", "outside", *(f"nees_{name}" for name in scenario.marginals))
    if knows_expectations(tracker):
        for name in scenario.observables(nowhere):
            yield from (f"squared_{name}", f"error_{name}")


def _keys(part: Part) -> set[str]:
    return {field.name for field in fields(cast(Any, part))}


def _noted(settings: Settings, scenario: Scenario, tracker: AnyFilter) -> set[str]:
    """Names of what a filter notes at a step, from the first step of one run."""
    if type(tracker).diagnostics is Filter.diagnostics:
        return set()
    data = simulate(scenario, settings.seed, 0, 1)
    model, rng = scenario.model, block_stream(settings.seed, 0)
    if "N" in _keys(tracker):  # nothing is known of the memory yet
        tracker = replace(cast(Any, tracker), N=min(tracker.particle_count, _FEW))
    with guarded(), np.errstate(all="ignore"):
        state = tracker.init(model, data.prior, rng)
        k = int(scenario.steps[1])
        return set(tracker.diagnostics(tracker.step(model, state, data.measurements[:, 0], k, rng)))


def _mistake(asked: Asked, names: Any, settings: Settings) -> str | None:
    role, word = asked.role, asked.word
    if role == "expression":
        role, word = _part_of(word)
    elif role == "comparison" and not settings.grid:
        role, word = "per_run", word.partition("(")[2].removesuffix(")") or word
    elif role == "comparison":
        role, word = _part_of(word)
    if role == "base":
        known = {base_name(name) for name in names.per_run | names.per_step}
        word = base_name(word)
    else:
        known = getattr(names, role) | (names.given if role == "summary" else set())
    if word not in known and not asked.named:
        return None
    if word not in known:
        near = get_close_matches(word, sorted(known), 1, 0.5)
        short = sorted({base_name(name) for name in known})
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(short)}"
        return f"{word!r} is no metric here; {hint}"
    kept = kept_metrics(settings, "per_step.csv" if role == "per_step" else "summary.csv")
    if role not in ("per_run", "per_step", "summary") or word in names.given or kept is None:
        return None
    if base_name(word) in kept:
        return None
    key = "per_step" if role == "per_step" and settings.per_step is not None else "metrics"
    return f"{word!r} is not kept: name it under {key}"


def _part_of(expression: str) -> tuple[str, str]:
    """Role and name of the metric that an expression is about."""
    metric = plain(expression)
    statistic, step = STATISTIC.fullmatch(metric), STEP.fullmatch(metric)
    if statistic:
        return "per_run", statistic.group(2)
    if step:
        return "per_step", step.group(1)
    return "per_run" if expression.startswith("below(") else "summary", metric
