"""Shell completion: experiments, files, kinds, filter labels and paths of keys.

Wrong configs complete to nothing.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import fields
from functools import wraps
from glob import escape, glob
from pathlib import Path
from typing import Any, TypeAlias, cast

import typer

FURTHER_LISTS = ("experiments", "problems", "suites", "metrics", "statistics")
"""Words of `trackbench list` beside the groups of kinds."""
Complete: TypeAlias = Callable[[typer.Context, str], list[str]]


def _completing(candidates: Callable[[typer.Context, str], Iterable[str]]) -> Complete:
    """Make a completion of the function ``candidates``, which returns all words for a place.

    The completion returns those that begin with the typed word, quoted for the shell.
    """

    @wraps(candidates)
    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        """Return the candidates that begin with the word typed so far."""
        with suppress(Exception):  # a traceback in the middle of a command line helps nobody
            return [_escape(w) for w in candidates(ctx, incomplete) if w.startswith(incomplete)]
        return []

    return complete


@_completing
def configs(ctx: typer.Context, incomplete: str) -> Iterator[str]:
    """Complete shipped experiments, and YAML files and folders of the working directory."""
    from trackbench.config.shipped_experiments import names

    yield from names()
    for path in sorted(glob(f"{escape(incomplete)}*")):
        if os.path.isdir(path):
            yield f"{path}/"
        elif path.endswith((".yaml", ".yml")):
            yield path


@_completing
def experiments(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete shipped experiments."""
    from trackbench.config.shipped_experiments import names

    return names()


@_completing
def groups(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete the words that `trackbench list` accepts."""
    from trackbench.registry import GROUPS

    return [*GROUPS, *FURTHER_LISTS]


@_completing
def all_kinds(ctx: typer.Context, incomplete: str) -> Iterator[str]:
    """Complete the kinds of every group."""
    from trackbench.registry import GROUPS, documentation

    for group in GROUPS:
        yield from documentation(group)


@_completing
def labels(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete the filter labels of the config that is named on the command line."""
    return list(_config_in_line(ctx)["filters"])


@_completing
def assignments(ctx: typer.Context, incomplete: str) -> Iterator[str]:
    """Yield ``PATH=`` for every key that the config has or may have."""
    from trackbench.config.experiment_keys import Settings

    config = _config_in_line(ctx)
    for field in fields(Settings):
        key = field.name
        value = config.get(key)
        if key == "scenario":
            yield from _key_paths(value, "scenarios", "scenario.")
        elif key in ("filters", "tables", "figures") and isinstance(value, dict):
            # The key is also the group of the kinds below it.
            for label, component in value.items():
                yield from _key_paths(component, key, f"{key}.{label}.")
        else:
            yield f"{key}="


def _key_paths(component: Any, group: str | None, path: str) -> Iterator[str]:
    """Yield ``PATH=`` for each key of a component: those of its kind, those in the config, nested ones.

    ``component`` is its mapping in the config. ``group`` is the group of its kind, such as filters; None
    for a mapping that is no component. ``path`` is the beginning of the paths, such as
    ``filters.PF.``.
    """
    from trackbench.field_types import dataclasses_in, hints_of, part_group
    from trackbench.models.assume import Assume
    from trackbench.registry import Group, of_kind

    known: dict[str, Any] = {}  # types of the keys that the kind has
    if group is not None and isinstance(component, dict) and "kind" in component:
        cls = cast(type[Any], of_kind(cast(Group, group), component["kind"]))
        known = {field.name: hints_of(cls)[field.name] for field in fields(cls)}
        if group == "filters" and cls.presets:
            known["preset"] = str
    if group == "filters":
        known |= {f"assume.{key}": hint for key, hint in hints_of(Assume).items()}
        known["late"] = known.pop("assume.late")  # this key is written beside `assume`
    for key in dict.fromkeys([*known, *component]):
        hint = known.get(key)
        group_of_key = part_group(hint)
        nested = []
        if group_of_key is None:
            nested = dataclasses_in(hint)
        if isinstance(component.get(key), dict) and not nested:
            yield from _key_paths(component[key], group_of_key, f"{path}{key}.")
        elif len(nested) == 1:  # of several dataclasses, the kind in the config decides on the keys
            for name in hints_of(nested[0]):
                yield f"{path}{key}.{name}="
        else:
            yield f"{path}{key}="


def _config_in_line(ctx: typer.Context) -> dict[str, Any]:
    """Return the data of the config on a command line that is being completed; includes are resolved."""
    from trackbench.config.includes import inline_parts
    from trackbench.config.shipped_experiments import located
    from trackbench.yaml_source import read

    given = ctx.params.get("configs") or [ctx.params.get("config")]
    # Before the value of an option is typed, the words so far are no parameters yet and stand in args.
    path = located(Path(given[0] or ctx.args[0]), note=lambda line: None)  # prints nothing
    source = read(path)
    inline_parts(source, path.parent)
    return source.data


def _escape(word: str) -> str:
    """Escape the special characters of a word for bash; the other shells escape by themselves."""
    if os.environ.get("_TRACKBENCH_COMPLETE", "").endswith("bash"):
        return re.sub(r"([^\w./=,:@%+-])", r"\\\1", word)
    return word
