"""Exact posterior of a state of two components, one run after the other: the kind `grid` uses it."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from trackbench.core import linalg, plane_quadrature
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.plane_quadrature import Map, Plane, UnresolvedError
from trackbench.filters.base import WrongReturnError
from trackbench.models.base import Model, SampledMotion, central_differences, log_likelihood

TOLERANCE = 1e-6  # of means in standard deviations, and of covariances likewise, by half the nodes
State = Plane | Array


class Planes(NamedTuple):
    """Posterior of each run, and the posterior by half as many nodes that it is checked against."""

    posteriors: tuple[State, ...]
    checks: tuple[State, ...]


def start(prior: Distribution, nodes: int) -> Planes:
    """Return the prior of each run, on nodes or as a known state.

    Raises WrongReturnError if the prior has no density and is no known state either.
    """
    runs = range(prior.mean.shape[1])
    if not np.any(prior.cov):
        known = tuple(prior.mean[:, run] for run in runs)
        return Planes(known, known)
    if linalg.is_singular(_of_run(prior.cov, 0)):
        raise WrongReturnError("init", "a part of the prior has no density: raise its `sigma`")
    each = [Gaussian(prior.mean[:, run], _of_run(prior.cov, run)) for run in runs]
    return Planes(
        *(tuple(plane_quadrature.over_prior(p, n) for p in each) for n in (nodes, nodes // 2))
    )


def step(model: Model, old: Planes, z: Array, k: int, nodes: int) -> Planes:
    """Return the posterior of each run after the measurement z (n_z, M) of step k.

    Raises WrongReturnError if half as many nodes give other moments.
    """
    motion = _map(model.motion, k)
    both: tuple[list[State], list[State]] = ([], [])
    for run, pair in enumerate(zip(*old, strict=True)):

        def likelihood(x: Array, z: Array = z[:, run : run + 1]) -> Array:
            return log_likelihood(model.sensor, z, x[:, None], k)[0]

        try:
            for new, prior, n in zip(both, pair, (nodes, nodes // 2), strict=True):
                new.append(plane_quadrature.condition(prior, motion, likelihood, n))
        except UnresolvedError as error:
            raise _unresolved(k, nodes, f": {error}") from None
    new_planes = Planes(tuple(both[0]), tuple(both[1]))
    if not _difference(new_planes) <= TOLERANCE:
        raise _unresolved(k, nodes, "")
    return new_planes


def moments(states: Iterable[State]) -> Gaussian:
    """Return the means (2, M) and covariances (2, 2, M)."""
    each = [s.moments() if isinstance(s, Plane) else Gaussian(s, np.zeros((2, 2))) for s in states]
    return Gaussian(
        np.stack([m.mean for m in each], axis=-1), np.stack([m.cov for m in each], axis=-1)
    )


def evidence(states: Iterable[State]) -> Array:
    """Return log p(z_k | z_1..k-1) (M,), NaN before the first measurement."""
    return np.array([s.evidence if isinstance(s, Plane) else np.nan for s in states])


def _map(motion: SampledMotion, k: int) -> Map:
    """Return the motion to step k as a map with additive noise."""

    def f(x: Array) -> Array:
        return motion.transition(x[:, None], k).mean[:, 0]

    Q = motion.transition(np.zeros((2, 1)), k).cov
    return Map(f, lambda x: central_differences(f, x), Q.reshape(2, 2))


def _of_run(cov: Array, run: int) -> Array:
    return cov if cov.ndim == 2 else cov[..., run]


def _difference(both: Planes) -> float:
    """Return the largest difference from the check, in standard deviations."""
    ours, check = moments(both.posteriors), moments(both.checks)
    sd = np.sqrt(linalg.diagonal(ours.cov))
    means = np.abs(check.mean - ours.mean) / sd
    covariances = np.abs(check.cov - ours.cov) / (sd[:, None] * sd)
    return float(max(means.max(), covariances.max()))


def _unresolved(k: int, nodes: int, why: str) -> WrongReturnError:
    what = f"grid does not resolve the posterior at step {k} with `nodes: {nodes}`{why}"
    return WrongReturnError("step", f"{what}; raise `nodes`, or narrow the start")
