"""Write a validated experiment as plain data with every default, which reruns the same experiment."""

import os
from collections.abc import Callable, Iterator
from dataclasses import MISSING, asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeAlias, cast

import yaml

from trackbench.component_parts import Part, field_values
from trackbench.config.build_components import ENTRY_KEYS
from trackbench.config.experiment import Experiment
from trackbench.config.file_paths import file_keys
from trackbench.config.filter_model import places_of_model
from trackbench.config.grid import single_paths
from trackbench.config.overrides import split_path
from trackbench.config.python_tables import path_from
from trackbench.config.tuning import tuned_label
from trackbench.evaluation.metric_expression import Measure
from trackbench.field_types import key_of
from trackbench.models.assume import Assume
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import Keys

PlainData: TypeAlias = dict[str, Any]
"""A config, or a part of one, as a file has it."""


def resolved(experiment: Experiment, folder: Path) -> PlainData:
    """Write out the config as plain data with every default; a grid keeps its list of values.

    If the grid or tuning varies a component's kind or preset, defaults differ from point to point, and
    the component has only the keys that the config sets. A filter that ``only`` leaves out stays, so
    that tables, figures and published numbers can name it. Paths are relative to ``folder``, where the
    config is to be written.
    """
    first = experiment.points[0]
    without_defaults = _components_with_varied_defaults(experiment)
    # Unless they are set, these keys are left out, as configs of older results folders lack them.
    optional = ("exact", "smoothed", "problem", "matters", "files", "environment")
    config: PlainData = {}
    for key, value in asdict(experiment.settings).items():
        if value or key not in optional:
            config[key] = value

    def relative(path: str) -> str:
        """Write a path relative to the folder; other words stay as they are."""
        if os.path.isabs(path):
            return path_from(path, folder)
        # A word as --table=/home/me/file.csv
        option, equals, value = path.partition("=")
        if os.path.isabs(value):
            return f"{option}{equals}{path_from(value, folder)}"
        return path

    def write_component(component: Part, keys: Keys) -> object:
        """Write a component, with its defaults unless these vary."""
        full = as_config(component, relative)
        if keys in without_defaults:
            return _keep_set_keys(full, experiment.source.value_at(keys))
        return full

    # Step 1: files and scenario.
    config["plugins"] = [relative(plugin.path) for plugin in experiment.plugins]
    # Every plugin has all of the declared files.
    if experiment.plugins and experiment.settings.files:
        config["files"] = [relative(name) for name, _ in experiment.plugins[0].files]
    elif not experiment.plugins:
        # The entries of programs already have the files and variables declared for all of them.
        config.pop("files", None)
        config.pop("environment", None)
    # A results folder holds copies of the files under these names, so that it stands alone.
    config["published"] = [f"published/{name}" for name in experiment.published.files]
    config["scenario"] = write_component(first.scenario, ("scenario",))
    # The training scenario has only the keys that differ from the scenario's.
    changes = config["tuning"].pop("scenario")
    if changes is not None and experiment.training is not None:
        whole = as_config(experiment.training.scenario, relative)
        config["tuning"]["scenario"] = _keep_set_keys(whole, changes)
    # Step 2: filters, tables and figures.
    all_filters = first.filters | experiment.left_out
    filters = {label: all_filters[label] for label in experiment.settings.filters}
    groups = cast("dict[str, PlainData]", {"filters": filters} | experiment.parts)
    for group, components in groups.items():
        config[group] = {}
        for name, component in components.items():
            config[group][name] = write_component(component, (group, name))
    if config["key_figure"] not in config["figures"]:  # a sweep has figures of its own
        config["key_figure"] = None
    # Step 3: filter models.
    for label, assume in first.assumed.items():
        assumed: object = entry_keys(assume, relative)
        if ("filters", label) in without_defaults:
            entry = experiment.source.value_at(("filters", label))
            set_keys = {key: entry[key] for key in ENTRY_KEYS if key in entry}
            assumed = _keep_set_keys(assumed, set_keys)
        config["filters"][label] |= assumed
    return config


def entry_keys(assume: Assume, write_path: Callable[[str], str] = str) -> PlainData:
    """Return the keys of a filter's entry that give this filter model: ``assume`` and ``late``.

    ``write_path`` writes the path of a data file.
    """
    assumed = {k: v for k, v in as_config(assume, write_path).items() if v is not None}
    # The treatment of late measurements stands beside `assume`.
    late = assumed.pop("late", None)
    entry: PlainData = {}
    # A filter model without any key is still written, as an empty mapping, unless `late` shows that
    # there is one.
    if assumed or late is None:
        entry["assume"] = assumed
    if late is not None:
        entry["late"] = late
    return entry


def data_files(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """List the data files in a results folder by name: those from Python, and those that lie there.

    Tables that Python passes are files of a temporary folder, and are copied into the results folder:
    `path_from` writes them as a name alone. Files elsewhere are named by a path and stay where they are.
    """
    path_by_name: dict[str, Path] = {}

    def note_path(path: str) -> str:
        """Note a data file as its path is written."""
        path_by_name.setdefault(path_from(path, folder), Path(path))
        return path

    for point in experiment.points:
        as_config(point.scenario, note_path)  # called for the paths that it writes
    # A name without a folder is that of a file in the results folder.
    return {name: path for name, path in path_by_name.items() if Path(name).name == name}


def data_from_python(experiment: Experiment, folder: Path) -> list[str]:
    """Name the data files that the run writes into the folder: those that do not lie there already."""
    names = []
    for name, path in data_files(experiment, folder).items():
        if path.resolve() != (folder / name).resolve():
            names.append(name)
    return names


def _components_with_varied_defaults(experiment: Experiment) -> set[Keys]:
    """Find the paths of components whose kind or preset the grid or tuning varies."""
    # Step 1: every path that varies.
    settings = experiment.settings
    paths = []
    for joint_path in settings.grid:
        paths += single_paths(joint_path)
    for label, keys in settings.tune.items():
        for filter_label in (label, tuned_label(label)):
            paths += [f"filters.{filter_label}.{key}" for key in keys]
    # Step 2: the components of the paths that end in a kind or preset.
    components = set()
    for path in paths:
        path_keys = split_path(experiment.source, path)
        if path_keys[-1] not in ("kind", "preset"):
            continue
        # The keys of a component are ("scenario",) or ("filters", LABEL).
        is_of_scenario = path_keys[0] == "scenario"
        components.add(path_keys[:1] if is_of_scenario else path_keys[:2])
    return components


def _keep_set_keys(full: object, config: object) -> object:
    """Return the part of ``full``, a component with all defaults, whose keys the ``config`` sets.

    A key that ``full`` lacks, such as ``preset``, is taken from the ``config``.
    """
    if isinstance(full, dict) and isinstance(config, dict):
        return {key: _keep_set_keys(full.get(key, value), value) for key, value in config.items()}
    if isinstance(full, list) and isinstance(config, list):
        return [_keep_set_keys(*pair) for pair in zip(full, config, strict=True)]
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
        quote = None
        if scalar(word) != word:
            quote = "'"
        if "\x85" in word:  # a line break in YAML, which only double quotes can express
            quote = '"'
        return self.represent_scalar("tag:yaml.org,2002:str", word, style=quote)


_Dumper.add_representer(str, _Dumper.represent_word)


def as_config(component: Part | Assume, write_path: Callable[[str], str] = str) -> PlainData:
    """Write a registered dataclass as the mapping that makes it.

    ``write_path`` writes the path of a data file. Keys that were added after the first versions are left
    out unless they are set, so that configs of older results folders stay as they are.
    """
    names_of_files = file_keys(type(component))
    mapping: PlainData = {}
    if isinstance(component, Part):
        mapping["kind"] = component.kind
    for field in fields(component):
        if not field.init:
            continue
        value = getattr(component, field.name)
        if field.name in names_of_files and isinstance(value, str):
            value = write_path(value)
        elif field.name in names_of_files and value is not None:
            value = [write_path(path) for path in value]
        mapping[field.name] = _as_plain_data(value, write_path)
    return _without_unset_later_keys(component, mapping)


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
    "input",
    "input_file",
    "input_gap",
    "input_naming",
)
"""Keys that older results folders lack: left out if unset, so that their configs stay as they are."""
_LATER_WITH_DEFAULT = ("gate_by", "input_holds")
"""Keys of this kind whose default is a word: left out at the default."""


def _without_unset_later_keys(component: Any, values: PlainData) -> PlainData:
    """Leave out keys of a component that older results folders lack, if they change nothing.

    A key of `_LATER` is left out if it is empty, as its default is. A key of `_LATER_WITH_DEFAULT` is
    left out if its value is its default.
    """
    defaults = {}
    for field in fields(component):
        has_factory = field.default_factory is not MISSING
        # Factories make empty lists and mappings, which count as no value.
        defaults[key_of(field.name)] = None if has_factory else field.default
    remaining = {}
    for key, value in values.items():
        # An empty list was written if the default is none: `clockwise: []` of one of several files.
        is_empty_list = defaults.get(key) is None and value in ([], ())
        is_unset = key in _LATER and not value and not defaults[key] and not is_empty_list
        is_default = key in _LATER_WITH_DEFAULT and value == defaults[key]
        if not (is_unset or is_default):
            remaining[key] = value
    return remaining


def _as_plain_data(value: object, write_path: Callable[[str], str]) -> object:
    """Write the value of a component's key as plain data: mappings, lists and scalars.

    ``write_path`` writes the path of a data file.
    """
    if isinstance(value, Part):
        return as_config(value, write_path)
    if is_dataclass(value) and not isinstance(value, type):
        # Keys that configs of older versions lack are left out unless they are set.
        by_key = {key_of(name): inner for name, inner in field_values(value).items()}
        value = _without_unset_later_keys(value, by_key)
    if isinstance(value, Measure):  # an expression, which is a named tuple: so before the tuples
        return str(value)
    if isinstance(value, dict):
        return {key: _as_plain_data(inner, write_path) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_as_plain_data(inner, write_path) for inner in value]
    return value


def configured_values(experiment: Experiment, label: str) -> dict[str, Any]:
    """Return the values of the keys of a filter, and of its filter model, by path: ``assume.motion.q``.

    Presets and defaults are included, and the model that the filter takes from the scenario.
    """
    point = experiment.points[0]
    filters = point.filters | experiment.left_out
    config = as_config(filters[label])
    assumed = {}
    if label in point.assumed:
        assumed = as_config(point.assumed[label])
        # The treatment of late measurements is a key of the filter's entry, beside `assume`.
        config["late"] = assumed.pop("late", None)
    # A component that the filter does not set is that of the scenario.
    scenario = {"scenario": as_config(point.scenario)}
    for component in ("motion", "sensor", "start"):
        # The first place is the filter's own `assume`, which is in ``assumed`` already.
        for place in places_of_model(label, component)[1:]:
            if assumed.get(component) is None:
                assumed[component] = _value_at(scenario, place)
    config["assume"] = assumed
    return dict(_walk_values(config))


def _value_at(data: Any, keys: Keys) -> Any:
    """Return the value at this path of keys in nested mappings; None if there is none."""
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data


def _walk_values(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and value of every scalar in nested mappings and lists: ``motions.1.q``, 0.3.

    ``path`` is that of ``data`` itself.
    """
    if isinstance(data, list):
        data = dict(enumerate(data))
    if not isinstance(data, dict):
        yield path, data
        return
    for key, value in data.items():
        inner_path = f"{path}.{key}" if path else str(key)
        yield from _walk_values(value, inner_path)
