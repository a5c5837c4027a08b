"""Standard problems: versions and digests, their listing, and your own filter beside the others."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests import problems
from tests.commands import trackbench
from tests.conftest import EXPERIMENTS, shipped
from trackbench.config import shipped_experiments
from trackbench.config.dump import resolved
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.execution.cache import block_key
from trackbench.execution.plan import make_plan

NAMES = problems.names()


@pytest.mark.parametrize("name", NAMES)
def test_a_change_raises_the_version(name: str) -> None:
    known, there = problems.read()
    assert problems.stored(name, known) == there[name], (
        f"{name} has changed: raise `version` in experiments/{name}.yaml, and run python -m tests.problems "
        "(alone where no number moves)"
    )


def test_the_digest_sees_what_moves_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    known, _ = problems.read()
    before = problems.stored("bearings-two", known).digest

    def digest_with(*words: str) -> str:
        changed = load(EXPERIMENTS / "bearings-two.yaml", words)
        mark = shipped("bearings-two").settings.problem  # which a changed scenario takes away
        changed = replace(changed, settings=replace(changed.settings, problem=mark))
        monkeypatch.setattr(problems, "shipped", lambda name: changed)
        return problems.stored("bearings-two", known).digest

    for change in ("seed=1", "runs=999", "scenario.sensor.R=0.0026", "filters.UKF.alpha=0.4"):
        assert digest_with(change) != before, change
    assert digest_with("filters.mine={kind: ekf}") != before
    for same in ("title=Another", "metrics=[rmse_position, nees, nis]", "figures={}", "runs=1000"):
        assert digest_with(same) == before, same


def test_young_keys_with_their_defaults_change_nothing() -> None:
    data, source = {"kind": "ekf", "young": 0, "old": 1}, {"kind": "ekf"}
    assert problems.without_young_keys(data, source, {"old"}) == {"kind": "ekf", "old": 1}
    source |= {"young": 0}
    assert "young" in problems.without_young_keys(data, source, {"old"})


def test_the_version_is_in_no_key_and_in_the_config() -> None:
    problem = shipped("nile")
    other = replace(problem, settings=replace(problem.settings, problem=None))
    keys = [[block_key(t, 0) for t in make_plan(e).unique] for e in (problem, other)]
    assert keys[0] == keys[1]
    assert resolved(problem, Path())["problem"] == {"version": 1, "reference": "KF"}
    assert "problem" not in resolved(other, Path())


def test_changed_problems_are_others() -> None:
    path = EXPERIMENTS / "nile.yaml"
    assert load(path, ["title=Another"], seed=3).settings.problem is not None
    assert load(path, ["scenario.sensor.R=15000"]).settings.problem is None
    assert load(path, grid=["scenario.sensor.R=15000,15100"]).settings.problem is None
    with pytest.raises(UserError, match="problem.version: 0 is less than 1"):
        load(path, ["problem.version=0"])
    with pytest.raises(
        UserError, match="problem.reference: 'KFF' is not a filter here; did you mean KF"
    ):
        load(path, ["problem.reference=KFF"])


def test_the_list_of_problems() -> None:
    done = trackbench("list", "problems")
    assert done.returncode == 0, done.stderr
    listed = {problem.name: problem for problem in shipped_experiments.problems()}
    assert len(listed) >= 21
    for name, one in listed.items():
        settings, published = shipped(name).settings, shipped(name).published.numbers
        mark = settings.problem
        assert mark is not None and one.version == mark.version
        assert one.reference == (mark.reference or settings.reference or settings.bound or "")
        rows = [row for row in published if row.label and not isinstance(row.value, str)]
        assert one.numbers == len({row.printed_at for row in rows})
        assert f"  {name} " in done.stdout and one.title in done.stdout
    marked = {p.stem for p in EXPERIMENTS.glob("*.yaml") if shipped(p.stem).settings.problem}
    assert marked == listed.keys()
