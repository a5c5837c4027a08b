"""Check a filter class: shapes, purity, independence of the runs, agreement with the Kalman filter.

Every check reports in one line, with the verdict good, bad or left out.
"""

from collections.abc import Iterator, Sequence
from warnings import catch_warnings, simplefilter

import numpy as np

from trackbench.contract.checks import CHECKS, Check
from trackbench.contract.default_keys_check import keys_without_default, with_defaults
from trackbench.contract.exemptions import find_exemptions
from trackbench.contract.findings import ContractError, Finding, LeftOutError
from trackbench.contract.problems import PLANAR, RADAR, SCALAR, ModelDraws
from trackbench.contract.why_not_running import why_not, why_program_fails
from trackbench.errors import in_line
from trackbench.filters.base import AnyFilter
from trackbench.filters.external import External
from trackbench.plugins.guarded_code import guarded
from trackbench.plugins.plugin_errors import located_message
from trackbench.scenarios.base import Scenario

_NAME_A_CONFIG = "a filter of one sensor is checked on an experiment with it, by `--on CONFIG`"


def check_filter(
    cls: type[AnyFilter],
    tracker: AnyFilter | None = None,
    scenarios: Sequence[Scenario] = (),
    on: ModelDraws | None = None,
) -> Iterator[Finding]:
    """Check a registered filter class; each check runs when the iterator comes to its finding.

    Parameters
    ----------
    cls
        the filter class
    tracker
        the instance to check; default: one with the default keys
    scenarios
        further scenarios, which are tried if the filter cannot run on the contract's
    on
        the problem that the filter's constants belong to, in place of the contract's

    Returns
    -------
    iterator
        findings, one for each check
    """
    # Step 1: an instance with the default keys. An instance that is given has its keys from elsewhere.
    check_of_defaults = "has a default for every key"
    if tracker is None:
        required = keys_without_default(cls)
        if required:
            why = f"{', '.join(required)} have none: `--on CONFIG` names an experiment with values"
            yield Finding(check_of_defaults, "left out", why)
            yield Finding("everything else", "left out", why)
            return
        try:
            tracker = with_defaults(cls)
        except ContractError as error:
            yield Finding(check_of_defaults, "bad", str(error))
            return
        # On the problem of a config the other checks say more than this one.
        if on is None:
            yield Finding(check_of_defaults, "good")
    # Step 2: a scenario that it can run on. The contract's linear one is tried first. `why_not_linear`
    # is why it does not run there, or on any scenario if there is none.
    scenario, why_not_linear = _choose_scenario(tracker, scenarios, on)
    if scenario is None and tracker.runs_program and why_not_linear:
        # Every check would fail for this reason.
        why = why_not_linear
        # A program without any answer does not speak the protocol: a config would not help.
        is_silent = isinstance(tracker, External) and tracker.is_silent
        if on is None and not is_silent:
            why += f"; {_NAME_A_CONFIG}"
        yield Finding("runs on a problem", "bad", why)
        return
    if scenario is None:
        yield Finding("everything else", "left out", why_not_linear)
        return
    # Step 3: the checks.
    exemptions = find_exemptions(tracker, scenario, why_not_linear)
    for key, (name, check) in CHECKS.items():
        if key == "digits" and not isinstance(tracker, External):
            continue
        # A program gets R as a matrix, and may refuse the kind of a sensor.
        if key == "equations" and tracker.runs_program:
            continue
        if key == "copies" and ("repeats" not in exemptions or tracker.runs_program):
            continue
        if key in exemptions:
            yield Finding(name, "left out", exemptions[key])
        else:
            yield run_check(name, check, tracker, scenario)


def run_check(name: str, check: Check, tracker: AnyFilter, scenario: Scenario) -> Finding:
    """Run one check and return its finding; an exception of the filter is a breach of the contract.

    ``name`` is the title of the check in the finding. A text that the check returns, on what was tried,
    becomes the reason of the finding.
    """
    try:
        # `guarded`: the filter's code cannot end the program.
        with guarded(), np.errstate(all="ignore"), catch_warnings():
            simplefilter("ignore")
            note = check(tracker, scenario)
    except LeftOutError as error:
        return Finding(name, "left out", str(error))
    except ContractError as error:
        return Finding(name, "bad", str(error))
    except Exception as error:
        return Finding(name, "bad", in_line(located_message(error, tracker)))
    return Finding(name, "good", note or "")


def _choose_scenario(
    tracker: AnyFilter, scenarios: Sequence[Scenario], on: Scenario | None
) -> tuple[Scenario | None, str]:
    """Choose the first scenario that the filter can run on; explain why it cannot run on earlier ones.

    The candidates are the contract's scenarios, first the linear one, and then ``scenarios``, or only
    ``on`` if that is given. The scenario is None if the filter runs on none of them.
    """
    candidates = (PLANAR, SCALAR, RADAR, *scenarios) if on is None else (on,)
    reasons: list[str] = []
    for scenario in candidates:
        why = why_not(tracker, scenario) or why_program_fails(tracker, scenario)
        if not why:
            # Without reasons the scenario is ``on``, or PLANAR, for which no caller reads the text.
            return scenario, "; ".join(reasons) or "is checked on the config's problem"
        if why not in reasons:
            reasons.append(why)
    return None, "; ".join(reasons)
