"""Reasons why a filter does not run on a problem: it refuses the problem, or fails on it."""

from typing import NamedTuple

import numpy as np

from trackbench.config.filter_requirements import meets_requirement
from trackbench.contract.estimates import run_filter, simulate
from trackbench.errors import in_line
from trackbench.filters.base import AnyFilter
from trackbench.filters.external import ProgramRunError
from trackbench.plugins.checked_hook_calls import filter_conflicts
from trackbench.plugins.guarded_code import guarded
from trackbench.scenarios.base import Scenario


def runs_on(tracker: AnyFilter, scenario: Scenario) -> bool:
    """Test whether a filter accepts a scenario and runs on it without an exception."""
    return not why_not_running(tracker, scenario).text


class WhyNotRunning(NamedTuple):
    """Reason why a filter does not run on a scenario."""

    text: str = ""
    """empty if it runs"""
    is_failure: bool = False
    """True if the filter accepts the scenario, and then fails"""


def why_not_running(tracker: AnyFilter, scenario: Scenario) -> WhyNotRunning:
    """Return the reason why a filter does not accept a scenario, or fails when it runs on it."""
    is_accepted = False
    try:
        # `guarded`: the filter's code cannot end the program.
        with guarded(), np.errstate(all="ignore"):
            refusal = why_not(tracker, scenario)
            if refusal:
                return WhyNotRunning(refusal)
            is_accepted = True
            run_filter(tracker, scenario, simulate(scenario, runs=2))
    except Exception as error:
        words = in_line(str(error)) or type(error).__name__
        return WhyNotRunning(words, is_failure=is_accepted)
    return WhyNotRunning()


def why_not(tracker: AnyFilter, scenario: Scenario) -> str:
    """Explain why a filter cannot run on a scenario; an empty text if it can."""
    for requirement in tracker.all_requirements:
        if not meets_requirement(scenario, requirement):
            return f"needs {requirement}"
    conflicts = list(filter_conflicts(tracker, scenario).values())
    if conflicts:
        return conflicts[0]
    return ""


def why_program_fails(tracker: AnyFilter, scenario: Scenario) -> str:
    """Explain why a program does not run on a scenario; an empty text if it runs."""
    if not tracker.runs_program:
        return ""
    try:
        # `guarded`: code of a plugin cannot end trackbench by an exit.
        with guarded(), np.errstate(all="ignore"):
            run_filter(tracker, scenario, simulate(scenario, runs=2))
    except ProgramRunError as error:
        return in_line(error.failure)
    except Exception as error:
        return in_line(str(error))
    return ""
