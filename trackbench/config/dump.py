"""Write a validated experiment as plain data with every default, which reruns the same experiment."""

import os
from collections.abc import Callable
from dataclasses import asdict, fields, is_dataclass
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias, cast

import yaml

from trackbench.config.build import ENTRY_KEYS, file_keys
from trackbench.config.experiment import Experiment
from trackbench.config.grid import single_paths
from trackbench.config.includes import split_path
from trackbench.config.python_tables import path_from
from trackbench.config.tuning import tuned_label
from trackbench.evaluation.metric_expression import Measure
from trackbench.extension_points import Part, field_values, key_of
from trackbench.models.sensors.base import Assume
from trackbench.yaml_source import Keys, scalar

PlainData: TypeAlias = dict[str, Any]
"""A config, or a part of one, as a file has it."""


def resolved(experiment: Experiment, folder: Path) -> PlainData:
    """Write out the config as plain data with every default; a grid keeps its list of values.

    If the grid or tuning varies a component's kind or preset, defaults differ from point to point, and
    the component has only the keys that the config sets. A filter that ``only`` leaves out stays, so
    that tables, figures and published numbers can name it. Paths are relative to ``folder``, where the
    config is to be written.
    """
    first, without_defaults = experiment.points[0], _with_varied_defaults(experiment)
    # Without these keys, configs stay as they are in older results folders.
    optional = ("exact", "smoothed", "problem", "matters", "files", "environment")
    out = {key: x for key, x in asdict(experiment.settings).items() if x or key not in optional}

    def relative(path: str) -> str:
        if os.path.isabs(path):
            return path_from(path, folder)
        # A word as --table=/home/me/file.csv
        name, equals, value = path.partition("=")
        return f"{name}{equals}{path_from(value, folder)}" if os.path.isabs(value) else path

    def written(part: Part, keys: Keys) -> object:
        full = as_config(part, relative)
        return _only_set(full, experiment.source.at(keys)) if keys in without_defaults else full

    # Step 1: files and scenario.
    out["plugins"] = [relative(plugin.path) for plugin in experiment.plugins]
    if experiment.plugins and experiment.settings.files:
        out["files"] = [relative(name) for name, _ in experiment.plugins[0].files]
    elif not experiment.plugins:
        # The entries of programs have what is declared for all of them.
        out.pop("files", None)
        out.pop("environment", None)
    # A results folder holds copies of the files under these names, so that it stands alone.
    out["published"] = [f"published/{name}" for name in experiment.published.files]
    out["scenario"] = written(first.scenario, ("scenario",))
    changes = out["tuning"].pop("scenario")  # the other keys are those of the scenario
    if changes is not None and experiment.training is not None:
        whole = as_config(experiment.training.scenario, relative)
        out["tuning"]["scenario"] = _only_set(whole, changes)
    # Step 2: filters, tables and figures.
    every = first.filters | experiment.left_out
    filters = {label: every[label] for label in experiment.settings.filters}
    groups = cast("dict[str, PlainData]", {"filters": filters} | experiment.parts)
    for group, built in groups.items():
        out[group] = {name: written(part, (group, name)) for name, part in built.items()}
    if out["key_figure"] not in out["figures"]:  # a sweep has figures of its own
        out["key_figure"] = None
    # Step 3: filter models.
    for label, assume in first.assumed.items():
        assumed: object = entry_keys(assume, relative)
        if ("filters", label) in without_defaults:
            entry = experiment.source.at(("filters", label))
            assumed = _only_set(assumed, {key: entry[key] for key in ENTRY_KEYS if key in entry})
        out["filters"][label] |= assumed
    return out


def entry_keys(assume: Assume, shown: Callable[[str], str] = str) -> PlainData:
    """Return the keys of a filter's entry that give these assumptions."""
    assumed = {k: v for k, v in as_config(assume, shown).items() if v is not None}
    late = {"late": assumed.pop("late")} if "late" in assumed else {}
    return ({"assume": assumed} if assumed or not late else {}) | late


def data_files(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """List the data files that a results folder has, by name: those from Python, and its own."""
    names: dict[str, Path] = {}

    def read(path: str) -> str:
        return str(names.setdefault(path_from(path, folder), Path(path)))

    for point in experiment.points:
        as_config(point.scenario, read)
    return {name: path for name, path in names.items() if Path(name).name == name}


def data_from_python(experiment: Experiment, folder: Path) -> list[str]:
    """Name the data files that the run writes into the folder."""
    named = data_files(experiment, folder).items()
    return [name for name, path in named if path.resolve() != (folder / name).resolve()]


def _with_varied_defaults(experiment: Experiment) -> set[Keys]:
    """Find the paths of components whose kind or preset the grid or tuning varies."""
    settings = experiment.settings
    paths = list(chain.from_iterable(map(single_paths, settings.grid)))
    for label, keys in settings.tune.items():
        for of in (label, tuned_label(label)):
            paths += [f"filters.{of}.{key}" for key in keys]
    varied = [split_path(experiment.source, path) for path in paths]
    varied = [keys for keys in varied if keys[-1] in ("kind", "preset")]
    return {keys[:1] if keys[0] == "scenario" else keys[:2] for keys in varied}


def _only_set(full: object, config: object) -> object:
    """Reduce ``full`` to the keys that the config sets."""
    if isinstance(full, dict) and isinstance(config, dict):
        return {key: _only_set(full.get(key, value), value) for key, value in config.items()}
    if isinstance(full, list) and isinstance(config, list):
        return [_only_set(*pair) for pair in zip(full, config, strict=True)]
    return full


def as_yaml(data: object) -> str:
    """Write plain data as YAML in its order; `yaml_source.read` returns the same data."""
    return yaml.dump(
        data,
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None,
        width=100,
    )


class _Dumper(yaml.SafeDumper):
    def represent_word(self, word: str) -> yaml.ScalarNode:
        """Represent a word, in quotes if YAML 1.2 would read it as a number, such as 1e5."""
        quote = "'" if scalar(word) != word else None
        if "\x85" in word:  # a line break in YAML, which only double quotes can express
            quote = '"'
        return self.represent_scalar("tag:yaml.org,2002:str", word, style=quote)


_Dumper.add_representer(str, _Dumper.represent_word)


def as_config(part: Part | Assume, shown: Callable[[str], str] = str) -> PlainData:
    """Write a registered dataclass as the mapping that makes it; ``shown`` is how paths are written."""
    files = file_keys(type(part))
    out: PlainData = {"kind": part.kind} if isinstance(part, Part) else {}
    for key in (field for field in fields(part) if field.init):
        value = getattr(part, key.name)
        if key.name in files and value is not None:
            value = shown(value) if isinstance(value, str) else [shown(path) for path in value]
        out[key.name] = _plain(value, shown)
    return _without_unset(part, out)


_LATER = (
    "faults",
    "robust",
    "delay",
    "late",
    "format",
    "density",
    "settled_error",
    "environment",
    "clockwise",
    "thousands",
)
"""Keys that older results folders lack: left out if unset, so that their configs stay as they are."""
_LATER_WITH_DEFAULT = ("gate_by",)
"""Such keys whose default is a word: left out at the default."""


def _without_unset(part: Any, keys: PlainData) -> PlainData:
    """Leave out keys that older results folders lack, if they are unset."""
    defaults = {key_of(key.name): key.default for key in fields(part)}
    kept = {}
    for key, value in keys.items():
        is_unset = key in _LATER and not value and not defaults[key]
        is_default = key in _LATER_WITH_DEFAULT and value == defaults[key]
        if not (is_unset or is_default):
            kept[key] = value
    return kept


def _plain(value: object, shown: Callable[[str], str]) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        if isinstance(value, Part):
            return as_config(value, shown)
        keys = {key_of(name): x for name, x in field_values(value).items()}
        value = _without_unset(value, keys)
    if isinstance(value, Measure):
        return str(value)
    if isinstance(value, dict):
        return {k: _plain(v, shown) for k, v in value.items()}
    return [_plain(v, shown) for v in value] if isinstance(value, list | tuple) else value
