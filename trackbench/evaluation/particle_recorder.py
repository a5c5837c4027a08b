"""Particles of a few steps of the first runs, for figures."""

from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.evaluation.block import BlockTask
from trackbench.filters.particle_base import PFState


class ParticleRecorder:
    """Recorder of the first runs' particles at the shown steps, each with its weight and parent.

    A parent is the place (0, 1, ...) among the step before of the particle that this one is moved from.
    """

    def __init__(self, task: BlockTask, n: int) -> None:
        first, last = task.particle_steps or (0, -1)
        self._runs, self._n = task.runs_with_tracks_among(task.runs), n
        self.wanted = range(first, last + 1) if self._runs else range(0)
        self._clouds: list[Array] = []
        self._origin: Array | None = None

    def add(self, state: Any, posterior: Posterior | None, k: int) -> None:
        """Record the state at step k; any other than one of particles is left out."""
        if not isinstance(posterior, ParticlePosterior):
            return
        if k in self.wanted:
            x, w = (a[..., : self._runs, :] for a in posterior.particles)
            unknown = np.full(w.shape, np.nan)
            parents = unknown if self._origin is None else self._origin[: self._runs]
            self._clouds.append(np.concatenate([x[: self._n], w[None], parents[None]]))
        self._origin = None
        if k + 1 in self.wanted and isinstance(state, PFState) and state.origin is not None:
            # Flat indices count on from run to run.
            runs, N = posterior.particles.w.shape
            self._origin = state.origin - float(N) * np.arange(runs)[:, None]

    def recorded(self) -> Array | None:
        """Return what was recorded (n_x + 2, S, N, r), NaN where a step had fewer particles."""
        if not self._clouds:
            return None
        most = max(cloud.shape[-1] for cloud in self._clouds)
        out = np.full((*self._clouds[0].shape[:-1], most, len(self._clouds)), np.nan)
        for i, cloud in enumerate(self._clouds):
            out[..., : cloud.shape[-1], i] = cloud
        return np.ascontiguousarray(out.transpose(0, 3, 2, 1))
