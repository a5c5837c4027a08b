"""Imports of a drawing process, made before it is needed."""

import gc

import pandas as pd
from matplotlib.backends import backend_svg

from trackbench.registry import kinds
from trackbench.report import paired, render
from trackbench.report.plotting import canvas
from trackbench.report.verdicts import numbers

__all__ = ["backend_svg", "canvas", "numbers", "paired", "pd", "render"]
kinds("figures")
gc.set_threshold(50_000)  # as in `__main__`
gc.freeze()  # a process that is forked from here need not look it through, and so copy its pages
