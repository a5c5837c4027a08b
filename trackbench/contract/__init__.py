"""Contract of a filter: shapes, purity, independence of the runs, agreement with the Kalman filter.

Every check reports in one line. A filter that cannot pass a check by its nature gives the reason in
a class attribute: ``contract_exemptions = {"kalman": "uses no measurement"}``. The names are those of
`checks.CHECKS`.
"""

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Literal, NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.load import load
from trackbench.config.plugin_checks import NO_FILTER, is_program, load_file
from trackbench.contract.checks import CHECKS, Check, ContractError, LeftOutError, alike
from trackbench.contract.problems import (
    PLANAR,
    RADAR,
    ModelDraws,
    has_covariance,
    planar,
    radar,
    run_filter,
    runs_on,
    simulate,
    why_not,
    why_program_fails,
)
from trackbench.errors import UserError, in_line
from trackbench.filters.base import AnyFilter, Filter
from trackbench.filters.external import External
from trackbench.filters.gaussian import GaussianFilter
from trackbench.models.motions.scalar import SineGamma
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.plugins.errors import PluginError, guarded, located_message
from trackbench.registry import kinds
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.starts.without_scans import Known
from trackbench.scenarios.targets.base import Launch
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking
from trackbench.yaml_source import read

_OWN_MODEL = "has constants of its own: `--on CONFIG` names an experiment that they belong to"

_NAME_A_CONFIG = "a filter of one sensor is checked on an experiment with it, by `--on CONFIG`"

SCALAR = Tracking(
    target=Driven(motion=SineGamma(), launch=Launch(x=1.0)),
    sensor=SquareThenLine(R=0.1),
    start=Known(),
    first=1,
    last=8,
)
"""Van der Merwe's scalar model, for filters that need one."""


class Finding(NamedTuple):
    """Result of one check: its name, the verdict, and the reason."""

    check: str
    verdict: Literal["good", "bad", "left out"]
    why: str = ""

    def __str__(self) -> str:
        line = f"{self.verdict:>8}  {self.check}"
        if self.why:
            line += f": {self.why}"
        return line


def check_file(
    path: Path, on: Path | None = None, allow_plugins: bool = False
) -> dict[str, list[Finding]]:
    """Check every filter that a Python file registers, or a program; this runs its code.

    Parameters
    ----------
    path : Path
        The Python file, or a program that speaks the protocol of `trackbench.filters.external`.
    on : Path, optional
        Config of an experiment: its filters of the file's kinds are checked with their keys, on data
        drawn from the model that each assumes there.
    allow_plugins : bool
        Whether the code of other plugins that the config names may be run.

    Returns
    -------
    dict
        Findings of each filter, by its kind, or by its label in the config.

    Raises
    ------
    UserError
        If a file cannot be read or loaded, or registers no filter.
    """
    # Step 1: a program, or the command of a config's filter.
    program_labels = []
    if on is not None:
        program_labels = _labels_of_program(path, on)
    if program_labels or path.suffix != ".py":
        return _check_program(path, on, program_labels, allow_plugins)
    # Step 2: the filters that a Python file registers.
    try:
        plugin = load_file(path)
    except PluginError as error:
        raise UserError(*error.args) from None
    registered = {k: c for k, c in kinds("filters").items() if c.__module__ == plugin.module}
    if not registered:
        raise UserError(f'{path}: registers no filter (@register("filters", "my-kind"))')
    classes = {kind: cls for kind, cls in registered.items() if issubclass(cls, Filter)}
    if on is None:
        return {kind: list(check_filter(cls)) for kind, cls in classes.items()}
    # Step 3: the entries of the config with these filters, or its problem if there is no entry. Only the
    # first point of a grid is taken.
    point = load(on, allow_plugins=allow_plugins, chosen=[path]).points[0]
    findings: dict[str, list[Finding]] = {}
    for kind, cls in classes.items():
        labels = [label for label, tracker in point.filters.items() if tracker.kind == kind]
        if labels:
            findings |= _check_entries(cls, point, labels)
        else:
            problem = ModelDraws(base=point.scenario)
            findings[kind] = list(check_filter(cls, on=problem))
    return findings


def _labels_of_program(path: Path, on: Path) -> list[str]:
    """Find the filters of the config ``on`` whose command has the file."""
    data = read(on).data
    if not isinstance(data, dict) or not isinstance(data.get("filters"), dict):
        return []
    labels = []
    for label, entry in data["filters"].items():
        if not isinstance(entry, dict):
            continue
        files = [(on.parent / str(word)).resolve() for word in entry.get("command") or ()]
        if path.resolve() in files:
            labels.append(label)
    return labels


def _check_program(
    path: Path, on: Path | None, labels: list[str], allow_plugins: bool
) -> dict[str, list[Finding]]:
    """Check the program ``path`` with the keys of each filter of the config ``on`` that runs it.

    ``labels`` are those of the filters. Without labels the program is checked without keys, on the
    problem of the config. Without a config it is checked on the contract's problems. Of a config's grid
    only the first point is taken.
    """
    if not labels and not is_program(path):
        what = "`--on CONFIG` checks a script, by the command of its filter there"
        raise UserError(f"{path}: {NO_FILTER}; {what}")
    if on is None:
        program = External(command=(str(path.absolute()),))
        return {path.stem: list(check_filter(External, program))}
    point = load(on, allow_plugins=allow_plugins, chosen=[path]).points[0]
    if labels:
        return _check_entries(External, point, labels)
    program = External(command=(str(path.absolute()),))
    problem = ModelDraws(base=point.scenario)
    return {path.stem: list(check_filter(External, program, on=problem))}


def _check_entries(
    cls: type[AnyFilter], point: Point, labels: Sequence[str]
) -> dict[str, list[Finding]]:
    """Check a filter with the keys of each of its entries in a config, given by label.

    If the filter is consistent with the keys of one entry, its code is right, and the keys of other
    entries are at fault: their check of consistency is then left out.
    """
    # Step 1: check each entry.
    findings_by_label = {}
    for label in labels:
        problem = ModelDraws(base=point.assumed_scenario(label))
        findings_by_label[label] = list(check_filter(cls, point.filters[label], on=problem))
    # Step 2: if one entry is consistent, the others have keys that do not fit.
    consistency, _ = CHECKS["consistency"]
    is_consistent = Finding(consistency, "good")
    if not any(is_consistent in findings for findings in findings_by_label.values()):
        return findings_by_label
    for findings in findings_by_label.values():
        for i, finding in enumerate(findings):
            if finding.check == consistency and finding.verdict == "bad":
                why = f"fits with other keys; with these {finding.why}"
                findings[i] = finding._replace(verdict="left out", why=why)
    return findings_by_label


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
    # Step 1: an instance with the default keys.
    check_of_defaults = "has a default for every key"
    if tracker is None:
        required = _keys_without_default(cls)
        if required:
            why = f"{', '.join(required)} have none: `--on CONFIG` names an experiment with values"
            yield Finding(check_of_defaults, "left out", why)
            yield Finding("everything else", "left out", why)
            return
        try:
            tracker = _with_defaults(cls)
        except ContractError as error:
            yield Finding(check_of_defaults, "bad", str(error))
            return
    if on is None and not tracker.runs_program:
        yield Finding(check_of_defaults, "good")
    # Step 2: a scenario that it can run on.
    scenario, why_not_linear = _choose_scenario(tracker, scenarios, on)
    if scenario is None and tracker.runs_program and why_not_linear:
        # Every check would fail by this text.
        why = why_not_linear
        is_silent = isinstance(tracker, External) and tracker.is_silent
        if on is None and not is_silent:
            why += f"; {_NAME_A_CONFIG}"
        yield Finding("runs on a problem", "bad", why)
        return
    if scenario is None:
        yield Finding("everything else", "left out", why_not_linear)
        return
    # Step 3: the checks.
    exemptions = _exemptions(tracker, scenario, why_not_linear)
    for key, (name, check) in CHECKS.items():
        if key == "digits" and not isinstance(tracker, External):
            continue
        if key in exemptions:
            yield Finding(name, "left out", exemptions[key])
        else:
            yield run_check(name, check, tracker, scenario)


def _keys_without_default(cls: type[AnyFilter]) -> list[str]:
    """Name the keys that every entry of the filter must set."""
    if not is_dataclass(cls):
        return []
    names = []
    for field in fields(cls):
        has_default = field.default is not MISSING or field.default_factory is not MISSING
        if field.init and not has_default:
            names.append(field.name)
    return names


def _exemptions(tracker: AnyFilter, scenario: Scenario, why_not_linear: str) -> dict[str, str]:
    """Return the checks that are left out for a filter on a scenario, with reasons.

    ``why_not_linear`` is the reason why the filter is not compared with the Kalman filter.
    """
    # Step 1: by the filter's nature.
    exempt: dict[str, str] = dict(type(tracker).contract_exemptions)
    if isinstance(tracker, GaussianFilter) and tracker.robust:
        exempt.setdefault("kalman", "weighs measurements by `robust`")
    if "kalman" in exempt:
        exempt.setdefault("consistency", exempt["kalman"])
    if "consistency" in exempt:
        exempt.setdefault("motion", exempt["consistency"])
    # This exemption leaves nothing else out: the consistency of a filter of one run is still checked.
    if tracker.loops_over_runs:
        exempt.setdefault("kalman", "a filter of one run is compared by its errors")
    program_runs = tracker.runs_program and runs_on(tracker, scenario)
    if program_runs and not has_covariance(tracker, scenario):
        exempt["covariance"] = "the program answers no covariance"
        exempt["consistency"] = "the program answers no covariance"
    # Step 2: by the problem.
    is_contract_problem = scenario in (PLANAR, RADAR)
    if not is_contract_problem:
        exempt.setdefault("tracks", "is another problem than the contract's")
        exempt.setdefault("motion", exempt["tracks"])
        if not isinstance(scenario, ModelDraws):
            exempt.setdefault("interval", exempt["tracks"])
            exempt.setdefault("place", exempt["tracks"])
            exempt.setdefault("angles", exempt["tracks"])
    elif not takes_model(tracker, of_radar=scenario is RADAR):
        exempt.setdefault("kalman", _OWN_MODEL)
        exempt.setdefault("consistency", _OWN_MODEL)
        exempt.setdefault("place", _OWN_MODEL)
        exempt.setdefault("motion", _OWN_MODEL)
        # A filter of one run gets dt, so these checks are fair without its model.
        if not tracker.loops_over_runs:
            exempt.setdefault("interval", _OWN_MODEL)
            exempt.setdefault("tracks", _OWN_MODEL)
    if scenario is not PLANAR:
        exempt.setdefault("kalman", why_not_linear)
    is_drawn_from_model = isinstance(scenario, ModelDraws) and not scenario.recorded_runs
    if not is_contract_problem and not is_drawn_from_model:
        exempt.setdefault("consistency", "has no reference filter")
    return exempt


def report(findings: dict[str, list[Finding]]) -> Iterator[str]:
    """Yield the lines of a report on each kind."""
    for kind, findings_of_kind in findings.items():
        yield f"{kind}:"
        for finding in findings_of_kind:
            yield f"  {finding}"


def run_check(name: str, check: Check, tracker: AnyFilter, scenario: Scenario) -> Finding:
    """Run one check and return its finding; an exception of the filter is a breach of the contract."""
    try:
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


def _with_defaults(cls: type[AnyFilter]) -> AnyFilter:
    """Return the filter with its default keys.

    Raises ContractError unless the filter can be hashed, compared and pickled.
    """
    if not is_dataclass(cls):
        raise ContractError("is not a dataclass (frozen=True, kw_only=True)")
    tracker = cls()
    equal_tracker = cls()
    try:
        if hash(tracker) != hash(equal_tracker) or tracker != equal_tracker:
            raise ContractError("two equal filters differ: make it @dataclass(frozen=True)")
    except TypeError as error:
        what = f"cannot be hashed ({error}): frozen=True, tuples and not lists"
        raise ContractError(what) from None
    if pickle.loads(pickle.dumps(tracker)) != tracker:
        raise ContractError("does not survive the way to another process")
    return tracker


def _choose_scenario(
    tracker: AnyFilter, scenarios: Sequence[Scenario], on: Scenario | None
) -> tuple[Scenario | None, str]:
    """Choose the first scenario that the filter can run on; explain why it cannot run on earlier ones.

    The candidates are the contract's scenarios and ``scenarios``, or only ``on`` if that is given.
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


def takes_model(tracker: AnyFilter, of_radar: bool) -> bool:
    """Test whether the filter uses the noise of the model that it is given.

    Its estimates then depend on the process noise or on the measurement noise. A filter of one run often
    has one of the two noises in a key: it must depend on both. ``of_radar`` chooses the contract's
    problem of a radar instead of the planar one.
    """
    make_problem: Callable[..., Tracking] = radar if of_radar else planar
    large_sigma = 120.0 if of_radar else 60.0
    if not runs_on(tracker, make_problem()):
        return True  # the checks report that the filter does not run
    # Step 1: two equal runs. If they differ, the filter draws random numbers of its own, and its
    # dependence on the noise cannot be seen.
    data = simulate(make_problem(), 3)
    first = run_filter(tracker, make_problem(), data)
    again = run_filter(tracker, make_problem(), data)
    if not alike(first, again):
        return not tracker.loops_over_runs
    # Step 2: equal data with another process noise, and with another measurement noise.
    other_q = run_filter(tracker, make_problem(q=400.0), data)
    uses_q = not alike(first, other_q)
    other_sigma = run_filter(tracker, make_problem(sigma=large_sigma), data)
    uses_sigma = not alike(first, other_sigma)
    if tracker.loops_over_runs:
        return uses_q and uses_sigma
    return uses_q or uses_sigma
