"""Notes below a ranking: meanings of words, runs that would decide, filters far off, diverged runs."""

from collections.abc import Mapping, Sequence
from math import isfinite

import numpy as np

from trackbench.report.findings import phrases
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.consistency_words import (
    diverged_runs,
    indefinite_text,
    words_decided_alone,
)
from trackbench.report.findings.cpu_time_notes import small_block_notes
from trackbench.report.findings.ranking import Ranking
from trackbench.report.findings.ranking_columns import (
    CONSISTENCY_CELL,
    RATIO_CELL,
    bound_point,
    span,
)
from trackbench.report.findings.recording_notes import recording_notes
from trackbench.report.markdown_table import Text
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.collapsed_runs import COLLAPSED_NOTE
from trackbench.statistics.indefinite_covariances import INDEFINITE_NOTE, NOT_DEFINITE
from trackbench.statistics.runs_needed import deviations_needed, run_count, runs_that_decide
from trackbench.statistics.sample_statistics import rms

_FAR = 1000.0
"""Ratio to the best beyond which an error shows that the filter has left the target."""


def ranking_notes(
    results: Results,
    ranking: Ranking,
    rows: Sequence[Sequence[Text]],
    ranked: Sequence[Candidate],
    consistency_words: Mapping[Candidate, str],
    matters: float,
    of_settings: bool,
) -> list[str]:
    """Return the notes below the table of a ranking.

    Parameters
    ----------
    results
        results folder
    ranking
        ranking of one scenario
    rows
        rows of the table, with the columns of `ranking_columns`
    ranked
        filters or settings of the table, and the reference behind them
    consistency_words
        words on the consistency of these filters
    matters
        share of an error from which a difference is not tiny
    of_settings
        True if the table ranks the settings of one filter

    Returns
    -------
    list[str]
        A note each on words that occur, runs that would decide, filters far off, and a recording.
    """
    is_score = ranking.metric.definition.is_score
    candidates = [candidate for candidate in ranked if candidate is not ranking.reference]
    notes: list[str] = []
    ratios = " ".join(row[RATIO_CELL].text for row in rows)
    if "n.s." in ratios:
        notes.append(
            f"n.s.: not significant at {100 * rules.LEVEL:g} % over all pairs of filters"
            f"{_runs_needed(ranking)}."
        )
        # A ratio without an interval in parentheses.
        if any(row[RATIO_CELL].text.endswith("x n.s.") for row in rows):
            notes.append("An interval is of its pair alone, and left out where it contradicts n.s.")
    if any(candidate.sample.steps is not None for candidate in candidates):
        number = "score" if is_score else "error"
        notes.append(
            f"One recording: a filter's own {number} has no ±, as it depends on the path that all "
            "filters share; compare by the third column."
        )
    if rules.UNTESTED in ratios:
        reasons = [rival.difference.why for rival in ranking.rivals if rival.difference.why]
        reason = f" ({phrases.listed(list(dict.fromkeys(reasons)))})" if reasons else ""
        notes.append(
            f"{rules.UNTESTED}: the difference from the best has no standard error{reason}, so that it "
            "may be by chance."
        )
    if "tiny" in ratios:
        notes.append(f"tiny: significant, but at most {phrases.percent(matters)}.")
    if any("collapsed" in row[CONSISTENCY_CELL].text for row in rows):
        notes.append(COLLAPSED_NOTE)
    indefinite_texts = [text for c in ranked if (text := indefinite_text(results, c))]
    if indefinite_texts:
        texts = phrases.listed(indefinite_texts)
        notes.append(f"Covariance {NOT_DEFINITE}: {texts}. {INDEFINITE_NOTE}")
    decided_alone = words_decided_alone(results, consistency_words)
    if decided_alone:
        verb = phrases.verb(decided_alone)
        notes.append(
            f"undecided: {phrases.listed(decided_alone)} {verb} decided by a test of one filter alone. "
            "The words are tested over all filters of the table, and may change with them."
        )
    diverged_texts = diverged_runs(results, candidates, consistency_words)
    if diverged_texts:
        notes.append(
            f"Diverged: {phrases.listed(diverged_texts)}. The last ten estimates of these runs are "
            "outside their own confidence regions."
        )
    smoothers = _smoothers_below_bound(results, ranking)
    if smoothers and not of_settings:
        notes.append(
            f"The bound is that of filters: {phrases.listed(smoothers)} may lie below it by later "
            "measurements."
        )
    has_times = any(row[-1].text != "–" for row in rows)  # the last cell is the CPU time
    if has_times:
        notes += small_block_notes(ranking.runs)
    far_labels = far_from_best(ranking)
    if far_labels:
        notes.append(
            f"{phrases.listed(far_labels)}: more than {_FAR:g} times the error of the best, and no run "
            "counts as lost: `lost_beyond` under `score` sets the error from which a run does."
        )
    if not of_settings:
        notes += _note_on_unranked_runs(results, ranking)
        notes += recording_notes(results, ranking)
    return notes


def unranked_runs(ranking: Ranking) -> list[int]:
    """Return the numbers of the runs in which no filter has a value or is lost.

    The list is empty if this is so in all runs, as in recorded runs without a truth.
    """
    is_ranked = np.zeros(ranking.runs, dtype=np.bool_)
    for candidate in (*ranking.order, *ranking.losing):
        values = candidate.sample.values
        M = len(values)  # a filter may have fewer runs than another
        is_ranked[:M] |= np.isfinite(values) | (candidate.lost[:M] > 0)
    if not is_ranked.any():
        return []
    numbers: list[int] = np.flatnonzero(~is_ranked).tolist()
    return numbers


def _note_on_unranked_runs(results: Results, ranking: Ranking) -> list[str]:
    """Return a note, in a list, on runs without a value of any filter; empty if there are none."""
    # Only the config of a recording may list its runs by name, in the order of their numbers.
    target = results.config.get("scenario", {}).get("target")
    names = target.get("runs") if isinstance(target, dict) else None
    words = [str(number) for number in unranked_runs(ranking)]
    if isinstance(names, list) and len(names) == ranking.runs:
        words = [f"{number} ({names[number]})" for number in unranked_runs(ranking)]
    if not words:
        return []
    noun = "run" if len(words) == 1 else "runs"
    reason = f"no filter has {ranking.metric.metric} there"
    if ranking.metric.definition.is_score:
        reason = "no filter got a measurement at a scored step after the start"
    return [f"Not ranked: {noun} {phrases.listed(words)}, counted from 0, as {reason}."]


def far_from_best(ranking: Ranking) -> list[str]:
    """Name the filters that have left the target although none of their runs counts as lost.

    Their error is more than `_FAR` times that of the best. A log score has no such ratio.
    """
    if ranking.metric.definition.is_score or not ranking.order:
        return []
    limit = _FAR * ranking.order[0].overall.value
    return [c.name for c in ranking.order if not c.losses and c.overall.value > limit > 0.0]


def _smoothers_below_bound(results: Results, ranking: Ranking) -> list[str]:
    """List the smoothers whose root mean square error is smaller than the bound's."""
    point = bound_point(results, ranking)
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
            below.append(candidate.name)
    return below


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
                times.append(run_count(multiple))
            else:
                times.append(f"{max(multiple, 1.1):.2g}")
        text = span(times)
        return f"; a recording {text} times as long would decide differences of this size"
    text = span([run_count(x) for x in ends])
    return f"; {text} runs would decide differences of this size"
