"""How everything is measured: interleaved rounds, medians, ratios, and the error beside the time.

An entrant does a workload's job once and returns its CPU time and its estimates. All entrants of a
workload take turns (A B C A B C ...), so that a busy minute of the machine hits all of them; the first
round warms up (compiles, loads) and is not counted.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array


class Skip(Exception):  # noqa: N818 (not an error)
    """A workload or a peer that cannot be run here, and why."""


class Outcome(NamedTuple):
    """CPU or wall seconds, units of work done, estimates (n_x, T, M) if there are any."""

    seconds: float
    work: float
    mean: Array | None = None


Entrant = Callable[[], Outcome]


class Bar(NamedTuple):
    """``slow`` must take at least ``factor`` times as long as ``fast``; or at most, if ``at_most``."""

    slow: str
    fast: str
    factor: float
    at_most: bool = False


class Limit(NamedTuple):
    """An entrant's own time in seconds."""

    name: str
    seconds: float


@dataclass
class Workload:
    """One table of the results."""

    name: str
    title: str
    unit: str
    entrants: dict[str, Entrant]
    bars: list[Bar] = field(default_factory=list)
    limits: list[Limit] = field(default_factory=list)
    truth: Array | None = None
    position: tuple[int, ...] = (0,)
    skipped: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, make: Callable[[], Entrant]) -> None:
        """An entrant, unless its package is not there."""
        try:
            self.entrants[name] = make()
        except ImportError as error:
            self.skipped[name] = f"not installed ({error.name})"


class Line(NamedTuple):
    """An entrant's medians: seconds per unit of work, and the mean RMSE of the common runs.

    ``first`` is the seconds per unit of the round that is not counted, which compiles.
    """

    name: str
    per_unit: float
    spread: float
    rmse: float
    stderr: float
    first: float


def timed(job: Callable[[], Array], work: float) -> Entrant:
    """An entrant that is one call; it returns the estimates."""

    def entrant() -> Outcome:
        started = time.process_time()
        mean = job()
        return Outcome(time.process_time() - started, work, mean)

    return entrant


def measure(workload: Workload, rounds: int) -> list[Line]:
    """Every entrant, interleaved, ``rounds`` times after a first one that is thrown away."""
    seen: dict[str, list[Outcome]] = {name: [] for name in workload.entrants}
    for _ in range(rounds + 1):
        for name, entrant in workload.entrants.items():
            seen[name].append(entrant())
    means = [outcomes[-1].mean for outcomes in seen.values()]
    common = min((mean.shape[-1] for mean in means if mean is not None), default=0)
    return [_line(workload, name, outcomes, common) for name, outcomes in seen.items()]


def _line(workload: Workload, name: str, outcomes: list[Outcome], runs: int) -> Line:
    per_unit = [o.seconds / o.work for o in outcomes[1:]]
    quarters = statistics.quantiles(per_unit, n=4)
    median, first = statistics.median(per_unit), outcomes[0].seconds / outcomes[0].work
    mean = outcomes[-1].mean
    if mean is None or workload.truth is None:
        return Line(name, median, quarters[2] - quarters[0], np.nan, np.nan, first)
    at = list(workload.position)
    e = (mean[at] - workload.truth[at][..., : mean.shape[-1]])[..., :runs]
    rmse = np.sqrt(np.square(e).sum(axis=0).mean(axis=0))
    stderr = rmse.std(ddof=1) / np.sqrt(runs)
    spread = quarters[2] - quarters[0]
    return Line(name, median, spread, float(rmse.mean()), float(stderr), first)


def verdicts(workload: Workload, lines: list[Line]) -> list[str]:
    """One line per bar: pass, or falls short."""
    found = {line.name: line.per_unit for line in lines}
    out = []
    for bar in workload.bars:
        if bar.slow not in found or bar.fast not in found:
            continue
        ratio = found[bar.slow] / found[bar.fast]
        good = ratio <= bar.factor if bar.at_most else ratio >= bar.factor
        bound = "at most" if bar.at_most else "at least"
        what = f"{bar.slow} / {bar.fast} = {ratio:.3g}, {bound} {bar.factor:g}"
        out.append(f"{_word(good)}: {what}")
    for limit in workload.limits:
        if limit.name in found:
            what = f"{limit.name} {found[limit.name]:.2f} s, at most {limit.seconds:g} s"
            out.append(f"{_word(found[limit.name] <= limit.seconds)}: {what}")
    return out


def _word(good: bool) -> str:
    return "pass" if good else "**falls short**"
