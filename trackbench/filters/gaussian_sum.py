"""Gaussian sum filter: a bank of extended Kalman filters over a split of the prior."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import elementary, linalg, particle_weights
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array, Index, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.particle_weights import Mass
from trackbench.core.particles import Particles
from trackbench.core.polar_conversions import Polar, ccm
from trackbench.core.sums import dot, total
from trackbench.field_types import Count, NonNegative, Positive
from trackbench.filters.assumed_noise import MODEL_NOISE
from trackbench.filters.base import Filter
from trackbench.filters.ekf import extended_step
from trackbench.models.base import Model, angle_rows
from trackbench.models.sensors.noise import ScaledNoise
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.two_scan_prior import TwoPoint, two_point_difference
from trackbench.registry import register

_AT_ONCE = (
    2**16
)  # entries of the innovation covariances of a run's components that are updated at once
_NEGLIGIBLE = 1e-9  # weight below which a few azimuths do not bring a component back


class Mixture(NamedTuple):
    """Components: means (n, M, C), covariances (n, n, M, C) and weights (M, C) that sum to one.

    ``mass`` is the sum of the unnormalized weights of the last update; None before the first one.
    """

    mean: Array
    cov: Array
    w: Array
    mass: Mass | None = None


@register("filters", "gaussian-sum")
@dataclass(frozen=True, kw_only=True)
class GaussianSum(Filter[Mixture]):
    """Gaussian sum filter: a bank of extended Kalman filters, one per component of the split prior.

    Alspach & Sorenson 1972. With two scans of a radar their azimuths are split, hence azimuth and
    cross speed. Any other prior is split along both axes of the position. A component is so narrow
    that an accurate range is nearly linear over it. After each update the filter keeps the heaviest
    components of either sign of the cross speed, which the ranges leave ambiguous, and merges those
    near the heaviest one.
    """

    split: Annotated[int, Ge(3)] = 35
    """components along each of the two azimuths, or axes; the initial number is its square"""
    span: Positive = 3.5
    """half the width of the split, in standard deviations"""
    kept: Count = 150
    """largest number of components of either sign of the cross speed after an update"""
    merge_within: NonNegative = 0.1
    """squared Mahalanobis distance to the heaviest component below which another is merged with it"""
    requires: ClassVar[tuple[str, ...]] = ("state.planar", "motion.jacobian", "sensor.jacobian")
    contract_exemptions: ClassVar[dict[str, str]] = {
        "kalman": "a sum that is pruned after each update"
    }

    def __post_init__(self) -> None:
        if self._width >= 1.0:
            message = (
                f"split = {self.split} over +-{self.span} leaves components wider than the prior"
            )
            raise ValueError(f"{message}; raise `split`")

    @property
    def _width(self) -> float:
        """Standard deviation of a component, and its distance to the next one.

        The unit is the standard deviation of the prior that is split.
        """
        return 2.0 * self.span / (self.split - 1)

    @property
    def particle_count(self) -> int:
        """Initial number of components."""
        return self.split**2

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Mixture:
        """Split the prior: a component per pair of nodes, together with about the prior's moments."""
        width = self._width
        nodes = width * (np.arange(self.split) - 0.5 * (self.split - 1))
        # In units of the prior's standard deviation the nodes have the variance 1 - width^2, and each
        # component has width^2: together that of the prior, but for the nodes beyond `span`.
        log_w = -0.5 * np.square(nodes) / (1.0 - width * width)
        # A component for each pair of nodes; its weight is the product of both.
        first_nodes, second_nodes = np.meshgrid(nodes, nodes, indexing="ij")
        first_nodes = first_nodes.ravel()
        second_nodes = second_nodes.ravel()
        if isinstance(prior, TwoPoint):
            # The scans of a start have no fault: take the sensor from the one whose noise faults scale.
            sensor = model.sensor
            if isinstance(sensor, ScaledNoise):
                sensor = sensor.sensor
            radar = cast(RangeAzimuth, sensor)
            start = _split_azimuths(radar, prior, first_nodes, second_nodes, width)
        else:
            start = _split_positions(prior, first_nodes, second_nodes, width)
        runs = start.mean.shape[1]
        log_w_of_pairs = (log_w[:, None] + log_w).ravel()
        w = particle_weights.normalize(np.tile(log_w_of_pairs, (runs, 1))).w
        return Mixture(mean=start.mean, cov=start.cov, w=w)

    def step(self, model: Model, state: Mixture, z: Array, k: int, rng: Generator) -> Mixture:
        """Update an EKF per component, weigh by the innovations, prune and merge.

        A mixture has means (n, M, C), covariances (n, n, M, C) and weights (M, C) of C components.
        """
        # Step 1: update an EKF per component, as many at a time as bound the memory of many sensors.
        size = max(1, _AT_ONCE // len(model.sensor.components) ** 2)
        means = []
        covs = []
        log_likelihoods = []
        for first in range(0, state.w.shape[-1], size):
            components = slice(first, first + size)
            before = Gaussian(state.mean[..., components], state.cov[..., components])
            after, innovation = extended_step(model, before, z, k, assumed=MODEL_NOISE)
            means.append(after.mean)
            covs.append(after.cov)
            log_likelihoods.append(innovation.log_likelihood)
        mean = np.concatenate(means, axis=-1)
        cov = np.concatenate(covs, axis=-1)
        log_p = np.concatenate(log_likelihoods, axis=-1)
        # Step 2: multiply each weight by the likelihood of the component's innovation.
        # A missing measurement, with a log-likelihood of NaN, leaves the weights as they are.
        log_w = elementary.log(state.w) + np.nan_to_num(log_p, neginf=-np.inf)
        weights = particle_weights.normalize(log_w)
        # Angles that differ by whole turns are brought together.
        together = bring_together(Particles(mean, weights.w), angle_rows(model.motion))
        # Step 3: prune and merge, which give some components the weight zero; `_compact` then drops
        # those that have it in all runs. The sum of the weights before the pruning, `mass`, is the
        # likelihood of z, for `log_likelihood`.
        w = _prune(together.x, weights.w, self.kept)
        heaviest = _compact(Mixture(mean=together.x, cov=cov, w=w))
        return _compact(_merge(heaviest, self.merge_within))._replace(mass=weights.mass)

    def estimate(self, state: Mixture) -> Gaussian:
        """Return mean and covariance of the mixture."""
        return _moments(state, state.w)

    def log_likelihood(self, state: Mixture) -> Array:
        """Return the logarithm (M,) of the weighted sum of the components' likelihoods."""
        if state.mass is None:
            return np.full(len(state.w), np.nan)
        return state.mass.log


def _split_azimuths(
    sensor: RangeAzimuth,
    prior: TwoPoint,
    first_nodes: Array,
    second_nodes: Array,
    width: float,
) -> Gaussian:
    """Return C components, each the two-point difference of both scans with shifted azimuths.

    The nodes (C,) are the shifts of the first and second azimuth, and ``width`` is the standard
    deviation of the azimuths within a component. Their unit is the standard deviation of a measured
    azimuth. The means are (4, M, C). The scans ``prior.first`` and ``prior.second`` (2, M) are ranges
    and azimuths. They are converted to positions by the conventional conversion (ccm), of first order.
    ``prior.q`` is the density of the white acceleration between the scans.
    """
    s = sensor.sigma_azimuth
    shape = (prior.first.shape[1], len(first_nodes))
    range_variance = np.square(sensor.sigma_range)
    azimuth_variance = np.square(width * s)
    # Arrays (M C,): the components of each run in turn.
    r1, a1 = _shifted(prior.first, s * first_nodes)
    r2, a2 = _shifted(prior.second, s * second_nodes)
    first = ccm(Polar(r1, a1, range_variance, azimuth_variance))
    second = ccm(Polar(r2, a2, range_variance, azimuth_variance))
    start = two_point_difference(first, second, prior.T, prior.q)
    return Gaussian(start.mean.reshape(4, *shape), start.cov.reshape(4, 4, *shape))


def _split_positions(
    prior: Distribution, first_nodes: Array, second_nodes: Array, width: float
) -> Gaussian:
    """Return C components that split the prior along the first two columns of its factor.

    The factor L of the covariance has the positions first. The nodes (C,) are factors on its columns in
    the components' means, and ``width`` is the factor on these columns in their covariance. The means
    are (n, M, C).
    """
    n = len(prior.mean)
    # Factor the covariance with both positions first: P = L L'.
    order = [0, 2, 1, *range(3, n)]
    L = with_trailing(linalg.root(prior.cov[np.ix_(order, order)]), 1, leading=2)
    L = L[np.ix_(order, range(n))]  # the order is its own inverse
    # Component means lie along the first two columns of L.
    nodes = L[:, 0, :, None] * first_nodes + L[:, 1, :, None] * second_nodes
    # Each component is narrower by `width` along these two columns.
    narrow = L * np.array([width, width, *np.ones(n - 2)])[:, None]
    cov = linalg.matmul(narrow, linalg.transpose(narrow))[..., None]
    mean = prior.mean[..., None] + nodes
    return Gaussian(mean, np.broadcast_to(cov, (n, n, *mean.shape[1:])))


def _shifted(scan: Array, azimuth: Array) -> Array:
    """Return the scan (2, M) with each of C angles added to its azimuth, as one array (2, M C)."""
    r, a = scan
    return np.stack([np.repeat(r, len(azimuth)), (a[:, None] + azimuth).ravel()])


def _prune(mean: Array, w: Array, number: int) -> Array:
    """Return the weights (M, C), but zero for all except the heaviest of either cross speed's sign.

    ``number`` components of each sign stay: ranges alone do not tell the sign. ``mean`` (n, M, C) are
    the means of the components.
    """
    px, vx, py, vy = mean[:4]
    out = np.zeros_like(w)
    # The sign of px vy - py vx is that of the cross speed.
    for side in (px * vy > py * vx, px * vy <= py * vx):
        # The NaN weights of a run that has diverged stay.
        of_sign = np.where(side & ~(w < _NEGLIGIBLE), w, 0.0)
        # Remove all but the `number` heaviest components of this sign.
        lightest: Index = np.argsort(-of_sign, axis=-1, kind="stable")[:, number:]
        np.put_along_axis(of_sign, lightest, 0.0, axis=-1)
        out += of_sign
    return out


def _compact(mixture: Mixture) -> Mixture:
    """Return the mixture without components of weight zero, heaviest first, with normalized weights.

    Means are (n, M, C), covariances (n, n, M, C) and weights (M, C).
    """
    # The run with the most weighted components sets their number: one at least, as the NaN weights of a
    # diverged run are not positive.
    number = max(1, int((mixture.w > 0.0).sum(axis=-1).max()))
    index: Index = np.argsort(-mixture.w, axis=-1, kind="stable")[:, :number]
    w = np.take_along_axis(mixture.w, index, axis=-1)
    return Mixture(
        np.take_along_axis(mixture.mean, index[None], axis=-1),
        np.take_along_axis(mixture.cov, index[None, None], axis=-1),
        w / total(w)[:, None],
    )


def _merge(mixture: Mixture, within: float) -> Mixture:
    """Replace the heaviest component and its near neighbors by one component with their moments.

    Neighbors have a squared Mahalanobis distance below ``within`` to the heaviest component. The mixture
    has means (n, M, C), covariances (n, n, M, C) and weights (M, C) of C components.
    """
    # Step 1: find the heaviest component and its neighbors by Mahalanobis distance.
    top = mixture.w.argmax(axis=-1)[:, None]  # (M, 1)
    center = np.take_along_axis(mixture.mean, top[None], axis=-1)
    near = linalg.mahalanobis(mixture.mean - center, mixture.cov) < within
    near |= np.arange(mixture.w.shape[1]) == top
    # Step 2: take the moments of the neighbors.
    near_w = np.where(near, mixture.w, 0.0)
    share = total(near_w)[:, None]
    merged = _moments(mixture, near_w / share)
    # Step 3: put these moments in place of the heaviest; its neighbors get weight zero.
    out = Mixture(mixture.mean.copy(), mixture.cov.copy(), np.where(near, 0.0, mixture.w))
    np.put_along_axis(out.mean, top[None], merged.mean[..., None], axis=-1)
    np.put_along_axis(out.cov, top[None, None], merged.cov[..., None], axis=-1)
    np.put_along_axis(out.w, top, share, axis=-1)
    return out


def _moments(mixture: Mixture, w: Array) -> Gaussian:
    """Return mean and covariance of the mixture with weights w (M, C)."""
    between = Particles(mixture.mean, w).moments()
    return Gaussian(between.mean, between.cov + dot(mixture.cov, w))
