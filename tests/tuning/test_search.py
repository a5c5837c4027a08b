"""The search by itself, on functions whose smallest value is known."""

from collections.abc import Callable

import numpy as np
import pytest

from trackbench.config.tuning_axes import Axis, read_axis
from trackbench.tuning.search import Rank, Search, Values


def searched(
    axes: list[Axis], f: Callable[[Values], Rank], budget: int, start: tuple[float, ...] = ()
) -> list[Values]:
    """Every value that was tried, in order."""
    search = Search(axes, start or (0.5,) * len(axes), budget)
    tried: list[Values] = []
    asking = search.run()
    wanted = next(asking)
    while True:
        assert wanted
        assert not set(wanted) & set(tried), "tried twice"
        tried += wanted
        try:
            wanted = asking.send({values: f(values) for values in wanted})
        except StopIteration:
            break
    assert len(tried) <= budget
    assert search.best == min(tried, key=f)
    return tried


@pytest.mark.parametrize("place", [0.02, 0.31, 0.77])
@pytest.mark.parametrize("keys", [1, 2, 3])
def test_a_bowl_anywhere(place: float, keys: int) -> None:
    """What is left of the bowl's rise over half the axis: a hundredth, of three keys five."""

    def f(values: Values) -> Rank:
        return 0, sum(((v - place) * (1.0 + i)) ** 2 for i, v in enumerate(values))

    tried = searched([Axis(str(i), 0.0, 1.0) for i in range(keys)], f, 40)
    assert f(min(tried, key=f))[1] < (0.0025 if keys < 3 else 0.0125)


def test_a_narrow_valley_beside_a_wide_one() -> None:
    """Nelder and Mead's simplex alone stays in the wide one."""

    def f(values: Values) -> Rank:
        x, y = values
        wide, narrow = (x - 0.2) ** 2 + (y - 0.2) ** 2, (x - 0.75) ** 2 + (y - 0.8) ** 2
        return 0, min(1.0 + wide, 8.0 * narrow)

    axes = [Axis("x", 0.0, 1.0), Axis("y", 0.0, 1.0)]
    assert f(min(searched(axes, f, 40, (0.2, 0.2)), key=f))[1] < 0.5


def test_the_config_s_own_value_is_the_first() -> None:
    axis = read_axis("q", "log:1e-4..1")
    tried = searched([axis], lambda values: (0, abs(values[0] - 0.3)), 20, (axis.share(0.02) or 0,))
    assert tried[0] == (0.02,)


def test_values_that_lose_runs_are_left() -> None:
    """Small errors beyond 0.6, where runs are lost."""
    tried = searched([Axis("q", 0.0, 1.0)], lambda v: (int(v[0] > 0.6) * 3, -v[0]), 30)
    best = min(tried, key=lambda v: (int(v[0] > 0.6) * 3, -v[0]))
    assert 0.55 < best[0] <= 0.6


def test_where_everything_is_lost_it_ends() -> None:
    assert len(searched([Axis("q", 0.0, 1.0)], lambda v: (9, np.inf), 15)) <= 15


def test_choices_and_whole_numbers() -> None:
    axes = [read_axis("kind", ["a", "b", "c"]), Axis("N", 1, 40, whole=True)]
    tried = searched(axes, lambda v: (0, (v[0] != "c") + (v[1] - 31) ** 2 / 1000), 40)
    assert ("c", 31) in tried
    only = searched([axes[0]], lambda v: (0, v[0] != "b"), 10)
    assert sorted(only) == [("a",), ("b",), ("c",)]


def test_many_choices_do_not_take_the_whole_budget() -> None:
    axes = [read_axis(str(i), list(range(6))) for i in range(3)] + [Axis("q", 0.0, 1.0)]
    tried = searched(axes, lambda v: (0, sum(v)), 40, (0.9,) * 4)
    assert len({v[3] for v in tried}) > 8
