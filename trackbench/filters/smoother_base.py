"""Keys of the smoothers, and the smoother of particle filters: backward simulation."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.random import Generator

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.particles import Particles, equal_weights
from trackbench.core.resampling import ancestors, select
from trackbench.core.smoothing import backwards, draw_predecessors
from trackbench.field_types import Count
from trackbench.filters.base import Filter, State
from trackbench.filters.particle_base import ParticleFilter, PFState
from trackbench.models.base import Model, NormalMotion, Scene


@dataclass(frozen=True, kw_only=True)
class FixedLag:
    """A smoother that estimates a step once a fixed number of later measurements is there."""

    lag: Count
    """number of later measurements that an estimate uses"""


@dataclass(frozen=True, kw_only=True)
class Trajectories:
    """Backward simulation with a number of trajectories, from all measurements or a fixed lag."""

    trajectories: Annotated[int, Interval(ge=2, le=10**6)] = 100
    """number of trajectories drawn backwards through the particles"""
    lag: Count | None = None
    """number of later measurements that an estimate uses; default: all"""


class SmoothingFilter(Filter[State]):
    """Base of the filters with the key ``smooth``."""

    smooth: bool | FixedLag | Trajectories

    @property
    def smooths(self) -> bool:
        """Return whether the key ``smooth`` is set."""
        return self.smooth is not False

    @property
    def lag(self) -> int | None:
        """Return the number of later measurements that an estimate uses, or None for all."""
        return None if isinstance(self.smooth, bool) else self.smooth.lag


@dataclass(frozen=True, kw_only=True)
class SimulatingSmoother(SmoothingFilter[PFState], ParticleFilter):
    """Base of the particle filters that smooth by backward simulation (Godsill et al. 2004)."""

    smooth: bool | Trajectories = False
    """estimate each step from all measurements of the run, or otherwise: {trajectories: 50, lag: 5}"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Return that a smoother needs the density of the motion, if it has none."""
        out, motion = super().conflicts(scenario), scenario.model.motion
        if self.smooths and isinstance(motion, NormalMotion) and linalg.is_singular(motion.Q):
            what = "weighs by the density of the process noise, and this motion's is singular"
            out["smooth"] = f"{what}; give every component noise, or smooth an ekf or ukf"
        return out

    def smoothed(
        self, model: Model, states: list[PFState], k: int, rng: Generator
    ) -> list[PFState]:
        """Return equally weighted trajectories in place of the particles of every step."""

        def one_back(i: int, later: Array) -> Array:
            cloud = states[i].weighted
            transition = model.motion.transition(cloud.x, k + 1 + i)
            return draw_predecessors(cloud, transition.log_prob, later, rng)

        # Step 1: draw the last states from each posterior; a run that diverged stays NaN.
        count = self._keys.trajectories
        ends = [
            select(np.where(np.isnan(w), np.nan, x), ancestors(w, rng, size=count))
            for x, w in (state.weighted for state in states)
        ]
        # Step 2: draw the states before them, step by step.
        paths = backwards(ends, one_back, self.lag)
        clouds = [Particles(x, equal_weights(*x.shape[1:])) for x in paths]
        return [
            state._replace(particles=cloud, weighted=cloud, estimate=cloud.moments())
            for state, cloud in zip(states, clouds, strict=True)
        ]

    def smoother_memory(self, model: Model, steps: int) -> int:
        """Return also the numbers of boosted particles and of the trajectories."""
        n, boosted = len(model.motion.components), self.max_particle_count - self.N
        more = 3 * (n + 1) * boosted * self.boost_scans + 2 * n * self._keys.trajectories * steps
        return super().smoother_memory(model, steps) + more

    @property
    def _keys(self) -> Trajectories:
        return Trajectories() if isinstance(self.smooth, bool) else self.smooth
