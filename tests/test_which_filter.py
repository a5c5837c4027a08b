"""The words of docs/which-filter.md follow from the stored scores; `tests.prose` ties its numbers."""

import re

import pytest

from tests.conftest import ROOT
from tests.suite_scores import score_of, scores_of_class, stored_suite, suite_number
from trackbench.report.suite.score_words import fails
from trackbench.report.suite.scores import FILTER, typical_ratios
from trackbench.statistics.significance_rules import ALIKE

PAGE = (ROOT / "docs" / "which-filter.md").read_text(encoding="utf-8")
BOOTSTRAP = ("PF 200", "PF 2000")


def ratio(problem: str, label: str) -> float:
    return score_of(problem, label).ratio_to_best.value


def best_on(problem: str) -> str:
    """Return the filter with the smallest error among those that lose no more runs than others."""
    (group,) = [g for g in stored_suite().values() if problem in g.problems]
    rated = [s for s in group.of_role(FILTER) if s.problem == problem and s.word == "best"]
    return rated[0].label


def largest(problems: tuple[str, ...], label: str) -> float:
    return max(ratio(problem, label) for problem in problems)


def test_no_filter_is_the_best_in_general() -> None:
    group = stored_suite()["known"]
    typical = typical_ratios(group)
    assert min(typical, key=lambda label: typical[label]) == "EnKF"
    rest = typical_ratios(group, without_class="chaotic")
    assert min(rest, key=lambda label: rest[label]) == "GPF"


def test_linear() -> None:
    for score in stored_suite()["known"].of_role(FILTER):
        if score.problem == "linear" and score.has_error:
            is_far = score.label in ("EPF", "UPF")
            assert (score.ratio_to_best.value > 2.0) == is_far
            assert is_far or score.ratio_to_best.value < 1.03


def test_mildly_nonlinear() -> None:
    assert largest(("turning-aircraft", "short-range"), "CKF") < 1.05
    assert largest(("turning-aircraft", "short-range", "random-sine"), "EKF, order 2") < 1.2


def test_bearings() -> None:
    assert all(score.ratio_to_best.value < 1.05 for score in scores_of_class("bearings", "CKF"))
    assert score_of("two-bearings", "PF 2000").word == ALIKE


def test_gray_cells() -> None:
    for score in stored_suite()["known"].of_role(FILTER):
        if score.label in ("EPF", "UPF") and score.is_left_out:
            assert "density of the process noise" in score.reason


def test_multimodal() -> None:
    for score in scores_of_class("multimodal", "PF 2000"):
        limit = ratio("two-places", "PF, jitter") + 0.005
        assert (score.ratio_to_best.value > limit) == (score.problem == "banana")
    gaussian = ("EKF", "IEKF", "IPLF", "UKF", "CKF", "GHKF", "EnKF", "EDH", "GPF")
    pair = ("squared", "two-places")
    assert max(largest(pair, label) for label in gaussian) == ratio("two-places", "GPF")
    assert best_on("random-sine") == "PF 2000"
    jittered = scores_of_class("multimodal", "PF, jitter")
    assert len(jittered) == 4
    assert max(score.ratio_to_best.value for score in jittered) == ratio("two-places", "PF, jitter")
    for label in ("CKF", "UKF", "GHKF", "IPLF", "UKF, small alpha"):
        assert ratio("ungm", "EnKF") < ratio("ungm", label)
    assert score_of("two-places", "GPF").word == ALIKE
    others = (label for label in stored_suite()["known"].labels(FILTER) if label != "PF, jitter")
    near = suite_number("near; known; PF, jitter")
    assert near > max(suite_number(f"near; known; {label}") for label in others)


def test_unusual_noise() -> None:
    for label in ("EKF", "CKF", "UKF", "GHKF"):
        assert ratio("stochastic-volatility", label) > 1.5
    for label in ("GPF", "PF 2000"):
        assert ratio("stochastic-volatility", label) < 1.02
        assert ratio("heavy-tailed", label) < 1.02
    for problem in ("heavy-tailed", "heavier-tailed"):
        robust = score_of(problem, "EKF, Student", "settings").ratio_to_best.value
        assert robust < 1.06 < score_of(problem, "EKF", "settings").ratio_to_best.value
    for label in (
        "GPF",
        "PF 200",
        "PF 2000",
        "PF, jitter",
        "RPF",
        "APF",
        "UPF",
        "EPF",
        "CKF",
        "UKF",
    ):
        assert ratio("merwe", label) > max(ratio("merwe", "IEKF"), ratio("merwe", "IPLF"))


def test_the_regularized_filter_diverges() -> None:
    for problem in ("random-sine", "two-bearings", "reentry"):
        assert ratio(problem, "RPF") > 1000.0
    assert fails(score_of("ungm", "UKF, small alpha"))


def test_the_second_order_filter_is_the_ekf_where_the_model_is_linear() -> None:
    for score in stored_suite()["known"].of_role(FILTER):
        if score.label == "EKF, order 2" and score.is_left_out:
            assert "linear" in score.reason


def test_slow_parameter() -> None:
    for problem in ("reentry", "falling-body"):
        for label in BOOTSTRAP:
            assert fails(score_of(problem, label))
        assert fails(score_of("reentry", "PF, jitter"))
        for label in ("CKF", "UKF", "EKF, order 2"):
            assert ratio(problem, label) <= ratio("falling-body", "UKF")


def test_chaotic() -> None:
    enkf = scores_of_class("chaotic", "EnKF")
    assert len(enkf) == 5
    assert not any(map(fails, enkf))
    assert max(score.ratio_to_best.value for score in enkf) == ratio("lorenz63", "EnKF")
    for problem in ("lorenz63", "lorenz63-anderson"):
        assert best_on(problem) == "PF, jitter"
    for label in ("EKF", *BOOTSTRAP):
        assert all(map(fails, scores_of_class("chaotic", label)))
    assert score_of("lorenz96-40", "PF, jitter").collapsed == 1
    gain = {
        problem: score_of(problem, "EnKF", "settings").ratio_to_best.value
        / score_of(problem, "EnKF, inflated", "settings").ratio_to_best.value
        for problem in stored_suite("settings")["chaotic"].problems
    }
    assert max(gain, key=lambda problem: gain[problem]) == "lorenz96"
    inflated = score_of("lorenz96", "EnKF, inflated", "settings")
    assert inflated.word == "best"


def test_angles() -> None:
    assert ratio("double-pendulum-10", "CKF") < 1.15
    for score in stored_suite()["known"].of_role(FILTER):
        if score.problem == "heading":
            is_far = score.label in ("EPF", "UPF")
            assert (score.ratio_to_best.value > 1.2) == is_far
    assert best_on("double-pendulum-100") == "RPF"
    for score in stored_suite()["known"].of_role(FILTER):
        is_last = score.problem == "double-pendulum-100" and score.has_error
        if is_last and score.label not in ("RPF", "PF, jitter"):
            assert score.ratio_to_best.value > 6.0


def test_maneuvers() -> None:
    group = stored_suite()["maneuvers"]
    typical = typical_ratios(group)
    assert min(typical, key=lambda label: typical[label]) == "IMM, CV and CT"
    assert suite_number("near; maneuvers; IMM, CV and CT") == len(group.problems)
    assert best_on("two-turns") == "CKF, CT"


def test_faults() -> None:
    typical = typical_ratios(stored_suite()["faults"])
    assert min(typical, key=lambda label: typical[label]) == "EKF, Student"
    for problem in ("half-burst", "short-burst", "rare", "freeze"):
        assert best_on(problem) in ("EKF, gate .999", "EKF, gate .99")
    assert ratio("burst", "EKF, gate .999") > ratio("burst", "EKF")
    assert best_on("blackout") == "EKF, fading"
    assert ratio("ramp", "EKF") < ratio("ramp", "EKF, Student") < ratio("ramp", "EKF, gate .999")


def test_late_data() -> None:
    for problem in stored_suite()["late"].problems:
        assert ratio(problem, "EKF, refilter") < 1.001
        is_slow = problem == "late-slow"
        assert (ratio(problem, "EKF, apply") < ratio(problem, "EKF, drop")) == is_slow


@pytest.mark.parametrize("seed", [11, 77])
def test_the_advice_holds_at_other_seeds(seed: int) -> None:
    name = f"standard-seed-{seed}"
    assert suite_number("twice; known; CKF", name) >= 17
    for group, label in (("maneuvers", "IMM, CV and CT"), ("faults", "EKF, Student")):
        typical = typical_ratios(stored_suite(name)[group])
        assert min(typical, key=lambda other: typical[other]) == label
    for score in scores_of_class("multimodal", "PF, jitter", name):
        assert score.ratio_to_best.value < 1.1
    bootstrap = score_of("banana", "PF 2000", name).ratio_to_best.value
    assert bootstrap > 2.0 * score_of("banana", "PF, jitter", name).ratio_to_best.value
    for problem in stored_suite(name)["late"].problems:
        assert score_of(problem, "EKF, refilter", name).ratio_to_best.value < 1.001
    chaotic = scores_of_class("chaotic", "EnKF", name)
    assert max(score.ratio_to_best.value for score in chaotic) < 2.05
    assert not any(map(fails, chaotic))


def test_the_advice_holds_at_other_noise() -> None:
    for size in ("half", "double"):
        assert score_of(f"aircraft-{size}", "CKF", "noise").ratio_to_best.value < 1.03
        assert score_of(f"bearings-{size}", "CKF", "noise").ratio_to_best.value < 1.1
        assert score_of(f"ungm-{size}", "PF 2000", "noise").word == "best"


def test_one_run_makes_the_error_of_the_ukf_on_the_measured_cubes() -> None:
    for seed, is_large in (("", True), ("-seed-11", False)):
        score = score_of("lorenz63-cubes", "UKF", f"standard{seed}")
        assert (score.ratio_to_best.value > 10.0) == is_large


def section(heading: str) -> str:
    """Return the text of a section of the page."""
    return PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]


def rows_of_table(text: str) -> list[str]:
    """Return the rows of a table below its head."""
    return [line for line in text.splitlines() if line.startswith("| ")][1:]


def test_the_sentences_are_ten() -> None:
    assert len(rows_of_table(section("Ten sentences that you may have heard"))) == 10


def test_every_problem_but_the_linear_one_is_like_somebodys() -> None:
    rows = rows_of_table(section("Which rows are like my problem?"))
    named = [name for row in rows for name in re.findall("`([^`]+)`", row)]
    listed = {name.rstrip("0123456789-") for name in named}
    for problem in stored_suite()["known"].problems:
        family = problem.split("-")[0] if problem.startswith("lorenz63") else problem
        assert family == "linear" or family.rstrip("0123456789-") in listed, problem
    assert {*named} <= {*stored_suite()["known"].problems}


def test_every_filter_is_explained() -> None:
    table = section("The filters")
    for label in stored_suite()["known"].labels(FILTER):
        assert re.search(rf"^\|[^|]*\b{label}\b", table, re.MULTILINE), label
