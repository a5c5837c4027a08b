"""Series that a scenario asks for beside the whole state's error.

``scenario.marginals``    {name: components}: consistency of a part of the state, ``nees_<name>``
``scenario.observables``  functions of the state, {name: (*batch)} from x (n_x, *batch): the error of
                          their posterior mean, for filters that know it (``expectation``)
"""

from typing import Any

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.scenarios.base import Scenario


def derived(
    scenario: Scenario, tracker: Any, state: Any, found: Gaussian, truth: Array
) -> dict[str, Array]:
    """Values (M,) of one step by the name of their series; truth is (n_x, M)."""
    out: dict[str, Array] = {}
    for name, part in marginals(scenario).items():
        at = list(part)
        part_found = Gaussian(found.mean[at], found.cov[np.ix_(at, at)])
        out[f"nees_{name}"] = normalised_error(part_found, truth[at])
    observables = getattr(scenario, "observables", None)
    expectation = getattr(tracker, "expectation", None)
    if observables is not None and expectation is not None:
        exact = observables(truth)
        for name, value in expectation(state, observables).items():
            error = value - exact[name]
            out[f"squared_{name}"], out[f"error_{name}"] = np.square(error), error
    return out


def normalised_error(found: Gaussian, truth: Array) -> Array:
    """Normalised estimation error squared (M,).

    Infinite where the covariance is singular, as a collapsed cloud's is up to rounding.
    """
    error = found.mean - truth
    nees = linalg.mahalanobis(error, found.cov)
    known = np.isfinite(error).all(axis=0) & np.isfinite(found.cov).all(axis=(0, 1))
    return np.where(np.isnan(nees) & known, np.inf, nees)


def marginals(scenario: Scenario) -> dict[str, tuple[int, ...]]:
    """The parts of the state that the scenario wants judged on their own."""
    return getattr(scenario, "marginals", {})


def sizes(scenario: Scenario) -> dict[str, int]:
    """Number of components by the name of each NEES series; the whole state has no name."""
    parts = {name: len(part) for name, part in marginals(scenario).items()}
    return {"": len(scenario.model.motion.components)} | parts
