"""trackbench: Monte Carlo experiments with target-tracking filters, from YAML to tables.

``trackbench.run``, ``run_all``, ``sweep``, ``tune`` and ``load`` do what the command line does.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trackbench.api import load, run, run_all, sweep, tune

__version__ = "0.1.0"
__all__ = ["load", "run", "run_all", "sweep", "tune"]


def __getattr__(name: str) -> Any:
    """The functions of the API, imported when they are first used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from trackbench import api

    return getattr(api, name)
