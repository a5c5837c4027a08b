"""Shell completion; wrong configs complete to nothing."""

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

Complete: TypeAlias = Callable[[typer.Context, str], list[str]]


def _completing(candidates: Callable[[typer.Context, str], Iterable[str]]) -> Complete:
    """Keep the candidates that begin with the typed word, quoted for the shell."""

    @wraps(candidates)
    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        with suppress(Exception):  # a traceback in the middle of a command line helps nobody
            return [_word(w) for w in candidates(ctx, incomplete) if w.startswith(incomplete)]
        return []

    return complete


@_completing
def configs(ctx: typer.Context, incomplete: str) -> Iterator[str]:
    """Return shipped experiments, and YAML files and folders of the working directory."""
    from trackbench.config.shipped_experiments import names

    yield from names()
    for path in sorted(glob(f"{escape(incomplete)}*")):
        if os.path.isdir(path):
            yield f"{path}/"
        elif path.endswith((".yaml", ".yml")):
            yield path


@_completing
def experiments(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return shipped experiments."""
    from trackbench.config.shipped_experiments import names

    return names()


@_completing
def groups(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the words that `trackbench list` accepts."""
    from trackbench.registry import GROUPS

    return [*GROUPS, "experiments", "problems"]


@_completing
def all_kinds(ctx: typer.Context, incomplete: str) -> Iterator[str]:
    """Return the kinds of every group."""
    from trackbench.registry import GROUPS, documentation

    for group in GROUPS:
        yield from documentation(group)


@_completing
def labels(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the filter labels of the config that is named on the command line."""
    return list(_config(ctx)["filters"])


@_completing
def assignments(ctx: typer.Context, incomplete: str) -> Iterator[str]:
    """Yield ``PATH=`` for every key that the config has or may have."""
    from trackbench.config.experiment import Settings

    config = _config(ctx)
    for field in fields(Settings):
        value = config.get(field.name)
        group = {"scenario": "scenarios"}.get(field.name, field.name)
        if field.name == "scenario":
            yield from _keys(value, group, "scenario.")
        elif field.name in ("filters", "tables", "figures") and isinstance(value, dict):
            for label, part in value.items():
                yield from _keys(part, group, f"{group}.{label}.")
        else:
            yield f"{field.name}="


def _keys(part: Any, group: str | None, path: str) -> Iterator[str]:
    """Yield paths to the keys of a component: its kind's, those in the config, nested ones."""
    from trackbench.config.build import dataclasses_in, hints_of
    from trackbench.field_types import part_group
    from trackbench.models.sensors.base import Assume
    from trackbench.registry import Group, of_kind

    known: dict[str, Any] = {}
    if group is not None and isinstance(part, dict) and "kind" in part:
        cls = cast(type[Any], of_kind(cast(Group, group), part["kind"]))
        known = {field.name: hints_of(cls)[field.name] for field in fields(cls)}
        known |= {"preset": str} if group == "filters" and cls.presets else {}
    if group == "filters":
        known |= {f"assume.{key}": hint for key, hint in hints_of(Assume).items()}
    for key in dict.fromkeys([*known, *part]):
        nested = dataclasses_in(known.get(key)) if part_group(known.get(key)) is None else []
        if isinstance(part.get(key), dict) and not nested:
            yield from _keys(part[key], part_group(known.get(key)), f"{path}{key}.")
        elif len(nested) == 1:
            yield from (f"{path}{key}.{name}=" for name in hints_of(nested[0]))
        else:
            yield f"{path}{key}="


def _config(ctx: typer.Context) -> dict[str, Any]:
    """Return the config on the command line with its includes resolved."""
    from trackbench.config.includes import inline_parts
    from trackbench.config.shipped_experiments import located
    from trackbench.yaml_source import read

    given = ctx.params.get("configs") or [ctx.params.get("config")]
    # Before the value of an option is typed, the words so far stand in args.
    path = located(Path(given[0] or ctx.args[0]), lambda line: None)
    source = read(path)
    inline_parts(source, path.parent)
    return source.data


def _word(word: str) -> str:
    """Escape a word for bash; the other shells escape by themselves."""
    if os.environ.get("_TRACKBENCH_COMPLETE", "").endswith("bash"):
        return re.sub(r"([^\w./=,:@%+-])", r"\\\1", word)
    return word
