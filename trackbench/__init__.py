"""trackbench: Monte Carlo experiments with target-tracking filters, from YAML to tables.

``trackbench.run``, ``sweep``, ``tune``, ``load``, ``compare``, ``plot`` do what the command line does.
"""

# Assigned, as an import of the module `typing` would come before `__main__.leave_working_folder`, and in
# `python -m trackbench` that module could be a file of the working folder.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from trackbench.api import (
        Options,
        Report,
        UserError,
        compare,
        load,
        plot,
        run,
        run_all,
        sweep,
        tune,
    )

__version__ = "0.1.0"
__all__ = [
    "Options",
    "Report",
    "UserError",
    "compare",
    "load",
    "plot",
    "run",
    "run_all",
    "sweep",
    "tune",
]


def __dir__() -> list[str]:
    """List the names for completion, before anything is imported."""
    return [*__all__, "__doc__", "__version__"]


def __getattr__(name: str) -> object:
    """Import a function of the API when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from trackbench import api

    return getattr(api, name)
