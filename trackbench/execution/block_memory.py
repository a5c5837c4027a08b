"""Memory of blocks: check that it is enough, and the stored blocks that stay in it until the merge."""

from trackbench.config.experiment import Experiment, Point
from trackbench.errors import Problem, UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution.block_file import PackedBlock
from trackbench.execution.block_size import block_width_of
from trackbench.execution.memory import memory
from trackbench.execution.plan import runs_with_tracks, stored_series
from trackbench.filters.base import AnyFilter

_PER_RUN = 10  # numbers of a run beside its series, at least
_KEPT_BYTES = 256_000_000
"""Size of the stored blocks that stay in memory from when they are found until they are merged."""


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


class FoundBlocks:
    """Stored blocks that were found and wait for the merge, so that their files are read once.

    Blocks beyond `_KEPT_BYTES` are not kept: the merge reads their files again. Tasks are looked up by
    identity, because the hash of a task takes half as long as reading its block. The task is kept with
    its block, so that no other object gets its identity.
    """

    def __init__(self) -> None:
        self._blocks: dict[int, tuple[BlockTask, PackedBlock]] = {}
        self._bytes = 0

    def keep(self, task: BlockTask, block: PackedBlock) -> None:
        """Keep a block if there is room for it; the key is the identity of its task."""
        if self._bytes + block.numbers.nbytes <= _KEPT_BYTES:
            self._blocks[id(task)] = task, block
            self._bytes += block.numbers.nbytes

    def take(self, task: BlockTask) -> PackedBlock | None:
        """Return a block and forget it; None if it was not kept.

        Only the very object ``task`` that the block was kept for finds it: the key is its identity.
        """
        if id(task) not in self._blocks:
            return None
        _, block = self._blocks.pop(id(task))
        self._bytes -= block.numbers.nbytes
        return block
