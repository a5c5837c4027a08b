"""Notes below the ranking of one recorded run, as on an ANIS outside its band.

`sensor_notes`, `closed_gate_notes` and `log_score_notes` have the others.
"""

from collections.abc import Sequence

import numpy as np

from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.closed_gate_notes import gate_notes
from trackbench.report.findings.log_score_notes import costly_steps_notes
from trackbench.report.findings.phrases import listed, rounded
from trackbench.report.findings.ranking import Ranking
from trackbench.report.findings.sensor_notes import sensor_notes
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.consistency_bands import largest_anees_of_one_run, nis_band


def recording_notes(results: Results, ranking: Ranking) -> list[str]:
    """Write the notes on one recorded run; none for several runs, or simulated ones."""
    candidates = [*ranking.order, *ranking.losing]
    # Only a recorded run has ``judged``, the first and last step that count.
    if ranking.runs != 1 or any(results.facts(c.point).judged is None for c in candidates):
        return []
    notes = [*_anis_notes(results, candidates), *_anees_notes(results, candidates)]
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
    """Name the filters whose ANIS is outside the 95 % band of a consistent filter.

    The results are those of one recorded run.
    """
    # Texts of the filters by the side of the band on which their ANIS lies, and by the band.
    groups: dict[tuple[str, str], list[str]] = {}
    for candidate in candidates:
        runs = results.runs(candidate.point)
        label = candidate.label
        if (label, "anis") not in runs:
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


def _anees_notes(results: Results, candidates: Sequence[Candidate]) -> list[str]:
    """Name the filters whose ANEES is larger than autocorrelated errors of a consistent filter explain.

    The ANEES is that of the whole state, or, where it has no value, of the first marginal that has one.
    An infinite one has a word in the ranking. The results are those of one recorded run.
    """
    # All filters of the ranking are one family of tests (Bonferroni).
    level = rules.LEVEL / max(len(candidates), 1)
    # Texts of the filters by the quantity and the limit of its ANEES.
    groups: dict[tuple[str, str], list[str]] = {}
    for candidate in candidates:
        runs = results.runs(candidate.point)
        for quantity, size in results.facts(candidate.point).sizes.items():
            name = f"nees_{quantity}" if quantity else "nees"  # the nameless size: the whole state
            nees = float(runs.get((candidate.label, name), np.full(1, np.nan))[0])
            if not np.isfinite(nees):
                continue
            limit = largest_anees_of_one_run(size, level)
            if nees > limit * size:
                text = f"{candidate.name} {rounded(nees / size, 3)}"
                groups.setdefault((quantity, rounded(limit, 2)), []).append(text)
            break
    notes = []
    for (quantity, limit_text), texts in groups.items():
        of_quantity = f" of the {quantity}" if quantity else ""
        notes.append(
            f"ANEES{of_quantity} above what autocorrelated errors of a consistent filter explain "
            f"({limit_text}): {listed(texts)}. Errors are larger than the covariances say, or the "
            "truth, its origin, its clock or a sensor's angles are wrong."
        )
    return notes
