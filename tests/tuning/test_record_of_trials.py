"""What tuning.csv says of the keys: ranges by hand, and what is written is read back."""

import io
from pathlib import Path

import numpy as np
import pytest

from trackbench.config.tuning_axes import Axis, read_axis
from trackbench.statistics.estimates import RunEstimate
from trackbench.tuning.range_of_good_values import values_within_stderr
from trackbench.tuning.record_of_trials import Record, Trial, read_tuning, write_tuning
from trackbench.tuning.remarks_on_keys import remarks_on_keys


def _record(*trials: tuple[float, float], key: str = "q", axis: str = "0..10") -> Record:
    """Trials of one key: value and objective, with a standard error of 1."""
    return Record(
        (read_axis(key, axis),), [Trial({key: value}, height, 1.0, 0) for value, height in trials]
    )


def test_the_range_of_one_standard_error_by_hand() -> None:
    """Straight between trials: 1 above the best is reached a half and a quarter of the way out."""
    record = _record((5.0, 20.0), (4.0, 22.0), (7.0, 24.0), (0.0, 30.0), (10.0, 40.0))
    assert values_within_stderr(record, record.axes[0]) == [4.5, 5.5]
    assert not list(remarks_on_keys(record, 10))


def test_trials_beside_the_line_widen_the_range() -> None:
    axes = (read_axis("q", "0..10"), read_axis("r", "0..10"))
    points = [((5.0, 5.0), 20.0), ((4.0, 5.0), 22.0), ((8.0, 8.0), 20.5), ((9.0, 9.0), 21.5)]
    record = Record(axes, [Trial({"q": q, "r": r}, y, 1.0, 0) for (q, r), y in points])
    assert values_within_stderr(record, axes[0]) == [4.5, 8.0]
    assert values_within_stderr(record, axes[1]) == [5.0, 8.0]


def test_trials_that_lose_runs_are_not_within() -> None:
    record = _record((5.0, 20.0), (1.0, 22.0))
    record.trials.append(Trial({"q": 9.0}, 1.0, 1.0, 3))
    assert values_within_stderr(record, record.axes[0])[1] == 5.0
    assert record.best.values == {"q": 5.0}


@pytest.mark.parametrize(
    ("trials", "said"),
    [
        ([(10.0, 1.0), (5.0, 9.0), (4.0, 9.0)], "q is at its upper bound, 10: let it go further"),
        ([(0.0, 1.0), (5.0, 9.0), (4.0, 9.0)], "q is at its lower bound, 0: let it go further"),
        ([(5.0, 1.0), (0.0, 1.5), (10.0, 1.5)], "q hardly matters: from 0 to 10 nothing is more"),
        ([(1.0, 9.0), (2.0, 9.0), (5.0, 1.0)], "the best values came last"),
    ],
)
def test_remarks(trials: list[tuple[float, float]], said: str) -> None:
    assert any(line.startswith(said) for line in remarks_on_keys(_record(*trials), 10))


@pytest.mark.parametrize(
    ("keys", "heights", "idle"),
    [
        # The height is that of the second key alone.
        (("parameters.a", "parameters.b"), (1.0, 1.0, 2.0, 2.0), {"parameters.a": 4}),
        # A key of a class may have an effect elsewhere, as that of a mode that is seldom entered.
        (("a", "b"), (1.0, 1.0, 2.0, 2.0), {}),
        (("a", "b"), (1.0, 1.0, 1.0, 1.0), {"a": 4, "b": 4}),
        (("parameters.a", "parameters.b"), (1.0, 1.1, 2.0, 2.0), {}),
    ],
)
def test_keys_without_effect(
    keys: tuple[str, str], heights: tuple[float, ...], idle: dict[str, int]
) -> None:
    points = [(1.0, 1.0), (2.0, 1.0), (1.0, 2.0), (2.0, 2.0)]
    axes = tuple(read_axis(key, "0..10") for key in keys)
    trials = []
    for point, height in zip(points, heights, strict=True):
        trials.append(Trial(dict(zip(keys, point, strict=True)), height, 1.0, 0))
    assert Record(axes, trials).keys_without_effect == idle


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    axes = (Axis("assume.motion.q", 0.0, 1.0), Axis("kind", choices=("cv", "cwna")))
    influences = np.array([1.0, -1.0, np.nan])
    good = Trial.of({axes[0].key: 0.25, "kind": "cv"}, RunEstimate(3.0, 1.0, influences, 2, 1))
    tuned = Record(axes, [good, Trial.of({axes[0].key: 1.0, "kind": "cwna"}, None)])
    write_tuning(tmp_path / "tuning.csv", {"A, B": tuned})
    text = (tmp_path / "tuning.csv").read_text()
    tune = {"A, B": {"assume.motion.q": "0..1", "kind": ["cv", "cwna"]}}
    record = read_tuning(io.StringIO(text), tune)["A, B"]
    assert record.axes == axes
    assert record.trials[0] == Trial({"assume.motion.q": 0.25, "kind": "cv"}, 3.0, 1.0, 1)
    assert np.isnan(record.trials[1].objective)
    assert record.trials[1].rank == tuned.trials[1].rank > good.rank
    assert record.best is record.trials[0]


def test_of_objectives_that_are_equal_as_stored_the_one_that_was_taken_is_the_best() -> None:
    text = (
        "filter,trial,key,value,objective,stderr,lost\nA,0,q,1.0,2.0,0.1,0\nA,1,q,3.0,2.0,0.1,0\n"
    )
    tune = {"A": {"q": "0..10"}}
    assert read_tuning(io.StringIO(text), tune)["A"].best.values == {"q": 1.0}
    taken = read_tuning(io.StringIO(text), tune, {"A": {"q": 3.0}})["A"]
    assert taken.best.values == {"q": 3.0}
