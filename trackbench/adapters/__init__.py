"""Filters that know one run only, from a few lines of one's own: no arrays of runs, no base to learn.

``PerRun``     a class with ``start(mean, cov)`` and ``step(z, dt)``, or ``predict(dt)``, ``update(z)``
``FilterPy``   the same from an object of filterpy that ``make(dt)`` gives
``StoneSoup``  the same from a predictor and an updater of Stone Soup

An object is made for every run, and the runs are looped over in Python.
"""

from trackbench.adapters.filterpy import FilterPy
from trackbench.adapters.per_run import PerRun
from trackbench.adapters.stonesoup_parts import StoneSoup

__all__ = ["FilterPy", "PerRun", "StoneSoup"]
