"""Where the truth is in a Gaussian, a cloud and a density, against sums by hand and quadrature."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import digamma
from scipy.stats import chi2, norm

from trackbench.core import grid_quadrature
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.linalg import distance
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import LinePosterior, NormalPosterior, ParticlePosterior
from trackbench.filters.grid_support import nodes_between

RNG = np.random.default_rng(7)


def normal(shared: bool = False) -> tuple[Gaussian, Array]:
    """Two components in five runs, and truths."""
    A = RNG.normal(size=(2, 2, 5))
    cov = np.einsum("ijm,kjm->ikm", A, A) + np.eye(2)[..., None]
    return Gaussian(RNG.normal(size=(2, 5)), cov[..., 0] if shared else cov), RNG.normal(
        size=(2, 5)
    )


@pytest.mark.parametrize("shared", [False, True])
def test_of_a_gaussian(shared: bool) -> None:
    found, x = normal(shared)
    cov = np.broadcast_to(found.cov[..., None], (2, 2, 5)) if shared else found.cov
    posterior = NormalPosterior(found)
    sd = np.sqrt(np.stack([cov[0, 0], cov[1, 1]]))
    np.testing.assert_allclose(posterior.below(x), norm.cdf(x, found.mean, sd), atol=1e-14)
    for m in range(5):
        e = x[:, m] - found.mean[:, m]
        nees = e @ np.linalg.solve(cov[..., m], e)
        assert posterior.within(x)[m] == pytest.approx(chi2.cdf(nees, 2), abs=1e-12)
        for i in range(2):
            law = norm(found.mean[i, m], sd[i, m])
            above = quad(lambda y, law=law: law.sf(y) ** 2, x[i, m], np.inf)[0]
            below = quad(lambda y, law=law: law.cdf(y) ** 2, -np.inf, x[i, m])[0]
            assert posterior.crps(x)[i, m] == pytest.approx(above + below, rel=1e-7)


def test_of_the_first_components_only() -> None:
    found, x = normal()
    cloud = ParticlePosterior(Particles(RNG.normal(size=(2, 5, 8)), np.full((5, 8), 0.125)))
    for posterior in (NormalPosterior(found), cloud):
        np.testing.assert_array_equal(posterior.below(x[:1]), posterior.below(x)[:1])
        np.testing.assert_array_equal(posterior.crps(x[:1]), posterior.crps(x)[:1])
        assert posterior.within(x[:1]).shape == (5,)


def test_of_a_weighted_cloud_by_hand() -> None:
    x, w = RNG.normal(size=(2, 3, 6)), RNG.random((3, 6))
    x[:, :, 5] = x[:, :, 2]  # resampled ones are equal
    w /= w.sum(axis=1, keepdims=True)
    truth = RNG.normal(size=(2, 3))
    truth[0, 0] = x[0, 0, 2]
    posterior = ParticlePosterior(Particles(x, w))
    below, within, crps = posterior.below(truth), posterior.within(truth), posterior.crps(truth)
    excess = posterior.log_excess(truth)
    for m in range(3):
        for i in range(2):
            points, y = x[i, m], truth[i, m]
            weight = w[m][points < y].sum() + 0.5 * w[m][points == y].sum()
            spread = (w[m] * w[m][:, None] * np.abs(points - points[:, None])).sum()
            score = (w[m] * np.abs(points - y)).sum() - 0.5 * spread
            assert below[i, m] == pytest.approx(weight, abs=1e-14)
            assert crps[i, m] == pytest.approx(score, rel=1e-12)
        pool, weights = np.column_stack([x[:, m], truth[:, m]]), np.append(w[m] * 6 / 7, 1 / 7)
        *each, own = (from_others(pool, weights, i) for i in range(7))
        assert within[m] == pytest.approx(w[m][np.array(each) < own].sum(), abs=1e-14)
        assert excess[m] == pytest.approx(np.log(own) - w[m] @ np.log(each), rel=1e-10)


def from_others(pool: Array, weights: Array, i: int) -> float:
    """Squared Mahalanobis distance of a column by the moments of all others."""
    x, w = np.delete(pool, i, axis=1), np.delete(weights, i)
    e = pool[:, i] - np.average(x, axis=1, weights=w)
    return float(e @ np.linalg.solve(np.cov(x, aweights=w, ddof=0), e))


def test_ranks_of_one_among_equals_are_uniform() -> None:
    """A truth that is one more draw has each of the N + 1 ranks equally often, one by one."""
    draws = RNG.normal(size=8)
    ranks = []
    for i in range(8):
        others = np.delete(draws, i)[None, None]
        cloud = ParticlePosterior(Particles(others, np.full((1, 7), 1 / 7)))
        ranks.append(float(cloud.uniform(cloud.below(draws[i : i + 1, None]))[0, 0]))
    ranks.sort()
    np.testing.assert_allclose(ranks, (np.arange(8) + 0.5) / 8)


def with_each_left_out(draws: Array) -> Iterator[tuple[ParticlePosterior, Array]]:
    """Each of the draws (n, N + 1) as the truth, and the others as equal particles."""
    N = draws.shape[1] - 1
    for i in range(N + 1):
        others = np.delete(draws, i, axis=1)[:, None]
        yield ParticlePosterior(Particles(others, np.full((1, N), 1 / N))), draws[:, [i]]


@pytest.mark.parametrize(("n", "N"), [(1, 4), (1, 19), (4, 6), (4, 19)])
def test_regions_of_equals_are_uniform(n: int, N: int) -> None:
    """So is the rank by the distance from all others, and the log NEES has no excess in the mean."""
    draws = np.exp(RNG.normal(size=(n, N + 1)))
    found = [(c.within(x), c.log_excess(x)) for c, x in with_each_left_out(draws)]
    within, excess = np.array(found)[..., 0].T
    np.testing.assert_allclose(np.sort(within), np.arange(N + 1) / N, atol=1e-12)
    assert excess.mean() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("n", "N"), [(1, 10), (2, 30), (4, 10), (4, 99)])
def test_the_log_of_the_nees_of_equals_is_hotellings(n: int, N: int) -> None:
    """log((N + 1) chi2(n) / chi2(N - n)), by draws from a Gaussian; the regions of 90 % hold as many."""
    runs = 3000
    cloud = ParticlePosterior(Particles(RNG.normal(size=(n, runs, N)), np.full((runs, N), 1 / N)))
    truth = RNG.normal(size=(n, runs))
    off = truth - cloud.particles.mean
    nees = np.log(distance(off, cloud.particles.moments().cov))
    expected = digamma(n / 2) + np.log(N + 1) - digamma((N - n) / 2)
    taken = nees - cloud.log_excess(truth)
    for values in (nees, taken):
        assert abs(values.mean() - expected) < 4 * values.std() / np.sqrt(runs)
    if N > 50:  # with few particles its mean has a heavy tail
        ratio = np.exp(nees) / n
        perfect = (N + 1) / (N - n - 2)
        assert abs(ratio.mean() - perfect) < 4 * ratio.std() / np.sqrt(runs)
    share = (np.floor(0.9 * N) + 1) / (N + 1)
    held = (cloud.within(truth) <= 0.9 + 1e-9).mean()
    assert abs(held - share) < 4 * np.sqrt(share * (1 - share) / runs)


def test_regions_by_weight_hold_their_share_as_the_effective_sample_size_grows() -> None:
    """Particles from a prior, weighted by a likelihood: the truth is a draw from the posterior."""
    runs, N = 2000, 400
    prior, truth = RNG.normal(size=(3, runs, N)), RNG.normal(size=(3, runs))
    off = prior[0] - (truth[0] + 0.5 * RNG.normal(size=runs))[:, None]
    w = np.exp(-2.0 * off**2)
    cloud = ParticlePosterior(Particles(prior, w / w.sum(axis=1, keepdims=True)))
    held, excess = (cloud.within(truth) <= 0.9).mean(), cloud.log_excess(truth)
    assert abs(held - 0.9) < 4 * np.sqrt(0.09 / runs) + 0.003  # some 170 effective ones
    assert abs(excess.mean()) < 4 * excess.std() / np.sqrt(runs)


@pytest.mark.parametrize("n", [1, 2])
def test_of_a_cloud_without_spread(n: int) -> None:
    """It is certain of one state: the truth is beyond all its regions, and the score is the error."""
    cloud = ParticlePosterior(Particles(np.ones((n, 1, 4)), np.full((1, 4), 0.25)))
    truth = np.full((n, 1), 3.0)
    certain = NormalPosterior(Gaussian(np.ones((n, 1)), np.zeros((n, n))))
    with np.errstate(all="ignore"):
        for posterior in (cloud, certain):
            assert posterior.within(truth) == 1.0
            assert posterior.log_excess(truth) in (np.inf, None)
            np.testing.assert_array_equal(posterior.below(truth), np.ones((n, 1)))
            np.testing.assert_array_equal(posterior.crps(truth), np.full((n, 1), 2.0))


def test_of_nothing_known() -> None:
    found, x = normal()
    cloud = ParticlePosterior(Particles(RNG.normal(size=(2, 5, 8)), np.full((5, 8), 0.125)))
    x[:, 1] = np.nan
    for posterior in (NormalPosterior(found), cloud):
        for values in (posterior.below(x), posterior.crps(x), posterior.within(x)[None]):
            assert np.isnan(values[:, 1]).all()
            assert np.isfinite(np.delete(values, 1, axis=1)).all()


@pytest.mark.parametrize("m", [0, 1])
def test_of_a_density(m: int) -> None:
    """Two pieces of a skew density, in one run with a gap between them and in one without."""
    support = np.array([-9.0, -9.0]), np.array([9.0, 9.0])
    low, high = (np.array([-3.0, -4.0]), np.array([-2.0, -1.0]))
    ends = (np.array([1.0, -1.0]), np.array([4.0, 5.0])), (low, high)

    def density(x: Array) -> Array:
        return np.exp(-0.5 * x) * (1.0 + np.sin(x) ** 2)

    panels = nodes_between(ends, support, 40)
    mass = sum(p._replace(density=density(p.x)).mass.sum(axis=0) for p in panels)
    posterior = LinePosterior(tuple(p._replace(density=density(p.x) / mass) for p in panels))
    x = np.array([[1.7, -0.3]])
    at = x[0, m]

    def integral(f: Callable[[float], float], end: float) -> float:
        cut = [(a[m], min(b[m], end)) for a, b in ends]
        return sum(quad(lambda y: f(y) * density(y), a, b)[0] for a, b in cut if a < b) / mass[m]

    def below(y: float) -> float:
        return integral(lambda _: 1.0, y)

    mean = integral(lambda y: y, 9.0)
    reach = abs(at - mean)
    assert posterior.below(x)[0, m] == pytest.approx(below(at), abs=1e-9)
    within = below(mean + reach) - below(mean - reach)
    assert posterior.within(x)[m] == pytest.approx(within, abs=1e-9)
    edges = sorted({-9.0, 9.0, at, *(float(e[m]) for pair in ends for e in pair)})
    square = [quad(lambda y: (below(y) - (y > at)) ** 2, *cell)[0] for cell in pairwise(edges)]
    assert posterior.crps(x)[0, m] == pytest.approx(sum(square), rel=1e-6)


@pytest.mark.parametrize("narrow", [1e-3, 1e-9, np.nan])
def test_a_score_on_panels_does_not_depend_on_the_other_runs(narrow: float) -> None:
    """A sum that counts its bits from the block's largest density changed the score of a wide run."""

    def posterior_of(sds: Array) -> LinePosterior:
        ends = ((-5.0 * sds, 5.0 * sds),)
        panels = nodes_between(ends, ends[0], 40)
        return LinePosterior(tuple(p._replace(density=norm.pdf(p.x / sds) / sds) for p in panels))

    alone = posterior_of(np.array([1.0]))
    beside = posterior_of(np.array([1.0, narrow]))
    truth = np.array([[0.4, 0.4]])
    for score in ("below", "within", "crps"):
        one = getattr(alone, score)(truth[:, :1])
        assert one[..., 0] == getattr(beside, score)(truth)[..., 0]


def test_of_one_known_value() -> None:
    posterior = LinePosterior(grid_quadrature.point_mass(np.array([[2.0, 2.0]])))
    x = np.array([[3.0, 0.5]])
    np.testing.assert_array_equal(posterior.below(x), [[1.0, 0.0]])
    np.testing.assert_array_equal(posterior.crps(x), [[1.0, 1.5]])


@pytest.mark.parametrize("value", [0.0, 10.0, 1e6, np.pi])
def test_a_component_that_is_known_exactly_is_no_direction(value: float) -> None:
    """Particles with one equal component are judged by the others: its rounding is no spread."""
    rng = np.random.default_rng(11)
    draws = rng.normal(size=(2, 400, 100))
    others, x = draws[..., :-1], draws[..., -1]
    known = np.full((1, 400, 99), value)
    w = rng.dirichlet(np.ones(99), 400)
    for weights in (np.full((400, 99), 1 / 99), w):
        alone = ParticlePosterior(Particles(others, weights))
        cloud = np.concatenate([others[:1], known, others[1:]])
        beside = ParticlePosterior(Particles(cloud, weights))
        at = np.stack([x[0], np.full(400, value), x[1]])
        np.testing.assert_allclose(beside.within(at), alone.within(x), atol=1e-9)
        np.testing.assert_allclose(beside.log_excess(at), alone.log_excess(x), rtol=1e-6)
    covered = (beside.within(at) < 0.5).mean()
    assert covered == pytest.approx(0.5, abs=0.1)
