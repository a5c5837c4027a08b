"""A filter class, or every one of a file, held against the contract."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.config.checks import has
from trackbench.config.plugin_checks import check_kind
from trackbench.contract.checks import CHECKS, ContractError, Finding
from trackbench.contract.fixtures import LINEAR, RADAR, SCALAR
from trackbench.errors import UserError, in_line
from trackbench.plugins.checks import filter_conflicts
from trackbench.plugins.errors import PluginError, guarded, located_message
from trackbench.plugins.load import load_plugin, read_plugin
from trackbench.registry import kinds


def check_file(path: Path) -> dict[str, list[Finding]]:
    """Every filter that a Python file registers, by its kind; runs the file's code."""
    kinds("filters")
    try:
        plugin = read_plugin(path)
        load_plugin(plugin, check_kind)
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except PluginError as error:
        raise UserError(*error.args) from None
    own = {k: cls for k, cls in kinds("filters").items() if cls.__module__ == plugin.module}
    if not own:
        raise UserError(f'{path}: registers no filter (@register("filters", "my-kind"))')
    return {kind: check_filter(cls) for kind, cls in own.items()}


def check_filter(
    cls: type[Any], tracker: Any = None, scenarios: Sequence[Any] = ()
) -> list[Finding]:
    """Hold a filter class against the contract: with its default keys, or as it is given.

    ``scenarios`` are further ones to run it on, if it does not run on the linear one.
    """
    try:
        tracker = _made(cls) if tracker is None else tracker
    except ContractError as error:
        return [Finding("can be made without any key", "bad", str(error))]
    found = [Finding("can be made without any key", "good")]
    scenario, why_not = _playground(tracker, scenarios)
    if scenario is None:
        return [*found, Finding("everything else", "left out", why_not)]
    excused: dict[str, str] = dict(cls.contract_exemptions)
    if scenario is not LINEAR:
        excused.setdefault("kalman", why_not)
    for key, (name, check) in CHECKS.items():
        if key in excused:
            found.append(Finding(name, "left out", excused[key]))
        else:
            found.append(_tried(name, check, tracker, scenario))
    return found


def _tried(name: str, check: Callable[[Any, Any], None], tracker: Any, scenario: Any) -> Finding:
    try:
        with guarded(), np.errstate(all="ignore"):
            check(tracker, scenario)
    except ContractError as error:
        return Finding(name, "bad", str(error))
    except Exception as error:
        return Finding(name, "bad", in_line(located_message(error, tracker)))
    return Finding(name, "good")


def _made(cls: type[Any]) -> Any:
    if not is_dataclass(cls):
        raise ContractError("is not a dataclass (frozen=True, kw_only=True)")
    required = [f.name for f in fields(cls) if f.init and not _has_default(f)]
    if required:
        what = ", ".join(required)
        raise ContractError(f"give {what} a default, so that a first run needs no keys")
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


def _has_default(field: Any) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING


def _playground(tracker: Any, scenarios: Sequence[Any]) -> tuple[Any, str]:
    """The first scenario the filter runs on, and why not on the linear one."""
    reasons: list[str] = []
    for scenario in (LINEAR, SCALAR, RADAR, *scenarios):
        lacking = [n for n in tracker.all_requirements if not has(scenario, n)]
        mistakes = list(filter_conflicts(tracker, scenario).values()) if not lacking else []
        if not lacking and not mistakes:
            return scenario, "; ".join(reasons)
        reasons.append(mistakes[0] if mistakes else f"needs {lacking[0]}")
    return None, "; ".join(reasons)


def report(found: dict[str, list[Finding]]) -> Iterator[str]:
    """Lines for people."""
    for kind, findings in found.items():
        yield f"{kind}:"
        yield from (f"  {finding}" for finding in findings)
