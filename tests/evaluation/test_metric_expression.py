"""What is measured is read once, and written again as it was."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackbench.config.requested_metrics import role_of
from trackbench.evaluation.metric_expression import Measure, Steps, measure, measured
from trackbench.metrics import METRICS, Metric, is_reserved, metric, metric_of, metrics_of, unit_of

READ = {
    "rmse": Measure("rmse"),
    "rmse_position[leg 1]": Measure("rmse_position", "leg 1"),
    "mean(rmse[k<=30])": Measure("rmse", "k<=30", "mean"),
    "rmse@20": Measure("rmse", steps=Steps("20")),
    "rmse@last": Measure("rmse", steps=Steps("last")),
    "rmse@3..last": Measure("rmse", steps=Steps("3", "last")),
    "mean(rmse@3)": Measure("rmse", "", "mean", Steps("3")),
    "gain(mean(rmse), PF (N=5))": Measure("rmse", "", "mean", relation="gain", other="PF (N=5)"),
    "win_rate(rmse[a, b], x, y)": Measure("rmse", "a, b", relation="win_rate", other="x, y"),
    "mean(rmse[a]b)])": Measure("rmse", "a]b)", "mean"),
}


@pytest.mark.parametrize("text", READ)
def test_it_is_read_and_written_again(text):
    assert measure(text) == READ[text]
    assert str(measure(text)) == text


names = st.from_regex(r"[a-z]{1,5}(_[a-z0-9.]{1,4}){0,2}", fullmatch=True)
words = st.text(st.characters(codec="ascii", categories=["L", "N", "Zs"], include_characters="<=(,"),
                min_size=1, max_size=8)  # fmt: skip


@given(
    names,
    words | st.just(""),
    st.sampled_from(["", "mean", "variance", "rms", "median", "time-mean"]),
    st.sampled_from(["", "gain", "ratio", "minus", "win_rate"]),
    words,
)
def test_whatever_is_put_together_is_read_as_that(name, window, statistic, relation, other):
    whole = Measure(name, window, statistic, relation=relation, other=other if relation else "")
    assert str(measure(str(whole))) == str(whole)
    assert measure(str(whole)).metric == name
    if "]" not in other and "]" not in window and not relation:
        assert measure(str(whole)) == whole


def test_a_median_at_a_step_is_written_either_way():
    assert measure("median(nees)@3") == measure("median(nees@3)")


@pytest.mark.parametrize(
    "text",
    ["", "5", "rmse at 5", "mean(rmse", "rmse)", "rmse@last..3", "rmse/4", "rmse[]", "rmse@2.5",
     "gain(mean(rmse),PF)", "rmse[a]@3", "mean()"],
)  # fmt: skip
def test_anything_else_is_no_expression(text):
    with pytest.raises(ValueError, match="is no expression such as"):
        measure(text)
    assert measured(text) == Measure(text)


def test_an_unknown_statistic_is_said_with_those_that_there_are():
    with pytest.raises(ValueError, match=r"'meen' is no statistic; known: mean, .*time-mean"):
        measure("meen(rmse)")


def test_the_steps_meant():
    assert measure("rmse@3..5").at_each(range(9)) == [measure(f"rmse@{k}") for k in (3, 4, 5)]
    assert [m.step for m in measure("rmse@7..last").at_each(range(9))] == [7, 8]
    assert measure("rmse@last").step is None


def test_the_base_is_what_a_run_has():
    assert measure("anees_position[late]").base == "nees_position"
    assert measure("mean(rmse[late])").base == "rmse"


def test_a_series_is_made_into_what_is_registered():
    assert [name for _, name in metrics_of("squared_x")] == ["rmse_x", "mse_x", "mae_x"]
    assert [name for _, name in metrics_of("error_x")] == ["bias_x", "std_x"]
    assert [name for _, name in metrics_of("nees")] == ["nees", "anees"]
    assert [(m.over_steps, name) for m, name in metrics_of("hits", {"hits"})] == [("sum", "hits")]


def test_names_units_and_what_is_reserved():
    assert metric_of("rmse_mean_range") == (METRICS["rmse"], "mean_range")
    assert metric_of("mode_x") == (Metric("mode_x"), "")  # a note, and no family
    assert [unit_of(n) for n in ("rmse_velocity", "bias_azimuth_deg", "std_px", "rmse", "ess")] == [
        *("m/s", "deg", "m", "", "1")
    ]
    assert is_reserved("squared_anything")
    assert is_reserved("anees")
    assert not is_reserved("")
    assert not is_reserved("rmsee")


def test_a_plugin_says_what_its_notes_are():
    for taken in ("rmse", "rmse_foo", "ess", "squared"):
        with pytest.raises(ValueError, match="already"):
            metric(taken, "another")
    metric("hits", "gates passed", "1", "higher")
    try:
        assert metric_of("hits")[0].better == "higher"
    finally:
        del METRICS["hits"]


def test_a_key_says_what_it_may_name():
    from trackbench.evaluation.metric_expression import Expression, OfRun

    assert (role_of(OfRun), role_of(dict[str, Expression]), role_of(str)) == (
        "per_run",
        "expression",
        "",
    )
