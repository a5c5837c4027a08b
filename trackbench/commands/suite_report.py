"""Outcome of a suite: its scores, tables and sentences, as Python gets it and the screen shows it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from trackbench.commands.notebook_report import Report
from trackbench.commands.suite_contract import ContractOutcome
from trackbench.config.suite import Suite
from trackbench.errors import first_names
from trackbench.models.motions.linear import Linear
from trackbench.report.findings.phrases import MOST_NAMES
from trackbench.report.markdown_table import TextTable
from trackbench.report.suite.filter_sentences import filter_sentences
from trackbench.report.suite.leading_filter import leader_sentence
from trackbench.report.suite.reachable_problems import ProblemModel, reach_sentence
from trackbench.report.suite.scores import FILTER, SuiteScores
from trackbench.report.suite.tables import filter_table, roster_table, smoother_table


@dataclass(frozen=True, kw_only=True)
class SuiteReport:
    """Outcome of a suite: its folder, the scores by group, and what failed."""

    suite: Suite
    models: Mapping[str, ProblemModel]
    """state and measurement of each problem, by its name"""
    folder: Path
    groups: list[SuiteScores]
    failed: list[str]
    """filters, tables and figures that failed, a line each, with the problem"""
    contract: list[ContractOutcome]
    """outcomes of the contract for the user's own filters"""

    def tables(self) -> list[TextTable]:
        """Return the tables of the first screen.

        These are one for each filter of the user, and one for each group of problems on which several
        filters ran.
        """
        shown = [filter_table(self.groups, label) for label in self.suite.own]
        for group in self.groups:
            # Smoothers, references and bounds have other roles and are no filters here.
            if len(group.labels(FILTER)) > 1:
                shown.append(roster_table(group))
        return shown

    def sentences(self) -> list[str]:
        """Return what follows from the scores, a paragraph each.

        First those on the user's filters and the best filter of each group of problems, then how the
        user's filters may run on more problems, and last which checks of the contract they fail. In the
        suite, ``own`` are all of the user's filters, and ``programs`` those that are programs.
        """
        lines = []
        for group in self.groups:
            for label in group.added:  # the user's filters that run on problems of this group
                lines.append(" ".join(filter_sentences(group, label)))
            lines.append(leader_sentence(group))
        lines += [
            reach_sentence(self.groups, label, label in self.suite.programs, self.models)
            for label in self.suite.own
        ]
        lines += [outcome.sentence() for outcome in self.contract]
        # Several of these texts are empty if there is nothing to say.
        return [line for line in lines if line]

    def runs_and_seeds(self) -> str:
        """Write the number of runs of a problem and the seed, or several: ``10, 40 runs, seed 1``."""
        settings = [problem.experiment.settings for problem in self.suite.problems]
        runs = sorted({each.runs for each in settings})
        seeds = sorted({each.seed for each in settings})
        noun = "run" if runs == [1] else "runs"
        seed_noun = "seed" if len(seeds) == 1 else "seeds"
        runs_text = first_names([str(number) for number in runs], MOST_NAMES)
        seeds_text = first_names([str(number) for number in seeds], MOST_NAMES)
        return f"{runs_text} {noun}, {seed_noun} {seeds_text}"

    def smoothers(self) -> list[TextTable]:
        """Return the tables of smoothers, of the groups that have any."""
        tables = [smoother_table(group) for group in self.groups]
        return [table for table in tables if table is not None]


def problem_models(suite: Suite) -> dict[str, ProblemModel]:
    """Return the names of state and measurement components of each problem, by the problem's name.

    Problems that are not run, because no filter of the user fits them, are included.
    """
    models = {}
    for problem in [*suite.problems, *suite.without_added]:
        motion, sensor = problem.experiment.points[0].scenario.model
        models[problem.name] = ProblemModel(
            state=tuple(motion.components),
            measurement=tuple(sensor.components),
            # A linear sensor has a measurement matrix H.
            is_linear=isinstance(motion, Linear) and getattr(sensor, "H", None) is not None,
        )
    return models


def failure_lines(suite: Suite, name: str, report: Report) -> list[str]:
    """Return a line for each of the user's filters, tables and figures that failed on a problem.

    The problem's ``name`` comes first in the line. Failed filters of the roster are not listed: their
    cells of the matrix have the reasons.
    """
    lines = list(report.results.unmade_lines)
    for line in report.failed_filters:  # "LABEL failed: ...", or "LABEL at ..." for a grid
        is_of_user = any(line.startswith(f"{label} ") for label in suite.own)
        if is_of_user:
            lines.append(line)
    return [f"{name}: {line}" for line in lines]
