"""Every field of a block's task is part of its key, or stands here with the reason why not."""

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from tests.papers import maneuver, merwe
from trackbench.config.component_as_config import as_config
from trackbench.config.file_paths import file_keys
from trackbench.config.load import load
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution import arithmetic_digests
from trackbench.execution.block_key import block_key
from trackbench.execution.plan import make_plan
from trackbench.filters.adaptive_kf.adaptive_kf_and_vdf import AdaptiveKF
from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import Detector, SecondDecision
from trackbench.filters.bootstrap_pf import PF
from trackbench.filters.imm import IMM
from trackbench.filters.kf import KF
from trackbench.models.assume import Assume
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.models.motions.merwe_sine_gamma import SineGamma
from trackbench.registry import kinds
from trackbench.scenarios.targets.legs import Leg
from trackbench.tuning.tuner import Training

TASK = BlockTask(merwe(T=4, R=0.1), PF(N=4), seed=1, index=1, width=3, runs_used=2, reference=KF())
SHOWN = replace(TASK, runs_with_tracks=4, keep_covariance=True)
LEGS = maneuver(legs=(Leg(start=40, end=80, ax=0.3),))
CV, CA = ConstantVelocity(q=0.0), ConstantAcceleration(q=1e-4)
NESTED = (
    IMM(motions=(CV, CA), transition=((0.9, 0.1), (0.1, 0.9))),
    AdaptiveKF(nmf=CV, mf=CA, detector=Detector(eta=9.0), dlw=SecondDecision(n=5)),
)
OTHERS: dict[str, Any] = {
    "scenario": merwe(T=4, R=0.2),
    "filter": PF(N=5),
    "reference": PF(N=6),
    "assume": Assume(motion=SineGamma()),
    "reference_assume": Assume(motion=SineGamma()),
    "index": 2,
    "width": 4,
    "runs_used": 1,
    "runs_with_tracks": 5,
    "keep_covariance": False,
}
"""Another value of a field; of all others a word, which no code takes for a value."""
NO_KEY = {
    "extra_run_counts": "a block that is reduced over other runs, too, is kept under their key",
    "stacked": "a block has the same numbers beside others",
    "copies": "a block has the same numbers beside others",
}
SAME_ESTIMATES = {
    "runs_used": "the filter runs on the whole block",
    "reference": "has estimates of its own",
    "reference_assume": "has estimates of its own",
    "runs_with_tracks": "what is kept of the estimates",
    "keep_covariance": "what is kept of the estimates",
    "keep_steps": "what is kept of the estimates",
    "extra_run_counts": "over which runs the estimates are reduced",
}
SAME_OF_REFERENCE = {
    **{name: why for name, why in SAME_ESTIMATES.items() if "reference" not in name},
    "filter": "the reference is another filter",
    "assume": "the reference is exact: it assumes the scenario's own model",
}
NOT_OF_TRAINING = {
    "runs_with_tracks": "no tracks of training runs are kept",
    "keep_covariance": "no tracks of training runs are kept",
    "keep_steps": "only numbers per run are kept",
    "extra_run_counts": "a trial has a fixed number of runs",
}
NAMES = [field.name for field in fields(BlockTask)]
MODELS = ("filters", "scenarios", "targets", "motions", "sensors", "starts")
CONFIG = """
name: all
runs: 7
block: 4
seed: 3
hold_out: 3
reference: KF
medians: [squared_position]
metrics: [log_score, rmsd_position]
scenario:
  kind: tracking
  last: 9
  target: {kind: driven, motion: {kind: cwna, q: 0.5}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
filters:
  KF: {kind: kf}
  Mine: {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}
  PF: {kind: pf, N: 9}
tune: {Mine: {assume.motion.q: log:1e-3..10}}
tuning: {runs: 6, metric: mean(rmsd_position)}
"""


def changed(part: Any, name: str, value: Any = "another") -> Any:
    """A part with another value of one field, whether its class would take it or not."""
    other = object.__new__(type(part))
    other.__dict__.update({**part.__dict__, name: value})
    return other


def varied(part: Any) -> Iterator[tuple[str, Any]]:
    """A part with one field of it, or of a part in it, changed; for each the path of the field."""
    for field in fields(part):
        value = getattr(part, field.name)
        yield field.name, changed(part, field.name)
        for path, inner in varied(value) if is_dataclass(value) else ():
            yield f"{field.name}.{path}", changed(part, field.name, inner)
        for i, item in enumerate(value) if isinstance(value, tuple) else ():
            for path, inner in varied(item) if is_dataclass(item) else ():
                items = (*value[:i], inner, *value[i + 1 :])
                yield f"{field.name}.{i}.{path}", changed(part, field.name, items)


@pytest.mark.parametrize("name", NAMES)
def test_another_value_of_a_field_is_another_key(name: str) -> None:
    task = SHOWN if name == "keep_covariance" else TASK
    other = replace(task, **{name: OTHERS.get(name, "another")})
    same = block_key(other, other.runs_used) == block_key(task, task.runs_used)
    assert same == (name in NO_KEY)
    if name not in ("stacked", "copies"):  # of a stack, which is no task of a plan
        assert (other == task) == same  # equal tasks are computed once


def test_the_runs_that_a_block_is_reduced_to_are_part_of_its_key() -> None:
    assert (
        block_key(TASK, 1)
        != block_key(TASK, 2)
        == block_key(replace(TASK, extra_run_counts=(1,)), 2)
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_field_that_changes_the_estimates_has_estimates_of_its_own(name: str) -> None:
    other = replace(TASK, **{name: OTHERS.get(name, "another")})
    if name == "scenario":
        assert (other.filtering_task, other.reference_task) != (
            TASK.filtering_task,
            TASK.reference_task,
        )
        return
    assert (other.filtering_task == TASK.filtering_task) == (name in SAME_ESTIMATES)
    assert (other.reference_task == TASK.reference_task) == (name in SAME_OF_REFERENCE)


def test_the_reference_has_the_task_that_it_has_among_the_filters() -> None:
    asked = replace(TASK, predictive_metrics=("score", "likelihood_ratio"))
    own = replace(asked, filter=KF(), reference=None)
    assert asked.reference_task == own.filtering_task


@pytest.mark.parametrize("group", MODELS)
def test_every_field_of_every_kind_is_in_its_config_and_tells_parts_apart(group: Any) -> None:
    """A part's digest is made of its config, and equal parts share it."""
    for kind, cls in kinds(group).items():
        part = object.__new__(cls)
        part.__dict__["_content"] = "of the files"
        for field in fields(cls):
            made = field.default_factory() if field.default_factory is not MISSING else "given"
            part.__dict__[field.name] = made if field.default is MISSING else field.default
        for path, other in varied(part):
            assert as_config(other) != as_config(part), f"{kind}: {path} is not in the config"
            assert other != part or path in file_keys(cls), (
                f"{kind}: {path} does not tell parts apart"
            )
        # Of files the content counts, whatever their paths.
        assert not file_keys(cls) or changed(part, "_content") != part, kind


def test_every_field_within_a_task_is_part_of_its_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        arithmetic_digests, "uses_numpy_arithmetic", lambda part: False
    )  # which makes the model
    (tmp_path / "all.yaml").write_text(CONFIG)
    planned = make_plan(load(tmp_path / "all.yaml")).tasks[0, "Mine"][0]
    within: set[str] = set()
    for task in (planned, *(replace(planned, scenario=LEGS, filter=made) for made in NESTED)):
        keys = {"": block_key(task, task.runs_used)}
        for name in ("scenario", "filter", "reference", "assume"):
            for path, other in varied(getattr(task, name)):
                keys[f"{name}.{path}"] = block_key(replace(task, **{name: other}), task.runs_used)
        paths = {key: path for path, key in keys.items()}
        assert len(paths) == len(keys), [path for path, key in keys.items() if paths[key] != path]
        within |= keys.keys()
    assert within > {
        *("scenario.target.motion.q", "scenario.target.legs.0.ax", "scenario.score.train"),
        *("assume.motion.q", "filter.motions.1.q", "filter.detector.eta", "filter.dlw.n"),
    }


def test_a_plan_fills_in_every_field(tmp_path: Path) -> None:
    """With a config in which no field has its default."""
    (tmp_path / "all.yaml").write_text(CONFIG)
    experiment = load(tmp_path / "all.yaml")
    (first, last) = make_plan(experiment, save_tracks=True, stops=(2, 6)).tasks[0, "Mine"]
    defaults = {f.name: f.default for f in fields(BlockTask) if f.default is not MISSING}
    left = [name for name, value in defaults.items() if getattr(first, name) == value]
    # What a reference knows of faults; the others by the worker that filters a stack.
    assert left == ["reference_assume", "stacked", "copies"]
    assert (first.extra_run_counts, last.extra_run_counts) == ((2,), (2,))
    assert [(t.seed, t.index, t.width, t.runs_used, t.runs_with_tracks) for t in (first, last)] == [
        (3, 0, 4, 4, 7),
        (3, 1, 4, 3, 7),
    ]
    assert (first.hold_out, first.keep_steps) == (3, ("squared_position",))
    assert (first.reference, last.filter) == (experiment.points[0].filters["KF"], KF())


def test_a_trial_fills_in_every_field_but_those_of_what_is_kept(tmp_path: Path) -> None:
    (tmp_path / "all.yaml").write_text(CONFIG)
    (first, last) = Training(load(tmp_path / "all.yaml"), "Mine").tasks((0.1,))
    defaults = {f.name: f.default for f in fields(BlockTask) if f.default is not MISSING}
    left = {name for name, value in defaults.items() if getattr(first, name) == value}
    unset = {"predictive_metrics", "reference_assume", "stacked", "copies"}
    assert left - unset == NOT_OF_TRAINING.keys()
    assert first.assume is not None
    assert [(t.seed, t.index, t.width, t.runs_used) for t in (first, last)] == [
        (3, -1, 3, 3),
        (3, -2, 3, 3),
    ]


@pytest.mark.parametrize(
    ("runs", "used"), [(1, [1]), (4, [4]), (5, [4, 1]), (7, [4, 3]), (9, [4, 3])]
)
def test_the_first_runs_of_a_plan_are_in_the_same_blocks(
    runs: int, used: list[int], tmp_path: Path
) -> None:
    (tmp_path / "all.yaml").write_text(CONFIG)
    plan = make_plan(load(tmp_path / "all.yaml"))
    for key, tasks in plan.first(runs).tasks.items():
        there = [replace(task, runs_used=n) for task, n in zip(plan.tasks[key], used, strict=False)]
        assert tasks == there
