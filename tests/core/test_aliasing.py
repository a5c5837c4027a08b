"""Functions of the core leave their arguments as they are and return memory of their own.

A caller may write into what it gets. The functions that return an argument, or a view of one, are
listed: their callers must not.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.conftest import random_covariance
from trackbench.core import (
    arrays,
    compiled,
    constant_matrix_cache,
    cumulative_probabilities,
    elementary,
    imm_probabilities_and_mixing,
    kalman,
    linalg,
    mixtures,
    sums,
)
from trackbench.core.distributions import Gaussian, zero_mean_log_prob

VIEWS = {
    "arrays": {"with_trailing", "with_axes_of"},
    "linalg": {"transpose"},
}
"""Functions that return an argument or a view of it, by module."""
MODULES = (arrays, elementary, linalg, sums)


def calls(n: int, batch: tuple[int, ...]) -> dict[str, Callable[[], Any]]:
    """Return calls of functions with matrices of size n, by function; arguments are read-only."""
    rng = np.random.default_rng(n)
    P = random_covariance(rng, n, 4).reshape(n, n, 4)
    P = P if batch else P[..., 0]
    A, x = rng.standard_normal((n, n, *batch)), rng.standard_normal((n, *(batch or (4,))))
    F, y, w = rng.standard_normal((n, n)), rng.uniform(0.1, 0.9, 4), np.full((2, 4), 0.5)
    L, mask = linalg.cholesky(P).copy(), np.array([True, False, True, False])
    state = Gaussian(x, P)
    for a in (P, A, x, F, y, w, L):
        a.flags.writeable = False
    p = {f"power {e}": lambda e=e: elementary.power(y, e) for e in (0, 1, 1.0, 2, 16, 0.5, -1.0)}
    return p | {
        "exp": lambda: elementary.exp(x),
        "log": lambda: elementary.log(y),
        "cos_sin": lambda: elementary.cos_sin(x),
        "arctan2": lambda: elementary.arctan2(y, y),
        "expm1": lambda: elementary.expm1(x),
        "sinh": lambda: elementary.sinh(x),
        "logaddexp": lambda: elementary.logaddexp(x, x),
        "normal_density": lambda: cumulative_probabilities.normal_density(x),
        "normal_cdf": lambda: cumulative_probabilities.normal_cdf(x),
        "chi_square_cdf 1": lambda: cumulative_probabilities.chi_square_cdf(y, 1),
        "chi_square_cdf 2": lambda: cumulative_probabilities.chi_square_cdf(y, 2),
        "choose": lambda: arrays.choose(mask, x, x),
        "matvec": lambda: linalg.matvec(A, x),
        "matvec of a constant": lambda: linalg.matvec(np.eye(n), x),
        "lower_product": lambda: linalg.lower_product(np.ones((n, n, 4)), x[..., None]),
        "matmul": lambda: linalg.matmul(A, P),
        "matmul of a constant": lambda: linalg.matmul(np.eye(n), P),
        "sandwich": lambda: linalg.sandwich(F, P),
        "symmetrize": lambda: linalg.symmetrize(P),
        "outer": lambda: linalg.outer(x, x),
        "identity_minus": lambda: linalg.identity_minus(A),
        "diagonal": lambda: linalg.diagonal(P),
        "trace": lambda: linalg.trace(P),
        "cholesky": lambda: linalg.cholesky(P),
        "root": lambda: linalg.root(P),
        "solve_lower": lambda: linalg.solve_lower(L, x),
        "whiten": lambda: linalg.whiten(L, x),
        "inverse": lambda: linalg.inverse(P),
        "mahalanobis": lambda: linalg.mahalanobis(x, P),
        "mahalanobis by a root": lambda: linalg.mahalanobis(x, P, L),
        "distance": lambda: linalg.distance(x, P),
        "solve_singular": lambda: linalg.solve_singular(P, A),
        "eigen": lambda: linalg.eigen(P),
        "beside": lambda: linalg.beside(P),
        "triangular": lambda: linalg.triangular(A),
        "product": lambda: linalg.product(F, F),
        "block_diagonal": lambda: linalg.block_diagonal([P, F], batch),
        "whiten_in_range": lambda: linalg.whiten_in_range(np.ones((n, n, 4)), x),
        "total": lambda: sums.total(x),
        "total of one row": lambda: sums.total(x[:1], axis=0),
        "mean": lambda: sums.mean(x[:, :1]),
        "dot": lambda: sums.dot(x, x),
        "update": lambda: kalman.update(state, x - 1.0, F, np.eye(n))[0],
        "condition": lambda: kalman.condition(state, x - 1.0, P, P),
        "zero_mean_log_prob": lambda: zero_mean_log_prob(x, P),
        "zero_mean_log_prob by a root": lambda: zero_mean_log_prob(x, P, L),
        "predict_weights": lambda: imm_probabilities_and_mixing.predict_weights(w, np.eye(2)),
        "combine one": lambda: mixtures.combine([state], np.ones((1, 4))),
        "arguments": lambda: (P, A, x, F, y, w, L),
    }


def arrays_of(result: Any) -> Iterator[np.ndarray]:
    if isinstance(result, np.ndarray):
        yield result
    elif isinstance(result, Gaussian):
        yield from (result.mean, result.cov)
    elif isinstance(result, tuple | list):
        for part in result:
            yield from arrays_of(part)


@pytest.mark.parametrize("kernels", [True, False])
@pytest.mark.parametrize("batch", [(), (4,)])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_results_are_memory_of_their_own(
    n: int, batch: tuple[int, ...], kernels: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not kernels:
        monkeypatch.setattr(compiled, "kernels", None)
    constant_matrix_cache.clear_caches()
    named = calls(n, batch)
    arguments = named.pop("arguments")()
    before = [a.copy() for a in arguments]
    for name, call in named.items():
        result = call()
        made = list(arrays_of(result))
        assert made or isinstance(result, float), f"{name} returns no array that this test knows"
        for out in made:
            shared = [a for a in arguments if np.shares_memory(out, a)]
            assert not shared, f"{name} returns memory of its argument"
    for a, old in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(a, old)


def test_every_function_is_called_or_listed() -> None:
    """A function of these modules that returns arrays stands in the calls or among the views."""
    called = {name.split()[0] for name in calls(2, (4,))}
    for module in MODULES:
        short = module.__name__.rpartition(".")[2]
        for name, function in vars(module).items():
            own = getattr(function, "__module__", "") == module.__name__
            annotations = getattr(function, "__annotations__", {})
            if name.startswith("_") or not own or "Array" not in str(annotations.get("return")):
                continue
            known = called | VIEWS.get(short, set()) | {"exp_of_moderate", "cached_results"}
            assert name in known, f"{short}.{name}"
