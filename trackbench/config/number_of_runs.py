"""Number of runs of a recording: all that are recorded, or fewer."""

from collections.abc import Sequence
from dataclasses import replace

from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.yaml_source import Source

QUICK = "--quick"
"""Option whose number of runs may be more than there are recordings."""


def fewest_recorded_runs(points: Sequence[Point]) -> int | None:
    """Return the smallest number of recorded runs of any point; None if all points are simulated.

    Each point of the grid has this number of runs.
    """
    counts = [point.scenario.recorded_runs for point in points]
    return min((count for count in counts if count is not None), default=None)


def with_recorded_runs(source: Source, settings: Settings, points: list[Point]) -> Settings:
    """Return the settings with the number of runs: all recorded runs unless the config sets fewer.

    Settings of simulated scenarios stay as they are.
    """
    recorded_runs = fewest_recorded_runs(points)
    if recorded_runs is None:
        return settings
    runs = recorded_runs
    if "runs" in source.data and settings.runs <= recorded_runs:
        runs = settings.runs
    elif "runs" in source.data and source.mark(("runs",)).file != QUICK:  # that of --quick is cut
        message = f"{settings.runs} is more than the {recorded_runs} recorded runs"
        source.add_problem(("runs",), message)
    block = settings.block
    if block is None and not settings.until:
        # There will never be more runs, and a wider block would filter runs that do not exist.
        block = "fit"
    return replace(settings, runs=runs, block=block)
