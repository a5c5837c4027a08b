"""Settling and recovery: the row from which on an error stays within a limit.

``settling_s`` of a target's legs and ``recovery_s`` of a fault count up to this row.
"""

import numpy as np

from trackbench.core.arrays import Index, Mask


def settled_row(above: Mask) -> Index:
    """Return the row (M,) after the last True of each column of ``above`` (K, M), 0 if none is True."""
    rows = np.arange(1, len(above) + 1)[:, None]
    return np.asarray(np.where(above, rows, 0).max(axis=0), dtype=np.intp)
