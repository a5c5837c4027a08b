"""C. Zhang & L. Li, sections II and III: APF, UPF and HDEPF on the scalar model of eqs. 12-13.

Readings as experiments/README.md lists them: the sine at the new index, the gamma's 2 a rate, x_1 = 1
known; `demo` is van der Merwe's public demo.
"""

from bisect import bisect_left
from itertools import accumulate
from math import exp, floor, inf, log, pi, prod, sin, sqrt

R, SHAPE, RATE = 1e-5, 3, 2
MATCHED, DEMO = (SHAPE / RATE**2, R, SHAPE / RATE), (1.5, 0.1, 0.0)  # a UKF's Q, R, noise mean


def f(x, k):
    return 1 + sin(0.04 * pi * k) + 0.5 * x


def h(x, k):
    return 0.2 * x**2 if k <= 30 else 0.5 * x - 2


def log_normal(e, variance):
    return -(e**2) / variance / 2 - log(2 * pi * variance) / 2


def log_likelihood(z, x, k, floored=False, variance=R):
    """log p(z_k | x_k), or what is left of it in a program that adds 1e-99."""
    found = log_normal(z - h(x, k), variance)
    return log(exp(found) + 1e-99) if floored else found


def log_prior(x, origin, k):
    """Gamma(3, rate 2), 2^3 / 2! v^2 e^(-2 v)."""
    v = x - f(origin, k)
    return log(RATE**SHAPE / 2 * v**2) - RATE * v if v > 0 else -inf


def shares(logs):
    """Exponentials over their sum; not a number if all are zero."""
    top = max(logs)
    values = [exp(value - top) for value in logs]
    return [value / sum(values) for value in values]


def weights(logs):
    """Normalized; equal if all are zero."""
    return shares(logs if max(logs) > -inf else [0.0] * len(logs))


def weighted(w, *factors):
    """The weighted mean of a product."""
    return sum(prod(terms) for terms in zip(w, *factors, strict=True))


def moments(x, w):
    mean = weighted(w, x)
    return [mean], [[weighted(w, [(a - mean) ** 2 for a in x])]]


def resampled(scheme, w, draws, size):
    """Ancestors in order: a comb with one uniform offset; or whole parts of N w, the rest drawn."""
    certain, u = [], draws.take("random")
    teeth = [(j + u[0]) / size for j in range(size)]
    if scheme == "residual":
        certain = [i for i, value in enumerate(w) for _ in range(floor(size * value + 1e-12))]
        teeth = u[: size - len(certain)]
        w = [max(size * value - certain.count(i), 0.0) for i, value in enumerate(w)]
        w = [value / sum(w) for value in w] if teeth else w
    edges = list(accumulate(w))
    return sorted(certain + [min(bisect_left(edges, t), len(w) - 1) for t in teeth])


def apf(measurements, draws, N, R, stages=1):
    """Auxiliary particle filter judged at the mean, with weights kept or resampled by (1999)."""
    x, logs = [1.0] * N, [0.0] * N
    for k, z in enumerate(measurements, 2):
        first = [log_likelihood(z, f(a, k) + SHAPE / RATE, k, variance=R) for a in x]
        chosen = weights([a + b for a, b in zip(first, logs, strict=True)])
        parents = resampled("systematic", chosen, draws, N)
        (noise,) = draws.take("standard_gamma")
        x = [f(x[i], k) + g / RATE for i, g in zip(parents, noise, strict=True)]
        second = [log_likelihood(z, a, k, variance=R) for a in x]
        logs = [a - first[i] for a, i in zip(second, parents, strict=True)]
        w = weights(logs)
        yield moments(x, w)
        if stages == 2:
            x, logs = [x[i] for i in resampled("systematic", w, draws, N)], [0.0] * N


def unscented(x, P, z, k, assumed):
    """UKF of the state and both noises, alpha = 1, beta = 0, kappa = 2: lambda = 2."""
    Q_v, R_n, noise_mean = assumed
    points = [(x, 0.0, 0.0)]
    for i, variance in enumerate((P, Q_v, R_n)):
        for e in (sqrt((3 + 2) * variance), -sqrt((3 + 2) * variance)):
            points.append((x + e * (i == 0), e * (i == 1), e * (i == 2)))
    W = [2 / 5] + [1 / 10] * 6
    X = [f(a, k) + noise_mean + v for a, v, _ in points]
    Z = [h(a, k) + n for a, (_, _, n) in zip(X, points, strict=True)]
    x_bar, z_bar = weighted(W, X), weighted(W, Z)
    dx, dz = [a - x_bar for a in X], [b - z_bar for b in Z]
    P_xz, P_zz = weighted(W, dx, dz), weighted(W, dz, dz)
    return x_bar + P_xz / P_zz * (z - z_bar), weighted(W, dx, dx) - P_xz**2 / P_zz


def proposed(x, P, z, k, assumed, draws):
    """Each particle's Gaussian importance density, and a draw from it (section III.B, step 1)."""
    mean, P = zip(*(unscented(a, b, z, k, assumed) for a, b in zip(x, P, strict=True)), strict=True)
    (noise,) = draws.take("standard_normal")
    return mean, P, [m + sqrt(b) * e for m, b, e in zip(mean, P, noise, strict=True)]


def upf(measurements, draws, N, demo):
    """Unscented particle filter (van der Merwe et al. 2000); the demo's prior is of the increment."""
    x, P = [1.0] * N, [0.75 if demo else 0.0] * N
    for k, z in enumerate(measurements, 2):
        mean, P, drawn = proposed(x, P, z, k, DEMO if demo else MATCHED, draws)
        logs = []  # eq. 7
        for new, old, m, b in zip(drawn, x, mean, P, strict=True):
            v = new - old
            prior = 2 * log(abs(v)) - 2 * v if demo else log_prior(new, old, k)
            logs.append(log_likelihood(z, new, k, demo) + prior - log_normal(new - m, b))
        w = weights(logs)
        chosen = resampled("residual" if demo else "systematic", w, draws, N)
        x, P = [drawn[i] for i in chosen], [P[i] for i in chosen]
        yield moments(x, [1 / N] * N) if demo else moments(drawn, w)


def evolved(x, log_fitness, draws, published_level):
    """Hybrid DE (section III.A) with F = .9, CR = .6, G = 20, T0 = 100, rho = .9; and log-fitness."""
    N, lowest, highest, temperature = len(x), min(x), max(x), 100.0
    fit = [log_fitness(i, a) for i, a in enumerate(x)]
    best = list(zip(fit, x, strict=True))
    for _ in range(20):
        (u1, u2), (crossing,) = draws.take("random"), draws.take("random")
        trial = []
        for i in range(N):
            others = [(i + step) % N for step in range(1, N)]
            r1 = others.pop(int(u1[i] * (N - 1)))
            r2 = others[int(u2[i] * (N - 2))]
            v = x[i] + 0.9 * (x[r1] - x[r2]) if crossing[i] <= 0.6 else x[i]  # eqs. 10-11
            trial.append(min(max(v, lowest), highest) if published_level else v)
        new = [log_fitness(i, a) for i, a in enumerate(trial)]
        f_x, f_v = (shares(a) if published_level else a for a in (fit, new))
        for i, loss in enumerate(draws.take("standard_gamma")):
            gain = f_v[i] - f_x[i]
            if gain > 0 or exp(-loss) < exp(gain / temperature):  # exp(-loss) is uniform
                x[i], fit[i] = trial[i], new[i]
            if fit[i] > best[i][0]:
                best[i] = fit[i], x[i]
        temperature *= 0.9
    return (x, fit) if published_level else ([a for _, a in best], [a for a, _ in best])


def hdepf(measurements, draws, N, published_level, uniform=False):
    """HDEPF (section III.B): the default reading, the one nearest to the print, eq. 9's population."""
    x, P = [1.0] * N, [0.75 if published_level else 0.0] * N
    for k, z in enumerate(measurements, 2):
        origin = x
        mean, P, drawn = proposed(x, P, z, k, DEMO if published_level else MATCHED, draws)

        def log_fitness(i, a, z=z, k=k, origin=origin, mean=mean, P=P):
            target = log_likelihood(z, a, k, published_level) + log_prior(a, origin[i], k)
            return target - log_normal(a - mean[i], P[i]) if published_level else target

        if uniform:
            lowest, highest, (u,) = min(drawn), max(drawn), draws.take("random")
            drawn = [lowest + share * (highest - lowest) for share in u]
        x, logs = evolved(drawn, log_fitness, draws, published_level)
        yield moments(x, weights(logs))
