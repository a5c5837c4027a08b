"""Hooks: declared by a base, told by `describe`, and a name that is nearly one is a mistake."""

import ast
import pickle
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trackbench
from trackbench import registry
from trackbench.contract import check_file
from trackbench.core.distributions import Gaussian
from trackbench.errors import UserError
from trackbench.execution.code_digests import foreign_code
from trackbench.filters.base import Filter
from trackbench.filters.kf import KF
from trackbench.help.descriptions import description, help_texts
from trackbench.plugin_class_hooks import InvalidHookError, hooks, mistakes, rebase
from trackbench.registry import GROUPS, Group, base_of, kinds, register


@pytest.fixture(autouse=True)
def _nothing_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    for group in GROUPS:
        monkeypatch.setitem(registry._kinds, group, dict(kinds(group)))


@pytest.mark.parametrize("group", GROUPS)
def test_every_hook_has_a_text_and_is_told(group: Group) -> None:
    told, known = description(group), hooks(base_of(group))
    assert known
    for hook in known:
        assert hook.text, hook.form
        assert f"  {hook.form} " in told


@pytest.mark.parametrize("group", GROUPS)
def test_every_kind_stands_on_its_base(group: Group) -> None:
    assert all(issubclass(cls, base_of(group)) for cls in kinds(group).values())


@pytest.mark.parametrize("group", GROUPS)
def test_our_own_kinds_have_no_mistaken_hook(group: Group) -> None:
    """They are not looked through when the program starts."""
    own = [cls for cls in kinds(group).values() if cls.__module__.startswith("trackbench.")]
    assert own
    assert [found for cls in own for found in mistakes(cls, base_of(group))] == []


def test_no_hook_is_looked_up_by_its_name() -> None:
    """So that one that is misspelt cannot be passed over in silence."""
    names = {hook.form.partition("(")[0] for g in GROUPS for hook in hooks(base_of(g))}
    for path in Path(trackbench.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in (
                "getattr",
                "hasattr",
            ):
                name = node.args[1]
                assert not (isinstance(name, ast.Constant) and name.value in names), path


class Own:
    """A filter that knows nothing of a base."""

    def init(self, model: Any, prior: Any, rng: Any) -> Gaussian:
        n, runs = prior.mean.shape
        return Gaussian(prior.mean, np.ones((n, n, runs)))

    def step(self, model: Any, state: Gaussian, z: Any, k: int, rng: Any) -> Gaussian:
        return state

    def estimate(self, state: Gaussian) -> Gaussian:
        return state


@register("filters", "test-plain")
@dataclass(frozen=True, kw_only=True)
class Plain(Own):
    """As it stands in a file of one's own."""

    N: int
    """how many"""
    scale: float = 2.0
    """of what"""
    summed_diagnostics = frozenset({"mine"})


def test_a_class_without_the_base_is_put_on_it() -> None:
    one: Any = Plain(N=7)
    assert isinstance(one, Filter)
    assert one.diagnostics(None) == {} == one.conflicts(None)
    assert (one.summed_diagnostics, one.requires) == ({"mine"}, ())
    assert one.particle_count == one.max_particle_count == 7
    assert [f.name for f in fields(one)] == ["N", "scale"]
    assert help_texts(Plain) == {"N": "how many", "scale": "of what"}
    assert (Plain.__name__, Plain.__doc__) == ("Plain", "As it stands in a file of one's own.")
    assert pickle.loads(pickle.dumps(one)) == one != Plain(N=8)
    assert hash(one) == hash(Plain(N=7))
    assert set(foreign_code(Plain)) != set() == set(foreign_code(KF))


def test_a_key_without_a_default_may_be_named_like_a_hook() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Counted(Own):
        particle_count: int

    assert rebase(Counted, Filter)(particle_count=3).particle_count == 3

    @dataclass(frozen=True, kw_only=True)
    class Inherits(Own, Filter[Gaussian]):  # type: ignore[misc]
        particle_count: int

    with pytest.raises(InvalidHookError, match=r"the key `particle_count` is a hook, too"):
        rebase(Inherits, Filter)


FILE = """
from dataclasses import dataclass
from trackbench.registry import register


@register("GROUP", "mine")
@dataclass(frozen=True)
class Mine:
    def NAME(self):
        return None
"""


@pytest.mark.parametrize(
    ("group", "name", "expected"),
    [
        ("filters", "diagnostic", "`diagnostic` is no hook; did you mean `diagnostics`?"),
        ("filters", "max_particle_count", "`max_particle_count` is no method"),
        ("scenarios", "bound", "`bound` is no hook; did you mean `bounds`?"),
        ("scenarios", "run_metric", "`run_metric` is no hook; did you mean `run_metrics`?"),
        ("targets", "span", "`span` is no hook; did you mean `spans`?"),
        ("motions", "sample", "`sample` is no hook; did you mean `sampled`?"),
        ("sensors", "locate", "`locate` is no hook; did you mean `located`?"),
        ("starts", "scan", "`scan` is no hook; did you mean `scans`?"),
        ("figures", "shown_run", "`shown_run` is no hook; did you mean `shown_runs`?"),
        ("tables", "conflict", "`conflict` is no hook; did you mean `conflicts`?"),
    ],
)
def test_a_name_that_is_nearly_a_hook(
    tmp_path: Path, group: Group, name: str, expected: str
) -> None:
    """Each mistake is a line with its place; what the base asks for is missing besides."""
    path = tmp_path / "mine.py"
    path.write_text(FILE.replace("GROUP", group).replace("NAME", name))
    with pytest.raises(UserError) as caught:
        check_file(path)
    said = str(caught.value).splitlines()
    needed = [hook.form.partition("(")[0] for hook in hooks(base_of(group)) if hook.needed]
    for line, missing in zip(said, sorted(needed), strict=False):
        assert line == f"{path}:8: Mine has no `{missing}`"
    assert said[len(needed)].startswith(f"{path}:9: {expected}")
    assert len(said) == len(needed) + 1
    assert "mine" not in kinds(group)
