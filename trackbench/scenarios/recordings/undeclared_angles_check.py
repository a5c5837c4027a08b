"""Notes on components that seem to be angles, by their names or jumps of a whole turn, undeclared."""

from collections.abc import Collection, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.models.angle_components import may_be_angle
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.stacked import Sensors, sensors_of

_TURN = 2.0 * np.pi
_SMALL = 0.7
"""rad; largest change of an angle from step to step by which a jump by a turn is recognized"""


def has_turns(values: Array) -> bool:
    """Test whether values (K, M) of K steps in M runs are an angle that jumps by a turn of 2 pi.

    They are if all lie within a turn plus `_SMALL`, one change or more from step to step is a turn to
    within `_SMALL`, and the other changes, one or more, are below `_SMALL`. Missing values are NaN. A
    change to or from a missing value does not count.
    """
    finite = values[np.isfinite(values)]
    if not len(finite) or np.ptp(finite) > _TURN + _SMALL:
        return False
    changes = np.abs(np.diff(values, axis=0))
    changes = changes[np.isfinite(changes)]
    is_turn = np.abs(changes - _TURN) < _SMALL
    other_changes = changes[~is_turn]
    return bool(is_turn.any() and len(other_changes) and (other_changes < _SMALL).all())


def notes_on_angles(
    components: Sequence[str], known: Collection[str], truth: Array | None, owner: str
) -> list[str]:
    """Return notes on components of the state that seem to be angles, and that no key declares as such.

    ``known`` are those that are declared, or that are lengths and velocities. ``truth`` (n_x, K, M) is
    recorded; None without one. ``owner``, target or motion, has the key that declares angles.
    """
    notes = []
    for row, name in enumerate(components):
        if name in known:
            continue
        why = ""
        if truth is not None and has_turns(truth[row]):
            why = f"the truth of {name} jumps by a turn of 2 pi"
        elif may_be_angle(name):
            why = f"{name} has the name of an angle"
        if why:
            notes.append(
                f"{why}, and no key says that it is one, so that a whole turn counts as an error: "
                f"if it is an angle in rad, write `angles: [{name}]` into the {owner}"
            )
    return notes


def notes_on_multiples(sensor: Sensors, angles: tuple[str, ...]) -> list[str]:
    """Return notes on sensors that measure a multiple of one of the state's ``angles``.

    Such a measurement jumps by another number than 2 pi where the angle jumps by a turn, as one in
    degrees does. It is right only if it counts on beyond a turn, and does not jump: an empty key
    ``angles`` of the sensor says so.
    """
    notes = []
    for each in sensors_of(sensor):
        if not isinstance(each, FunctionSensor):
            continue
        for measured in each.multiples_of_angles(angles):
            notes.append(
                f"{measured} measures a multiple of an angle, so that a whole turn counts as an "
                "error: write `h` in rad, or `angles: []` into the sensor if it counts on"
            )
    return notes
