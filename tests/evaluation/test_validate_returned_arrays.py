"""What a filter of one's own cannot do: write to what it is given, give back what is no estimate."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter, track
from tests.papers import banana, maneuver, merwe
from trackbench.core.constant_matrix_cache import cached_if_constant
from trackbench.core.distributions import Gaussian
from trackbench.core.read_only import fixed, freeze
from trackbench.core.undo_plugin_changes import Seal
from trackbench.evaluation import writes_to_shared_arrays
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.cached_filter_outputs import run_filter_cached
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.simulated_runs import simulate
from trackbench.evaluation.validate_returned_arrays import (
    check_axes,
    check_estimate,
    check_symmetry,
    checked_metrics,
)
from trackbench.filters.base import WrongReturnError
from trackbench.filters.ukf import UKF
from trackbench.scenarios.targets.legs import Leg
from trackbench.scenarios.tracking import Tracking

SCENARIO = merwe(T=5, R=0.1)
MANEUVER = maneuver(duration=60.0, legs=())


def block(tracker: Any, scenario: Any = SCENARIO, **keys: Any) -> Any:
    return run_block(BlockTask(scenario, tracker, 1, 0, 4, 4, **keys))


@pytest.mark.parametrize("scenario", [SCENARIO, MANEUVER, banana(scans=4)])
def test_what_filters_share_is_read_only(scenario: Any) -> None:
    data = simulate(scenario, 1, 0, 3)
    inside = [value for value in vars(data.prior).values() if isinstance(value, np.ndarray)]
    assert inside
    for shared in (data.truth, data.measurements, data.measurements[:, 0], *inside):
        with pytest.raises(ValueError, match="read-only"):
            shared[...] = 0.0
    assert simulate(scenario, 1, 0, 3) is data
    data.prior.sample(np.random.default_rng(0), 5)[...] = 0.0  # what is made of it is not


@dataclass(frozen=True, slots=True)
class Pair:
    """Parts that refer to each other, as a prior of one's own may have them."""

    means: dict[str, Any]
    both: list[Any]
    later: Any = field(init=False)


def test_every_array_at_any_depth_is_frozen() -> None:
    a, b = np.zeros(2), np.zeros(3)
    pair = Pair({"a": a}, [b, np])
    pair.both.append(pair)
    assert freeze((pair, 1.0)) == (pair, 1.0)
    assert not a.flags.writeable
    assert not b.flags.writeable
    assert pair.means["a"] is not a  # but lies where nobody can write
    assert pair.both[2] is pair
    prior: Any = simulate(banana(scans=4), 1, 0, 3).prior
    assert not prior.sensor.R.flags.writeable


@pytest.mark.parametrize(
    "a",
    [
        np.arange(24.0).reshape(2, 3, 4),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(24.0).reshape(2, 3, 4).transpose(1, 2, 0)[::-1],
        np.array(2.5),
        np.empty((0, 3)),
        np.array([True, False]),
        np.arange(5, dtype=np.float32)[::2],
    ],
    ids=lambda a: f"{a.dtype}{a.shape}",
)
def test_fixed_arrays_are_the_same_numbers(a: np.ndarray) -> None:
    held = fixed(a)
    assert (held.dtype, held.shape) == (a.dtype, a.shape)
    assert held.flags.c_contiguous or held.flags.f_contiguous
    assert not a.flags.fnc or held.strides == a.strides
    np.testing.assert_array_equal(held, a)
    assert fixed(held) is held
    with pytest.raises(ValueError, match="cannot set WRITEABLE"):
        held.setflags(write=True)


def test_of_objects_and_masks_only_the_flag_is_set() -> None:
    for a in (np.array([{}, None]), np.ma.masked_array([1.0, 2.0], [True, False])):
        assert fixed(a) is a
        assert not a.flags.writeable


class WritesMeasurement(UKF):
    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        z -= 0.5
        return super().step(model, state, z, k, rng)


class WritesPrior(UKF):
    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        prior.mean[...] += 3.0
        return super().init(model, prior, rng)


class WritesPriorLater(UKF):
    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        state.posterior.mean[...] += 1.0  # which is the prior's own array
        return super().step(model, state, z, k, rng)


class WritesModel(UKF):
    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        Q = model.motion.transition(state.posterior.mean, k).cov
        Q *= 2.0
        return super().step(model, state, z, k, rng)


@pytest.mark.parametrize(
    ("cls", "scenario"),
    [
        (WritesMeasurement, SCENARIO),
        (WritesPrior, SCENARIO),
        (WritesPriorLater, SCENARIO),
        (WritesModel, banana(scans=4)),
    ],
)
def test_a_filter_that_writes_to_its_input_fails_alone(cls: Any, scenario: Any) -> None:
    other = make_filter("ukf")
    simulate.cache_clear()
    before = block(other, scenario).per_run
    simulate.cache_clear()
    with pytest.raises(ValueError, match="given is read-only: copy it before you write to it"):
        block(cls(), scenario)
    after = block(other, scenario).per_run
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values)


def _arrays(whole: Any) -> list[np.ndarray]:
    """The array, or those of a model or a distribution, its bases, and views of them."""
    if isinstance(whole, np.ndarray):
        return [whole, whole[..., :1], *_arrays(whole.base)]
    if isinstance(whole, tuple):
        return [a for part in whole for a in _arrays(part)]
    return [a for part in getattr(whole, "__dict__", {}).values() for a in _arrays(part)]


@pytest.mark.parametrize("scenario", [SCENARIO, MANEUVER, banana(scans=4)])
def test_what_filters_share_cannot_be_made_writable(scenario: Any) -> None:
    given: dict[str, Any] = {}

    class Looks(UKF):
        def init(self, model: Any, prior: Any, rng: Any) -> Any:
            given.update(model=model, prior=prior)
            return super().init(model, prior, rng)

        def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
            after = super().step(model, state, z, k, rng)
            given.update(z=z, gain=inverse(np.eye(2)))
            return after

    block(Looks(), scenario)
    for name, whole in given.items():
        arrays = _arrays(whole)
        assert arrays or name == "model", name
        for a in arrays:
            assert not a.flags.writeable
            with pytest.raises(ValueError, match="cannot set WRITEABLE"):
                a.setflags(write=True)


@dataclass(frozen=True, kw_only=True)
class WritesMemory(UKF):
    """Hands addresses to a library that writes there, and swallows what numpy says of it."""

    where: str

    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        self._spoil("prior", _arrays(prior)[0])
        self._spoil("model", model.sensor.R)
        self._spoil("gains", inverse(np.eye(2)))
        return super().init(model, prior, rng)

    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        self._spoil("measurement", z)
        if self.where == "error":
            self._spoil("error", z)
            raise KeyError
        return super().step(model, state, z, k, rng)

    def _spoil(self, where: str, a: np.ndarray) -> None:
        if where == self.where:
            memory = ctypes.cast(a.ctypes.data, ctypes.POINTER(ctypes.c_double))
            memory[0] += 1.0


@cached_if_constant
def inverse(A: np.ndarray) -> np.ndarray:
    """Stand for a gain that all filters share."""
    return 1.0 / (A + 1.0)


@pytest.mark.parametrize("where", ["measurement", "prior", "model", "gains", "error"])
@pytest.mark.parametrize("held_out", [None, 2])
def test_a_filter_that_writes_to_memory_fails_alone(where: str, held_out: int | None) -> None:
    scenario, other = banana(scans=4), make_filter("ekf")
    gain = inverse(np.eye(2)).copy()
    simulate.cache_clear()
    before = block(other, scenario, hold_out=held_out).per_run
    with pytest.raises(WrongReturnError, match="that all filters of the block share: copy"):
        block(WritesMemory(where=where), scenario, hold_out=held_out)
    run_filter_cached.cache_clear()
    after = block(other, scenario, hold_out=held_out).per_run  # of the same data
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values)
    np.testing.assert_array_equal(inverse(np.eye(2)), gain)


def test_only_blocks_with_foreign_code_are_sealed(monkeypatch: pytest.MonkeyPatch) -> None:
    sealed = []
    monkeypatch.setattr(
        writes_to_shared_arrays, "Seal", lambda *shared: sealed.append(shared) or Seal(*shared)
    )
    run_filter_cached.cache_clear()
    block(make_filter("ukf"))
    assert not sealed
    block(make_filter("ekf"), reference=WritesMemory(where=""))
    assert len(sealed) == 1


class InPlace(UKF):
    """A state of its own that every step writes to, estimates and diagnostics included."""

    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        state = super().init(model, prior, rng)
        mean, cov = (np.array(a) for a in (state.posterior.mean, state.posterior.cov))
        return state._replace(posterior=Gaussian(mean, cov), nis=np.zeros(mean.shape[1]))

    def step(self, model: Any, state: Any, z: Any, k: int, rng: Any) -> Any:
        new = super().step(model, state, z, k, rng)
        state.posterior.mean[...] = new.posterior.mean
        state.posterior.cov[...] = new.posterior.cov
        state.nis[...] = new.nis
        return state


def test_estimates_are_taken_before_the_next_step_overwrites_them() -> None:
    plain, overwritten = (track(MANEUVER, cls(), 3) for cls in (UKF, InPlace))
    np.testing.assert_array_equal(overwritten.mean, plain.mean)
    np.testing.assert_array_equal(overwritten.nees, plain.nees)
    np.testing.assert_array_equal(overwritten.diagnostics["nis"], plain.diagnostics["nis"])


def test_a_smoother_gets_the_states_as_they_were_before_later_steps() -> None:
    plain = track(MANEUVER, UKF(smooth=True), 3)
    overwritten = track(MANEUVER, InPlace(smooth=True), 3)
    np.testing.assert_array_equal(overwritten.mean, plain.mean)
    np.testing.assert_array_equal(overwritten.nees, plain.nees)


def giving(change: Callable[[Any, Any], Any]) -> Any:
    """A filter whose estimate is what ``change`` makes of mean (4, M) and covariance (4, 4, M)."""

    class Changed(UKF):
        def estimate(self, state: Any) -> Any:
            found = super().estimate(state)
            cov = np.broadcast_to(found.cov.reshape(4, 4, -1), (4, 4, found.mean.shape[1]))
            return Gaussian(*change(found.mean, cov))

    return Changed()


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda m, P: (m[0], P), r"the mean of the estimate is an array \(4,\) of float64"),
        (lambda m, P: (m[:1], P), r"the mean .* is an array \(1, 4\) of float64"),
        (lambda m, P: (m[:, :1], P), r"the mean .* is an array \(4, 1\) of float64"),
        (lambda m, P: (np.vstack([m, m[:2]]), P), r"the mean .* is an array \(6, 4\) of float64"),
        (lambda m, P: (m.tolist(), P), "the mean .* is a list"),
        (lambda m, P: (m + 0j, P), r"the mean .* is an array \(4, 4\) of complex128"),
        (lambda m, P: (m.astype(object), P), r"the mean .* is an array \(4, 4\) of object"),
        (lambda m, P: (np.ma.array(m, mask=True), P), "the mean .* is a MaskedArray"),
        (lambda m, P: (m, P[:2, :2]), r"the covariance of .* is an array \(2, 2, 4\) of float64"),
        (lambda m, P: (m, P[..., :1]), r"the covariance .* is an array \(4, 4, 1\) of float64"),
    ],
)
def test_what_is_no_estimate_is_refused(change: Any, found: str) -> None:
    with pytest.raises(ValueError, match=rf"{found}, not an array \(4, 4.*\) of real numbers"):
        block(giving(change), MANEUVER)


def test_components_and_runs_exchanged_are_noticed_where_there_are_as_many() -> None:
    changed = giving(lambda m, P: (np.ascontiguousarray(m.T), P))
    with pytest.raises(ValueError, match="components and runs of the mean are exchanged"):
        block(changed, MANEUVER)


def test_whole_and_short_numbers_are_taken_as_they_are() -> None:
    found = block(giving(lambda m, P: (np.rint(m).astype(int), P[..., 0].astype("f4"))), MANEUVER)
    assert np.isfinite(found.per_run["rmse_position"]).all()
    assert found.per_run["nees"].dtype == np.float64


def noting(**values: Any) -> Any:
    """A filter that notes these at every step."""

    class Noting(UKF):
        def diagnostics(self, state: Any) -> dict[str, Any]:
            return values

    return Noting()


def test_a_diagnostic_that_a_later_step_lacks_is_an_error() -> None:
    calls = []

    class Once(UKF):
        def diagnostics(self, state: Any) -> dict[str, Any]:
            calls.append(1)
            return {"mine": state.nis} if len(calls) == 1 else {}

    with pytest.raises(KeyError, match="mine"):
        block(Once(), MANEUVER)


@pytest.mark.parametrize(
    "name",
    ["rmse", "bias", "std", "lost", "nees", "anees", "outside_region", "rmsd", "squared", "error"],
)
@pytest.mark.parametrize("suffix", ["", "_position", "_x", "[k<=30]", "_x[k<=30]"])
def test_a_diagnostic_cannot_have_a_name_of_the_errors(name: str, suffix: str) -> None:
    tracker = noting(**{name + suffix: np.zeros(4)})
    with pytest.raises(ValueError, match="a diagnostic cannot be named") as caught:
        block(tracker)
    assert repr(name + suffix) in str(caught.value)


@pytest.mark.parametrize("name", ["mean(rmse)", "mode[turns]", "rmse@3", ""])
def test_a_diagnostic_cannot_look_like_an_expression(name: str) -> None:
    with pytest.raises(ValueError, match="use letters, digits"):
        block(noting(**{name: np.zeros(4)}))


@pytest.mark.parametrize("name", ["peak_position", "detection_delay_s", "false_maneuvers_per_1000"])
def test_a_diagnostic_cannot_have_the_name_of_a_metric_of_the_scenario(name: str) -> None:
    turn = maneuver(duration=90.0, legs=(Leg(start=30, end=50, ax=0.3, ay=0.0),), settle=10.0)
    with pytest.raises(ValueError, match=rf"'{name}.*' is a metric of the scenario"):
        block(noting(**{name: np.zeros(4), "mode": np.zeros(4)}), turn)


def test_errors_cannot_be_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(UKF, "summed_diagnostics", frozenset({"nees"}), raising=False)
    with pytest.raises(ValueError, match="cannot be named 'nees'"):
        block(make_filter("ukf"))


@pytest.mark.parametrize("value", [np.zeros(1), np.zeros((1, 4)), 0.5, np.zeros(4, dtype=complex)])
def test_a_diagnostic_is_a_number_per_run(value: Any) -> None:
    with pytest.raises(ValueError, match=r"diagnostic 'mine' is .*, not an array \(4,\)"):
        block(noting(mine=value))


@pytest.mark.parametrize("value", [np.ones(4, dtype=bool), np.ones(4, dtype=int)])
def test_a_diagnostic_of_whole_numbers_has_no_value_before_the_first_step(value: Any) -> None:
    """The prior's row is missing; as a whole number it would be true, or the smallest there is."""
    found = track(SCENARIO, noting(mine=value), 4).diagnostics["mine"]
    assert np.isnan(found[0]).all()
    assert (found[1:] == 1.0).all()


def test_the_mean_of_the_reference_is_read_only(monkeypatch: pytest.MonkeyPatch) -> None:
    given = []
    errors = Tracking.errors
    monkeypatch.setattr(Tracking, "errors", lambda s, m, x: given.append(x) or errors(s, m, x))
    block(make_filter("ukf"), reference=make_filter("prior-mean"))
    assert [x.flags.writeable for x in given] == [False, False]  # the truth, and the reference


def test_an_expectation_is_a_number_per_run(monkeypatch: pytest.MonkeyPatch) -> None:
    tracker = make_filter("pf", N=20)
    mean = {"mean_range": np.ones(1)}
    monkeypatch.setattr(type(tracker), "expectation", lambda self, state, g: mean)
    with pytest.raises(ValueError, match=r"expectation 'mean_range' is an array \(1,\)"):
        block(tracker, banana(scans=4))


@pytest.mark.parametrize(("sizes", "n"), [((4, 4), 4), ((4, 6), 4), ((4, 6), 6)])
def test_an_estimate_has_the_components_of_the_truth_or_of_what_is_assumed(
    sizes: tuple[int, int], n: int
) -> None:
    check_estimate(Gaussian(np.zeros((n, 3)), np.zeros((n, n, 3))), sizes, 3)
    check_estimate(Gaussian(np.zeros((n, 3)), np.zeros((n, n))), sizes, 3)
    for mean, cov in ((5, 5), (n, 5)):
        with pytest.raises(ValueError, match="of the estimate"):
            check_estimate(Gaussian(np.zeros((mean, 3)), np.zeros((cov, cov))), sizes, 3)


def test_a_symmetric_start_may_be_exchanged() -> None:
    start = np.array([[1.0, 2.0], [2.0, 5.0]])
    check_axes(Gaussian(start, np.eye(2)), start)


def test_a_metric_is_a_word_and_what_it_is_of() -> None:
    assert set(checked_metrics({"delay_s[leg 1]": np.zeros(3)}, 3)) == {"delay_s[leg 1]"}
    for name in ("a b", "delay[]", "delay[leg 1]s", "delay[a[b]]", "", "[x]"):
        with pytest.raises(ValueError, match="a metric cannot be named"):
            checked_metrics({name: np.zeros(3)}, 3)


@pytest.mark.parametrize("part", [np.tril, np.triu])
def test_a_covariance_of_a_plugin_is_symmetric(part: Any) -> None:
    class Half(UKF):
        def estimate(self, state: Any) -> Gaussian:
            whole = super().estimate(state)
            return Gaussian(whole.mean, np.moveaxis(part(np.moveaxis(whole.cov, 2, 0)), 0, 2))

    block(make_filter("ukf"), MANEUVER)
    with pytest.raises(WrongReturnError, match=r"not symmetric: row 1, column 2 .* return L L'"):
        block(Half(), MANEUVER)


def test_rounding_errors_and_lost_runs_are_symmetric_enough() -> None:
    cov = np.broadcast_to(np.diag([1e8, 4.0, 0.0])[..., None], (3, 3, 5)).copy()
    cov[0, 1, 1] = 1e-6 * 2e4
    cov[1, 2, 2] = 1e-9
    cov[:, :, 3] = np.nan
    cov[0, 1, 4] = np.inf
    check_symmetry(cov)
    check_symmetry(cov[:, :, :, None])
    check_symmetry(cov[:, :, 1])
    cov[0, 1, 1] = 2e-5 * 2e4
    with pytest.raises(WrongReturnError, match="differ by 2e-05 of the product"):
        check_symmetry(cov)
