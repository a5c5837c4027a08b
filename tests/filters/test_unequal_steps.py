"""Every filter moves its state over the interval of each step."""

from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.unequal_steps import INTERVALS, filtered
from trackbench.core.distributions import Gaussian
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.registry import kinds

PLANAR = {"state.planar", "motion.jacobian", "sensor.jacobian", "motion.T|intervals"}
PLANAR |= {"motion.F|linear", "sensor.H"}
KINDS = [
    kind
    for kind, cls in kinds("filters").items()
    if set(getattr(cls, "requires", ())) <= PLANAR and not kind.startswith("grid")
]


@pytest.mark.parametrize("kind", [*KINDS, "pf with moves"])
def test_a_known_state_without_noise_moves_in_a_straight_line(kind: str) -> None:
    """From 1 m at 1 m/s, along both axes; no measurement corrects a wrong interval."""
    still = WhiteAcceleration(q=1e-12)
    chain = {"motions": (still, still), "transition": ((0.9, 0.1), (0.2, 0.8))}
    keys: dict[str, Any] = {"imm": chain, "mmpf": chain, "pf with moves": {"moves": 3}}
    tracker: Any = make_filter(kind.split()[0], **keys.get(kind, {}))
    prior = Gaussian(np.ones((4, 2)), 1e-12 * np.eye(4))
    found, _ = filtered(tracker, prior, np.full((2, len(INTERVALS), 2), np.nan), still.q)
    at = 1.0 + np.concatenate([[0.0], np.cumsum(INTERVALS)])
    for x, position in zip(found, at, strict=True):
        np.testing.assert_allclose(x.mean[:, 0], [position, 1.0, position, 1.0], atol=1e-4)
