"""Gates of the filters with one Gaussian: measurements that are refused because their NIS is too large.

A filter with the key ``gate`` updates twice: first with all measurements, which gives the NIS, then
without the refused ones. `GaussianFilter.step` and `IMM.step` call the functions of this file.
"""

from functools import cache
from typing import Literal, TypeAlias, cast

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.kalman import Innovation
from trackbench.core.read_only import fixed
from trackbench.filters.robust import sensor_rows
from trackbench.models.base import Scene, Sensor
from trackbench.models.sensors.noise import ScaledNoise
from trackbench.models.sensors.stacked import Sensors, sensors_of

GateScope: TypeAlias = Literal["measurement", "sensor"]
"""One gate for the measurement of all sensors at a step, or one for each sensor's measurement."""


def refused_components(
    gate: float, scope: GateScope, sensor: Sensor, z: Array, innovation: Innovation, nis: Array
) -> Mask:
    """Return the measured components that are beyond their gates.

    The gate of one sensor judges the NIS of its own innovation, ``nu_s' S_ss^-1 nu_s``. The limit
    depends on the number of components with an innovation.

    Parameters
    ----------
    gate : float
        Probability of the chi-square quantile that is the limit, such as 0.999.
    scope : GateScope
        One gate for all sensors of a step, or one for each sensor.
    sensor : Sensor
        Sensor of the filter model, which may stand for several.
    z : array (n_z, M)
        Measurements of the step.
    innovation : Innovation
        Innovation of the update with all measurements.
    nis : array (M,)
        NIS of that innovation.

    Returns
    -------
    array (n_z, M)
        True where a measured component is refused.
    """
    nu = innovation.nu
    S = innovation.S
    limits = gate_limits(gate, len(z))
    # A measured component that the filter cannot use has no innovation and adds nothing to the NIS, such
    # as a range without azimuth in cmkf.
    has_innovation = ~np.isnan(nu)
    is_measured = ~np.isnan(z)
    rows_of_sensors = sensor_rows(sensor)  # a slice of each sensor's rows in z
    if scope == "measurement" or len(rows_of_sensors) == 1:
        beyond = nis > limits[has_innovation.sum(axis=0)]
        return np.asarray(beyond & is_measured)
    refused = np.zeros(z.shape, dtype=np.bool_)
    for rows in rows_of_sensors:
        # `rows` is a slice, so that `S[rows, rows]` is a block.
        nis_of_sensor = Innovation(nu[rows], S[rows, rows]).nis
        refused[rows] = nis_of_sensor > limits[has_innovation[rows].sum(axis=0)]
    return refused & is_measured


def count_refused(scope: GateScope, sensor: Sensor, refused: Mask) -> Array:
    """Count the measurements (M,) that have a refused component.

    Parameters
    ----------
    scope : GateScope
        ``measurement`` counts the measurement of all sensors as one, ``sensor`` each sensor's.
    sensor : Sensor
        Sensor of the filter model.
    refused : array (n_z, M)
        Refused components.

    Returns
    -------
    array (M,)
        Number of refused measurements of each run.
    """
    if scope == "measurement":
        return np.asarray(refused.any(axis=0), dtype=float)
    count = np.zeros(refused.shape[1])
    for rows in sensor_rows(sensor):
        count += refused[rows].any(axis=0)
    return count


@cache
def gate_limits(gate: float, n_z: int) -> Array:
    """Return the limits of the NIS for each number of measured components.

    Parameters
    ----------
    gate : float
        Probability of the chi-square quantile that is the limit, such as 0.999.
    n_z : int
        Number of components of a measurement.

    Returns
    -------
    array (n_z + 1,)
        Chi-square quantiles, read-only: entry n is for n measured components. Entry 0 is infinite.
    """
    from scipy.special import chdtri

    # Without a measured component the limit is infinite: nothing is refused.
    quantiles = [chdtri(n, 1.0 - gate) for n in range(1, n_z + 1)]
    return fixed(np.array([np.inf, *quantiles]))


def idle_gate_keys(gate: float | None, scenario: Scene) -> dict[str, str]:
    """Return the reason why the key ``gate_by`` has no effect, for `Filter.idle_keys`.

    Parameters
    ----------
    gate : float or None
        Value of the key ``gate``; None without a gate.
    scenario : Scene
        Filter model, steps and prior of the scenario.

    Returns
    -------
    dict
        Reason by key: there is no gate, or only one sensor. Empty if the key has an effect.
    """
    if gate is None:
        return {"gate_by": "without `gate`"}
    if len(sensor_rows(scenario.model.sensor)) > 1:
        return {}
    return {"gate_by": "with one sensor"}


def gate_cautions(gate: float | None, scope: GateScope, scenario: Scene) -> list[str]:
    """Return a note if one gate judges the measurements of several sensors at a step together.

    Parameters
    ----------
    gate : float or None
        Value of the key ``gate``; None without a gate.
    scope : GateScope
        Value of the key ``gate_by``.
    scenario : Scene
        Filter model, steps and prior of the scenario.

    Returns
    -------
    list of str
        One note, or none if each sensor has its own gate or no two sensors measure at one step.
    """
    if gate is None or scope == "sensor" or not _measure_together(scenario):
        return []
    message = "one gate judges all sensors of a step, so that a bad one costs the others"
    return [f"{message}; `gate_by: sensor` gives each sensor a gate of its own"]


def _measure_together(scenario: Scene) -> bool:
    """Test whether the periods of the scenario's sensors let two of them measure at one step."""
    sensor = scenario.model.sensor
    while isinstance(sensor, ScaledNoise):  # faults multiply the noise of the sensor inside
        sensor = sensor.sensor
    measured_steps = scenario.steps[1:]  # after the step of the prior
    sensors_per_step = np.zeros(len(measured_steps))
    for single in sensors_of(cast(Sensors, sensor)):
        sensors_per_step += single.measures_at(measured_steps)
    return bool((sensors_per_step > 1).any())
