"""Ranking over several scenarios of a grid: at how many of them a filter is among the best."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain
from math import inf, isfinite, nan

import numpy as np

from trackbench.config.grid import single_paths
from trackbench.durations import cpu_time_in_words
from trackbench.report.findings import grid_headings, phrases
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.consistency_words import consistency
from trackbench.report.findings.metric_phrases import head_of, statistic_words
from trackbench.report.findings.ranking import Ranking
from trackbench.report.findings.ranking_columns import (
    ANEES,
    LOST,
    TIME,
    cpu_seconds,
    finish_table,
    span,
)
from trackbench.report.findings.ratio_to_best import multiple_of_best
from trackbench.report.findings.recording_notes import recording_notes
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.rounded_numbers import rounded
from trackbench.report.tables_and_figures import Results

_KEYS_OF_RECORDINGS = frozenset(("scenario.target.runs", "scenario.target.measurements"))
"""Keys of a grid whose values choose recordings."""


def table_over_scenarios(results: Results, scene_rankings: Sequence[Ranking]) -> TextTable:
    """Tabulate for each filter at how many scenarios it is among the best, and its other numbers.

    A ranking has the filters in ``order``, and apart from them those ``losing`` significantly more runs
    than another, which have no rank. ``chosen`` is True if a filter is ranked with its best setting.
    """
    # Step 1: title and heads. Metric and statistic are those of every scenario.
    first = scene_rankings[0]
    is_score = first.metric.definition.is_score
    any_candidate = [*first.order, *first.losing][0]
    statistic = any_candidate.sample.statistic
    paths = " and ".join(grid_headings.axis(path) for path in first.scene)
    title = f"Ranking over {len(scene_rankings)} values of {paths}"
    title += f" by {statistic_words(statistic, first.metric)}"
    if first.chosen:
        title += ", each filter at its best of the grid"
    ratio_head = "Below the best (nats)" if is_score else "Ratio to the best"
    number_head = head_of(statistic, first.metric)
    heads = ["Filter", "Among the best", number_head, ratio_head, LOST, ANEES, TIME]
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
            ratios.setdefault(candidate.label, []).append(multiple_of_best(ranking, candidate))
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
            ratio = span([f"{x:.3g}" for x in sorted_ratios[label]])
            if not is_score:
                ratio += " x"
        numbers = [phrases.rounded(x, 4) for x in sorted(filter(isfinite, values[label]))]
        # The second field of a text is the number by which the page sorts.
        cells = [Text(label), Text(f"at {number} of {len(scene_rankings)}", number)]
        cells += [Text(span(numbers) or "–"), Text(ratio)]
        cells += _cells_over_scenarios(results, candidates[label], consistency_words)
        table.rows.append(cells)
    extreme = "highest score" if is_score else "lowest error"
    table.notes = [
        f"Among the best: the {extreme}, or no significant difference from it, however large."
    ]
    first = scene_rankings[0]
    keys = chain.from_iterable(single_paths(path) for path in first.scene)
    if first.runs == 1 and not _KEYS_OF_RECORDINGS.isdisjoint(keys):
        table.notes.append(
            "Each recording is judged alone, by its steps: no test is over all of them."
        )
    table.notes += _notes_on_recordings(results, scene_rankings)
    return finish_table(results, table)


def _notes_on_recordings(results: Results, scene_rankings: Sequence[Ranking]) -> list[str]:
    """Return the notes that stand below the ranking of each recording alone, with its grid point.

    Of many points with notes the result has one note, with their number and the first of them.
    """
    notes_by_point: dict[str, list[str]] = {}
    for ranking in scene_rankings:
        notes = recording_notes(results, ranking)
        if notes:
            notes_by_point[grid_headings.heading(ranking.scene, results.grid_units)] = notes
    if len(notes_by_point) > phrases.MOST_NAMES:
        number = f"{len(notes_by_point)} of {len(scene_rankings)} values"
        points = phrases.listed([*notes_by_point])
        return [
            f"At {number} there are notes on the recording, as on an ANIS outside its band: {points}. "
            "Run one of them alone to read its notes."
        ]
    return [f"At {point}: {note}" for point, notes in notes_by_point.items() for note in notes]


def _cells_over_scenarios(
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
        Text(losses, number=lost),
        Text(", ".join(consistency_texts) or "–"),
        Text(span(times) or "–"),
    ]


def table_by_scenario(results: Results, scene_rankings: Sequence[Ranking]) -> TextTable:
    """Tabulate the ranking metric: a row for each scenario of the grid, a column for each filter.

    A cell has the filter's mean or rms over the runs. The best filter of a row, and those near it
    without a significant difference, are marked. A filter without a number has a dash.
    """
    first = scene_rankings[0]
    # Filters with a rank are in ``order``; those that lose significantly more runs are in ``losing``.
    any_candidate = [*first.order, *first.losing][0]
    title = head_of(any_candidate.sample.statistic, first.metric)
    table = TextTable(title, [*map(grid_headings.axis, first.scene), *results.filters])
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


def headline_over_scenarios(scene_rankings: Sequence[Ranking]) -> str:
    """Return the sentence on the filter that is among the best most often; empty if none ever is."""
    times_best = Counter[str]()
    for ranking in scene_rankings:
        times_best.update(candidate.label for candidate in ranking.among_the_best)
    if not times_best:
        return ""
    label, times = times_best.most_common(1)[0]
    paths = phrases.joined(grid_headings.axis(path) for path in scene_rankings[0].scene)
    name = phrases.named(label)
    return f"{name} is among the best at {times} of {len(scene_rankings)} values of {paths}."
