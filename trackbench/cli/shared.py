"""The options that all commands have which run experiments."""

import inspect
from collections.abc import Callable

from trackbench.cli.options import (
    AllowPlugins,
    DryRun,
    EngineName,
    Format,
    Fresh,
    Json,
    Only,
    Out,
    Runs,
    Scheduler,
    Seed,
    Set,
    Workers,
)


def _shared(
    set_: Set = None,
    only: Only = None,
    runs: Runs = None,
    seed: Seed = None,
    out: Out = None,
    engine: EngineName = "processes",
    workers: Workers = None,
    scheduler: Scheduler = None,
    fresh: Fresh = False,
    dry_run: DryRun = False,
    format_: Format = "png,svg",
    allow_plugins: AllowPlugins = False,
    json: Json = False,
) -> None:
    """Their types and defaults."""


def runs_experiments(command: Callable[..., None]) -> Callable[..., None]:
    """A command with these options behind its own, in its ``**given``; one of its own comes first."""
    own = dict(inspect.signature(command).parameters)
    given = own.popitem()[1]
    assert given.kind is inspect.Parameter.VAR_KEYWORD
    shared = {k: p for k, p in inspect.signature(_shared).parameters.items() if k not in own}
    parameters = [*own.values(), *shared.values()]
    by_name = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    command.__signature__ = inspect.Signature(by_name, return_annotation=None)  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    return command
