"""Check that the blocks of an experiment and its stored numbers fit into the memory."""

from trackbench.config.experiment import Experiment, Point
from trackbench.errors import Problem, UserError
from trackbench.execution.block_size import block_width_of
from trackbench.execution.memory import memory
from trackbench.execution.plan import runs_with_tracks, stored_series
from trackbench.filters.base import AnyFilter

_PER_RUN = 10  # numbers of a run beside its series, at least


def check_memory(experiment: Experiment, save_tracks: bool = False) -> None:
    """Raise UserError if a block of a filter and the stored numbers exceed the machine's memory.

    This is a lower bound: the particles with their weights before and after a step, and the estimates
    of a block. The queue measures how much a block really takes. ``save_tracks`` stores the tracks of
    all runs, with covariances.
    """
    settings = experiment.settings
    series = len(stored_series(experiment))
    shown = runs_with_tracks(experiment, save_tracks)  # number of runs
    for point in experiment.points:
        n_x = len(point.scenario.components)
        steps = len(point.scenario.steps)
        # Numbers that are stored of all runs, and of the tracks that are shown: saved tracks are counted
        # by their covariances, others by their means.
        per_step = n_x * n_x if save_tracks else n_x
        of_runs = settings.runs * (_PER_RUN + series * steps)
        of_tracks = shown * per_step * steps * len(point.filters)
        for label, tracker in point.filters.items():
            # Numbers of one run while its block is filtered.
            particles = tracker.max_particle_count * _kept_states(tracker, point, label)
            of_run = 2 * (n_x + 1) * particles + n_x * steps
            width = block_width_of(settings, tracker, point.scenario)  # runs per block
            needed = 8 * (width * of_run + of_runs + of_tracks)  # bytes, 8 of each number
            if needed > memory():
                message = (
                    f"needs at least {needed / 1e9:.1f} GB of memory and this machine has "
                    f"{memory() / 1e9:.1f} GB: use fewer particles or runs, or a smaller block"
                )
                # Position in the config of the filter's key `N`, or else of the filter.
                mark = experiment.source.mark(("filters", label, "N"))
                raise UserError(Problem(mark, f"filters.{label}", message))


def _kept_states(tracker: AnyFilter, point: Point, label: str) -> int:
    """Return how many states of a run are in memory at once.

    A smoother has those of all steps. A filter that repeats steps for late measurements has the states
    that it may go back to.
    """
    steps = len(point.scenario.steps)
    if tracker.smooths:
        return steps
    late = point.assumed_scenario(label).late
    if late is None or late.kind != "refilter":
        return 1
    # Without a `memory` the filter may go back to the start.
    return min(steps, 1 + point.scenario.longest_delay, 1 + (late.memory or steps))
