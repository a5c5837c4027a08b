"""Check the user's own filters of a suite against the contract, once, before the suite runs."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

from trackbench.config.added_filters import typed_file_of
from trackbench.config.suite import Suite
from trackbench.contract.findings import Finding
from trackbench.contract.problems import ModelDraws
from trackbench.contract.run_contract import check_filter
from trackbench.errors import counted
from trackbench.filters.base import AnyFilter
from trackbench.report.findings.phrases import joined

_CONTRACT_S = 10.0
"""Seconds after which no further check of a filter begins."""


@dataclass(frozen=True, kw_only=True)
class ContractOutcome:
    """Outcome of the contract for one of the user's own filters."""

    label: str
    command: str
    """command that runs the whole contract"""
    bad: tuple[Finding, ...]
    """checks that the filter fails"""
    is_finished: bool
    """False if checks were left out because they take long"""

    def notes(self) -> Iterator[str]:
        """Yield a line for each check that the filter fails, and one if checks were left out."""
        for finding in self.bad:
            yield f"{self.label}: fails the check {finding.check!r} of the contract: {finding.why}"
        if not self.is_finished:
            yield (
                f"{self.label}: was not checked by the whole contract, which takes longer than "
                f"{_CONTRACT_S:g} s for this filter; run `{self.command}`"
            )

    def sentence(self) -> str:
        """Return a sentence on failed checks, for the last lines on the screen; empty without any."""
        if not self.bad:
            if self.is_finished:
                return ""
            return (
                f"{self.label} was not checked by the whole contract of filters, which takes long: "
                f"`{self.command}`."
            )
        names = joined([repr(finding.check) for finding in self.bad])
        return (
            f"{self.label} fails {counted(len(self.bad), 'check')} of the contract of filters, {names}. "
            "Its errors may come from this mistake and say little about the filter: "
            f"`{self.command}` prints the reason."
        )


def check_own_filters(suite: Suite) -> list[ContractOutcome]:
    """Check each of the user's own filters with its keys on the first problem that it fits.

    The contract runs the filter on problems of its own. If the filter fits none of them, it is run with
    the model of the suite's problem.
    """
    outcomes = []
    for label in suite.own:
        for problem in suite.problems:
            point = problem.experiment.points[0]
            if label not in point.filters:
                continue
            own_problem = ModelDraws(base=point.assumed_scenario(label))
            outcomes.append(_check(label, point.filters[label], own_problem))
            break
    return outcomes


def _check(label: str, tracker: AnyFilter, own_problem: ModelDraws) -> ContractOutcome:
    """Check a filter against the contract until `_CONTRACT_S` seconds are over.

    The contract is a list of checks that every filter must pass. Its checks run the filter on its own
    problems, or on ``own_problem`` if the filter fits none of them.
    """
    deadline = time.monotonic() + _CONTRACT_S
    bad = []
    is_finished = True
    for finding in check_filter(type(tracker), tracker, [own_problem]):
        if finding.verdict == "bad":
            bad.append(finding)
        if time.monotonic() > deadline:
            is_finished = False
            break
    command = f"trackbench check --contract {typed_file_of(tracker)}"
    return ContractOutcome(label=label, command=command, bad=tuple(bad), is_finished=is_finished)
