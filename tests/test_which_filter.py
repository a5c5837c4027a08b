"""The words of docs/which-filter.md follow from the stored scores; `tests.prose` ties its numbers."""

import re

import pytest

from tests.conftest import ROOT
from tests.suite_scores import score_of, scores_of_class, stored_suite, suite_number
from trackbench.report.suite.scores import FILTER, typical_ratios
from trackbench.report.suite.tables import fails

PAGE = (ROOT / "docs" / "which-filter.md").read_text(encoding="utf-8")
SIMILAR = ("IPLF", "EnKF", "CKF")
BOOTSTRAP = ("PF 200", "PF 2000")


def ratio(problem: str, label: str) -> float:
    return score_of(problem, label).ratio_to_best.value


def best_on(problem: str) -> str:
    """Return the filter with the smallest error among those that lose no more runs than others."""
    (group,) = [g for g in stored_suite().values() if problem in g.problems]
    rated = [s for s in group.of_role(FILTER) if s.problem == problem and s.word == "best"]
    return rated[0].label


def test_no_one_of_three_is_the_best_in_general() -> None:
    group = stored_suite()["known"]
    typical = typical_ratios(group)
    assert sorted(typical, key=lambda label: typical[label])[:3] == [*SIMILAR]
    orders = set()
    for name in dict.fromkeys(group.classes.values()):
        rest = typical_ratios(group, without_class=name)
        orders.add(tuple(sorted(SIMILAR, key=lambda label: rest[label])))
    assert len(orders) > 1


def test_linear() -> None:
    for score in stored_suite()["known"].of_role(FILTER):
        if score.problem == "linear" and score.has_error:
            few = score.label in ("EPF", "UPF")
            assert (score.ratio_to_best.value > 2.0) == few
            assert few or score.ratio_to_best.value < 1.03


def test_mildly_nonlinear() -> None:
    for label in ("CKF", "GHKF"):
        for score in scores_of_class("mildly nonlinear", label):
            assert score.ratio_to_best.value < 1.6
    assert best_on("random-sine") == "EKF, order 2"


def test_bearings() -> None:
    for label in ("EKF", "CKF"):
        assert all(score.ratio_to_best.value < 1.1 for score in scores_of_class("bearings", label))


def test_multimodal() -> None:
    assert best_on("ungm") == "PF 2000"
    for label in ("CKF", "UKF", "GHKF", "IPLF"):
        assert ratio("ungm", "EnKF") < ratio("ungm", label)
    assert ratio("banana", "UKF") < 1.005
    assert ratio("banana", "PF 2000") > 2.0
    assert score_of("banana", "PF 2000").collapsed
    assert ratio("squared", "EKF") == 1.0


def test_unusual_noise() -> None:
    assert best_on("heavy-tailed") == "GPF"
    assert ratio("stochastic-volatility", "GPF") < 1.01
    particles = ("GPF", "PF 200", "PF 2000", "RPF", "APF", "UPF", "EPF")
    for label in particles:
        assert ratio("merwe", label) > max(ratio("merwe", "IEKF"), ratio("merwe", "IPLF"))
        assert score_of("merwe", label).collapsed


def test_singular_noise() -> None:
    for problem in ("reentry", "falling-body"):
        for label in BOOTSTRAP:
            assert fails(score_of(problem, label))
        for label in ("CKF", "UKF", "GHKF", "IPLF"):
            assert ratio(problem, label) < 1.03


def test_chaotic() -> None:
    enkf = scores_of_class("chaotic", "EnKF")
    assert len(enkf) == 5
    for label in stored_suite()["known"].labels(FILTER):
        if label != "EnKF":
            others = scores_of_class("chaotic", label)
            assert max(score.limited_ratio for score in others) > ratio("lorenz96", "EnKF")
    assert max(score.ratio_to_best.value for score in enkf) == ratio("lorenz96", "EnKF")
    assert not any(map(fails, enkf))
    for label in ("EKF", *BOOTSTRAP):
        assert all(map(fails, scores_of_class("chaotic", label)))


def test_angles() -> None:
    assert best_on("double-pendulum-10") == "GPF"
    assert best_on("double-pendulum-100") == "RPF"
    for score in stored_suite()["known"].of_role(FILTER):
        if score.problem == "double-pendulum-100" and score.has_error and score.label != "RPF":
            assert score.ratio_to_best.value > 5.0


def test_maneuvers() -> None:
    group = stored_suite()["maneuvers"]
    typical = typical_ratios(group)
    assert min(typical, key=lambda label: typical[label]) == "IMM, CV and CT"
    assert suite_number("near; maneuvers; IMM, CV and CT") == len(group.problems)


def test_faults_and_late_data() -> None:
    typical = typical_ratios(stored_suite()["faults"])
    assert min(typical, key=lambda label: typical[label]) == "EKF, Student"
    gates = ("EKF, gate .999", "EKF, gate .99")
    assert best_on("freeze") in gates
    assert ratio("burst", "EKF, gate .999") > ratio("burst", "EKF")
    for problem in stored_suite()["late"].problems:
        assert ratio(problem, "EKF, apply") > ratio(problem, "EKF, drop")
        assert ratio(problem, "EKF, refilter") < 1.001


@pytest.mark.parametrize("label", ["GPF", "RPF"])
def test_spread_particles_fail_less_often_than_the_bootstrap_filter(label: str) -> None:
    assert suite_number(f"fails; known; {label}") < suite_number("fails; known; PF 2000")


@pytest.mark.parametrize("seed", [11, 77])
def test_the_advice_holds_at_other_seeds(seed: int) -> None:
    name = f"standard-seed-{seed}"
    assert suite_number("near; known; CKF", name) >= 12
    for group, label in (("maneuvers", "IMM, CV and CT"), ("faults", "EKF, Student")):
        typical = typical_ratios(stored_suite(name)[group])
        assert min(typical, key=lambda other: typical[other]) == label
    for problem in ("ungm", "heavy-tailed", "stochastic-volatility"):
        gpf = score_of(problem, "GPF", name).ratio_to_best.value
        assert gpf < 1.05 < score_of(problem, "CKF", name).ratio_to_best.value
    for problem in stored_suite(name)["late"].problems:
        assert score_of(problem, "EKF, refilter", name).ratio_to_best.value < 1.001
        assert score_of(problem, "EKF, drop", name).ratio_to_best.value > 1.1
    chaotic = scores_of_class("chaotic", "EnKF", name)
    assert max(score.ratio_to_best.value for score in chaotic) < 2.05
    assert not any(map(fails, chaotic))


def test_the_advice_holds_at_other_noise() -> None:
    for size in ("half", "double"):
        aircraft = score_of(f"aircraft-{size}", "CKF", "noise").ratio_to_best.value
        assert aircraft < 1.03
        assert score_of(f"bearings-{size}", "EKF", "noise").word == "best"
        assert score_of(f"ungm-{size}", "PF 2000", "noise").word == "best"
    assert score_of("aircraft-half", "GPF", "noise").collapsed


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


def test_smoothers_and_iteration() -> None:
    assert best_on("two-turns") == "CKF, CT"
    assert all(map(fails, scores_of_class("chaotic", "EKF")))
