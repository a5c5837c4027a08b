"""Smoother of the particle filters: backward simulation of trajectories (Godsill et al. 2004)."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from trackbench.core import linalg, particles
from trackbench.core.angles import bring_together, near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.particles import Particles
from trackbench.core.resampling import ancestors, select
from trackbench.core.smoothing import backwards, draw_predecessors
from trackbench.filters.base import SmoothingFilter, Trajectories
from trackbench.filters.particle_base import ParticleFilter, PFState
from trackbench.models.base import Model, Scene, angle_rows


@dataclass(frozen=True, kw_only=True)
class SimulatingSmoother(SmoothingFilter[PFState], ParticleFilter):
    """Base of the particle filters that smooth by backward simulation (Godsill et al. 2004)."""

    smooth: bool | Trajectories = False
    """estimate each step from all measurements of the run, or otherwise: {trajectories: 50, lag: 5}"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a smoother if the motion has no density, judged at one state if Q depends on it."""
        conflicts = super().conflicts(scenario)
        if not self.smooths:
            return conflicts
        motion = scenario.model.motion
        n = len(motion.components)
        # An arbitrary state, not at zero, where a Q may vanish.
        x = np.linspace(0.3, 1.7, n)[:, None]
        # The scenario's first step has the start; the first transition leads to the next step.
        step_after_start = int(scenario.steps[0]) + 1
        transition = motion.transition(x, step_after_start)
        if isinstance(transition, Gaussian) and linalg.is_singular(transition.cov.reshape(n, n)):
            message = "weighs by the density of the process noise, and this motion's Q is singular"
            conflicts["smooth"] = f"{message}; give every component noise, or smooth an ekf or ukf"
        return conflicts

    def smoothed(
        self, model: Model, states: list[PFState], k: int, rng: Generator
    ) -> list[PFState]:
        """Replace the particles of every step by equally weighted trajectories.

        The posterior of a step is that of `averaged_particles`, as `particles` may be resampled and
        jittered for the next step already. The trajectories replace both.
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
            cloud = Particles(x, particles.equal_weights(*x.shape[1:]))
            clouds.append(bring_together(cloud, angles))
        return [
            state._replace(particles=cloud, averaged_particles=cloud, estimate=cloud.moments())
            for state, cloud in zip(states, clouds, strict=True)
        ]
