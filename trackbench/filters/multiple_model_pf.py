"""Multiple-model particle filter: each particle follows one of several motions."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from trackbench.core import particle_weights, resampling
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array, Index
from trackbench.core.distributions import Distribution
from trackbench.core.particles import Particles
from trackbench.core.random_streams import Streams
from trackbench.core.regularization import Kernel, jitter_if_measured, jitter_modes
from trackbench.core.regularization import Mode as Spread
from trackbench.core.sums import total
from trackbench.field_types import NonNegative
from trackbench.filters.jump_markov_base import JumpMarkov, position_velocity_components
from trackbench.filters.particle_base import ParticleFilter, PFState
from trackbench.models.base import Model, angle_rows, extra_std
from trackbench.models.first_particles import draw_covering
from trackbench.registry import register


@register("filters", "mmpf")
@dataclass(frozen=True, kw_only=True)
class MultipleModelPF(JumpMarkov[PFState], ParticleFilter):
    """Multiple-model particle filter: each particle follows one of the motions.

    McGinnity & Irwin 2000; Ristic, Arulampalam & Gordon 2004, section 3.5.5, with the regularization of
    section 3.5.3 for the particles of each motion. A motion may have further components: a particle that
    switches to it draws them from their initial distribution.
    """

    kernel: Kernel = "epanechnikov"
    """regularization kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth; 0 is plain resampling"""
    diagnostic_names = ParticleFilter.diagnostic_names | {"mode"}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw particles from the prior, each with a motion.

        A prior that has draws with heavier tails than its own gives them, with log-weights (M, N) that
        correct for it. The first step adds these to the log-likelihoods.
        """
        x, log_w = draw_covering(prior, rng, self._particle_count_after(0))
        runs, N = x.shape[1:]
        extra = _extra_deviations(self.models(model))
        # Draw the motion of each particle from the initial probabilities.
        mode = _draw_modes(np.tile(self.initial_weights[:, None, None], (1, runs, N)), rng)
        # Take the shared components from the prior; draw those that a motion adds.
        shared = x[: len(position_velocity_components(model.motion))]
        weighted = Particles(shared, particle_weights.normalize(log_w).w)
        x = np.concatenate([shared, _draw_extra(extra, mode, rng)])
        state = PFState.first(weighted, log_w)
        return state._replace(particles=Particles(x, weighted.w), mode=mode)

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Draw each particle's motion, then its state from that motion; weigh, resample."""
        assert state.mode is not None
        models = self.models(model)
        n = len(position_velocity_components(model.motion))
        # Step 1: draw the motion of each particle by its row of the transition matrix.
        extra = _extra_deviations(models)
        before = state.mode
        p = np.array(self.transition).T[:, before]  # probability (r, M, N) of each motion j
        mode = _draw_modes(p, rng)
        # Step 2: draw the components that the motion before did not have (NaN); move. They follow the n
        # components that all motions share.
        x = state.particles.x.copy()
        new = np.isnan(extra[:, before])
        x[n:] = np.where(new, _draw_extra(extra, mode, rng), x[n:])
        x = _propagate(models, x, mode, k, rng)
        # Step 3: weigh by the likelihood; angles that differ by whole turns are brought together.
        w, collapsed, evidence = self._weigh(model, state, z, x[:n], k)
        angles = [i for i in angle_rows(models[0].motion) if i < n]
        x = bring_together(Particles(x, w), angles).x
        weighted = Particles(x[:n], w)
        size = self._particle_count_after(state.age + 1)
        # Step 4: resample states and motions; regularize the particles of each motion by themselves. A
        # motion has the components `rows`, so that its particles are jittered in a call of their own, as
        # the members of its only kernel.
        index = resampling.ancestors(w, rng, self.resampling, size)
        spreads = _spreads(models, x, mode, w)
        x = resampling.select(x, index)
        mode = resampling.select(mode, index)
        jittered = x.copy()
        for j, rows in enumerate(_rows_of_motions(models)):
            kernel = spreads[j]._replace(members=mode == j)
            jittered[rows] = jitter_modes(
                jittered[rows], [kernel], self.kernel, rng, self.bandwidth_scale
            )
        regularized = jitter_if_measured(z, x, jittered)
        return PFState(
            particles=Particles(regularized, particle_weights.equal_weights(*index.shape)),
            averaged_particles=weighted,
            estimate=weighted.moments(),
            collapsed=collapsed,
            age=state.age + 1,
            w=w,
            mode=mode,
            evidence=evidence,
        )

    def diagnostics(self, state: PFState) -> dict[str, Array]:
        """Report also ``mode``: share of particles that follow another motion than the first."""
        assert state.mode is not None
        others = (state.mode != 0).sum(axis=-1) / state.mode.shape[-1]
        return super().diagnostics(state) | {"mode": others}


def _extra_names(models: list[Model]) -> list[str]:
    """Return the components beyond the shared positions and velocities, each once."""
    names: list[str] = []
    for model in models:
        n = len(position_velocity_components(model.motion))
        names += [name for name in model.motion.components[n:] if name not in names]
    return names


def _extra_deviations(models: list[Model]) -> Array:
    """Return the initial standard deviations (e, r) of the e extra components in each of r motions.

    NaN if a motion lacks the component.
    """
    names = _extra_names(models)
    deviations = np.full((len(names), len(models)), np.nan)
    for j, model in enumerate(models):
        std = extra_std(model.motion)
        own_names = model.motion.components[len(model.motion.components) - len(std) :]
        for name, s in zip(own_names, std, strict=True):
            deviations[names.index(name), j] = s
    return deviations


def _draw_extra(extra: Array, mode: Index, rng: Streams) -> Array:
    """Draw the extra components (e, M, N) of particles with motions ``mode`` (M, N).

    ``extra`` (e, r) are their standard deviations. A component that the motion lacks is zero.
    """
    return np.nan_to_num(extra)[:, mode] * rng.standard_normal((len(extra), *mode.shape))


def _draw_modes(p: Array, rng: Streams) -> Index:
    """Draw the number of a motion, 0 to r - 1, for each particle (M, N), given p (r, M, N)."""
    # The number is that of the sums p_0, p_0 + p_1, ... that a uniform draw reaches.
    u = rng.random(p.shape[1:])
    edge = np.zeros(p.shape[1:])
    mode = np.zeros(p.shape[1:], dtype=np.intp)
    for row in p[:-1]:
        edge += row
        mode += u >= edge
    return mode


def _rows_of_motions(models: list[Model]) -> list[list[int]]:
    """Return the rows of a particle's state that each motion moves."""
    n = len(position_velocity_components(models[0].motion))
    names = _extra_names(models)
    rows = []
    for model in models:
        extra_rows = [n + names.index(name) for name in model.motion.components[n:]]
        rows.append(list(range(n)) + extra_rows)
    return rows


def _propagate(models: list[Model], x: Array, mode: Index, k: int, rng: Streams) -> Array:
    """Move states (n + e, M, N), each by its particle's motion.

    The n positions and velocities come first, then the e further components of all motions. Those that
    a particle's motion lacks stay as they are: `step` draws them anew when the particle leaves this
    motion.
    """
    moved = x.copy()
    for j, rows in enumerate(_rows_of_motions(models)):
        by_motion = models[j].motion.transition(x[rows], k).sample(rng)
        moved[rows] = np.where(mode == j, by_motion, moved[rows])
    return moved


def _spreads(models: list[Model], x: Array, mode: Index, w: Array) -> list[Spread]:
    """Return, for each motion, the share of the weight and the covariance of its particles.

    ``x`` (n, M, N) are the particles, ``mode`` (M, N) their motions and ``w`` (M, N) their weights.
    """
    spreads = []
    for j, rows in enumerate(_rows_of_motions(models)):
        # Weights of the particles of motion j, normalized unless all are zero.
        w_of_motion = np.where(mode == j, w, 0.0)
        share = total(w_of_motion)
        cloud = Particles(x[rows], w_of_motion / np.where(share > 0.0, share, 1.0)[:, None])
        # Which particles are the motion's members is set after resampling.
        spreads.append(Spread(members=None, share=share, cov=cloud.moments().cov))
    return spreads
