"""Contract of a filter: shapes, purity, independence of the runs, agreement with the Kalman filter.

Every check reports in one line. A filter that cannot pass a check by its nature gives the reason in
a class attribute: ``contract_exemptions = {"kalman": "uses no measurement"}``. The other names are
``shapes``, ``purity``, ``repeats``, ``independence``, ``gaps`` and ``angles``.
"""

import pickle
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, fields, is_dataclass
from itertools import chain
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
        return f"{self.verdict:>8}  {self.check}" + (f": {self.why}" if self.why else "")


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
    labels = _labels_of_program(path, on) if on is not None else []
    if labels or path.suffix != ".py":
        return _check_program(path, on, labels, allow_plugins)
    try:
        plugin = load_file(path)
    except PluginError as error:
        raise UserError(*error.args) from None
    registered = {k: c for k, c in kinds("filters").items() if c.__module__ == plugin.module}
    if not registered:
        raise UserError(f'{path}: registers no filter (@register("filters", "my-kind"))')
    classes = {k: c for k, c in registered.items() if issubclass(c, Filter)}
    if on is None:
        return {k: [*check_filter(c)] for k, c in classes.items()}
    point = load(on, allow_plugins=allow_plugins, chosen=[path]).points[0]
    out: dict[str, list[Finding]] = {}
    for kind, cls in classes.items():
        labels = [label for label, f in point.filters.items() if f.kind == kind]
        alone = {} if labels else {kind: [*check_filter(cls, on=ModelDraws(base=point.scenario))]}
        out |= alone or _check_entries(cls, point, labels)
    return out


def _labels_of_program(path: Path, on: Path) -> list[str]:
    """Find the filters of a config whose command has the file."""
    data = read(on).data
    entries = data.get("filters") if isinstance(data, dict) else None
    labels = []
    for label, entry in entries.items() if isinstance(entries, dict) else ():
        words = entry.get("command") if isinstance(entry, dict) else None
        files = [(on.parent / str(word)).resolve() for word in words or ()]
        labels += [label] if path.resolve() in files else []
    return labels


def _check_program(
    path: Path, on: Path | None, labels: list[str], allow_plugins: bool
) -> dict[str, list[Finding]]:
    """Check a program, with the keys of each filter of a config that runs it."""
    if not labels and not is_program(path):
        what = "`--on CONFIG` checks a script, by the command of its filter there"
        raise UserError(f"{path}: {NO_FILTER}; {what}")
    program = External(command=(str(path.absolute()),)) if not labels else None
    if on is None:
        return {path.stem: [*check_filter(External, program)]}
    point = load(on, allow_plugins=allow_plugins, chosen=[path]).points[0]
    if program is not None:
        problem = ModelDraws(base=point.scenario)
        return {path.stem: [*check_filter(External, program, on=problem)]}
    return _check_entries(External, point, labels)


def _check_entries(
    cls: type[AnyFilter], point: Point, labels: Sequence[str]
) -> dict[str, list[Finding]]:
    """Check a filter with the keys of each entry of a config; if it fits with one, the code is right."""
    by_label = {}
    for label in labels:
        problem = ModelDraws(base=point.assumed_scenario(label))
        by_label[label] = [*check_filter(cls, point.filters[label], on=problem)]
    name = CHECKS["consistency"][0]
    if Finding(name, "good") not in chain.from_iterable(by_label.values()):
        return by_label
    for findings in by_label.values():
        for i, f in enumerate(findings):
            if f.check == name and f.verdict == "bad":
                why = f"fits with other keys; with these {f.why}"
                findings[i] = f._replace(verdict="left out", why=why)
    return by_label


def check_filter(
    cls: type[AnyFilter],
    tracker: AnyFilter | None = None,
    scenarios: Sequence[Scenario] = (),
    on: ModelDraws | None = None,
) -> Iterator[Finding]:
    """Check a registered filter class; a check runs when its finding is asked for.

    ``tracker`` is the instance to check, by default one with the default keys. Further ``scenarios`` are
    tried if the filter cannot run on the contract's. ``on`` is the problem that the filter's constants
    belong to, in place of the contract's.
    """
    name = "has a default for every key"
    keys = fields(cls) if is_dataclass(cls) else ()
    required = [f.name for f in keys if f.init and f.default is f.default_factory is MISSING]
    if tracker is None and required:
        why = f"{', '.join(required)} have none: `--on CONFIG` names an experiment with values"
        yield Finding(name, "left out", why)
        yield Finding("everything else", "left out", why)
        return
    try:
        tracker = _with_defaults(cls) if tracker is None else tracker
    except ContractError as error:
        yield Finding(name, "bad", str(error))
        return
    if on is None and not tracker.runs_program:
        yield Finding(name, "good")
    scenario, why_not_linear = _choose_scenario(tracker, scenarios, on)
    if scenario is None and tracker.runs_program and why_not_linear:
        # Every check would fail by this text.
        hint = "" if on is not None else f"; {_NAME_A_CONFIG}"
        yield Finding("runs on a problem", "bad", why_not_linear + hint)
        return
    if scenario is None:
        yield Finding("everything else", "left out", why_not_linear)
        return
    exempt = _exemptions(tracker, scenario, why_not_linear)
    for key, (name, check) in CHECKS.items():
        if key in exempt:
            yield Finding(name, "left out", exempt[key])
        else:
            yield run_check(name, check, tracker, scenario)


def _exemptions(tracker: AnyFilter, scenario: Scenario, why_not_linear: str) -> dict[str, str]:
    """Collect the checks that are left out, with reasons."""
    exempt: dict[str, str] = dict(type(tracker).contract_exemptions)
    if isinstance(tracker, GaussianFilter) and tracker.robust:
        exempt.setdefault("kalman", "weighs measurements by `robust`")
    if "kalman" in exempt:
        exempt.setdefault("consistency", exempt["kalman"])
    if tracker.loops_over_runs:
        exempt.setdefault("kalman", "a filter of one run is compared by its errors")
    program_runs = tracker.runs_program and runs_on(tracker, scenario)
    if program_runs and not has_covariance(tracker, scenario):
        exempt |= dict.fromkeys(("covariance", "consistency"), "the program answers no covariance")
    of_contract = scenario in (PLANAR, RADAR)
    if not of_contract:
        exempt.setdefault("tracks", "is another problem than the contract's")
        if not isinstance(scenario, ModelDraws):
            exempt.setdefault("interval", exempt["tracks"])
            exempt.setdefault("angles", exempt["tracks"])
    elif not takes_model(tracker, scenario is RADAR):
        # A filter of one run gets dt, so these checks are fair without its model.
        free = () if tracker.loops_over_runs else ("interval", "tracks")
        exempt = dict.fromkeys(("kalman", "consistency", *free), _OWN_MODEL) | exempt
    if scenario is not PLANAR:
        exempt.setdefault("kalman", why_not_linear)
    if not of_contract and (not isinstance(scenario, ModelDraws) or scenario.recorded_runs):
        exempt.setdefault("consistency", "has no reference filter")
    return exempt


def report(findings: dict[str, list[Finding]]) -> Iterator[str]:
    """Yield the lines of a report on each kind."""
    for kind, of_kind in findings.items():
        yield f"{kind}:"
        yield from (f"  {finding}" for finding in of_kind)


def run_check(name: str, check: Check, tracker: AnyFilter, scenario: Scenario) -> Finding:
    """Run one check, in which an exception of the filter is a breach."""
    try:
        with guarded(), np.errstate(all="ignore"), catch_warnings():
            simplefilter("ignore")
            check(tracker, scenario)
    except LeftOutError as error:
        return Finding(name, "left out", str(error))
    except ContractError as error:
        return Finding(name, "bad", str(error))
    except Exception as error:
        return Finding(name, "bad", in_line(located_message(error, tracker)))
    return Finding(name, "good")


def _with_defaults(cls: type[AnyFilter]) -> AnyFilter:
    """Make the filter with its default keys: it must be hashable, comparable and picklable."""
    if not is_dataclass(cls):
        raise ContractError("is not a dataclass (frozen=True, kw_only=True)")
    one, other = cls(), cls()
    try:
        if hash(one) != hash(other) or one != other:
            raise ContractError("two equal filters differ: make it @dataclass(frozen=True)")
    except TypeError as error:
        what = f"cannot be hashed ({error}): frozen=True, tuples and not lists"
        raise ContractError(what) from None
    if pickle.loads(pickle.dumps(one)) != one:
        raise ContractError("does not survive the way to another process")
    return one


def _choose_scenario(
    tracker: AnyFilter, scenarios: Sequence[Scenario], on: Scenario | None
) -> tuple[Scenario | None, str]:
    """Choose the first scenario that the filter can run on; say why not those before it."""
    reasons: list[str] = []
    for scenario in (PLANAR, SCALAR, RADAR, *scenarios) if on is None else (on,):
        why = why_not(tracker, scenario) or why_program_fails(tracker, scenario)
        if not why:
            return scenario, "; ".join(reasons) or "is checked on the config's problem"
        if why not in reasons:
            reasons.append(why)
    return None, "; ".join(reasons)


def takes_model(tracker: AnyFilter, of_radar: bool) -> bool:
    """Test whether the estimates depend on the noise of the runner's model.

    A filter of one run often has one of the noises in a key: it takes the model if it uses both.
    """
    problem, loud = (radar, 120.0) if of_radar else (planar, 60.0)
    if not runs_on(tracker, problem()):
        return True  # the checks report it
    data = simulate(problem(), 3)
    first, again = (run_filter(tracker, problem(), data) for _ in range(2))
    if not alike(first, again):
        return not tracker.loops_over_runs  # what draws by itself depends on nothing
    others = (run_filter(tracker, s, data) for s in (problem(q=400.0), problem(sigma=loud)))
    differs = [not alike(first, other) for other in others]
    return all(differs) if tracker.loops_over_runs else any(differs)
