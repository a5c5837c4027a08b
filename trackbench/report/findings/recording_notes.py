"""Sentences on the ranking of one recorded run, and notes below it, as on an ANIS outside its band.

`sensor_notes`, `closed_gate_notes` and `log_score_notes` have the others.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.closed_gate_notes import gate_notes
from trackbench.report.findings.log_score_notes import costly_steps_notes
from trackbench.report.findings.metric_phrases import metric_words
from trackbench.report.findings.phrases import listed, rounded, verb
from trackbench.report.findings.ranking import Ranking, Rival
from trackbench.report.findings.ratio_to_best import (
    distance_from_best,
    distances_in_words,
    within_in_words,
)
from trackbench.report.findings.sensor_notes import sensor_notes
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.consistency_bands import nis_band

_FAR_OFF = 10.0
"""Multiple of the best error, or of the density of the best score, beyond which a filter is far off."""


def recording_notes(results: Results, ranking: Ranking) -> list[str]:
    """Write the notes on one recorded run; none for several runs, or simulated ones."""
    candidates = [*ranking.order, *ranking.losing]
    # Only a recorded run has ``judged``, the first and last step that count.
    if ranking.runs != 1 or any(results.facts(c.point).judged is None for c in candidates):
        return []
    notes = _anis_notes(results, candidates)
    is_by_score = ranking.metric.definition.is_score
    of_sensors = sensor_notes(results, candidates, is_by_score)
    notes += of_sensors.notes
    # If a note on a sensor explains why a filter's gate rejects most measurements, the note on this gate
    # is left out.
    unexplained = [c for c in candidates if c not in of_sensors.explained]
    notes += gate_notes(results, unexplained)
    # Notes on steps that lower the mean log score, which only then ranks the filters.
    if is_by_score:
        notes += costly_steps_notes(results, ranking.order)
    return notes


def _anis_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Name the filters whose ANIS is outside the 95 % band of a consistent filter, without a truth.

    With a truth the ranking judges the NEES instead. The results are those of one recorded run.
    """
    # Texts of the filters by the side of the band on which their ANIS lies, and by the band.
    groups: dict[tuple[str, str], list[str]] = {}
    for candidate in candidates:
        runs = results.runs(candidate.point)
        label = candidate.label
        if (label, "nees") in runs or (label, "anis") not in runs:
            continue
        # The values of the only run: its ANIS, and how many measured components it averages.
        anis = float(runs[label, "anis"][0])
        components = float(runs.get((label, "innovations"), np.zeros(1))[0])
        if not (np.isfinite(anis) and components > 0.0):
            continue
        # Distribution of the NIS of the measurements that the filter's gate accepts; None without gate.
        accepted = results.facts(candidate.point).accepted_nis(label)
        low, high = nis_band(components, accepted)
        if low <= anis <= high:
            continue
        side = "above" if anis > high else "below"
        band = f"{low:.3f} to {high:.3f}"
        groups.setdefault((side, band), []).append(f"{candidate.name} {rounded(anis, 3)}")
    notes = []
    for (side, band), texts in groups.items():
        nearness = "farther from" if side == "above" else "nearer to"
        notes.append(
            f"ANIS {side} the 95 % band of a consistent filter ({band}): {listed(texts)}. Measurements "
            f"are {nearness} the predictions than the covariances say."
        )
    return notes


def sentences_on_recording(ranking: Ranking, has_inputs: bool) -> Iterator[str]:
    """Yield sentences on one recording whose steps cannot be tested: it is described, and not more.

    They name the best on this recording, and how near it or far from it each other filter is. Then
    they say why another recording may be different. ``has_inputs`` is True if it has inputs of a motion.
    """
    assert ranking.best is not None
    # Step 1: the filters by how far they are from the best; those that are worse have been tested.
    near: list[Rival] = []
    between: list[Rival] = []
    far: list[Rival] = []
    for rival in ranking.not_worse:
        distance = distance_from_best(ranking, rival)
        if distance <= rules.NEAR_BEST:
            near.append(rival)
        elif distance <= _FAR_OFF:
            between.append(rival)
        else:
            far.append(rival)
    # Step 2: a clause for each of these groups.
    extreme = "highest" if ranking.metric.definition.is_score else "lowest"
    words = metric_words(ranking.metric)
    yield f"On this recording {ranking.best.name} has the {extreme} {words}."
    clauses = []
    if near:
        names = [rival.filter.name for rival in near]
        farthest = max(near, key=lambda rival: distance_from_best(ranking, rival))
        clauses.append(f"{listed(names)} {verb(names)} {within_in_words(ranking, farthest)} of it")
    if between:
        names = [rival.filter.name for rival in between]
        clauses.append(
            f"{listed(names)} {verb(names)} farther off, {distances_in_words(ranking, between)}"
        )
    if far:
        names = [rival.filter.name for rival in far]
        clauses.append(f"{listed(names)} {verb(names)} far off, {distances_in_words(ranking, far)}")
    if clauses:
        yield f"{'; '.join(clauses)}."
    # Step 3: why this is not tested.
    names_by_reason = ranking.names_by_reason
    for reason, names in names_by_reason.items():
        yield (
            "One recording cannot decide how it would be on another, and no test compares it with "
            f"{listed(names)}: {reason}."
        )
    # Errors of successive steps are correlated, often over most of the recording. The terms of a log
    # score, one for each measurement given those before, are hardly correlated and can be tested. A
    # user ranks by it with a first column of the first table that has the log score.
    is_score = ranking.metric.definition.is_score
    is_correlated = any("autocorrelation" in reason for reason in names_by_reason)
    if is_correlated and not is_score:
        way = "filters are ranked by the first column of the first table"
        if has_inputs:
            # Runs with inputs of their own exclude each other in one experiment (`inputs_at`).
            yield f"The log score may decide: {way}. A grid over recordings judges each alone."
        else:
            recordings = f"{rules.FEWEST_RUNS} recordings as runs of one experiment"
            yield f"{recordings} may decide, or the log score: {way}."
