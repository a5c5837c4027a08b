"""The ranking as a table, a row a filter, the best first: what a user reads before anything else.

Error, ratio to the best with its 95 % interval, lost runs, consistency in a word, CPU time of a run.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from math import inf, isfinite, isinf, isnan, nan

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import head_of, metric_words, named, statistic_words
from trackbench.report.findings.ranking import Candidate, Ranking, best_settings, rankings
from trackbench.report.results import Results
from trackbench.report.table import Text, TextTable, rounded
from trackbench.statistics import rules
from trackbench.statistics.comparison import Comparison
from trackbench.statistics.estimates import COLLAPSED_NOTE, collapsed_in_words
from trackbench.statistics.intervals import studentized
from trackbench.statistics.over_runs import influence, interval, mean

_SECONDS = ((1.0, "s"), (1e3, "ms"), (1e6, "µs"))
_LOST, _ANEES, _TIME = "Lost runs", "ANEES", "CPU per run"
_FULL_BLOCK = 100
"""Runs that share the calls of a block so that a run's CPU time hardly depends on their number."""
_FAR = 1000.0
"""Ratio to the best beyond which an error shows that the filter has left the target."""
_MOST_SETTINGS = 20
"""Longer tables of a filter's settings are cut to the best."""


def ranking_tables(results: Results, numbers: bool = False) -> list[TextTable]:
    """Tabulate the ranking; of several scenarios one table over all of them.

    With ``numbers``, those of each scenario, or of each filter's settings, follow.
    """
    standings = [s for s in rankings(results) if s.order or s.losing]
    if len(standings) > 1:
        tables = [_over_scenes(results, standings)]
        return [*tables, _by_scene(results, standings)] if numbers else tables
    settings = best_settings(results) if numbers else []
    return [_table(results, s, s in settings) for s in (*standings, *settings)]


def _table(results: Results, standing: Ranking, of_settings: bool) -> TextTable:
    """Tabulate one ranking, of filters or of one filter's settings."""
    order, metric = standing.order, standing.metric
    shown = [*order, *standing.losing][: _MOST_SETTINGS if of_settings else None]
    is_score = metric.family[0].is_score
    beside = "Below the best (nats)" if is_score else "Ratio to the best (95 %)"
    statistic = shown[0].sample.statistic if standing.runs > 1 else "rms"
    words = statistic_words(statistic, metric)
    over = _runs_ranked(standing)
    title = f"{results.citation}: ranking" if results.citation else f"Ranking over {over}"
    title += f" by {words}"
    title += ", each filter at its best of the grid" * standing.chosen
    if of_settings:
        at = f", {phrases.heading(standing.scene)}" * bool(standing.scene)
        title = f"{named(shown[0].label)}{at}: {words} of its settings"
    heads = ["Settings" if of_settings else "Filter", head_of(statistic, metric)]
    table = TextTable(title, [*heads, beside, _LOST, _ANEES, _TIME])
    matters = rules.share_that_matters(results.config.get("matters"))
    reference = [standing.reference] if standing.reference is not None else []
    words_on = consistency(results, [*shown, *reference])
    for c in shown:
        ratio = "unranked: loses more" if c in standing.losing else _ratio(standing, c, matters)
        at = f" at {c.setting}" * bool(c.varied)
        name = c.setting if of_settings else f"{c.label}{at}"
        table.rows.append(_row(results, c, name, ratio, words_on[c]))
    if not of_settings:
        for row in _unranked(results, standing, matters, words_on):
            _insert(table.rows, row, is_score)
    words = " ".join(row[2].text for row in table.rows)
    if "n.s." in words:
        table.notes.append(
            f"n.s.: not significant at {100 * rules.LEVEL:g} % over all pairs of filters (an interval "
            f"is of its pair alone, and left out where it would show a difference)"
            f"{_runs_needed(standing)}."
        )
    if "tiny" in words:
        table.notes.append(f"tiny: significant, but at most {phrases.percent(matters)}.")
    if any("collapsed" in row[4].text for row in table.rows):
        table.notes.append(COLLAPSED_NOTE)
    if 1 < standing.runs < _FULL_BLOCK and any(row[-1].text != "–" for row in table.rows):
        table.notes.append("CPU times: a run takes less in blocks of more runs.")
    far = _far_from_best(standing)
    if far:
        table.notes.append(
            f"{phrases.listed(far)}: more than {_FAR:g} times the error of the best, and no run counts "
            "as lost: `lost_beyond` under `score` sets the error from which a run does."
        )
    return _without_empty(results, table, names_losses=not far)


def _far_from_best(standing: Ranking) -> list[str]:
    """Name the filters that lost no run and have an error far beyond that of the best."""
    if standing.metric.family[0].is_score or not standing.order:
        return []
    limit = _FAR * standing.order[0].overall.value
    return [c.name for c in standing.order if not c.losses and c.overall.value > limit > 0.0]


def _runs_ranked(standing: Ranking) -> str:
    """Count the runs of which any filter has a value or is lost, of recordings those with a truth."""
    if standing.runs <= 1:
        return "one run"
    ranked = np.zeros(standing.runs, dtype=np.bool_)
    for candidate in (*standing.order, *standing.losing):
        values = candidate.sample.values
        ranked[: len(values)] |= np.isfinite(values) | (candidate.lost[: len(values)] > 0)
    count = int(ranked.sum())
    every = counted(standing.runs, "run")
    return every if count in (0, standing.runs) else f"{count} of {every}"


def _insert(rows: list[list[Text]], row: list[Text], is_score: bool) -> None:
    """Insert a row without a rank at the place of its number, at the end without one."""
    sign, place = -1.0 if is_score else 1.0, len(rows)
    number, *others = ((cells[1].number or 0.0) * sign for cells in (row, *rows))
    for i, other in enumerate(others):
        if other >= number:
            place = i
            break
    rows.insert(place, row)


def _row(results: Results, c: Candidate, name: str, ratio: str, word: str) -> list[Text]:
    seconds = cpu_seconds(results, c)
    looped = " *" * (c.label in results.loops_over_runs)
    return [
        Text(name),
        Text("–" if isnan(c.overall.value) else rounded(*c.overall, 4), c.overall.value),
        Text(ratio),
        Text(f"{c.losses} of {len(c.lost)}" if c.losses else "0", c.losses),
        Text(word or "–"),
        Text(f"{_duration(seconds)}{looped}" if isfinite(seconds) else "–", seconds),
    ]


def _unranked(
    results: Results, standing: Ranking, matters: float, words_on: Mapping[Candidate, str]
) -> Iterator[list[Text]]:
    """Yield the reference, the bound, exact errors, and filters without a number."""
    metric, reference = standing.metric, standing.reference
    if reference is not None:
        ratio = _ratio(standing, reference, matters)
        name = f"{reference.label} (reference)"
        yield _row(results, reference, name, ratio, words_on[reference])
    point = results.points()[0] | standing.scene
    statistic = next((c.sample.statistic for c in standing.order), "")
    rows = results.columns("summary", point).where(metric=f"rms({metric.metric})")
    bound = results.config.get("bound")
    for row in rows.records():
        if row["filter"] not in (bound, *results.exact):
            continue
        number = rounded(row["value"], row["stderr"], 4)
        role = ["bound"] * (row["filter"] == bound) + ["rms"] * (statistic != "rms")
        name = f"{row['filter']} ({', '.join(role)})".removesuffix(" ()")
        yield [Text(name), Text(number, row["value"]), *[Text("–")] * 4]
    ranked = {c.label for c in (*standing.order, *standing.losing, reference) if c is not None}
    failed = {row["filter"] for row in results.failed}
    for label in results.filters:
        if label not in ranked:
            why = "failed" if label in failed else f"has no {metric_words(metric)}"
            yield [Text(label), Text("–", nan), Text(why), *[Text("–")] * 3]


def _ratio(standing: Ranking, c: Candidate, matters: float) -> str:
    """Write ``2.4 x (2.1 to 2.8)``, with a mark where it is not significant; of scores nats."""
    comparison = standing.compared.get(c.name)
    if comparison is None:
        first = "0" if standing.metric.family[0].is_score else "1"
        return first if c in standing.order[:1] else "–"
    if comparison.is_equal:
        return "equal"
    value, low, high = _beside(standing.metric, comparison)
    if not isfinite(value):
        return "–"
    is_score, wide = standing.metric.family[0].is_score, high - low
    texts = [f"{x:.2g}" if is_score else phrases.multiple(x, wide) for x in (value, low, high)]
    text = texts[0] + " x" * (not is_score)
    if isfinite(wide) and (is_score or low > 0.0):
        interval_text = f" ({texts[1]} to {texts[2]})"
    elif isfinite(wide):
        interval_text = f" (at most {texts[2]})"
    elif isfinite(low):
        interval_text = f" (more than {phrases.rounded(low, 2)})"
    else:
        interval_text = ""
    if not comparison.interval_contradicts:
        text += interval_text
    if not comparison.is_tested:
        return text if standing.best is None else f"{text} {rules.UNTESTED}"
    if not comparison.sign:
        return f"{text} n.s."
    is_tiny = comparison.sign and not is_score and abs(value - 1.0) < matters
    return f"{text} tiny" if is_tiny else text


def _beside(metric: Measure, comparison: Comparison) -> tuple[float, float, float]:
    """Compare with the best: ratio and interval; of a score, how far it is below the best."""
    if metric.family[0].is_score:
        comparison = comparison.swapped
        value, limits = comparison.difference.value, comparison.difference.interval()
    else:
        value = comparison.ratio.value
        limits = comparison.ratio_interval
    return (value, *limits) if comparison.is_tested else (value, nan, nan)


def _times_best(standing: Ranking, c: Candidate) -> float:
    """Divide by the best, subtract scores; NaN of a filter that loses more."""
    if c in standing.order[:1]:
        return 0.0 if standing.metric.family[0].is_score else 1.0
    comparison = standing.compared.get(c.name)
    return nan if comparison is None else _beside(standing.metric, comparison)[0]


def _runs_needed(standing: Ranking) -> str:
    """Write how many runs would decide the ties if the differences are as large as measured."""
    runs = []
    for _, tie in standing.not_worse:
        if isfinite(tie.z) and tie.z:
            needed = rules.deviations_needed(tie.tests)
            runs.append(rules.runs_that_decide(tie.difference.runs, tie.z, needed))
    if not runs:
        return ""
    ends = min(runs), max(runs)
    if standing.runs == 1:
        times = [phrases.run_count(x) if x >= 10.0 else f"{max(x, 1.1):.2g}" for x in ends]
        return f"; a recording {_span(times)} times as long would decide differences of this size"
    long = _span([*map(phrases.run_count, ends)])
    return f"; {long} runs would decide differences of this size"


def consistency(results: Results, candidates: Sequence[Candidate]) -> dict[Candidate, str]:
    """Judge NEES, or NIS without a truth, of every filter of a table in a word; empty if unknown.

    The filters are one family of tests: of several exact filters none is called overconfident or
    underconfident with a probability of 1 - `rules.LEVEL`.
    """
    every = {c: _normalized_squares(results, c) for c in candidates}
    means = {c: _mean_if_consistent(results, c) for c in candidates}
    zs = [_z_of_mean(values, means[c]) for c, values in every.items()]
    words = {}
    for (c, values), sign in zip(every.items(), rules.signs(zs), strict=True):
        words[c] = _word_on(values, sign, means[c])
    return words


def _normalized_squares(results: Results, candidate: Candidate) -> Array:
    """Return each run's NEES over the number of components, or ANIS: 1 if consistent; NaN left out."""
    runs = results.runs(candidate.point)
    name = _consistency_metric(results, candidate)
    if not name:
        return np.empty(0)
    n = results.facts(candidate.point).sizes[""] if name == "nees" else 1
    values = runs[candidate.label, name]
    return values[~np.isnan(values)] / n


def _consistency_metric(results: Results, candidate: Candidate) -> str:
    """Name the metric that a filter's consistency is judged by; empty if it has none."""
    runs = results.runs(candidate.point)
    return next((n for n in ("nees", "anis") if (candidate.label, n) in runs), "")


def _mean_if_consistent(results: Results, candidate: Candidate) -> tuple[float, float]:
    """Return the least and largest mean of a consistent filter; a gate accepts small NIS only."""
    accepted = results.facts(candidate.point).accepted_nis(candidate.label)
    if accepted is None or _consistency_metric(results, candidate) == "nees":
        return 1.0, 1.0
    return accepted.mean


def _z_of_mean(values: Array, if_consistent: tuple[float, float]) -> float:
    """Return z of the mean of a consistent filter; NaN where the runs decide nothing.

    Runs with a number that is not finite have a word of their own.
    """
    if len(values) < 2 or not np.isfinite(values).all():
        return nan
    least, largest = if_consistent
    of_runs = mean(values).value
    target = min(max(of_runs, least), largest)
    return studentized(of_runs - target, influence("mean", values))


def _word_on(values: Array, sign: int, if_consistent: tuple[float, float]) -> str:
    """Return the word on runs' normalized squares.

    ``sign`` is that of a significant difference of their mean from that of a consistent filter.
    """
    if not len(values):
        return ""
    if words := collapsed_in_words(values):
        whole = f"{len(values)} of {len(values)} runs"
        return "collapsed in all" if words.endswith(f" {whole}") else words.removesuffix(" runs")
    if isinf(mean(values).value):
        return "overconfident"
    low, high = interval("mean", values)
    return rules.credibility(low, high, sign, if_consistent) or ("" if isnan(low) else "undecided")


def cpu_seconds(results: Results, c: Candidate) -> float:
    """Return the CPU seconds of a filter's run; NaN if they were not measured."""
    rows = results.columns("timing", c.point).where(filter=c.label)
    return float(rows["cpu_s_per_run"][0]) if len(rows) else nan


def _duration(seconds: float) -> str:
    scale, unit = next(((s, u) for s, u in _SECONDS if seconds * s >= 1.0), _SECONDS[-1])
    return f"{phrases.rounded(seconds * scale, 2)} {unit}"


def _is_empty(rows: list[list[Text]], column: int) -> bool:
    return all(row[column].text in ("–", "0") for row in rows)


def _without_empty(results: Results, table: TextTable, names_losses: bool = True) -> TextTable:
    """Leave out columns without a word, and the column of lost runs if there are none.

    The title then says that no run is lost, if it ``names_losses``.
    """
    columns = range(len(table.heads))
    empty = [i for i in columns if _is_empty(table.rows, i)]
    shown = [i for i in columns if i < 3 or i not in empty]
    if names_losses and _LOST in [table.heads[i] for i in empty]:
        table.title += "; no lost runs"
    if any(row[-1].text.endswith("*") for row in table.rows):
        table.notes.append("*: filtered run by run, which is slower than the method.")
    has_nees = any(name == "nees" for _, name in results.runs(results.points()[0]))
    heads = [table.heads[i] for i in shown]
    table.heads = ["ANIS" if head == _ANEES and not has_nees else head for head in heads]
    table.rows = [[*map(row.__getitem__, shown)] for row in table.rows]
    return table


def _over_scenes(results: Results, standings: Sequence[Ranking]) -> TextTable:
    """Count for each filter at how many scenarios of the grid it is among the best."""
    first = standings[0]
    is_score = first.metric.family[0].is_score
    paths = " and ".join(phrases.axis(path) for path in first.scene)
    words = statistic_words([*first.order, *first.losing][0].sample.statistic, first.metric)
    title = f"Ranking over {len(standings)} values of {paths} by {words}"
    title += ", each filter at its best of the grid" * first.chosen
    beside = "Below the best (nats)" if is_score else "Ratio to the best"
    table = TextTable(title, ["Filter", "Among the best", beside, _LOST, _ANEES, _TIME])
    of: dict[str, list[Candidate]] = {}
    ratios: dict[str, list[float]] = {}
    best = Counter[str]()
    for standing in standings:
        best.update(c.label for c in standing.among_the_best)
        for c in (*standing.order, *standing.losing):
            of.setdefault(c.label, []).append(c)
            ratios.setdefault(c.label, []).append(_times_best(standing, c))
    words_on = consistency(results, [*chain.from_iterable(of.values())])
    ratios = {label: sorted(filter(isfinite, values)) for label, values in ratios.items()}
    for label in sorted(of, key=lambda label: (-best[label], np.median(ratios[label] or [inf]))):
        ratio = _span([f"{x:.3g}" for x in ratios[label]])
        row = [Text(label), Text(f"at {best[label]} of {len(standings)}", best[label])]
        row.append(Text(f"{ratio}{' x' * (not is_score)}" if ratio else "–"))
        table.rows.append([*row, *_over_candidates(results, of[label], words_on)])
    table.notes = ["Among the best: the lowest error, or no significant difference from it."]
    return _without_empty(results, table)


def _over_candidates(
    results: Results, candidates: Sequence[Candidate], words_on: Mapping[Candidate, str]
) -> Iterator[Text]:
    """Yield a filter's lost runs, words on its consistency and CPU times over several scenarios."""
    lost, runs = sum(c.losses for c in candidates), sum(len(c.lost) for c in candidates)
    yield Text(f"{lost} of {runs}" if lost else "0", lost)
    words = Counter(words_on[c].partition(" in ")[0] for c in candidates)
    yield Text(", ".join(f"{word} at {n}" for word, n in words.most_common() if word) or "–")
    times = [cpu_seconds(results, c) for c in candidates]
    yield Text(_span([*map(_duration, sorted(filter(isfinite, times)))]) or "–")


def _span(texts: Sequence[str]) -> str:
    """Join the first and last text."""
    return " to ".join(dict.fromkeys((texts[0], texts[-1]))) if texts else ""


def _by_scene(results: Results, standings: Sequence[Ranking]) -> TextTable:
    """Tabulate the numbers: a row for each scenario of the grid, a column for each filter."""
    first = standings[0]
    head = head_of([*first.order, *first.losing][0].sample.statistic, first.metric)
    table = TextTable(head, [*map(phrases.axis, first.scene), *results.filters])
    for standing in standings:
        compared = (*standing.order, *standing.losing, standing.reference)
        cells = {c.label: c for c in compared if c is not None}
        good = [c.label for c in standing.marked]
        row = [Text(phrases.number(value)) for value in standing.scene.values()]
        for label in results.filters:
            number = cells[label].overall if label in cells else None
            text = "–" if number is None else rounded(*number, 4)
            row.append(Text(text, nan if number is None else number.value, best=label in good))
        table.rows.append(row)
    return table
