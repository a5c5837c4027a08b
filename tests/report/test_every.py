"""Claims about every run and every step: exact shares, and statements about many steps at once."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from tests.commands import ran
from tests.papers import merwe_text
from trackbench import api
from trackbench.config.published_numbers_and_claims import Claim
from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.verdicts.claim_verdicts import judge
from trackbench.statistics import share_of_runs
from trackbench.statistics.claim_rules import weakest
from trackbench.statistics.influential_runs import without_each_batch
from trackbench.verify.verify_folder import verify

CONFIG = """
name: every
runs: 80
block: 40
scenario: MERWE
filters:
  PF: {kind: pf, N: 20}
  UKF: {kind: ukf}
  Exact: {kind: grid, nodes: 40}
  None: {kind: prior-mean}
published: [claims.csv]
metrics: [rmse, log_score, bias]
""".replace("MERWE", merwe_text(T=8))
CLAIMS = """paper,claim,experiment,left,expression,relation,factor,right
p,lower at every step,every,Exact,rmse@3..last,<,1,None
p,lower in every run,every,Exact,"win_rate(rmse, None)",>,0.97,
p,lower at every step than itself,every,Exact,rmse@2..4,<,1,Exact
"""


def test_one_of_many_comparisons_fails_only_beyond_what_chance_gives_of_so_many():
    zs = [-3.2, *[5.0] * 99]
    assert weakest([-3.2]) == -3.2
    assert weakest(zs) == pytest.approx(norm.ppf(100 * norm.cdf(-3.2)))
    assert weakest([-1.0, *zs[1:]]) == pytest.approx(0.0, abs=1e-12)
    assert weakest([3.2, 5.0, 4.0]) == 3.2  # each has to hold: nothing to correct
    assert np.isnan(weakest([np.nan, 1.0, -9.0]))
    assert weakest([-60.0, 1.0]) == pytest.approx(-60.0, abs=0.1)


def test_false_failures_of_many_equal_comparisons_are_rare():
    rng = np.random.default_rng(77)
    zs = rng.standard_normal((4000, 50))
    found = np.array([weakest(row) for row in zs])
    level = norm.cdf(-1.6449)  # a level that 4000 repetitions can see
    share = (found <= -1.6449).mean()
    assert share == pytest.approx(level, abs=4 * np.sqrt(level / 4000))
    assert (zs.min(axis=1) <= -1.6449).mean() > 0.9  # uncorrected


def test_the_grammar_of_many_steps():
    for text in ("rmse@3..last", "win_rate(rmse, PF (N=100))", "ratio(rmse_x@3..7, DE, same)"):
        assert str(measure(text)) == text
    assert str(measure("win_rate(rmse[k<=30], DE, same)").plain) == "rmse[k<=30]"

    def at_each(text, steps):
        return [str(m) for m in measure(text).at_each(steps)]

    assert at_each("rmse@3..last", range(6)) == ["rmse@3", "rmse@4", "rmse@5"]
    assert at_each("minus(rmse@3..4, PF)", range(9)) == [f"minus(rmse@{k}, PF)" for k in (3, 4)]
    assert at_each("mean(rmse)", range(6)) == ["mean(rmse)"]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("every")
    (folder / "claims.csv").write_text(CLAIMS)
    return ran(folder, CONFIG).results


def test_runs_have_shares_of_every_step_of_the_filters_that_are_compared(results):
    def steps(label):
        return {m for f, m in results.runs({}) if f == label and "@" in m}

    assert steps("Exact") == {f"rmse@{k}" for k in range(2, 9)}
    assert steps("None") == {f"rmse@{k}" for k in range(3, 9)}
    assert steps("PF") == steps("UKF") == set()
    assert verify(results.folder, 80) == []


def test_the_weakest_step_decides(results):
    evidence = Evaluator(results, {})
    claim = results.published.claims[0]
    judged = judge(claim, evidence)
    zs = {
        k: -evidence.difference(
            measure(f"rmse@{k}").of("Exact"), measure(f"rmse@{k}").of("None")
        ).z()
        for k in range(3, 9)
    }
    least = min(zs, key=zs.__getitem__)
    assert judged.verdict.z == zs[least] > 0
    assert judged.paired
    assert len(judged.verdict.parts) == 4
    assert f"at step {least}; " in judged.note
    asked = measure("rmse@3..last")
    turned = judge(
        Claim(paper="p", claim="c", left="None", expression=asked, right="Exact"), evidence
    )
    assert turned.verdict.z == pytest.approx(weakest([-z for z in zs.values()]))


def test_a_claim_against_several_filters_fails_beyond_what_chance_gives_of_so_many(results):
    evidence = Evaluator(results, {})
    claim = Claim(paper="p", claim="c", left="UKF", expression=measure("mean(rmse)"), right="Exact")
    alone = judge(claim, evidence).verdict
    assert alone.z < -5.0
    among_three = judge(replace(claim, right="Exact;PF;None"), evidence).verdict
    assert among_three.z == pytest.approx(norm.ppf(3.0 * norm.cdf(alone.z)))
    for one, three in zip(alone.parts, among_three.parts, strict=True):
        assert three == pytest.approx(norm.ppf(3.0 * norm.cdf(one)))


def test_the_better_of_two_runs_has_the_higher_score_or_the_smaller_bias(results):
    runs = results.runs({})
    better = {
        "log_score": runs["UKF", "log_score"] > runs["PF", "log_score"],
        "bias": np.abs(runs["UKF", "bias"]) < np.abs(runs["PF", "bias"]),
    }
    evaluator = Evaluator(results, {})
    for name, is_better in better.items():
        term = evaluator.term(measure(f"win_rate({name}, PF)").of("UKF"))
        assert term.value == is_better.sum() / 80
        assert term.value != 1.0 - is_better.sum() / 80  # no test if as many are better as worse


def test_a_share_of_runs(results):
    runs = results.runs({})
    term = Evaluator(results, {}).term(measure("win_rate(rmse, None)").of("Exact"))
    lower = int((runs["Exact", "rmse"] < runs["None", "rmse"]).sum())
    assert (term.value, term.runs, term.has_influences) == (lower / 80, 80, True)
    assert term.z(0.9) == share_of_runs.share_z(lower, 80, 0.9)
    assert term.interval() == share_of_runs.share_interval(lower, 80)
    judged = judge(results.published.claims[1], Evaluator(results, {}))
    assert judged.verdict.z == share_of_runs.share_z(lower, 80, 0.97)
    rest = without_each_batch(term, 4)[0]
    lower = int((runs["Exact", "rmse"] < runs["None", "rmse"])[20:].sum())
    assert (rest.value, rest.runs) == (pytest.approx(lower / 60), 60)
    assert rest.z(0.9) == share_of_runs.share_z(lower, 60, 0.9)
    assert judged.verdict.parts[0] == share_of_runs.share_z(lower, 60, 0.97)


def test_what_is_the_same_at_every_step_is_not_decided(results):
    judged = judge(results.published.claims[2], Evaluator(results, {}))
    assert judged.verdict.word == "inconclusive"
    assert np.isnan(judged.verdict.z)


def test_steps_that_nothing_is_known_of_are_not_measured(results):
    claim = Claim(
        paper="p", claim="c", left="Exact", expression=measure("rmse@99..last"), right="None"
    )
    judged = judge(claim, Evaluator(results, {}))
    assert judged.verdict.word == "not measured"
    assert "nothing is known of Exact's rmse@99..last" in judged.note


NUMBER = "paper,table,filter,metric,value,label,expression\np,t,f,m,1,PF,rmse@3..last\n"
UNEQUAL = """paper,claim,left,expression,right,right_expression
p,c,PF,rmse@3..last,UKF,rmse@4..last
"""


@pytest.mark.parametrize(
    ("text", "what"),
    [(NUMBER, "is no number: name one step"), (UNEQUAL, "is not at the steps of 'rmse@3..last'")],
)
def test_steps_that_cannot_be_compared_are_said(tmp_path, text, what):
    (tmp_path / "c.yaml").write_text(CONFIG)
    (tmp_path / "claims.csv").write_text(text)
    with pytest.raises(UserError, match=what):
        api.prepare(tmp_path / "c.yaml", api.Options())
