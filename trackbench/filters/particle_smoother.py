"""Smoother of the particle filters: backward simulation of trajectories.

Godsill, Doucet & West 2004. The keys of ``smooth`` are the number of trajectories and the lag.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.random import Generator

from trackbench.core import elementary, particle_weights
from trackbench.core.angles import bring_together, near
from trackbench.core.arrays import Array
from trackbench.core.fixed_lag_smoothing import backwards
from trackbench.core.particle_weights import normalize
from trackbench.core.particles import Particles
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import ancestors, select
from trackbench.field_types import Count
from trackbench.filters.particle_base import ParticleFilter, PFState
from trackbench.filters.singular_process_noise import smoother_conflicts
from trackbench.filters.smoother_keys import SmoothingFilter
from trackbench.models.base import Model, Scene, angle_rows


@dataclass(frozen=True, kw_only=True)
class Trajectories:
    """Backward simulation with a number of trajectories, from all measurements or a fixed lag."""

    trajectories: Annotated[int, Interval(ge=2, le=10**6)] = 100
    """number of trajectories drawn backwards through the particles"""
    lag: Count | None = None
    """number of later measurements that an estimate uses; default: all"""


@dataclass(frozen=True, kw_only=True)
class SimulatingSmoother(SmoothingFilter[PFState], ParticleFilter):
    """Base of the particle filters that smooth by backward simulation (Godsill et al. 2004)."""

    smooth: bool | Trajectories = False
    """estimate each step from all measurements of the run, or otherwise: {trajectories: 50, lag: 5}"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a smoother if the motion has no density, judged at one state if Q depends on it."""
        conflicts = super().conflicts(scenario)
        if self.smooths:
            conflicts |= smoother_conflicts(scenario)
        return conflicts

    def smoothed(
        self, model: Model, states: list[PFState], k: int, rng: Generator
    ) -> list[PFState]:
        """Replace the particles of every step by equally weighted trajectories.

        The posterior of a step is that of `averaged_particles`, as `particles` may be resampled and
        jittered for the next step already. The trajectories replace both. ``k`` is the step of the first
        state.
        """
        angles = angle_rows(model.motion)

        def draw_one_back(i: int, later: Array) -> Array:
            """Draw states of r trajectories from the particles of ``states[i]``, at step k + i.

            ``later`` (n, M, r) are the trajectories' states at the step after it.
            """
            cloud = states[i].averaged_particles
            transition = model.motion.transition(cloud.x, k + 1 + i)

            def log_density(x: Array) -> Array:
                # An angle of a later state is the same after whole turns.
                return transition.log_prob(near(x, transition.mean, angles))

            return draw_predecessors(cloud, log_density, later, rng)

        # Step 1: draw the last states from each posterior; a run that diverged stays NaN.
        # The value True of the key stands for the default number of trajectories, from all measurements.
        trajectories = Trajectories() if isinstance(self.smooth, bool) else self.smooth
        last_states = []
        for state in states:
            x, w = state.averaged_particles
            x_or_nan = np.where(np.isnan(w), np.nan, x)
            last_states.append(select(x_or_nan, ancestors(w, rng, size=trajectories.trajectories)))
        # Step 2: draw the states before them, step by step.
        paths = backwards(last_states, draw_one_back, self.lag)
        clouds = []
        for x in paths:
            cloud = Particles(x, particle_weights.equal_weights(*x.shape[1:]))
            # Shift angles by whole turns to near each other, before they are averaged.
            clouds.append(bring_together(cloud, angles))
        return [
            state._replace(particles=cloud, averaged_particles=cloud, estimate=cloud.moments())
            for state, cloud in zip(states, clouds, strict=True)
        ]


def draw_predecessors(
    cloud: Particles, log_density: Callable[[Array], Array], later: Array, rng: Streams
) -> Array:
    """Draw the state before each of S later states among weighted particles.

    Particle i is drawn with probability ``w_i p(later | x_i)`` (Godsill, Doucet & West 2004).

    Parameters
    ----------
    cloud : Particles
        Particles x (n, M, N) of a step, with weights w (M, N).
    log_density : callable
        Takes one later state of each run (n, M, 1) and returns log p(later | x_i) (M, N).
    later : array (n, M, S)
        States of the step after it.
    rng : Streams
        Random numbers of the block of runs.

    Returns
    -------
    array (n, M, S)
        Copies of particles. A run with NaN among its weights has NaN.
    """
    out = np.empty_like(later)
    log_w = elementary.log(cloud.w)
    u = rng.random(later.shape[1:])
    runs = np.arange(later.shape[1])
    for s in range(later.shape[2]):
        # Step 1: weights of the particles given the later state; without any density the filter's.
        w, collapsed, _ = normalize(log_w + log_density(later[..., s, None]))
        w = np.where(collapsed[:, None], cloud.w, w)
        # Step 2: the particle i with C_{i-1} <= u C_N < C_i, C being cumulative weights.
        C = np.add.accumulate(w, axis=-1)
        index = (C[:, :-1] <= (u[:, s] * C[:, -1])[:, None]).sum(axis=-1)
        out[..., s] = np.where(np.isnan(C[:, -1]), np.nan, cloud.x[:, runs, index])
    return out
