"""Refusal of process noise without a density, of filters and smoothers that weigh particles by it."""

import numpy as np

from trackbench.core import linalg
from trackbench.core.distributions import Gaussian
from trackbench.filters.base import WHOLE_FILTER
from trackbench.models.base import NormalMotion, Scene


def proposal_conflicts(scenario: Scene) -> dict[str, str]:
    """Reject a motion with a singular Q, of a filter that weighs by likelihood * prior / proposal.

    Parameters
    ----------
    scenario : Scene
        Filter model, steps and prior of the scenario.

    Returns
    -------
    dict
        Reason for the filter as a whole, by the key `WHOLE_FILTER`; empty for another motion.
    """
    motion = scenario.model.motion
    if isinstance(motion, NormalMotion) and linalg.is_singular(motion.Q):
        return {
            WHOLE_FILTER: "weighs by the density of the process noise, and this motion's is singular"
        }
    return {}


def smoother_conflicts(scenario: Scene) -> dict[str, str]:
    """Reject a particle filter's smoother if Q is singular, judged at one state if Q depends on it.

    Parameters
    ----------
    scenario : Scene
        Filter model, steps and prior of the scenario.

    Returns
    -------
    dict
        Reason by the key ``smooth``; empty if the motion's noise has a density.
    """
    motion = scenario.model.motion
    n = len(motion.components)
    # An arbitrary state, not at zero, where a Q may vanish.
    x = np.linspace(0.3, 1.7, n)[:, None]
    # The scenario's first step has the start; the first transition leads to the next step.
    step_after_start = int(scenario.steps[0]) + 1
    transition = motion.transition(x, step_after_start)
    # Noise of another law, such as gamma, always has a density.
    if isinstance(transition, Gaussian) and linalg.is_singular(transition.cov.reshape(n, n)):
        message = "weighs by the density of the process noise, and this motion's Q is singular"
        return {"smooth": f"{message}; give every component noise, or smooth an ekf or ukf"}
    return {}
