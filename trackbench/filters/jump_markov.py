"""Filters of several motions, between which the target jumps as a Markov chain does."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.random import Generator

from trackbench.core import particles, resampling
from trackbench.core.arrays import Array, Index
from trackbench.core.distributions import Distribution, draw_covering
from trackbench.core.kernel_smoothing import Kernel, jitter_modes
from trackbench.core.kernel_smoothing import Mode as Spread
from trackbench.core.particles import Particles
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError, NonNegative, Registered, Share
from trackbench.filters.base import OWN_MOTION, Filter, State
from trackbench.filters.particle_base import Cloud, ParticleFilter
from trackbench.models.base import Model, Motion, SampledMotion, Scene, extra_std
from trackbench.models.motions.irregular import sample_alike
from trackbench.registry import register

_ROUNDING = 1e-9  # of a row's sum


@dataclass(frozen=True, kw_only=True)
class JumpMarkov(Filter[State]):
    """Keys shared by the filters of several motions."""

    motions: Annotated[tuple[Motion, ...], Registered("motions")]
    """motions of the models, such as [{kind: cv, q: 0.01}, {kind: ca, q: 0.001}]"""
    transition: tuple[tuple[Share, ...], ...]
    """probability of going from model i (row) to model j in one step, however long; rows sum to 1"""
    initial: tuple[Share, ...] | None = None
    """probability of each model at the start; default: equal"""
    requires: ClassVar[tuple[str, ...]] = ("motion.T|intervals",)
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "believes in motions of its own"}

    def __post_init__(self) -> None:
        r = len(self.motions)
        if r < 2:
            raise InvalidKeyError("give at least two motions", "motions")
        if len(self.transition) != r:
            what = f"{len(self.transition)} rows for {r} motions"
            raise InvalidKeyError(what, "transition")
        for i, row in enumerate(self.transition):
            if len(row) != r:
                raise InvalidKeyError(f"{len(row)} entries for {r} motions", "transition", i)
            if abs(sum(row) - 1.0) > _ROUNDING:
                raise InvalidKeyError(f"the row sums to {sum(row):g}, not to 1", "transition", i)
        if self.initial is not None and len(self.initial) != r:
            raise InvalidKeyError(f"{len(self.initial)} entries for {r} motions", "initial")
        if self.initial is not None and abs(sum(self.initial) - 1.0) > _ROUNDING:
            raise InvalidKeyError(f"sums to {sum(self.initial):g}, not to 1", "initial")

    @property
    def at_first(self) -> Array:
        """Probabilities (r,) of the models at the start."""
        r = len(self.motions)
        return np.full(r, 1.0 / r) if self.initial is None else np.array(self.initial)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Motions of something else than the target."""
        own = shared_components(scenario.model.motion)
        found = super().conflicts(scenario)
        for i, (motion, _) in enumerate(self.models(scenario.model)):
            if shared_components(motion) != own:
                of = ", ".join(motion.components) or "positions and velocities"
                found[f"motions.{i}"] = f"a motion of {of} for {', '.join(own)}"
        return found

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Its motions are `motions`."""
        return super().idle_keys(scenario) | OWN_MOTION

    def models(self, model: Model) -> list[Model]:
        """A model per motion, along the axes and over the interval of the one that is assumed."""
        return [Model(sample_alike(motion, model.motion), model.sensor) for motion in self.motions]


def own_components(motion: SampledMotion) -> int:
    """How many components of a motion are positions and velocities of the target."""
    return len(motion.components) - len(extra_std(motion))


def shared_components(motion: SampledMotion) -> tuple[str, ...]:
    """Components that a motion shares with all others of its target."""
    return motion.components[: own_components(motion)]


@register("filters", "mmpf")
@dataclass(frozen=True, kw_only=True)
class MultipleModelPF(JumpMarkov[Cloud], ParticleFilter):
    """Multiple-model particle filter: every particle carries the motion that it follows.

    McGinnity & Irwin 2000; Ristic, Arulampalam & Gordon 2004, section 3.5.5, with the regularisation of
    section 3.5.3 for the particles of each motion by themselves. Motions may have components of their
    own: a particle that enters one draws them as they are before anything is known.
    """

    kernel: Kernel = "epanechnikov"
    """regularisation kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth; 0 is plain resampling"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """Draws from the prior, each with a motion."""
        x, log_w = draw_covering(prior, rng, self._size(0))
        runs, N = x.shape[1:]
        extra = _extra(self.models(model))
        mode = _drawn(np.tile(self.at_first[:, None, None], (1, runs, N)), rng)
        own = Particles(x[: own_components(model.motion)], particles.normalize(log_w).w)
        cloud = Particles(np.concatenate([own.x, _entering(extra, mode, rng)]), own.w)
        dead = np.zeros(runs, dtype=np.bool_)
        return Cloud(cloud, own, own.moments(), dead, 0, log_w=log_w, mode=mode)

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Draw each particle's motion, then its state from that motion; weigh, resample."""
        assert state.mode is not None
        models, n = self.models(model), own_components(model.motion)
        extra, before = _extra(models), state.mode
        mode = _drawn(np.array(self.transition).T[:, before], rng)
        x, new = state.particles.x.copy(), np.isnan(extra[:, before])
        x[n:] = np.where(new, _entering(extra, mode, rng), x[n:])
        x = _moved(models, x, mode, k, rng)
        w, dead, told = self._weighed(model, state, z, x[:n], k)
        weighted, size = Particles(x[:n], w), self._size(state.age + 1)
        index = resampling.ancestors(w, rng, self.resampling, size)
        spreads = _spreads(models, x, mode, w)
        x, mode = resampling.select(x, index), resampling.select(mode, index)
        x = self._jittered(models, x, mode, spreads, rng)
        kept = Particles(x, particles.equal_weights(*index.shape))
        estimate, age = weighted.moments(), state.age + 1
        return Cloud(kept, weighted, estimate, dead, age, w=w, mode=mode, evidence=told)

    def _jittered(
        self, models: list[Model], x: Array, mode: Index, spreads: list[Spread], rng: Streams
    ) -> Array:
        """States (n + e, M, N), those of each motion moved by a kernel of their own spread."""
        for j, (of, spread) in enumerate(zip(_places(models), spreads, strict=True)):
            here = [spread._replace(members=mode == j)]
            x[of] = jitter_modes(x[of], here, self.kernel, rng, self.bandwidth_scale)
        return x

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return super().diagnostic_names | {"mode"}

    def diagnostics(self, state: Cloud) -> dict[str, Array]:
        """The same, and ``mode``: the share of particles that follow another motion than the first."""
        assert state.mode is not None
        others = (state.mode != 0).sum(axis=-1) / state.mode.shape[-1]
        return super().diagnostics(state) | {"mode": others}


def _names(models: list[Model]) -> list[str]:
    """Components that only some motions have, each once."""
    own = (m.motion.components[own_components(m.motion) :] for m in models)
    return list(dict.fromkeys(name for names in own for name in names))


def _extra(models: list[Model]) -> Array:
    """Deviations (e, r), before anything is known, of those components; NaN where a motion lacks one."""
    rows = [
        dict(zip(reversed(m.motion.components), reversed(extra_std(m.motion)), strict=False))
        for m in models
    ]
    found = [[row.get(name, np.nan) for row in rows] for name in _names(models)]
    return np.array(found).reshape(-1, len(models))


def _entering(extra: Array, mode: Index, rng: Streams) -> Array:
    """Draws (e, M, N) of the components of each particle's motion; zero where it lacks one."""
    return np.nan_to_num(extra)[:, mode] * rng.standard_normal((len(extra), *mode.shape))


def _drawn(p: Array, rng: Streams) -> Index:
    """Numbers (M, N) drawn with probabilities p (r, M, N)."""
    u, edge = rng.random(p.shape[1:]), np.zeros(p.shape[1:])
    mode = np.zeros(p.shape[1:], dtype=np.intp)
    for row in p[:-1]:
        edge += row
        mode += u >= edge
    return mode


def _places(models: list[Model]) -> list[list[int]]:
    """Where in a particle's state the components of each motion stand."""
    n, names = own_components(models[0].motion), _names(models)
    return [
        [*range(n), *(n + names.index(name) for name in m.motion.components[n:])] for m in models
    ]


def _moved(models: list[Model], x: Array, mode: Index, k: int, rng: Streams) -> Array:
    """States (n + e, M, N), each moved by its particle's own motion."""
    out = x.copy()
    for j, (of, (motion, _)) in enumerate(zip(_places(models), models, strict=True)):
        out[of] = np.where(mode == j, motion.transition(x[of], k).sample(rng), out[of])
    return out


def _spreads(models: list[Model], x: Array, mode: Index, w: Array) -> list[Spread]:
    """Share of the weight and covariance of the particles that follow each motion."""
    spreads = []
    for j, of in enumerate(_places(models)):
        of_mode = np.where(mode == j, w, 0.0)
        share = total(of_mode)
        cloud = Particles(x[of], of_mode / np.where(share > 0.0, share, 1.0)[:, None])
        spreads.append(Spread(None, share, cloud.moments().cov))
    return spreads
