"""The bank of a Gaussian sum, as a whole and in pieces."""

from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from trackbench.core.distributions import Gaussian
from trackbench.filters import gaussian_sum
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.stacked import StackedSensor


def test_pieces_of_the_bank_change_no_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    radar = RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=3.0)
    model = Model(WhiteAcceleration(q=0.1).sampled(1.0), StackedSensor((radar, radar)))
    prior = Gaussian(np.full((4, 3), 300.0), np.diag([400.0, 9.0, 400.0, 9.0]))
    tracker: Any = make_filter("gaussian-sum", split=9)
    z = np.tile([[425.0], [0.78]], (2, 3))
    found = []
    for at_once in (2**16, 100):
        monkeypatch.setattr(gaussian_sum, "_AT_ONCE", at_once)
        state = tracker.init(model, prior, np.random.default_rng(0))
        for k in (1, 2):
            state = tracker.step(model, state, z, k, np.random.default_rng(0))
        found.append(state)
    whole, pieces = found
    for a, b in zip(whole[:3], pieces[:3], strict=True):
        assert a.tobytes() == b.tobytes()
