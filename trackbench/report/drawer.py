"""What a process that draws figures imports, so that it is there when it is asked for one."""

import gc

from trackbench.registry import kinds
from trackbench.report import paired, render, verdicts
from trackbench.report.artists import import_artists

__all__ = ["paired", "render", "verdicts"]
import_artists()
kinds("figures")
gc.set_threshold(50_000)  # as in `__main__`
gc.freeze()  # a process that is forked from here need not look it through, and so copy its pages
