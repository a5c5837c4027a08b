"""Write a validated experiment as plain data with every default, which reruns the same experiment."""

import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import cast

import yaml

from trackbench.component_parts import Part
from trackbench.config.build_components import ENTRY_KEYS
from trackbench.config.component_as_config import PlainData, as_config
from trackbench.config.experiment import Experiment
from trackbench.config.grid import single_paths
from trackbench.config.overrides import split_path
from trackbench.config.python_tables import path_from
from trackbench.config.tuning import tuned_label
from trackbench.models.assume import Assume
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import Keys


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
