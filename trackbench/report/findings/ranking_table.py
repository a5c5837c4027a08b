"""The ranking as a table, a row a filter, the best first: what a user reads before anything else.

Error, ratio to the best with its 95 % interval, lost runs, consistency in a word, CPU time of a run.
"""

from collections.abc import Iterator, Mapping
from math import isfinite, isnan, nan

from trackbench.durations import cpu_time_in_words
from trackbench.errors import counted
from trackbench.report.findings import grid_headings
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.consistency_words import (
    consistency,
    diverged_runs,
)
from trackbench.report.findings.metric_phrases import head_of, metric_words, statistic_words
from trackbench.report.findings.notes_below_ranking_table import (
    far_from_best,
    ranking_notes,
    unranked_runs,
)
from trackbench.report.findings.phrases import named
from trackbench.report.findings.ranking import Ranking, rankings
from trackbench.report.findings.ranking_columns import (
    ANEES,
    ERROR_CELL,
    LOST,
    TIME,
    bound_point,
    cpu_seconds,
    finish_table,
)
from trackbench.report.findings.ranking_of_settings import best_settings
from trackbench.report.findings.ranking_over_scenarios import (
    table_by_scenario,
    table_over_scenarios,
)
from trackbench.report.findings.ratio_to_best import marked_ratio
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.rounded_numbers import rounded
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules

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
        tables = [table_over_scenarios(results, scene_rankings)]
        if numbers:
            tables.append(table_by_scenario(results, scene_rankings))
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
            title += f", {grid_headings.heading(ranking.scene)}"
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
        *[LOST, ANEES, TIME],
    ]
    table = TextTable(title, heads)
    # Step 2: a row per filter or setting, and rows of what has no rank. A significant difference of an
    # error from the best is called tiny below the share ``matters`` of it.
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
            ratio = marked_ratio(ranking, candidate, matters)
        row = _row(results, candidate, name, ratio, consistency_words[candidate])
        table.rows.append(row)
    if not of_settings:
        for row in _unranked_rows(results, ranking, matters, consistency_words):
            _insert_row(table.rows, row, is_score)
    # Step 3: notes, and the columns that say something.
    ranked = [*candidates, *references]
    table.notes += ranking_notes(
        results, ranking, table.rows, ranked, consistency_words, matters, of_settings
    )
    # A title that says "no lost runs" would mislead where filters are far from the target.
    has_diverged = bool(diverged_runs(results, candidates, consistency_words))
    names_losses = not far_from_best(ranking) and not has_diverged
    return finish_table(results, table, names_losses=names_losses)


def _runs_ranked(ranking: Ranking) -> str:
    """Write in how many runs any filter has a value or is lost: ``3 of 5 runs``, ``5 runs`` for all.

    In a recorded run without a truth no filter has a value or is lost.
    """
    if ranking.runs <= 1:
        return "one run"
    all_runs = counted(ranking.runs, "run")
    unranked = unranked_runs(ranking)
    if not unranked:
        return all_runs
    return f"{ranking.runs - len(unranked)} of {all_runs}"


def _insert_row(rows: list[list[Text]], row: list[Text], is_score: bool) -> None:
    """Insert a row without a rank into ``rows``, before the first row whose number is not better.

    The number is the error, or the score if ``is_score``: then the highest number is the best, else the
    lowest. A row with NaN comes last.
    """
    sign = -1.0 if is_score else 1.0  # times this sign, a lower number is a better one
    # Each row has a number in this cell, NaN without a value. Only the type of a cell allows None.
    number = (row[ERROR_CELL].number or 0.0) * sign
    for place, other_row in enumerate(rows):
        other_number = (other_row[ERROR_CELL].number or 0.0) * sign
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
            time += " *"  # `finish_table` adds a note on this mark
    return [
        Text(name),
        Text(error, number=value),
        Text(ratio),
        Text(losses, number=candidate.losses),
        Text(consistency_word or "–"),
        Text(time, number=seconds),
    ]


def _unranked_rows(
    results: Results,
    ranking: Ranking,
    matters: float,
    consistency_words: Mapping[Candidate, str],
) -> Iterator[list[Text]]:
    """Yield rows of the reference, the bound, exact errors, and filters that the ranking does not have.

    The ranking has the filters in its ``order`` and those in ``losing``, which lose significantly more
    runs than another: both have rows already. A row has the cells of `_row`. ``matters`` is the share of
    an error below which a significant difference is called tiny. ``consistency_words`` has the word on
    the reference's consistency.
    """
    reference = ranking.reference
    if reference is not None:
        ratio = marked_ratio(ranking, reference, matters)
        name = f"{reference.label} (reference)"
        yield _row(results, reference, name, ratio, consistency_words[reference])
    # The bound and the exact errors of linear filters, `results.exact`, are stored as rms errors.
    point = bound_point(results, ranking)
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
