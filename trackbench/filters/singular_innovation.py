"""Refusal of measurements with a singular innovation covariance: one component follows from others."""

import numpy as np

from trackbench.core import linalg
from trackbench.filters.base import WHOLE_FILTER
from trackbench.models.base import Scene


def innovation_conflicts(scenario: Scene) -> dict[str, str]:
    """Reject a redundant measured component, by which the innovation covariance is singular.

    Parameters
    ----------
    scenario : Scene
        Filter model, steps and prior of the scenario.

    Returns
    -------
    dict
        Reason for the filter as a whole, by the key `WHOLE_FILTER`. Empty without such a component, and
        for a sensor that is not linear or whose noise depends on the state.
    """
    name = _redundant_component(scenario)
    if name is None:
        return {}
    message = f"`{name}` is a combination of other measured components, its noise included"
    return {WHOLE_FILTER: f"the innovation covariance is singular: {message}; leave it out"}


def _redundant_component(scenario: Scene) -> str | None:
    """Name the first measured component that follows from the components before it.

    None if there is none, or if the sensor is not linear with constant noise.
    """
    motion, sensor = scenario.model
    if not hasattr(sensor, "H") or len(sensor.components) < 2:
        return None
    any_state = np.ones((len(motion.components), 1))
    H = sensor.H(len(any_state))
    # Faults may scale R at some steps, which leaves a redundant component redundant: any step with a
    # measurement will do, such as the last.
    measured_step = int(scenario.steps[-1])
    R = sensor.measurement(any_state, measured_step).cov
    if R.ndim > 2:  # the noise depends on the state
        return None
    # A component is redundant if a combination d of components has neither state nor noise:
    # d' [H R] = 0. Rows and columns are scaled, so that units do not matter.
    B = np.hstack([H, R])
    for axis in (1, 0):
        largest = np.abs(B).max(axis=axis, keepdims=True)
        B = B / np.where(largest > 0.0, largest, 1.0)
    # A row of B that follows from the rows before it has a zero pivot in the factor of B B'.
    pivots = np.diagonal(linalg.root_in_range(linalg.matmul(B, B.T)))
    redundant = np.flatnonzero(pivots == 0.0)
    if len(redundant) == 0:
        return None
    return sensor.components[redundant[0]]
