"""norfair 2.3.0: predictions without a detection do not add to the variance."""

import sys

import numpy as np
from norfair.filter import FilterPyKalmanFilterFactory, OptimizedKalmanFilterFactory

gains = {}
for factory in (FilterPyKalmanFilterFactory(), OptimizedKalmanFilterFactory()):
    for gap in (1, 10):
        one = factory.create_filter(np.zeros((1, 2)))
        for _ in range(gap):
            one.predict()
        one.update(np.ones((2, 1)))
        gains[type(factory).__name__, gap] = one.x[0].item()
name = "OptimizedKalmanFilterFactory"
if np.isclose(gains[name, 1], gains[name, 10]):
    other = "FilterPyKalmanFilterFactory"
    sys.exit(
        f"gain {gains[name, 1]:.3f} after 1 prediction and after 10; with {other} "
        f"{gains[other, 1]:.3f} and {gains[other, 10]:.3f}"
    )
