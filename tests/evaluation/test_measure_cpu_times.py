"""CPU times side by side: filters of known cost; operations that are known by hand."""

import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pytest

from tests.papers import banana, maneuver, merwe
from trackbench.core.distributions import Gaussian
from trackbench.evaluation import measure_cpu_times as timing
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.measure_cpu_times import Measured, measure
from trackbench.evaluation.operation_counts import operations, shares_of_steps
from trackbench.filters.base import Filter
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.registry import kinds

T = 40
WIDTH = 5


class Clock:
    """Seconds that only the filters here spend; ``disturbances`` come on top at the next readings."""

    seconds = 0.0
    disturbances: ClassVar[list[float]] = []

    def __call__(self) -> float:
        self.seconds += self.disturbances.pop(0) if self.disturbances else 0.0
        return self.seconds


CLOCK = Clock()


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    monkeypatch.setattr(CLOCK, "seconds", 0.0)
    monkeypatch.setattr(CLOCK, "disturbances", [])
    monkeypatch.setattr(timing, "_clock", CLOCK)
    return CLOCK


@dataclass(frozen=True)
class Busy(Filter[Any]):
    """A filter whose steps take a known time, a longer one within some steps."""

    seconds: float = 1e-4
    dear: tuple[int, int] = (0, 0)
    times: float = 1.0
    fails_at: int = 10**9
    calls: list[int] = field(default_factory=list, compare=False)

    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        return [0]

    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        self.calls.append(k)
        if len(self.calls) > self.fails_at:
            raise SystemExit("enough")
        first, last = self.dear
        CLOCK.seconds += self.seconds * (self.times if first <= k <= last else 1.0)
        return [state[0] + 1]

    def estimate(self, state: Any) -> Gaussian:
        return Gaussian(np.zeros((1, WIDTH)), np.ones((1, 1)))


@dataclass(frozen=True)
class Sleeping(Busy):
    """One whose steps take 3 ms of wall time."""

    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        time.sleep(3e-3)
        return super().step(model, state, z, k, rng)


@dataclass(frozen=True)
class Object(Busy):
    """One whose state is an object that changes with each step."""

    loops_over_runs: ClassVar[bool] = True
    seen: list[tuple[int, int]] = field(default_factory=list, compare=False)

    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        self.seen.append((k, state[0]))
        state[0] += 1
        return state


def task(tracker: Any, scenario: Any = None) -> BlockTask:
    return BlockTask(scenario or merwe(T=T + 1), tracker, 1, 0, WIDTH, 0)


def medians(found: list[Any]) -> list[float]:
    return [float(np.median(m.seconds)) for m in found]


def test_filters_of_known_cost() -> None:
    """A run's time is that of its steps over the runs of the block."""
    step = 3e-4
    plain = Busy(step)
    turns = Busy(step, dear=(10, 19), times=6.0)
    first = Busy(step, dear=(1, 4), times=20.0)
    assert medians(measure([*map(task, (plain, turns, first))])) == pytest.approx(
        [step * n / WIDTH for n in (T, T + 10 * 5, _steps_dear(first))]
    )


def _steps_dear(tracker: Busy) -> float:
    steps = merwe(T=T + 1).steps[1:]
    dear = ((steps >= tracker.dear[0]) & (steps <= tracker.dear[1])).sum()
    return len(steps) + (tracker.times - 1.0) * dear


def test_a_pass_that_is_too_long_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of 10 ms: the pass ends after 50 ms, a repeat is one step, and a run is 40 of them."""
    monkeypatch.setattr(timing, "_QUICK_S", 0.01)
    monkeypatch.setattr(timing, "_PASS_S", 0.05)
    monkeypatch.setattr(timing, "REPEATS", 6)
    dear = Busy(1e-2)
    assert medians(measure([task(dear)])) == pytest.approx([1e-2 * T / WIDTH])
    assert len(dear.calls) < T + 40


@pytest.mark.parametrize("step", [1, 2, 5, 9])
def test_a_second_pass_that_is_cut(
    step: int, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The machine stops for a second in a step of the second pass: the first pass has the times."""
    monkeypatch.setattr(timing, "REPEATS", 6)
    clock.disturbances += [0.0] * (2 * T + 2 * step + 1) + [1.0]
    assert medians(measure([task(Busy(1e-4))])) == pytest.approx([1e-4 * T / WIDTH])
    assert clock.disturbances == []


def test_a_coarse_clock_does_not_make_a_repeat_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """The CPU clock shows no time for steps of 3 ms: a repeat has ten of them, not 30 000."""
    monkeypatch.setattr(timing, "REPEATS", 1)
    slow = Sleeping(0.0)
    (found,) = measure([task(slow)])
    assert isinstance(found, Measured)
    assert len(slow.calls) <= 3 * T + 11  # the operations, two passes and the repeat


def test_filters_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[float] = []
    repeated = timing._Pass.time_repeat

    def noted(one: Any) -> Any:
        order.append(one._task.filter.seconds)
        return repeated(one)

    monkeypatch.setattr(timing._Pass, "time_repeat", noted)
    monkeypatch.setattr(timing, "REPEATS", 4)
    measure([task(Busy(s)) for s in (1e-5, 2e-5, 3e-5)])
    assert [round(1e5 * s) for s in order] == [1, 2, 3, 3, 2, 1, 1, 2, 3, 3, 2, 1]


def test_what_fails_costs_only_its_own_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "REPEATS", 3)

    @contextmanager
    def guard() -> Any:
        try:
            yield
        except SystemExit as error:
            raise RuntimeError("left") from error

    always, later = Busy(1e-5, fails_at=3), Busy(1e-5, fails_at=T + 300)
    ticks: list[None] = []
    tasks = [task(Busy(2e-5)), task(always), task(later)]
    good, first, second = measure(tasks, guard, lambda: ticks.append(None))
    assert len(ticks) == len(tasks) + timing.REPEATS  # failures count as done
    assert isinstance(good, Measured)
    assert len(good.seconds) == 3
    assert [str(first), str(second)] == ["left", "left"]


def test_objects_are_copied_before_each_step() -> None:
    tracker = Object()
    (found,) = measure([task(tracker)])
    assert isinstance(found, Measured)
    start = int(merwe(T=T + 1).steps[1])
    assert all(before == k - start for k, before in tracker.seen)


@pytest.mark.parametrize(
    ("kind", "keys", "expected"),
    [
        ("pf", {"N": 10}, (10, 0)),
        ("apf", {"N": 10}, (20, 0)),
        ("ukf", {}, (0, 1)),
        ("upf", {"N": 10}, (10, 10)),
        ("hdepf", {"N": 10, "G": 5}, (10 * 7, 10)),
    ],
)
def test_operations_of_a_step(kind: str, keys: Any, expected: tuple[int, int]) -> None:
    """A likelihood per particle, two of an APF, of HDEPF one more a generation and for the first."""
    counts = operations(task(kinds("filters")[kind](**keys)))
    assert counts.shape == (2, T)
    assert counts.mean(axis=1).tolist() == list(expected)


def test_operations_of_shared_covariances() -> None:
    """All particles of an MPF share one covariance; an IMM has one per model, a KF one for all runs."""
    found = {
        kind: operations(task(kinds("filters")[kind](**keys), scenario)).mean(axis=1).tolist()
        for kind, keys, scenario in (
            ("mpf", {"N": 20}, banana(scans=12)),
            ("los-rbpf", {"N": 20}, banana(scans=12)),
            ("imm", _two_models(), maneuver(T=10.0)),
        )
    }
    assert found == {"mpf": [20, 1], "los-rbpf": [20, 1], "imm": [0, 2]}


def _two_models() -> dict[str, Any]:
    motions = (WhiteAcceleration(q=0.1), WhiteAcceleration(q=1.0))
    return {"motions": motions, "transition": ((0.9, 0.1), (0.1, 0.9))}


def test_operations_do_not_depend_on_what_was_remembered() -> None:
    scenario = maneuver(T=10.0)
    first, second = (
        operations(task(kinds("filters")["imm"](**_two_models()), scenario)) for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


def test_a_filter_that_notes_nothing_has_no_operations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "REPEATS", 2)
    (found,) = measure([task(Busy(1e-5))])
    assert isinstance(found, Measured)
    assert (found.likelihoods, found.covariances) == (None, None)


def test_a_step_has_the_share_of_its_operations_in_the_work_of_a_run() -> None:
    """Of eight steps, the first four were counted: 6, 2, 2 and 2 operations, 3 a step."""
    counts = np.array([[4.0, 1.0, 2.0, 0.0], [2.0, 1.0, 0.0, 2.0]])
    found = shares_of_steps(counts, 8)
    np.testing.assert_allclose(found, np.array([2, 2 / 3, 2 / 3, 2 / 3, 1, 1, 1, 1]) / 8)
    # A step without operations says nothing about the others.
    np.testing.assert_array_equal(shares_of_steps(np.zeros((2, 4)), 8), np.full(8, 1 / 8))
