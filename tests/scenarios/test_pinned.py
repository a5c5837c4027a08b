"""The simulations of the three papers, to the last bit: what every published number rests on.

The digests are those of the scenarios that were classes of their own before targets, sensors and starts
could be combined.
"""

from hashlib import sha256
from typing import Any

import numpy as np
import pytest

from tests.papers import banana, maneuver, merwe
from trackbench.evaluation.simulated_runs import simulate

RUNS, SEED = 20, 2026
PINNED: dict[str, tuple[Any, str]] = {
    "merwe": (merwe(), "157324e523e3ec49cfb91a833dfd2cfab356c22d089df82a2202c9936bfd7c65"),
    "merwe, first state drawn": (
        merwe(x1=0.0, P1=1.0),
        "bfb7b59a32854691524654210e75e6406c013caa60c3bcf52259e47dff90f2e1",
    ),
    "banana": (banana(), "d9cfb99b8a8563f78c2c7ef278c0ff54a9c15110aede3fadb238856a4659458a"),
    "maneuver": (maneuver(), "87b07a98f7b6f7caaadb38b74ef54d1ad4691a6ba45cecc57ceb7f9a6faf6a14"),
    "maneuver as printed": (
        maneuver(truth="as-printed"),
        "da94015d1c9cf003d5344e7039e35f6bd730768b2d6cc2e2fb43915b11e3bd91",
    ),
}


@pytest.mark.parametrize("name", PINNED)
def test_truth_measurements_and_prior_are_what_they_were(name: str) -> None:
    scenario, expected = PINNED[name]
    data, digest = simulate(scenario, SEED, 0, RUNS), sha256()
    for values in (data.truth, data.measurements, data.prior.mean, data.prior.cov):
        digest.update(str(values.shape).encode())
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    assert digest.hexdigest() == expected
