"""What a suite says of a filter that runs on few problems."""

import pytest

from trackbench.report.suite.reachable_problems import ProblemModel, reach_sentence
from trackbench.report.suite.scores import FILTER, Score, SuiteScores

PLANE = ("px", "vx", "py", "vy")
MODELS = {
    "radar": ProblemModel(state=PLANE, measurement=("range", "azimuth"), is_linear=False),
    "turn": ProblemModel(state=(*PLANE, "w"), measurement=("range", "azimuth"), is_linear=False),
    "position": ProblemModel(state=PLANE, measurement=("x", "y"), is_linear=True),
    "lidar": ProblemModel(state=PLANE, measurement=("x", "y"), is_linear=True),
    "bearing": ProblemModel(state=PLANE, measurement=("bearing",), is_linear=False),
    "ungm": ProblemModel(state=("x",), measurement=("y",), is_linear=False),
}


def sentence(*fitted: str, is_program: bool = True) -> str:
    """Return the sentence on a filter that runs on these problems."""
    scores = [
        Score(
            group="g", problem=name, problem_class="c", label="own", role=FILTER, error=1.0, runs=8,
            reason="" if name in fitted else "refused",
        )
        for name in MODELS
    ]  # fmt: skip
    ran = [score for score in scores if not score.reason]
    left_out = tuple(score for score in scores if score.reason)
    group = SuiteScores(group="g", title="G", scores=ran, runs={}, not_computed=left_out)
    return reach_sentence([group], "own", is_program, MODELS)


def test_a_radar_filter_is_told_of_problems_like_its_own() -> None:
    """A hint at F, Q, H and R does not help a filter of range and azimuth."""
    text = sentence("radar")
    assert text.startswith("own runs on 1 of 6 problems. It takes the state px vx py vy and the ")
    assert "With such a measurement 1 problem has another state: px vx py vy w (1)." in text
    assert "With such a state 3 problems have another measurement: x y (2) and bearing (1)." in text
    assert "F, Q, H and R" not in text


def test_a_state_that_the_filter_takes_is_no_other_state() -> None:
    """It runs on `position`, and not on `lidar`, which has the same state and measurement."""
    text = sentence("position")
    assert "another state" not in text
    assert "With such a state 2 problems have another measurement" in text


def test_a_filter_of_positions_is_told_of_linear_models() -> None:
    text = sentence("position", "lidar")
    assert "runs on every linear problem" in text
    assert "It takes the state px vx py vy and the measurement x y." in text


def test_a_class_is_told_of_functions_and_a_filter_of_most_problems_nothing() -> None:
    assert "takes its model as functions" in sentence("radar", is_program=False)
    assert sentence("radar", "turn", "position", "lidar") == ""


@pytest.mark.parametrize("is_program", [True, False])
def test_a_filter_that_runs_nowhere_has_a_hint(is_program: bool) -> None:
    assert sentence(is_program=is_program).startswith("own runs on 0 of 6 problems. A ")
