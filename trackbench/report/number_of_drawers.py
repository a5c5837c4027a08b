"""Processes that draw figures: how many, and the module that they import."""

from trackbench.execution.engines import Engine

DRAWER = "trackbench.report.drawing_preload"
"""What a process that draws figures imports."""


def most_drawers(engine: Engine, workers: int) -> int:
    """Return the largest number of processes that draw figures; ``workers`` is that of the blocks.

    These are as many as there are workers on this machine. Figures are drawn in this process if blocks
    are computed in it, or on a cluster.
    """
    if engine == "processes":
        return workers
    return 1
