"""Experiments of a folder: opened with their verdicts, by topic, each with its result in words."""

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias
from urllib.parse import quote

from trackbench.errors import Problem, UserError
from trackbench.report.findings.ranking import Ranking, rankings
from trackbench.report.folder_check import explain_content_errors, open_with_notes
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.published_numbers import Verdicts, compare

Overview: TypeAlias = list[tuple[Results, Verdicts]]
"""Experiments of a folder, each with its verdicts."""


def relative_link(path: Path) -> str:
    """Write a relative path as a link: a folder may be called ``javascript:x`` or ``a#b``."""
    name = path.as_posix()
    quoted = quote(name)
    if quoted == name:
        return name
    # With "./" a browser takes no part of the name as a protocol.
    return f"./{quoted}"


_RECORDINGS = "Recordings"
_ANGLES = "Targets seen by radar, lidar or bearings"
_POSITIONS = "Targets with measured positions"
_OTHERS = "Other dynamic systems"


def group_by_topic(experiments: Overview) -> dict[str, Overview]:
    """Group the experiments by topic: what is estimated, and by which sensors.

    Topics without experiments are left out.
    """
    groups: dict[str, Overview] = {}
    for topic in (_RECORDINGS, _ANGLES, _POSITIONS, _OTHERS):
        groups[topic] = []
    for results, comparison in experiments:
        groups[_topic(results)].append((results, comparison))
    return {topic: group for topic, group in groups.items() if group}


def _topic(results: Results) -> str:
    """Return the topic of an experiment: what is estimated, and by which sensors."""
    scenario = results.config["scenario"]
    # Recorded measurements, or a recorded path that is measured anew in every run.
    if (scenario.get("target") or {}).get("kind") in ("measured", "recorded"):
        return _RECORDINGS
    # The state of a target in space begins with px and vx.
    if results.facts(results.grid_points[0]).components[:2] != ["px", "vx"]:
        return _OTHERS
    sensors = scenario.get("sensor")
    if not isinstance(sensors, list):
        sensors = [sensors or {}]
    kinds = {sensor.get("kind") for sensor in sensors}
    if kinds <= {"position", "velocity"}:
        return _POSITIONS
    return _ANGLES


def result_in_words(results: Results) -> str:
    """Write the result in a few words; empty if the runs are missing."""
    if not results.has_runs:
        return ""
    return short_answer(rankings(results))


def short_answer(scene_rankings: Sequence[Ranking]) -> str:
    """Return the result in about five words: ``IMM best of 16 filters``; empty without a ranking."""
    # In how many scenarios each filter is among the best.
    times_best = Counter[str]()
    for ranking in scene_rankings:
        times_best.update(candidate.label for candidate in ranking.among_the_best)
    if not times_best:
        has_rivals = any(len(ranking.order) > 1 for ranking in scene_rankings)
        return "which is best is inconclusive" if has_rivals else ""
    # Of several scenarios the filter that is best most often.
    if len(scene_rankings) > 1:
        label, most = times_best.most_common()[0]
        return f"{label} best at {most} of {len(scene_rankings)}"
    ranking = scene_rankings[0]
    filters = len(ranking.order) + len(ranking.losing)
    ties = len(times_best) - 1
    if filters == 1:
        return ""
    if ties + 1 == filters:
        return f"no significant difference between {filters}"
    best = ranking.among_the_best[0].label
    if ties:
        return f"{best} and {ties} others best"
    return f"{best} best of {filters} filters"


def join_verdicts(comparisons: list[Verdicts]) -> Verdicts:
    """Join the verdicts of several experiments, to count them together.

    The result has no ``experiment_runs``: experiments with fewer runs than planned are not marked.
    """
    joined = Verdicts(rows=[], claims=[], ranks=[])
    for comparison in comparisons:
        joined.rows.extend(comparison.rows)
        joined.claims.extend(comparison.claims)
        joined.ranks.extend(comparison.ranks)
        joined.left_out.extend(comparison.left_out)
    return joined


def open_experiments(folder: Path) -> tuple[Overview, int]:
    """Open the experiments of a folder with their verdicts.

    Return also how many are left out because their runs are missing. Raises UserError for any other
    mistake, and if no experiment is left.
    """
    if not os.path.isdir(folder):
        raise UserError(f"{folder}: there is no such folder")
    candidates = sorted(path.parent for path in folder.glob("*/config.yaml"))
    if not candidates:
        raise UserError(f"{folder}: has neither a config.yaml nor results folders in it")
    opened: Overview = []
    problems: list[Problem | str] = []
    without_runs: list[Problem | str] = []
    for candidate in candidates:
        results = None
        try:
            with explain_content_errors(candidate):
                results = open_with_notes(candidate)
                opened.append((results, compare(results)))
        except UserError as error:
            if results and not results.has_runs:
                without_runs += error.problems
            else:
                problems += error.problems
    if problems or not opened:
        raise UserError(*problems, *without_runs)
    return opened, len(without_runs)
