"""Metrics by name: what a config asks for must be there, and what it keeps is what is written."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.config import diagnostic_names
from trackbench.errors import UserError
from trackbench.filters.base import declares_diagnostics
from trackbench.filters.bootstrap_pf import PF
from trackbench.registry import kinds

pytestmark = pytest.mark.usefixtures("no_report")

CONFIG = """\
name: small
runs: 3
scenario: MERWE
filters:
  PF: {kind: pf, N: 10}
  EKF: {kind: ekf}
""".replace("MERWE", merwe_text(T=8))


def prepared(folder: Path, more: str) -> list[str]:
    """The mistakes of a config."""
    path = folder / "c.yaml"
    path.write_text(CONFIG + more)
    try:
        api.prepare(path, api.Options())
    except UserError as error:
        return [line.removeprefix(f"{path}:") for line in str(error).splitlines()]
    return []


def test_what_there_is_may_be_asked_for(tmp_path: Path) -> None:
    columns = (
        'A: mean(rmse), B: anees, C: "ratio(cpu_s_per_run, PF)", D: rmse@last, E: N, '
        "F: mean(collapsed_steps), G: time-mean(rmse), H: median(nees)"
    )
    more = f"medians: [nees]\ntables: {{a: {{kind: metrics, columns: {{{columns}}}}}}}\n"
    figures = "figures: {a: {kind: rmse-vs-time, metric: median(nees)}, b: {kind: heat-map}}"
    assert prepared(tmp_path, more + figures) == []


def test_what_a_table_shows_by_itself_need_not_be_there(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"  # of a filter that notes no innovations
    text = CONFIG.replace("  EKF: {kind: ekf}\n", "")
    path.write_text(text + "metrics: [nees]\ntables: {a: {kind: consistency}}")
    assert api.prepare(path, api.Options())


def test_metrics_in_a_list_of_a_plugin_must_be_there(tmp_path: Path) -> None:
    (tmp_path / "several.py").write_text(
        "from dataclasses import dataclass\n"
        "from trackbench.evaluation.metric_expression import OfRun\n"
        "from trackbench.registry import register\n"
        '@register("tables", "several")\n'
        "@dataclass(frozen=True, kw_only=True)\n"
        "class Several:\n"
        "    metrics: tuple[OfRun, ...]\n"
        "    def table(self, results): ...\n"
    )
    path = tmp_path / "c.yaml"
    tables = "tables: {t: {kind: several, metrics: [rmse, rmsee]}}\n"
    path.write_text(f"{CONFIG}plugins: [several.py]\n{tables}")
    with pytest.raises(UserError, match=r"tables\.t\.metrics\.1: 'rmsee' is no metric here"):
        api.prepare(path, api.Options(allow_plugins=True))


def test_a_filter_that_fails_is_not_asked_twice(tmp_path: Path, monkeypatch) -> None:
    """What it notes is unknown then, so nothing is said of names; its run reports the failure."""
    from trackbench.filters.bootstrap_pf import PF

    def broken(*_):
        raise RuntimeError("broken")

    monkeypatch.setattr(PF, "init", broken)
    monkeypatch.setattr(diagnostic_names, "declares_diagnostics", lambda cls: False)
    more = "tables: {a: {kind: metrics, columns: {A: mean(collapsed_steps)}}}"
    assert prepared(tmp_path, more) == []


def test_only_named_metrics_are_written(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG)
    options = api.Options(engine="serial", quiet=True, formats=())
    whole = api.run(tmp_path / "c.yaml", options, out=tmp_path / "whole")
    (tmp_path / "few.yaml").write_text(CONFIG + "metrics: [rmse]\nper_step: [bias, nis]\n")
    few = api.run(tmp_path / "few.yaml", options, out=tmp_path / "few")
    all_again = {"set": ("metrics=null", "per_step=null"), "out": tmp_path / "all"}
    again = api.run(tmp_path / "few.yaml", options, **all_again)
    pd.testing.assert_frame_equal(again.per_step, whole.per_step)
    assert set(few.per_run["metric"].str.partition("[")[0]) == {"lost", "rmse"}
    assert set(few.per_step["metric"]) == {"bias", "nis"}
    assert set(few.summary["metric"]) >= {"mean(rmse)", "time-mean(rmse)"}
    assert not few.summary["metric"].str.contains("nees").any()
    for frame in ("per_run", "per_step", "summary"):
        kept, every = getattr(few, frame), getattr(whole, frame)
        keys = [c for c in kept.columns if c not in ("value", "stderr")]
        both = kept.merge(every, on=keys, suffixes=("", "_whole"))
        assert len(both) == len(kept)
        pd.testing.assert_series_equal(both["value"], both["value_whole"], check_names=False)


def test_numbers_have_the_digits_they_are_said_to_have(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG)
    report = api.run(
        tmp_path / "c.yaml",
        api.Options(engine="serial", quiet=True, out=tmp_path / "r", formats=()),
    )
    for frame, digits in ((report.per_run, 7), (report.per_step, 6), (report.summary, 7)):
        values = frame["value"].to_numpy(dtype=float)
        shorter = np.array([float(f"{x:.{digits}g}") for x in values])
        np.testing.assert_array_equal(values, shorter)
        assert (values != [float(f"{x:.{digits - 2}g}") for x in values]).any()


def test_no_step_is_needed_to_know_what_a_filter_of_the_package_notes() -> None:
    assert all(declares_diagnostics(cls) for cls in kinds("filters").values())


def test_notes_are_believed_of_the_diagnostics_that_they_are_of() -> None:
    class More(PF):
        def diagnostics(self, state: Any) -> Any:
            return super().diagnostics(state) | {"mine": 1.0}

    class Told(More):
        diagnostic_names = frozenset({"collapsed_steps", "ess", "distinct_particles", "mine"})

    assert [declares_diagnostics(cls) for cls in (PF, More, Told)] == [True, False, True]
