"""Simulate how often verdicts are wrong, decided and repeated: the numbers of docs/statistics.md.

``python -m tests.simulated`` prints them in a few minutes. The tests take fewer repetitions.
"""

import json
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from trackbench.core.arrays import Array
from trackbench.execution.stop_when_precise import checkpoints, precise_after
from trackbench.statistics.claim_rules import claim_verdict
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.heavy_tails import tail_index
from trackbench.statistics.influential_runs import with_few_runs_changed, without_each_batch
from trackbench.statistics.sample_statistics import OVER_RUNS, influence, interval, mean
from trackbench.statistics.significance_rules import LEVEL
from trackbench.statistics.skewness_corrected_t_test import spread
from trackbench.statistics.student_t import deviations
from trackbench.statistics.verdict_rules import DECIDED, SURE, Verdict

TRUE_Z = (0, 4, 5, 6, 8, 10)
Rng = np.random.Generator


_ERRORS = json.loads((Path(__file__).parent / "reference" / "errors.json").read_text())
ERRORS: dict[str, Array] = {label: np.array(errors) for label, errors in _ERRORS.items()}
"""RMSE per run (M,) of UPF in merwe2000 and of HDEPF in hdepf, without lost runs."""

LAWS: dict[str, Callable[[Rng, tuple[int, ...]], Array]] = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "lognormal": lambda rng, shape: rng.lognormal(size=shape) - np.exp(0.5),
    "UPF": lambda rng, shape: _resampled(rng, ERRORS["UPF"], shape),
    "HDEPF": lambda rng, shape: _resampled(rng, ERRORS["HDEPF"], shape),
}
"""Runs of mean zero; those of filters are drawn from the shipped ones."""
DIFFERENCES = LAWS | {
    "lognormal, better": lambda rng, shape: -LAWS["lognormal"](rng, shape),
    "rare": lambda rng, shape: (
        rng.normal(size=shape) + np.where(rng.random(shape) < 0.02, 9.8, -0.2)
    ),
    "rare, better": lambda rng, shape: -DIFFERENCES["rare"](rng, shape),
}
"""Runs' errors of the worse filter, less the better one's, about their mean.

``lognormal``, ``rare``: the worse filter has the far runs; ``rare`` is one run of 50. ``better``: the
better filter has them.
"""
DEVIATION = {
    "normal": 1.0,
    "lognormal": np.sqrt((np.e - 1.0) * np.e),
    "rare": np.sqrt(1.0 + 0.02 * 0.98 * 100.0),
} | {name: errors.std() for name, errors in ERRORS.items()}
DEVIATION |= {f"{law}, better": DEVIATION[law] for law in ("lognormal", "rare")}


def _resampled(rng: Rng, x: Array, shape: tuple[int, ...]) -> Array:
    return (x - x.mean())[rng.integers(0, len(x), shape)]


def decisions(law: str, M: int, repetitions: int, rng: Rng) -> Iterator[tuple[int, float, float]]:
    """Generate the true z, and how often the old rule and the new one decide for a mean above zero.

    Of no true difference: how often for or against it.
    """
    size = max(1, 2_000_000 // M)
    each = [
        _found(law, M, min(size, repetitions - done), rng) for done in range(0, repetitions, size)
    ]
    for i, true in enumerate(TRUE_Z):
        old, new = (np.concatenate([found[i][rule] for found in each]) for rule in (0, 1))
        yield true, *(float(np.mean((w != 0) if true == 0 else w > 0)) for w in (old, new))


def _found(law: str, M: int, R: int, rng: Rng) -> list[tuple[Array, Array]]:
    """What either rule says (R,) at every true z: 1 above, -1 below, 0 inconclusive."""
    x = LAWS[law](rng, (4, R, M // 4))
    sums = np.stack([power.sum(axis=2) for power in (x, x * x, x * x * x, x * x * x * x)])
    words = []
    for true in TRUE_Z:
        target = -true * DEVIATION[law] / np.sqrt(M)
        whole = z_of(sums.sum(axis=1), M, target)
        batches = [z_of(sums[:, b], M // 4, target) for b in range(4)]
        rests = [z_of(sums.sum(axis=1) - sums[:, b], 3 * M // 4, target) for b in range(4)]
        words.append((_all_beyond([whole, *batches], SURE), _decided(whole, rests)))
    return words


FILTER_RUNS = (5, 8, 20, 50, 200, 800, 3200)
SHIFTS = (0.0, 0.5, 1.0, 2.0)
"""Mean differences of two filters, in standard deviations of a run."""


def filters_differ(
    law: str, M: int, repetitions: int, rng: Rng, tests: int = 1
) -> list[tuple[float, float]]:
    """Return how often the rule for filters decides for and against each mean of `SHIFTS`.

    ``tests``: comparisons of the family, of which this one is the first by Holm.
    """
    size = max(1, 1_000_000 // M)
    zs: list[list[Array]] = [[] for _ in SHIFTS]
    for done in range(0, repetitions, size):
        x = DIFFERENCES[law](rng, (min(size, repetitions - done), M))
        sums = np.stack([power.sum(axis=1) for power in (x, x * x, x * x * x, x * x * x * x)])
        for found, shift in zip(zs, SHIFTS, strict=True):
            found.append(z_of(sums, M, -shift * DEVIATION[law]))
    least = deviations(1.0 - LEVEL / tests)
    every = [np.concatenate(found) for found in zs]
    return [(float(np.mean(z > least)), float(np.mean(z < -least))) for z in every]


def _all_beyond(zs: list[Array], least: float) -> Array:
    return np.where(np.min(zs, axis=0) >= least, 1, np.where(np.max(zs, axis=0) <= -least, -1, 0))


def _decided(whole: Array, rests: list[Array]) -> Array:
    return np.where(np.abs(whole) >= DECIDED, _all_beyond([whole, *rests], SURE), 0)


def z_of(sums: Array, M: int, target: float) -> Array:
    """z (R,) of means from the sums (4, R) of the first four powers: Hall's and Satterthwaite's."""
    m, p2, p3, p4 = sums / M
    c2, c3 = p2 - m * m, p3 - 3 * m * p2 + 2 * m**3
    c4 = p4 - 4 * m * p3 + 6 * m * m * p2 - 3 * m**4
    T, a = (m - target) / np.sqrt(c2 / (M - 1)), c3 / c2**1.5 / np.sqrt(M)
    T = T + a * (1 / 6 + T * T / 3 + a * T**3 / 27)
    f = np.minimum(M - 1.0, 2 * M / (c4 / c2**2 - 1))
    return np.copysign(np.sqrt(f * np.log1p(T * T / f)) * (8 * f + 1) / (8 * f + 3), T)


def repeated(
    law: str, statistic: str, M: int, repetitions: int, rng: Rng
) -> tuple[float, float, float]:
    """Return how many decided verdicts are marked, how many others come out again, and have heavy tails.

    The claims' edges lie 3 to 300 standard errors off.
    """
    seeds = [_seed(statistic, LAWS[law](rng, (M,))) for _ in range(repetitions)]
    found = []
    for one, other in pairwise(seeds):
        assert one.influences is not None
        edge = one.value + rng.choice([-1, 1]) * 10 ** rng.uniform(0.5, 2.5) * one.stderr
        first, again = (_above(term, edge) for term in (one, other))
        if first.word != "inconclusive":
            found.append(
                (first.fragile, first.word == again.word, tail_index(one.influences)[0] < 2.0)
            )
    marked, same, heavy = np.array(found).T
    return float(marked.mean()), float(same[~marked].mean()), float(heavy.mean())


def false_of_variances(law: str, M: int, repetitions: int, rng: Rng) -> tuple[float, float]:
    """Return how often a variance is decided to be other than it is, and how often without a mark."""
    seeds = (_seed("variance", LAWS[law](rng, (M,))) for _ in range(repetitions))
    found = [_above(term, DEVIATION[law] ** 2) for term in seeds]
    decided = [verdict.fragile for verdict in found if verdict.word != "inconclusive"]
    return len(decided) / repetitions, decided.count(False) / repetitions


def _seed(statistic: str, x: Array) -> RunEstimate:
    influences = influence(statistic, x)
    return RunEstimate(OVER_RUNS[statistic](x).value, spread(influences).stderr, influences, len(x))


def _above(term: RunEstimate, edge: float) -> Verdict:
    parts, stressed = (
        [t.z(edge) for t in terms]
        for terms in (without_each_batch(term, 4), with_few_runs_changed(term))
    )
    return claim_verdict(term.z(edge), parts, stressed)


UNTIL = {"HDEPF": (0.02, 0.01, 0.005), "rare": (0.02, 0.01, 0.005), "lognormal": (0.04, 0.02)}
"""Standard errors, as shares of the mean, by law; ``rare``: one run in 200 is six times the others."""


def ended(
    law: str, share: float, repetitions: int, rng: Rng, most: int = 20_000
) -> list[tuple[float, float, float]]:
    """Return mean runs, bias in shares of the mean and coverage of `until`: old rule, new one."""
    found: list[list[tuple[float, float, bool]]] = [[], []]
    for _ in range(repetitions):
        x = _of_mean_one(law, most, rng)
        for least, rule in ((50, found[0]), (1000, found[1])):
            stops = list(checkpoints(least, most))
            exact = [m.stderr <= share * m.value for m in (mean(x[:n]) for n in stops)]
            first = stops[exact.index(True)] if any(exact) else most
            runs = first if least == 50 else precise_after(stops, exact) or most
            low, high = interval("mean", x[:runs])
            rule.append((runs, mean(x[:runs]).value - 1.0, low <= 1.0 <= high))
    return [tuple(np.mean(rule, axis=0)) for rule in found]


def _of_mean_one(law: str, M: int, rng: Rng) -> Array:
    if law == "rare":
        return (np.where(rng.random(M) < 0.005, 6.0, 1.0) + 0.1 * rng.normal(size=M)) / 1.025
    true = np.exp(0.5) if law == "lognormal" else ERRORS["HDEPF"].mean()
    return np.asarray(1.0 + LAWS[law](rng, (M,)) / true)


def main() -> None:
    """Print the numbers of docs/statistics.md, with more sizes."""
    rng = np.random.default_rng(2026)
    for law in LAWS:
        for M in FILTER_RUNS:
            (_, *many), (false, *power) = (
                filters_differ(law, M, min(40_000, 20_000_000 // M), rng, tests)
                for tests in (10, 1)
            )
            cells = [
                f"{sum(false):.4f}",
                *(f"{one[0]:.2f} {ten[0]:.2f}" for one, ten in zip(power, many, strict=True)),
            ]
            print("|", " | ".join([law, str(M), *cells]), "|", flush=True)
    for law in LAWS:
        for M in (200, 800, 3200):
            rows = list(decisions(law, M, 40_000_000 // M, rng))
            cells = [f"{new:.0e}" if z == 0 else f"{old:.2f} {new:.2f}" for z, old, new in rows]
            cells[0] = cells[0] if rows[0][2] else "0"
            print("|", " | ".join([law, str(M), *cells]), "|", flush=True)
    for law in LAWS:
        for M, repetitions in ((200, 6000), (800, 4000), (3200, 2000)):
            print(law, M, *false_of_variances(law, M, repetitions, rng), flush=True)
    for law in LAWS:
        for statistic in ("mean", "variance"):
            for M in (200, 800):
                cells = [f"{100 * share:.0f} %" for share in repeated(law, statistic, M, 2000, rng)]
                print("|", " | ".join([law, statistic, str(M), *cells]), "|", flush=True)
    for law, shares in UNTIL.items():
        for share in shares:
            cells = [
                f"{n:.0f} | {100 * bias:+.2f} % | {cover:.3f}"
                for n, bias, cover in ended(law, share, 1000, rng)
            ]
            print("|", " | ".join([law, f"{100 * share:g} %", *cells]), "|", flush=True)


if __name__ == "__main__":
    main()
