"""Verdicts on CPU times: those of one machine, in a file and tables of their own.

Two filters are compared by the ratio of their times in each repeat: its median, and the median's rank
interval. On other machines, and in other executions, it scattered by up to a factor of `SCATTER`.
So the interval is widened by that factor to both sides. A claim holds if the whole widened interval
agrees with it, and fails if no part of it does. A printed number differs if it lies outside.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain
from math import inf, isnan, nan
from typing import NamedTuple

from trackbench.atomic_files import ensure_folder, remove, within, write_csv
from trackbench.config.published import Claim, Published, PublishedNumber
from trackbench.report.expressions import repeats_of
from trackbench.report.results import Results
from trackbench.report.table import Text, TextTable
from trackbench.report.verdicts.claims import point_of
from trackbench.results.folder_contents import TIME_VERDICTS
from trackbench.statistics.over_runs import interval, median
from trackbench.statistics.rules import UNDECIDED

SCATTER = 2.0
"""Factor by which a ratio of two filters' times may differ on another machine or at another time."""
HEADER = [
    *("statement", "verdict", "measured", "low", "high", "wanted_low", "wanted_high"),
    *("filters", "operations", "paper", "source", "note"),
]
LEGEND = (
    "CPU times are of the machine that ran the experiment. A ratio is decided only beyond a factor "
    f"of {SCATTER:g} either way. Operations are per run and step: evaluations of a likelihood, updates "
    "of a covariance; - where a filter does not note them."
)


class TimeVerdict(NamedTuple):
    """A number or claim about CPU times, the verdict, the measured ratio and its 95 % interval."""

    row: PublishedNumber | Claim
    word: str
    measured: float
    low: float
    high: float
    wanted: tuple[float, float]
    """where the ratio has to be"""
    filters: str
    operations: str

    @property
    def statement(self) -> str:
        """Claim, or what the number is of."""
        row = self.row
        return row.claim if isinstance(row, Claim) else f"{row.filter}: {row.metric}"


def without_times(published: Published) -> Published:
    """Return the published rows that are not about CPU times."""
    numbers = [row for row in published.numbers if not _is_of_time(row)]
    claims = [row for row in published.claims if not _is_of_time(row)]
    return replace(published, numbers=numbers, claims=claims)


def _is_of_time(row: PublishedNumber | Claim) -> bool:
    return any(m.is_cpu_time for m in row.expressions)


def time_verdicts(results: Results) -> list[TimeVerdict]:
    """Compare the measured CPU times with the published numbers, then with the claims."""
    published = results.published
    rows: list[PublishedNumber | Claim] = [*published.numbers, *published.claims]
    verdicts = (_verdicts(results, row) for row in rows if _is_of_time(row))
    return list(chain.from_iterable(verdicts))


def _verdicts(results: Results, row: PublishedNumber | Claim) -> Iterator[TimeVerdict]:
    """Judge a number for each of its labels; a claim by the filter that it is weakest against."""
    other = row.expression.other if row.expression else ""
    if not isinstance(row, Claim):
        yield from (_verdict(results, row, left, other) for left in row.labels or [""])
        return
    verdicts = [_verdict(results, row, row.left, right) for right in row.rights or [other]]
    # A claim has the worst verdict of its comparisons.
    order = ("fails", UNDECIDED, "holds")
    yield min(verdicts, key=lambda verdict: order.index(verdict.word))


def _verdict(results: Results, row: PublishedNumber | Claim, left: str, right: str) -> TimeVerdict:
    point, wanted = point_of(results, row.point), _wanted(row)
    # Each filter's repeats and operations; of a folder without measured times none.
    records = results.columns("timing", point).records() if point is not None else ()
    stored = {record["filter"]: record for record in records}
    labels, seconds, operations = [label for label in (left, right) if label], [], []
    for label in (b for b in labels if b in stored):
        seconds.append(repeats_of(stored[label]))
        words = (f"{stored[label].get(n, '-')} {n}" for n in ("likelihoods", "covariances"))
        operations.append(f"{label} {', '.join(words)}")
    value, low, high, word = nan, nan, nan, UNDECIDED
    lengths = {len(s) for s in seconds}
    if wanted and len(seconds) == len(labels) > 0 and len(lengths) == 1 and lengths.pop() > 1:
        # Ratio (or seconds) of each repeat: median and rank interval, widened by SCATTER.
        ratios = seconds[0] / (seconds[1] if right else 1.0)
        value, (low, high) = median(ratios).value, interval("median", ratios)
        word = _word(row, low / SCATTER, high * SCATTER, *wanted)
    ends = wanted or (nan, nan)
    return TimeVerdict(row, word, value, low, high, ends, " / ".join(labels), "; ".join(operations))


def _wanted(row: PublishedNumber | Claim) -> tuple[float, float] | None:
    """Find the ends of the ratios, or of the seconds, that a row speaks of; None of what is no ratio."""
    relation = row.expression.relation if row.expression else ""
    if not all(m.is_cpu_time for m in row.expressions):
        return None
    if not isinstance(row, Claim):
        if isinstance(row.value, str) or relation not in ("", "ratio", "gain"):
            return None
        # A gain of p percent is a ratio of 1 - p / 100.
        ratio = 1.0 - row.value / 100.0 if relation == "gain" else row.value
        return ratio, ratio
    if relation not in ("", "ratio") or (relation and row.rights):
        return None
    if row.relation == "~":
        return row.factor * (1.0 - row.tolerance), row.factor * (1.0 + row.tolerance)
    return (0.0, row.factor) if row.relation == "<" else (row.factor, inf)


def _word(row: PublishedNumber | Claim, low: float, high: float, least: float, most: float) -> str:
    if isnan(low):
        return UNDECIDED
    outside = high <= least or low >= most
    if not isinstance(row, Claim):
        return UNDECIDED if row.chosen else "differs" if outside else "compatible"
    if outside:
        return "fails"
    return "holds" if least <= low and high <= most else UNDECIDED


def write_time_verdicts(results: Results) -> None:
    """Write them, or take away an old file if nothing is published about times."""
    verdicts, path = time_verdicts(results), results.target / TIME_VERDICTS
    if not verdicts:
        remove(path)
        return
    ensure_folder(within(results.target, "run"))
    rows = []
    for v in verdicts:
        cells = [v.statement, v.word, v.measured, v.low, v.high, *v.wanted]
        rows.append([*cells, v.filters, v.operations, v.row.paper, v.row.source, v.row.note])
    write_csv(path, HEADER, rows)


def time_tables(verdicts: Iterable[TimeVerdict]) -> list[TextTable]:
    """Return a table of them; none if there is none."""
    heads = ["Statement", "Verdict", "Filters", "Time, ratio", "95 %", "Published", "Operations"]
    table = TextTable("CPU times, on this machine", [*heads, "Source"], notes=[LEGEND])
    for v in verdicts:
        source = f"{v.row.paper}, {v.row.source}".rstrip(", ")
        cells = [v.statement, v.word, v.filters, _number(v.measured), _ends(v.low, v.high)]
        cells += [_ends(*v.wanted), v.operations, source]
        table.rows.append([Text(c, v.measured if i == 3 else None) for i, c in enumerate(cells)])
    return [table] if table.rows else []


def time_line(results: Results) -> list[str]:
    """Return one line on these verdicts; none if there is none."""
    words = Counter(verdict.word for verdict in time_verdicts(results))
    counts = ", ".join(f"{number} {word}" for word, number in words.items())
    return [f"CPU times, on this machine: {counts}; {TIME_VERDICTS} has them"] if counts else []


def _ends(low: float, high: float) -> str:
    if low == high:
        return _number(low)
    if low == 0.0 or high == inf:
        return f"< {_number(high)}" if low == 0.0 else f"> {_number(low)}"
    return f"{_number(low)} to {_number(high)}"


def _number(value: float) -> str:
    return "–" if isnan(value) else f"{value:.3g}"
