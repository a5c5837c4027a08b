"""Standard problems: versions and digests, their listing, and your own filter beside the others."""

import csv
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import problems
from tests.commands import trackbench
from tests.conftest import EXPERIMENT_FILES, PLANE, plugins_forgotten, shipped
from trackbench.config import shipped_problems
from trackbench.config.load import load
from trackbench.config.resolved_config import resolved
from trackbench.errors import UserError
from trackbench.execution.block_key import block_key
from trackbench.execution.plan import make_plan

NAMES = problems.names()
EKF = """from dataclasses import dataclass
from trackbench.filters.ekf import EKF
from trackbench.registry import register
"""
CLASS = """

@register("filters", "{kind}")
@dataclass(frozen=True, kw_only=True)
class {name}(EKF):
    {key}
"""


def filter_file(folder: Path, name: str, *kinds: str, key: str = '"""An EKF."""') -> Path:
    """Write a file of filters of these kinds."""
    path = folder / name
    classes = (CLASS.format(kind=kind, name=f"F{i}", key=key) for i, kind in enumerate(kinds))
    path.write_text(EKF + "".join(classes))
    return path


@pytest.mark.parametrize("name", NAMES)
def test_a_change_raises_the_version(name: str) -> None:
    known, there = problems.read()
    assert problems.stored(name, known) == there[name], (
        f"{name} has changed: raise `version` in {name}.yaml, and run "
        "python -m tests.problems (alone where no number moves)"
    )


def test_the_digest_sees_what_moves_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    known, _ = problems.read()
    before = problems.stored("bearings-two", known).digest

    def digest_with(*words: str) -> str:
        changed = load(EXPERIMENT_FILES["bearings-two"], words)
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
    path = EXPERIMENT_FILES["nile"]
    assert load(path, ["title=Another"], seed=3).settings.problem is not None
    assert load(path, ["scenario.sensor.R=15000"]).settings.problem is None
    assert load(path, grid=["scenario.sensor.R=15000,15100"]).settings.problem is None
    with pytest.raises(UserError, match=r"problem\.version: 0 is less than 1"):
        load(path, ["problem.version=0"])
    with pytest.raises(UserError, match=r"problem\.reference: 'KFF' is not a filter here"):
        load(path, ["problem.reference=KFF"])


def test_the_list_of_problems() -> None:
    done = trackbench("list", "problems")
    assert done.returncode == 0, done.stderr
    listed = {problem.name: problem for problem in shipped_problems.problems()}
    assert len(listed) >= 21
    for name, one in listed.items():
        settings, published = shipped(name).settings, shipped(name).published.numbers
        mark = settings.problem
        assert mark is not None
        assert one.version == mark.version
        assert one.reference == (mark.reference or settings.reference or settings.bound or "")
        rows = [row for row in published if row.label and not isinstance(row.value, str)]
        assert one.numbers == len({row.printed_at for row in rows})
        assert f"  {name} " in done.stdout
        assert one.title in done.stdout
    marked = {name for name in EXPERIMENT_FILES if shipped(name).settings.problem}
    assert marked == listed.keys()


def test_a_filter_of_yours_stands_beside_the_others(tmp_path: Path) -> None:
    filter_file(tmp_path, "mine.py", "my-ekf")
    words = ("run", "car-track", "--workers", "1", "--format", "svg")
    done = trackbench(*words, "--filter", "mine.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "results in results/car-track-with-mine/" in done.stderr
    assert done.stdout.startswith("trackbench/car-track v1, 1 run: ranking by position RMSE")
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("my-ekf "))
    assert line.split()[1:3] == ["0.4254", "1.6"]
    assert "trackbench/car-track v1" in (
        tmp_path / "results" / "car-track-with-mine" / "report.html"
    ).read_text(encoding="utf-8")
    # The results of the problem itself stay, with the same numbers.
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["car-track-with-mine"]
    assert trackbench(*words, cwd=tmp_path).returncode == 0
    alone, beside = (
        (tmp_path / "results" / name / "summary.csv").read_text().splitlines()
        for name in ("car-track", "car-track-with-mine")
    )
    assert [line for line in beside if not line.startswith("my-ekf,")] == alone


def test_the_rank_is_that_of_the_runs(tmp_path: Path) -> None:
    filter_file(tmp_path, "mine.py", "fixed", key='"""An EKF."""\n    fading: float = 1.5')
    config = (
        "name: plane\nruns: 200\nseed: 4\nproblem: {version: 3}\nbound: PCRLB\n"
        + PLANE
        + "filters:\n  KF: {kind: kf}\n  Bad: {kind: ekf, fading: 4}\n  S: {kind: kf, smooth: true}\n"
    )
    (tmp_path / "plane.yaml").write_text(config)
    done = trackbench(
        *("run", "plane.yaml", "--workers", "1", "--format", "svg", "--filter", "mine.py"),
        *("--out", "out"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out" / "per_run.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["metric"] == "rmse_position"]
    runs = {
        label: np.array([float(row["value"]) for row in rows if row["filter"] == label])
        for label in ("KF", "Bad", "S", "fixed")
    }
    with (tmp_path / "out" / "summary.csv").open(newline="") as file:
        rms = {r["filter"]: float(r["value"]) for r in csv.DictReader(file)
               if r["metric"] == "rms(rmse_position)"}  # fmt: skip
    title, _, _, *lines = done.stdout.splitlines()
    assert title.startswith("trackbench/plane v3, 200 runs: ranking by position RMSE")
    places = {label: i for i, line in enumerate(lines) for label in line.split()[:1]}
    shown = ["S", "KF", "fixed", "Bad", "PCRLB"]
    assert sorted(shown, key=places.__getitem__) == sorted(shown, key=rms.__getitem__)
    # The ratio of the rms errors of the default table, its error by leaving out each run in turn.
    assert rms["S"] < rms["KF"] < rms["fixed"] < rms["Bad"]
    ratio = re.search(r" (\S+) x \((\S+) to (\S+)\)", lines[places["fixed"]])
    assert ratio is not None
    value, low, high = map(float, ratio.groups())
    assert value == pytest.approx(rms["fixed"] / rms["S"], rel=0.02)
    left_out = [
        np.sqrt((np.delete(runs["fixed"], i) ** 2).mean() / (np.delete(runs["S"], i) ** 2).mean())
        for i in range(200)
    ]
    assert high - low == pytest.approx(2 * 1.972 * np.sqrt(199 * np.var(left_out)), rel=0.1)
    assert float(lines[places["PCRLB"]].split()[2]) == pytest.approx(rms["PCRLB"], rel=1e-3)


def test_added_filters_are_shown_and_set(tmp_path: Path) -> None:
    file = filter_file(tmp_path, "mine.py", "my-a", "my-b")

    def loaded(name: str, *words: str, **keys: Any) -> Any:
        with plugins_forgotten():
            return load(EXPERIMENT_FILES[name], words, filter_files=[file], **keys)

    lorenz = loaded("lorenz63", "filters.my-a.fading=1.2")
    assert [*lorenz.points[0].filters][-2:] == ["my-a", "my-b"]
    assert lorenz.points[0].filters["my-a"].fading == 1.2
    assert lorenz.figures["x"].filters[-2:] == ("my-a", "my-b")
    assert lorenz.settings.problem is not None
    assert [plugin.path for plugin in lorenz.plugins] == [str(file)]
    assert [*loaded("nile", only=["KF"]).points[0].filters] == ["KF", "my-a", "my-b"]
    assert loaded("lorenz63", "filters.EKF.fading=1.2").settings.problem is None


@pytest.mark.parametrize(
    ("name", "text", "what"),
    [
        ("none.py", None, "none.py: no such file or directory"),
        ("mine.yaml", "",
         "is neither the path of a Python file nor of a program that can be executed; "
         "`trackbench new filter NAME` writes one"),
        ("mine.py", "x = 1\n", "registers no filter; `trackbench new filter NAME` writes one"),
        ("mine.py", "1 / 0\n", "mine.py:1: ZeroDivisionError: division by zero"),
        ("mine.py", EKF + CLASS.format(kind="needs", name="A", key='q: float\n    """q"""'),
         "filters.needs.q: this key is required"),
        ("mine.py", EKF + CLASS.format(kind="KF", name="A", key='"""An EKF."""'),
         "'KF' is already the label of a filter; give this one another kind or file name"),
        ("mine.py", EKF + CLASS.format(kind="ekf", name="A", key='"""An EKF."""'),
         "filters kind 'ekf' is already taken by trackbench.filters.ekf"),
    ],
)  # fmt: skip
def test_a_file_without_a_usable_filter(
    tmp_path: Path, name: str, text: str | None, what: str
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    done = trackbench("run", "nile", "--filter", name, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"--filter {name}: ")
    assert done.stderr.endswith(f"{what}\n")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "results").exists()
