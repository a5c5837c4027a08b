"""Check the filters of a Python file, a program, or the entries of a config with these filters."""

from collections.abc import Sequence
from pathlib import Path

from trackbench.config.added_filters import NO_FILTER, is_program, runs_as_program
from trackbench.config.experiment import Point
from trackbench.config.load import check_is_config, load
from trackbench.config.plugins_of_config import load_file
from trackbench.contract.checks import CHECKS
from trackbench.contract.findings import Finding
from trackbench.contract.problems import ModelDraws
from trackbench.contract.run_contract import check_filter
from trackbench.errors import UserError
from trackbench.filters.base import AnyFilter, Filter
from trackbench.filters.external import External
from trackbench.plugins.plugin_errors import PluginError
from trackbench.registry import kinds
from trackbench.yaml_source import read


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
        check_is_config(on)
        program_labels = _labels_of_program(path, on)
    if program_labels or runs_as_program(path):
        return _check_program(path, on, program_labels, allow_plugins)
    # Step 2: the filters that a Python file registers.
    try:
        plugin = load_file(path)
    except PluginError as error:
        raise UserError(*error.args) from None
    registered = {k: c for k, c in kinds("filters").items() if c.__module__ == plugin.module}
    if not registered:
        raise UserError(f'{path}: registers no filter (@register("filters", "my-kind"))')
    # `register` makes every class of the group a Filter: the condition only narrows the type.
    classes = {kind: cls for kind, cls in registered.items() if issubclass(cls, Filter)}
    if on is None:
        return {kind: list(check_filter(cls)) for kind, cls in classes.items()}
    # Step 3: the entries of the config with these filters, or its problem if there is no entry. Only the
    # first point of a grid is taken. `chosen`: the user has named this file, so that its code may run
    # without `allow_plugins`.
    point = load(on, allow_plugins=allow_plugins, chosen=[path]).points[0]
    findings: dict[str, list[Finding]] = {}
    for kind, cls in classes.items():
        labels = [label for label, tracker in point.filters.items() if tracker.kind == kind]
        if labels:
            findings |= check_entries(cls, point, labels)
        else:
            # The truth is drawn from the model that the filter gets: with that of the config, such as a
            # maneuver, a correct filter would be inconsistent.
            problem = ModelDraws(base=point.scenario)
            findings[kind] = list(check_filter(cls, on=problem))
    return findings


def _labels_of_program(path: Path, on: Path) -> list[str]:
    """Find the filters of the config ``on`` whose key `command` names the program ``path``.

    Return their labels. Paths in a command are relative to the config.
    """
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

    In place of the truth of the config one is drawn from the model that the filter gets (`ModelDraws`):
    with another truth, such as a maneuver, a correct filter would be inconsistent.
    """
    if not labels and not is_program(path):
        message = "`--on CONFIG` checks a script, by the command of its filter there"
        raise UserError(f"{path}: {NO_FILTER}; {message}")
    if on is None:
        program = External(command=(str(path.absolute()),))
        return {path.stem: list(check_filter(External, program))}
    # `chosen`: the user has named this program, so that it may run without `allow_plugins`.
    point = load(on, allow_plugins=allow_plugins, chosen=[path]).points[0]
    if labels:
        return check_entries(External, point, labels)
    program = External(command=(str(path.absolute()),))
    problem = ModelDraws(base=point.scenario)
    return {path.stem: list(check_filter(External, program, on=problem))}


def check_entries(
    cls: type[AnyFilter], point: Point, labels: Sequence[str]
) -> dict[str, list[Finding]]:
    """Check a filter class with the keys of each of its entries in a config; return findings by label.

    ``labels`` are those of the entries, and ``point`` is a point of the config's grid. A filter is
    checked on data from the model that its entry assumes.

    If the filter is consistent with the keys of one entry, its code is right, and the keys of other
    entries are at fault: their check of consistency is then left out.
    """
    # Step 1: check each entry.
    findings_by_label = {}
    for label in labels:
        problem = ModelDraws(base=point.assumed_scenario(label))
        findings_by_label[label] = list(check_filter(cls, point.filters[label], on=problem))
    # Step 2: if one entry is consistent, the others have keys that do not fit.
    consistency, _ = CHECKS["consistency"]  # the title of the check
    good_finding = Finding(consistency, "good")  # the finding of a consistent entry
    if not any(good_finding in findings for findings in findings_by_label.values()):
        return findings_by_label
    for findings in findings_by_label.values():
        for i, finding in enumerate(findings):
            if finding.check == consistency and finding.verdict == "bad":
                why = f"fits with other keys; with these {finding.why}"
                findings[i] = finding._replace(verdict="left out", why=why)
    return findings_by_label
