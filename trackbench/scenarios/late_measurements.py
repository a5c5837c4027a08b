"""Key `late` of a filter, which a scenario with late measurements demands."""

from collections.abc import Sequence

from trackbench.errors import counted, joined
from trackbench.field_types import InvalidKeyError
from trackbench.models.assume import Assume
from trackbench.models.delays import Late
from trackbench.models.sensors.stacked import sensor_name


def treatment_of_late_measurements(assume: Assume) -> Late | None:
    """Return a filter's treatment of late measurements.

    Parameters
    ----------
    assume : Assume
        Assumptions of the filter.

    Returns
    -------
    Late or None
        Treatment. None if the filter gets all measurements on time.

    Raises
    ------
    InvalidKeyError
        If the filter model has neither `late` nor `delay: none`.
    """
    # The filter is given every measurement on time, which bounds what it could reach with late ones.
    if assume.delay == "none":
        return None
    if assume.late is None:
        message = "measurements arrive late here: add `late: drop`, `apply` or `refilter`; to get"
        raise InvalidKeyError(f"{message} them on time, as a bound, `assume: {{delay: none}}`")
    if isinstance(assume.late, str):
        return Late(kind=assume.late)
    return assume.late


def notes_on_unused_sensors(
    late: Late | None, shortest_delays: Sequence[int], names: Sequence[str]
) -> list[str]:
    """Return a note if a filter drops all measurements of a sensor, because all of them are too late.

    Parameters
    ----------
    late : Late or None
        Treatment of late measurements; None if the filter gets all of them on time.
    shortest_delays : sequence of int (S,)
        Number of steps by which all measurements of each sensor are late at least.
    names : sequence of str
        Names of the sensors in a recording; there may be none.
    """
    if late is None:
        return []
    if late.kind == "drop":
        most_steps = 0
        key = "`late: drop`"
        way = "take `refilter` or `apply`"
    elif late.memory is not None:
        most_steps = late.memory
        key = f"`memory: {late.memory}`"
        way = "take a longer memory"
    else:
        return []
    unused = [n for n, delay in enumerate(shortest_delays) if delay > most_steps]
    if not unused:
        return []
    steps = counted(min(shortest_delays[n] for n in unused), "step")
    if len(unused) == len(shortest_delays):
        return [
            f"{key} drops all measurements, as they are at least {steps} late, so that the filter "
            f"only predicts; {way}"
        ]
    sensors = joined(sensor_name(n, names) for n in unused)
    return [f"{key} drops all measurements of {sensors}, as they are at least {steps} late; {way}"]
