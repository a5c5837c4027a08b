"""Number of runs: by the options `--runs` and `--quick`; of a recording all recorded ones, or fewer."""

from collections.abc import Sequence
from dataclasses import replace

from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.overrides import override
from trackbench.config.quick_run import QUICK, QUICK_RUNS
from trackbench.errors import Mark, counted
from trackbench.yaml_source import Source


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
        message = f"{settings.runs} is more than the {counted(recorded_runs, 'recorded run')}"
        source.add_problem(("runs",), message)
    block = settings.block
    if block is None and not settings.until:
        # There will never be more runs, and a wider block would filter runs that do not exist.
        block = "fit"
    return replace(settings, runs=runs, block=block)


def set_runs(source: Source, runs: int | None, seed: int | None, quick: bool) -> None:
    """Override the number of runs and the seed by the options that are given.

    ``--runs`` beside ``--quick`` has the last word.
    """
    if quick:
        override(source, ("runs",), QUICK_RUNS, Mark(QUICK))
    for key, number in {"runs": runs, "seed": seed}.items():
        if number is not None:
            override(source, (key,), number, Mark(f"--{key}"))
