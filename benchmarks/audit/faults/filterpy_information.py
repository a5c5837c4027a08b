"""filterpy 2.0.0, 1.4.5, bayesian-filters 1.4.5: the information filter where 1 < dim_z < dim_x."""

import sys

import numpy as np

if "bayesian_filters" in sys.argv:
    from bayesian_filters.kalman import InformationFilter
else:
    from filterpy.kalman import InformationFilter

one = InformationFilter(dim_x=3, dim_z=2)
one.F, one.H = np.eye(3), np.eye(2, 3)
one.predict()
try:
    one.update(np.array([[1.0], [2.0]]))
except ValueError as error:
    sys.exit(f"update of 3 states with 2 measurements: ValueError: {error}")
