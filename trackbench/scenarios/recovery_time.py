"""Recovery after a fault: `recovery_s` and `not_recovered`."""

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import total
from trackbench.metrics import in_window
from trackbench.scenarios.faults import Fault, FaultContext
from trackbench.scenarios.settling_time import settled_row


def recovery(
    context: FaultContext,
    faults: Sequence[Fault],
    windows: Mapping[str, Mask],
    values: Mapping[str, Array],
) -> dict[str, Array]:
    """Measure ``recovery_s`` and ``not_recovered`` of each fault, by the first quantity's error.

    A run has recovered at the first step from which on its excess error stays within the limit, up to
    the next fault. Its time counts from the last step with the fault.

    Parameters
    ----------
    context : FaultContext
        Sensors and steps of the scenario.
    faults : sequence of Fault
        Faults of the scenario.
    windows : mapping of str to array of bool (K,)
        Scored steps by name, those after each fault among them.
    values : mapping of str to array (K, M)
        Series by name. ``damage_position`` is the length of the error less that of the twin without
        faults.

    Returns
    -------
    dict of array (M,)
        Time, s, and 1 for a run that has not recovered, by the metric's name. The time of such a run is
        NaN. Both are NaN without an error. Empty without a series of damage.
    """
    # damage_position: length of the error less that of the twin, the same filter without faults
    excess_names = [name for name in values if name.partition("_")[0] == "damage"]
    if not excess_names:
        return {}
    first_name = excess_names[0]
    damage = values[first_name]
    squared = values[first_name.replace("damage", "squared", 1)]
    metrics: dict[str, Array] = {}
    for fault in faults:
        after = windows.get(f"after {fault.name}")
        if after is None:
            continue
        # Step 1: the limit is a share of the twin's RMSE after the fault.
        twin = np.square(np.sqrt(squared[after]) - damage[after])
        known = ~np.isnan(twin)
        limit = fault.recovered * np.sqrt(total(np.where(known, twin, 0.0), 0) / known.sum(axis=0))
        # Step 2: the last step, from that of the fault's end on, with a larger excess. `faulty_steps`
        # leaves out the first step, which has no measurement.
        last = int(np.flatnonzero(context.faulty_steps(fault))[-1]) + 1
        places = np.append(last, np.flatnonzero(after))
        # Place from which on the excess stays within the limit; one after the last place, whose time is
        # NaN, for a run that does not recover.
        recovered = settled_row(damage[places] > limit)
        times = np.append(context.times[places] - context.times[last], np.nan)
        seconds = np.where(np.isnan(limit), np.nan, times[recovered])
        not_recovered = (recovered == len(places)).astype(float)
        metrics[in_window("recovery_s", fault.name)] = seconds
        metrics[in_window("not_recovered", fault.name)] = np.where(
            np.isnan(limit), np.nan, not_recovered
        )
    return metrics
