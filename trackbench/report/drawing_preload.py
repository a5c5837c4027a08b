"""Modules that the processes that draw figures have imported before they are needed."""

import gc

from matplotlib.backends import backend_svg

from trackbench.registry import kinds
from trackbench.report import pairs_of_filters, render
from trackbench.report.plotting import notebook_figure, raised_digits_formatter
from trackbench.report.verdicts import all_verdicts

__all__ = [
    "all_verdicts",
    "backend_svg",
    "notebook_figure",
    "pairs_of_filters",
    "raised_digits_formatter",
    "render",
]
kinds("figures")  # imports the figure kinds
# As in `__main__`.
gc.set_threshold(50_000)
# Processes are forked from this one. The garbage collector leaves out what exists now: it would write to
# these objects, and each process would copy their memory.
gc.freeze()
