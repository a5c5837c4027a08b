"""Filters written for a single run, which trackbench loops over the runs.

``PerRun``     a class with ``start(mean, cov)`` and ``step(z, dt)``, or ``predict(dt)``, ``update(z)``
``FilterPy``   a filterpy object, created by ``make(dt)``
``StoneSoup``  a Stone Soup predictor and updater, created by ``make(transition, measurement)``
"""

from trackbench.adapters.filterpy import FilterPy
from trackbench.adapters.per_run import PerRun
from trackbench.adapters.stonesoup import StoneSoup

__all__ = ["FilterPy", "PerRun", "StoneSoup"]
