"""The ranking as a table, a row a filter, the best first: what a user reads before anything else.

Error, ratio to the best with its 95 % interval, lost runs, consistency in a word, CPU time of a run.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from math import inf, isfinite, isnan, nan

import numpy as np

from trackbench.durations import cpu_time_in_words
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.findings import phrases
from trackbench.report.findings.consistency_words import (
    consistency,
    diverged_runs,
    indefinite_text,
    words_decided_alone,
)
from trackbench.report.findings.phrases import head_of, metric_words, named, statistic_words
from trackbench.report.findings.ranking import Candidate, Ranking, best_settings, rankings
from trackbench.report.findings.recording_notes import recording_notes
from trackbench.report.table import Text, TextTable, rounded
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.collapsed_runs import COLLAPSED_NOTE
from trackbench.statistics.comparison import Comparison
from trackbench.statistics.indefinite_covariances import INDEFINITE_NOTE, NOT_DEFINITE
from trackbench.statistics.runs_needed import deviations_needed, runs_that_decide
from trackbench.statistics.sample_statistics import rms

_LOST = "Lost runs"
_ANEES = "ANEES"
_TIME = "CPU per run"
_ERROR_CELL = 1
_RATIO_CELL = 2
_CONSISTENCY_CELL = 4
"""Index of the cell with this content in a row of `_row`; the CPU time is the last cell."""
_FULL_BLOCK = 100
"""Runs that share the calls of a block so that a run's CPU time hardly depends on their number."""
_FAR = 1000.0
"""Ratio to the best beyond which an error shows that the filter has left the target."""
_MOST_SETTINGS = 20
"""Longer tables of a filter's settings are cut to the best."""
_ERROR_DIGITS = 4
"""Significant digits of an error in the table, if its standard error does not decide them."""


def ranking_tables(results: Results, numbers: bool = False) -> list[TextTable]:
    """Tabulate the ranking of the filters, over all scenarios if the grid has several.

    With ``numbers`` there are further tables: one with each scenario's numbers if there are several
    scenarios, otherwise one for each filter that ranks its settings.
    """
    scene_rankings = [ranking for ranking in rankings(results) if ranking.order or ranking.losing]
    if len(scene_rankings) > 1:
        tables = [_table_over_scenes(results, scene_rankings)]
        if numbers:
            tables.append(_table_by_scene(results, scene_rankings))
        return tables
    tables = [_ranking_table(results, ranking, of_settings=False) for ranking in scene_rankings]
    if numbers:
        for ranking in best_settings(results):
            # A filter without the metric, such as one without a likelihood, has no settings to rank.
            if not ranking.order and not ranking.losing:
                continue
            tables.append(_ranking_table(results, ranking, of_settings=True))
    return tables


def _ranking_table(results: Results, ranking: Ranking, of_settings: bool) -> TextTable:
    """Tabulate one ranking: of filters, or of one filter's settings if ``of_settings``.

    The ranking has a candidate at least, in its order or among those that lose more runs.
    """
    candidates = [*ranking.order, *ranking.losing]
    if of_settings:
        candidates = candidates[:_MOST_SETTINGS]
    is_score = ranking.metric.definition.is_score
    # Step 1: title and heads.
    # Over a single run mean and rms are equal, and the words on the rms are shorter.
    statistic = candidates[0].sample.statistic if ranking.runs > 1 else "rms"
    statistic_name = statistic_words(statistic, ranking.metric)
    if of_settings:
        title = named(candidates[0].label)
        if ranking.scene:
            title += f", {phrases.heading(ranking.scene)}"
        title += f": {statistic_name} of its settings"
    else:
        title = f"Ranking over {_runs_ranked(ranking)}"
        if results.citation:
            title = f"{results.citation}: ranking"
        title += f" by {statistic_name}"
        if ranking.chosen:
            title += ", each filter at its best of the grid"
    heads = [
        "Settings" if of_settings else "Filter",
        head_of(statistic, ranking.metric),
        "Below the best (nats)" if is_score else "Ratio to the best (95 %)",
        *[_LOST, _ANEES, _TIME],
    ]
    table = TextTable(title, heads)
    # Step 2: a row per filter or setting, and rows of what has no rank.
    matters = rules.share_that_matters(results.config.get("matters"))
    references = [] if ranking.reference is None else [ranking.reference]
    consistency_words = consistency(results, [*candidates, *references])
    for candidate in candidates:
        if of_settings:
            name = candidate.setting
        else:
            name = candidate.label
            if candidate.varied:
                name += f" at {candidate.setting}"
        if candidate in ranking.losing:
            ratio = "unranked: loses more"
        else:
            ratio = _ratio(ranking, candidate, matters)
        row = _row(results, candidate, name, ratio, consistency_words[candidate])
        table.rows.append(row)
    if not of_settings:
        for row in _unranked_rows(results, ranking, matters, consistency_words):
            _insert_row(table.rows, row, is_score)
    # Step 3: notes on the words that occur. A row has the cells of `_row`.
    ratios = " ".join(row[_RATIO_CELL].text for row in table.rows)
    if "n.s." in ratios:
        table.notes.append(
            f"n.s.: not significant at {100 * rules.LEVEL:g} % over all pairs of filters"
            f"{_runs_needed(ranking)}."
        )
        # A ratio without an interval in parentheses.
        if any(row[_RATIO_CELL].text.endswith("x n.s.") for row in table.rows):
            table.notes.append(
                "An interval is of its pair alone, and left out where it contradicts n.s."
            )
    if any(candidate.sample.steps is not None for candidate in candidates):
        number = "score" if is_score else "error"
        table.notes.append(
            f"One recording: a filter's own {number} has no ±, as it depends on the path that all "
            "filters share; compare by the third column."
        )
    if rules.UNTESTED in ratios:
        table.notes.append(
            f"{rules.UNTESTED}: the difference from the best has no standard error, so that it may be "
            "by chance."
        )
    if "tiny" in ratios:
        table.notes.append(f"tiny: significant, but at most {phrases.percent(matters)}.")
    if any("collapsed" in row[_CONSISTENCY_CELL].text for row in table.rows):
        table.notes.append(COLLAPSED_NOTE)
    ranked = [*candidates, *references]
    indefinite_texts = [text for c in ranked if (text := indefinite_text(results, c))]
    if indefinite_texts:
        texts = phrases.listed(indefinite_texts)
        table.notes.append(f"Covariance {NOT_DEFINITE}: {texts}. {INDEFINITE_NOTE}")
    decided_alone = words_decided_alone(results, consistency_words)
    if decided_alone:
        verb = phrases.verb(decided_alone)
        table.notes.append(
            f"undecided: {phrases.listed(decided_alone)} {verb} decided by a test of one filter alone. "
            "The words are tested over all filters of the table, and may change with them."
        )
    diverged_texts = diverged_runs(results, candidates, consistency_words)
    if diverged_texts:
        table.notes.append(
            f"Diverged: {phrases.listed(diverged_texts)}. The last ten estimates of these runs are "
            "outside their own confidence regions."
        )
    smoothers = _smoothers_below_bound(results, ranking)
    if smoothers and not of_settings:
        table.notes.append(
            f"The bound is that of filters: {phrases.listed(smoothers)} may lie below it by later "
            "measurements."
        )
    has_times = any(row[-1].text != "–" for row in table.rows)  # the last cell is the CPU time
    if 1 < ranking.runs < _FULL_BLOCK and has_times:
        table.notes.append("CPU times: a run takes less in blocks of more runs.")
    far_labels = _far_from_best(ranking)
    if far_labels:
        table.notes.append(
            f"{phrases.listed(far_labels)}: more than {_FAR:g} times the error of the best, and no run "
            "counts as lost: `lost_beyond` under `score` sets the error from which a run does."
        )
    if not of_settings:
        table.notes += recording_notes(results, ranking)
    # A title that says "no lost runs" would mislead where filters are far from the target.
    names_losses = not far_labels and not diverged_texts
    return _finish_table(results, table, names_losses=names_losses)


def _far_from_best(ranking: Ranking) -> list[str]:
    """Name the filters that have left the target although none of their runs counts as lost.

    Their error is more than `_FAR` times that of the best. A log score has no such ratio.
    """
    if ranking.metric.definition.is_score or not ranking.order:
        return []
    limit = _FAR * ranking.order[0].overall.value
    return [c.name for c in ranking.order if not c.losses and c.overall.value > limit > 0.0]


def _runs_ranked(ranking: Ranking) -> str:
    """Write in how many runs any filter has a value or is lost: ``3 of 5 runs``, ``5 runs`` for all.

    In a recorded run without a truth no filter has a value or is lost.
    """
    if ranking.runs <= 1:
        return "one run"
    is_ranked = np.zeros(ranking.runs, dtype=np.bool_)
    for candidate in (*ranking.order, *ranking.losing):
        values = candidate.sample.values
        M = len(values)  # a filter may have fewer runs than another
        is_ranked[:M] |= np.isfinite(values) | (candidate.lost[:M] > 0)
    number = int(is_ranked.sum())
    all_runs = counted(ranking.runs, "run")
    if number in (0, ranking.runs):  # 0 without a truth
        return all_runs
    return f"{number} of {all_runs}"


def _insert_row(rows: list[list[Text]], row: list[Text], is_score: bool) -> None:
    """Insert a row without a rank into ``rows``, before the first row whose number is not better.

    The number is the error, or the score if ``is_score``: then the highest number is the best, else the
    lowest. A row with NaN comes last.
    """
    sign = -1.0 if is_score else 1.0  # times this sign, a lower number is a better one
    number = (row[_ERROR_CELL].number or 0.0) * sign
    for place, other_row in enumerate(rows):
        other_number = (other_row[_ERROR_CELL].number or 0.0) * sign
        if other_number >= number:
            rows.insert(place, row)
            return
    rows.append(row)


def _row(
    results: Results, candidate: Candidate, name: str, ratio: str, consistency_word: str
) -> list[Text]:
    """Write the six cells of a row: name, error, ratio to the best, lost runs, consistency, CPU time.

    ``name``, ``ratio`` and ``consistency_word`` are the texts of their cells.
    """
    value = candidate.overall.value
    error = "–" if isnan(value) else rounded(value, candidate.overall.stderr, _ERROR_DIGITS)
    losses = "0"
    if candidate.losses:
        losses = f"{candidate.losses} of {len(candidate.lost)}"
    seconds = cpu_seconds(results, candidate)
    time = "–"
    if isfinite(seconds):
        time = cpu_time_in_words(seconds)
        if candidate.label in results.loops_over_runs:
            time += " *"  # `_finish_table` adds a note on this mark
    return [
        Text(name),
        Text(error, number=value),
        Text(ratio),
        Text(losses, number=candidate.losses),
        Text(consistency_word or "–"),
        Text(time, number=seconds),
    ]


def _bound_point(results: Results, ranking: Ranking) -> GridPoint:
    """Return the point of the grid at which the bound and exact errors of a ranking are taken.

    The scenario has the values of the ranking, and all other paths have their first values.
    """
    return results.points()[0] | ranking.scene


def _smoothers_below_bound(results: Results, ranking: Ranking) -> list[str]:
    """List the smoothers whose root mean square error is smaller than the bound's."""
    point = _bound_point(results, ranking)
    summary = results.columns("summary", point)
    of_metric = summary.where(metric=f"rms({ranking.metric.metric})").records()
    bounds = [row["value"] for row in of_metric if row["filter"] == results.config.get("bound")]
    if not bounds:
        return []
    # A smoother is a filter with the key `smooth`, or the copy of one that the config's key `smoothed`
    # names.
    filters = results.config.get("filters", {})
    smoothed_labels = {f"{label}, smoothed" for label in results.config.get("smoothed", ())}
    below = []
    for candidate in ranking.order:
        label = candidate.label
        is_smoother = label in smoothed_labels or filters.get(label, {}).get("smooth")
        if not is_smoother:
            continue
        errors = candidate.sample.values
        if rms(errors[~np.isnan(errors)]).value < bounds[0]:
            below.append(label)
    return below


def _unranked_rows(
    results: Results,
    ranking: Ranking,
    matters: float,
    consistency_words: Mapping[Candidate, str],
) -> Iterator[list[Text]]:
    """Yield rows of the reference, the bound, exact errors, and filters that the ranking does not have.

    A row has the cells of `_row`. ``matters`` is the share of an error below which a significant
    difference is called tiny. ``consistency_words`` has the word on the reference's consistency.
    """
    reference = ranking.reference
    if reference is not None:
        ratio = _ratio(ranking, reference, matters)
        name = f"{reference.label} (reference)"
        yield _row(results, reference, name, ratio, consistency_words[reference])
    # The bound and the exact errors of linear filters, `results.exact`, are stored as rms errors.
    point = _bound_point(results, ranking)
    statistic = next((candidate.sample.statistic for candidate in ranking.order), "")
    bound = results.config.get("bound")
    summary = results.columns("summary", point)
    for summary_row in summary.where(metric=f"rms({ranking.metric.metric})").records():
        label = summary_row["filter"]
        if label != bound and label not in results.exact:
            continue
        remarks = []
        if label == bound:
            remarks.append("bound")
        if statistic != "rms":
            remarks.append("rms")
        name = label
        if remarks:
            name += f" ({', '.join(remarks)})"
        value = summary_row["value"]
        error = rounded(value, summary_row["stderr"], _ERROR_DIGITS)
        yield [Text(name), Text(error, number=value), *[Text("–")] * 4]
    # Filters that the ranking does not have.
    candidates = (*ranking.order, *ranking.losing, reference)
    ranked_labels = {candidate.label for candidate in candidates if candidate is not None}
    failed_labels = {row["filter"] for row in results.failed}
    for label in results.filters:
        if label not in ranked_labels:
            why = "failed" if label in failed_labels else f"has no {metric_words(ranking.metric)}"
            yield [Text(label), Text("–", number=nan), Text(why), *[Text("–")] * 3]


def _ratio(ranking: Ranking, candidate: Candidate, matters: float) -> str:
    """Write a filter's ratio to the best and its interval, ``2.4 x (2.1 to 2.8)``, with a mark.

    The mark is ``n.s.`` for a difference that is not significant, and ``tiny`` for a significant one
    below the share ``matters`` of the error. Of scores the text is the difference in nats.
    """
    is_score = ranking.metric.definition.is_score
    comparison = ranking.compared.get(candidate.name)
    if comparison is None:
        # The first of the order is the best; any other filter is not compared with it.
        is_best = candidate in ranking.order[:1]
        if not is_best:
            return "–"
        return "0" if is_score else "1"
    if comparison.is_equal:
        return "equal"
    value, low, high = _ratio_to_best(ranking.metric, comparison)
    if not isfinite(value):
        return "–"
    with_interval = not comparison.interval_contradicts
    text = _ratio_text(is_score, value, low, high, with_interval)
    if not comparison.is_tested:
        # Without a best filter the sentences say why nothing is tested.
        if ranking.best is None:
            return text
        return f"{text} {rules.UNTESTED}"
    if not comparison.sign:
        return f"{text} n.s."
    is_tiny = not is_score and abs(value - 1.0) < matters
    if is_tiny:
        return f"{text} tiny"
    return text


def _ratio_text(is_score: bool, value: float, low: float, high: float, with_interval: bool) -> str:
    """Write a ratio with its interval from ``low`` to ``high``: ``2.4 x (2.1 to 2.8)``.

    An end that is not finite, or the low end of a ratio if it is not above zero, is left out: ``2.4 x
    (at most 2.8)``. If ``is_score``, the numbers are differences of scores. The interval is left out
    unless ``with_interval``.
    """
    width = high - low
    if is_score:
        text = f"{value:.2g}"
        low_text = f"{low:.2g}"
        high_text = f"{high:.2g}"
    else:
        text = f"{phrases.multiple(value, width)} x"
        low_text = phrases.multiple(low, width)
        high_text = phrases.multiple(high, width)
    if not with_interval:
        return text
    if isfinite(width) and (is_score or low > 0.0):
        return f"{text} ({low_text} to {high_text})"
    if isfinite(width):
        return f"{text} (at most {high_text})"
    if isfinite(low):
        return f"{text} (more than {phrases.rounded(low, 2)})"
    return text


def _ratio_to_best(metric: Measure, comparison: Comparison) -> tuple[float, float, float]:
    """Return a filter's ratio to the best, and the low and high end of its 95 % interval.

    ``comparison`` is that of the filter with the best. The ends are NaN if it is not tested. Of a score
    the numbers are how far it lies below the best.
    """
    # A ratio of scores, which are logarithms, would mean nothing.
    if metric.definition.is_score:
        difference = comparison.swapped.difference  # the best minus this filter
        value = difference.value
        low, high = difference.interval()
    else:
        value = comparison.ratio.value
        low, high = comparison.ratio_interval
    if comparison.is_tested:
        return (value, low, high)
    return (value, nan, nan)


def _multiple_of_best(ranking: Ranking, candidate: Candidate) -> float:
    """Return a filter's ratio to the best; of a score how far it lies below the best.

    It is NaN if the filter is not compared with the best. One that loses more runs is not.
    """
    is_best = candidate in ranking.order[:1]
    if is_best:
        return 0.0 if ranking.metric.definition.is_score else 1.0
    comparison = ranking.compared.get(candidate.name)
    if comparison is None:
        return nan
    value, _, _ = _ratio_to_best(ranking.metric, comparison)
    return value


def _runs_needed(ranking: Ranking) -> str:
    """Write how many runs would decide the ties if the differences are as large as measured.

    The text follows a clause: ``; 200 to 500 runs would decide differences of this size``. It is empty
    if no tie has a measured difference.
    """
    needed_runs = []
    for rival in ranking.not_worse:
        comparison = rival.comparison
        if isfinite(comparison.z) and comparison.z:
            # The number of standard errors that is significant among so many tests.
            needed_z = deviations_needed(comparison.tests)
            measured_runs = comparison.difference.runs
            needed_runs.append(runs_that_decide(measured_runs, comparison.z, needed_z))
    if not needed_runs:
        return ""
    ends = (min(needed_runs), max(needed_runs))
    # One run is a recording, which is compared step by step: the numbers are multiples of its length,
    # of which two digits are written, and at least 1.1.
    if ranking.runs == 1:
        times = []
        for multiple in ends:
            if multiple >= 10.0:
                times.append(phrases.run_count(multiple))
            else:
                times.append(f"{max(multiple, 1.1):.2g}")
        text = _span(times)
        return f"; a recording {text} times as long would decide differences of this size"
    text = _span([phrases.run_count(x) for x in ends])
    return f"; {text} runs would decide differences of this size"


def cpu_seconds(results: Results, candidate: Candidate) -> float:
    """Return the CPU seconds of a filter's run; NaN if they were not measured."""
    rows = results.columns("timing", candidate.point).where(filter=candidate.label)
    if not len(rows):
        return nan
    return float(rows["cpu_s_per_run"][0])


def _finish_table(results: Results, table: TextTable, names_losses: bool = True) -> TextTable:
    """Leave out the empty columns of a ranking, add its last note, and set its column heads.

    If no run is lost, the title says so, unless ``names_losses`` is False.
    """
    # Step 1: the first three columns stay in every table. Any other needs a cell that says something.
    columns = []
    for i, head in enumerate(table.heads):
        is_empty = all(row[i].text in ("–", "0") for row in table.rows)
        if i < 3 or not is_empty:
            columns.append(i)
        if head == _LOST and is_empty and names_losses:
            table.title += "; no lost runs"
    # Step 2: a star marks the CPU time of a filter that loops over the runs in Python.
    if any(row[-1].text.endswith("*") for row in table.rows):
        table.notes.append("*: filtered run by run, which is slower than the method.")
        if results.programs:
            table.notes.append(phrases.time_of_programs(results.programs))
    # Step 3: without NEES, which needs a truth, the column of consistency is about ANIS.
    has_nees = any(name == "nees" for _, name in results.runs(results.points()[0]))
    heads = []
    for i in columns:
        head = table.heads[i]
        if head == _ANEES and not has_nees:
            head = "ANIS"
        heads.append(head)
    table.heads = heads
    table.rows = [[row[i] for i in columns] for row in table.rows]
    return table


def _table_over_scenes(results: Results, scene_rankings: Sequence[Ranking]) -> TextTable:
    """Tabulate for each filter at how many scenarios it is among the best, and its other numbers."""
    # Step 1: title and heads. Metric and statistic are those of every scenario.
    first = scene_rankings[0]
    is_score = first.metric.definition.is_score
    statistic = [*first.order, *first.losing][0].sample.statistic
    paths = " and ".join(phrases.axis(path) for path in first.scene)
    title = f"Ranking over {len(scene_rankings)} values of {paths}"
    title += f" by {statistic_words(statistic, first.metric)}"
    if first.chosen:
        title += ", each filter at its best of the grid"
    ratio_head = "Below the best (nats)" if is_score else "Ratio to the best"
    number_head = head_of(statistic, first.metric)
    heads = ["Filter", "Among the best", number_head, ratio_head, _LOST, _ANEES, _TIME]
    table = TextTable(title, heads)
    # Step 2: each filter over the scenarios.
    times_best = Counter[str]()
    values: dict[str, list[float]] = {}
    candidates: dict[str, list[Candidate]] = {}
    ratios: dict[str, list[float]] = {}
    for ranking in scene_rankings:
        times_best.update(candidate.label for candidate in ranking.among_the_best)
        for candidate in (*ranking.order, *ranking.losing):
            candidates.setdefault(candidate.label, []).append(candidate)
            ratios.setdefault(candidate.label, []).append(_multiple_of_best(ranking, candidate))
            values.setdefault(candidate.label, []).append(candidate.overall.value)
    sorted_ratios = {label: sorted(filter(isfinite, ratios[label])) for label in ratios}
    consistency_words = consistency(results, [*chain.from_iterable(candidates.values())])

    # Step 3: a row per filter. Those that are among the best most often come first, then those with the
    # lowest median ratio.
    def sort_key(label: str) -> tuple[int, float]:
        median_ratio = float(np.median(sorted_ratios[label] or [inf]))
        return -times_best[label], median_ratio

    for label in sorted(candidates, key=sort_key):
        number = times_best[label]
        ratio = "–"
        if sorted_ratios[label]:
            ratio = _span([f"{x:.3g}" for x in sorted_ratios[label]])
            if not is_score:
                ratio += " x"
        numbers = [phrases.rounded(x, 4) for x in sorted(filter(isfinite, values[label]))]
        cells = [Text(label), Text(f"at {number} of {len(scene_rankings)}", number)]
        cells += [Text(_span(numbers) or "–"), Text(ratio)]
        cells += _cells_over_scenes(results, candidates[label], consistency_words)
        table.rows.append(cells)
    extreme = "highest score" if is_score else "lowest error"
    table.notes = [
        f"Among the best: the {extreme}, or no significant difference from it, however large."
    ]
    return _finish_table(results, table)


def _cells_over_scenes(
    results: Results, candidates: Sequence[Candidate], consistency_words: Mapping[Candidate, str]
) -> list[Text]:
    """Write a filter's lost runs, words on its consistency and CPU times over several scenarios.

    ``candidates`` are the filter in each scenario, and ``consistency_words`` the words on them.
    """
    lost = sum(candidate.losses for candidate in candidates)
    runs = sum(len(candidate.lost) for candidate in candidates)
    losses = f"{lost} of {runs}" if lost else "0"
    # "collapsed in 3 of 10" counts as "collapsed".
    words = Counter(consistency_words[c].partition(" in ")[0] for c in candidates)
    consistency_texts = [f"{word} at {n}" for word, n in words.most_common() if word]
    seconds = sorted(filter(isfinite, [cpu_seconds(results, c) for c in candidates]))
    times = [cpu_time_in_words(x) for x in seconds]
    return [
        Text(losses, lost),
        Text(", ".join(consistency_texts) or "–"),
        Text(_span(times) or "–"),
    ]


def _span(texts: Sequence[str]) -> str:
    """Join the first and last text: ``2 to 5``; ``2`` if they are equal, empty if there are none."""
    if not texts:
        return ""
    return " to ".join(dict.fromkeys((texts[0], texts[-1])))


def _table_by_scene(results: Results, scene_rankings: Sequence[Ranking]) -> TextTable:
    """Tabulate the numbers: a row for each scenario of the grid, a column for each filter."""
    first = scene_rankings[0]
    title = head_of([*first.order, *first.losing][0].sample.statistic, first.metric)
    table = TextTable(title, [*map(phrases.axis, first.scene), *results.filters])
    for ranking in scene_rankings:
        candidates = (*ranking.order, *ranking.losing, ranking.reference)
        numbers = {c.label: c.overall for c in candidates if c is not None}
        marked_labels = [candidate.label for candidate in ranking.marked]
        cells = [Text(phrases.number(value)) for value in ranking.scene.values()]
        for label in results.filters:
            is_best = label in marked_labels
            if label in numbers:
                value, stderr = numbers[label]
                cells.append(Text(rounded(value, stderr, 4), value, best=is_best))
            else:
                cells.append(Text("–", nan, best=is_best))
        table.rows.append(cells)
    return table
