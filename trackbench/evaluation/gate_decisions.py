"""Wrong decisions of gates: good measurements that are rejected, and bad ones that are accepted."""

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.deliver_late_measurements import deliveries
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.models.sensors.stacked import Sensors, rows_of
from trackbench.scenarios.base import Simulation


def rejections(z: Array, twin: Array, diagnostics: Mapping[str, Array]) -> dict[str, Array]:
    """Return which good measurements a gate rejects, and which bad ones it accepts.

    A measurement is bad if a fault changed it, so that it differs from that without faults.

    Parameters
    ----------
    z, twin
        measurements (n_z, T, M) with and without faults, NaN where a component is missing
    diagnostics
        diagnostics (T + 1, M) of the filter by name

    Returns
    -------
    dict
        ``rejected_good`` and ``accepted_bad`` (T + 1, M), each 0 or 1. ``rejected_good`` is NaN for bad
        measurements, ``accepted_bad`` for good ones, and both if the filter was not given a measurement.
        Empty without the diagnostics ``gated`` and ``nis``
    """
    if not {"gated", "nis"} <= diagnostics.keys():
        return {}
    gated = diagnostics["gated"]
    nis = diagnostics["nis"]
    changed = (z != twin) & ~np.isnan(z)
    # The first row is that of the prior, which has no measurement.
    bad = np.insert(changed.any(axis=0), 0, False, axis=0)
    # A measurement that was given is refused by the gate (1 in `gated`), or has a NIS (else NaN).
    given = (gated > 0.0) | ~np.isnan(nis)
    return {
        "rejected_good": np.where(given & ~bad, gated, np.nan),
        "accepted_bad": np.where(given & bad, 1.0 - gated, np.nan),
    }


def sensor_rejections(
    z: Array, twin: Array, refused: Mask, sensors: Sequence[slice]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the shares of good measurements that gates reject, and of bad ones that they accept.

    Each of several sensors has a gate. A measurement that a fault changed is bad.

    Parameters
    ----------
    z, twin
        measurements (n_z, T, M) with and without faults, NaN where a component is missing
    refused
        mask (n_z, T, M) of the components that a gate refused
    sensors
        rows of each sensor in ``z``

    Returns
    -------
    shares : dict
        ``rejected_good`` and ``accepted_bad`` (T + 1, M), shares of each step's measurements; NaN
        without any
    numbers : dict
        numbers (T + 1, M) of the measurements that they are shares of, by the same names
    """
    changed = (z != twin) & ~np.isnan(z)
    # Masks (S, T, M) of the measurements that the filter got, of the bad ones, and of the rejected ones.
    given = np.stack([~np.isnan(z[rows]).all(axis=0) for rows in sensors])
    bad = np.stack([changed[rows].any(axis=0) for rows in sensors])
    rejected = np.stack([refused[rows].any(axis=0) for rows in sensors])
    good_share, good_number = _share_of_wrong_decisions(given & ~bad, rejected)
    bad_share, bad_number = _share_of_wrong_decisions(given & bad, ~rejected)
    shares = {"rejected_good": good_share, "accepted_bad": bad_share}
    numbers = {"rejected_good": good_number, "accepted_bad": bad_number}
    return shares, numbers


def _share_of_wrong_decisions(counted: Mask, is_wrong: Mask) -> tuple[Array, Array]:
    """Return the share of the ``counted`` measurements (S, T, M) that gates decide wrongly.

    ``is_wrong`` (S, T, M) marks the wrong decisions, such as the rejection of a good measurement. The
    second result is the number of the counted measurements. Both are (T + 1, M): they are over the S
    sensors at each step. In the first row, the prior's, the share is NaN and the number 0.
    """
    number = counted.sum(axis=0).astype(float)
    with np.errstate(invalid="ignore"):
        share = (counted & is_wrong).sum(axis=0) / number
    return np.insert(share, 0, np.nan, axis=0), np.insert(number, 0, 0.0, axis=0)


def gate_decisions(
    task: BlockTask, twin_task: BlockTask, data: Simulation, output: FilterOutput
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return series of the gate's wrong decisions, and the weights of their steps.

    Parameters
    ----------
    task
        task of the filter
    twin_task
        task of the same runs without faults. Its measurements show which measurements are bad
    data
        data of the block, with faults
    output
        output of the filter over ``data``

    Returns
    -------
    series : dict
        ``rejected_good`` and ``accepted_bad`` (T + 1, M). With several sensors a step's value is a share
        of its measurements
    weights : dict
        numbers (T + 1, M) of the measurements by series; empty with one sensor
    """
    z = data.measurements
    clean = twin_task.data.measurements
    delivered = deliveries(task, data)
    # A late measurement stands at the step at which the filter gets it, as in the filter's output.
    if delivered is not None:
        z = delivered.given(z)
        clean = delivered.given(clean)
    # The gate of a single sensor writes its decisions to the diagnostics.
    if output.refused is None:
        return rejections(z, clean, output.diagnostics), {}
    sensors = rows_of(cast(Sensors, task.scenario.true_sensor))
    return sensor_rejections(z, clean, output.refused, sensors)
