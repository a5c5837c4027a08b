"""Recognition of an undeclared heading by its jumps of a whole turn."""

import numpy as np

from trackbench.core.arrays import Array

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
