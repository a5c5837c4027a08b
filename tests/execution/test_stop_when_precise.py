"""`until`: runs go on until numbers are as exact as asked; what comes out is a batch like any other."""

import os
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import trackbench
from tests.commands import BARE
from tests.papers import merwe_text
from tests.simulated import ended
from trackbench.commands.notebook_report import Report
from trackbench.errors import UserError
from trackbench.evaluation.summary_rows import SummaryRow
from trackbench.execution.stop_when_precise import (
    PrecisionCheck,
    PrecisionTarget,
    checkpoints,
    precise_after,
)

pytestmark = pytest.mark.usefixtures("no_report")

TEXT = f"""name: u
seed: 5
runs: {{runs}}
{{more}}
scenario: {merwe_text(T=20).replace("{", "{{").replace("}", "}}")}
filters: {{{{EKF: {{{{kind: ekf}}}}, PF: {{{{kind: pf, N: 400}}}}}}}}
"""
UNTIL = "until: {mean(rmse): 5%}\nmin_runs: 20"


def run(folder: Path, runs: int, more: str = "", **options: object) -> Report:
    config = folder / "u.yaml"
    config.write_text(TEXT.format(runs=runs, more=more))
    return trackbench.run(config, out=folder / "out", quiet=True, formats=(), **options)


def files(folder: Path) -> list[bytes]:
    return [(folder / "out" / f"{name}.csv").read_bytes() for name in ("per_run", "per_step")]


def test_it_stops_when_every_filter_is_exact_enough(tmp_path: Path) -> None:
    report = run(tmp_path, 4000, UNTIL)
    summary = report.summary[report.summary["metric"] == "mean(rmse)"]
    runs = int(summary["runs"].max())
    assert runs in list(checkpoints(20, 4000))
    assert runs < 4000
    assert (summary["stderr"] <= 0.05 * summary["value"]).all()
    *_, short, once = (n for n in checkpoints(20, 4000) if n < runs)
    for fewer, enough in ((short, False), (once, True)):
        first = run(tmp_path, fewer).summary
        first = first[first["metric"] == "mean(rmse)"]
        assert (first["stderr"] <= 0.05 * first["value"]).all() == enough


def test_a_table_says_after_how_many_runs_each_was_enough(tmp_path: Path) -> None:
    table = run(tmp_path, 4000, UNTIL + "\ntables: {p: {kind: precision}}").tables["p"]
    runs = trackbench.load(tmp_path / "out").config["runs"]
    after = {keys[0]: int(keys[3]) for keys in table.keys}
    assert after.keys() == {"EKF", "PF"}
    assert max(after.values()) == runs
    assert set(after.values()) <= set(checkpoints(20, 4000))


def test_the_bytes_are_those_of_so_many_runs(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("until", "again", "alone", "plain")]
    for folder in folders:
        folder.mkdir()
    runs = run(folders[0], 4000, UNTIL).results.config["runs"]
    run(folders[1], 4000, UNTIL, fresh=True, workers=1)
    run(folders[2], runs, UNTIL, engine="serial")
    run(folders[3], runs, fresh=True)
    assert all(files(folder) == files(folders[0]) for folder in folders)


def test_verdicts_need_no_more_runs_than_are_exact_enough(tmp_path: Path) -> None:
    results = run(tmp_path, 4000, UNTIL).results
    assert results.config["runs"] < 4000
    assert results.experiment_runs is None
    fewer = trackbench.run(
        tmp_path / "u.yaml", out=tmp_path / "out", runs=30, quiet=True, formats=()
    )
    assert fewer.results.experiment_runs == 4000


def test_what_is_never_exact_enough_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "u.yaml"
    config.write_text(TEXT.format(runs=60, more="until: {mean(rmse): 0.1%}\nmin_runs: 20"))
    trackbench.run(config, out=tmp_path / "out", formats=())
    said = capsys.readouterr().err
    assert "up to 60 runs" in said
    assert "PF: after all 60 runs the standard error of mean(rmse) is " in said
    assert " times the 0.1 % that `until` asks" in said


@pytest.mark.skipif(sys.platform == "win32", reason="has no pseudo-terminal")
def test_the_progress_bar_says_how_far_it_is(tmp_path: Path) -> None:
    import fcntl
    import pty
    import struct
    import termios

    (tmp_path / "u.yaml").write_text(TEXT.format(runs=300, more=UNTIL))
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 150, 0, 0))
    words = ["run", "u.yaml", "--out", "out", "--workers", "1", *BARE]
    command, shown = [sys.executable, "-m", "trackbench", *words], b""
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=theirs) as done:
        os.close(theirs)
        with suppress(OSError):  # Linux says so that it has ended
            while part := os.read(ours, 1 << 16):
                shown += part
    os.close(ours)
    assert done.returncode == 0
    first = re.search(r"mean\(rmse\): (\S+) x the error wanted", shown.decode())
    assert first is not None
    after = run(tmp_path, 20).summary.query("metric == 'mean(rmse)'")
    share = (after["stderr"] / after["value"] / 0.05).max()
    assert float(first[1]) == pytest.approx(share, rel=0.06)  # two digits


def test_looks_do_not_hang_on_what_is_seen() -> None:
    assert list(checkpoints(50, 300)) == [50, 75, 112, 168, 252, 300]
    assert list(checkpoints(50, 20)) == [20]
    assert list(checkpoints(1, 4)) == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("exact", "after"),
    [
        ([False, True, True, True], 75),
        ([True, False, True, True], 112),
        ([False, True, False, True], 112),  # all runs: there is no later look
        ([True, True, False, False], 50),
        ([True, False, False, False], None),
        ([False, True], None),
    ],
)
def test_two_looks_in_a_row_have_to_succeed(exact: list[bool], after: int | None) -> None:
    assert precise_after([33, 50, 75, 112], exact) == after


@pytest.mark.parametrize(("law", "share"), [("HDEPF", 0.02), ("rare", 0.01), ("lognormal", 0.04)])
def test_rare_far_runs_bias_what_ends_early(law: str, share: float) -> None:
    """docs/statistics.md has longer runs. Before, the first success after 50 runs was the end."""
    R = 200
    before, now = ended(law, share, R, np.random.default_rng(61), most=8000)
    assert now[1] == pytest.approx(0.0, abs=0.2 * share + 3.0 * share / np.sqrt(R))
    assert now[2] > 0.93 - 3.0 * np.sqrt(0.05 * 0.95 / R)
    if law != "lognormal":
        assert before[1] < -0.3 * share
        assert before[2] < now[2]


def test_a_share_is_of_the_value() -> None:
    row = SummaryRow("mean(rmse)", -20.0, 0.3, 100, 0)
    assert PrecisionTarget.read("mean(rmse)", "1%").ratio(row) == pytest.approx(1.5)
    assert PrecisionTarget.read("mean(rmse)", 0.6).ratio(row) == pytest.approx(0.5)
    assert np.isnan(PrecisionTarget.read("mean(rmse)", "1%").ratio(row._replace(value=0.0)))


def test_an_event_that_no_run_had_is_not_exact() -> None:
    """Of three runs that did not stray up to 71 % could have (Clopper and Pearson)."""
    row = SummaryRow("mean(beyond_10_sigma)", 0.0, 0.0, 3, 0)
    assert PrecisionTarget.read("mean(beyond_10_sigma)", 0.1).ratio(row) == pytest.approx(
        0.7076 / 3.92 / 0.1, rel=1e-3
    )
    assert (
        PrecisionTarget.read("mean(distinct_particles)", 0.1).ratio(
            row._replace(metric="mean(distinct_particles)")
        )
        == 0.0
    )


@pytest.mark.parametrize("error", ["0%", "-1", "x", "x%", "0", "nan%", ".inf"])
def test_an_error_is_a_number_or_a_share(error: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"u\.yaml:4:21: until\.mean\(rmse\): give a number"):
        run(tmp_path, 100, f"until: {{mean(rmse): {error}}}")


@pytest.mark.parametrize(
    ("share", "runs", "enough"),
    [(1.0, 100, True), (1.001, 100, False), (np.nan, 100, False), (np.nan, 0, True)],
)
def test_a_number_is_exact_enough_up_to_the_error_that_is_wanted(
    share: float, runs: int, enough: bool
) -> None:
    wanted = PrecisionTarget.read("mean(rmse)", "5%")
    row = SummaryRow("mean(rmse)", -2.0, 0.1 * share, runs, 0)
    assert wanted.ratio(row) == pytest.approx(share, nan_ok=True)
    assert PrecisionCheck(wanted, row, share).enough == enough
    assert PrecisionTarget.read("mean(rmse)", 0.2).ratio(row) == pytest.approx(
        share / 2, nan_ok=True
    )
