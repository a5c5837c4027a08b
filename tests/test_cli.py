"""The built command line, end to end, as a user would."""

import csv
import re
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
import pytest
import yaml

from tests.commands import BARE, spawned, trackbench
from tests.conftest import EXPERIMENT_FILES, PLANE
from trackbench.registry import Group, documentation


@pytest.fixture(scope="module")
def hdepf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "hdepf"
    done = spawned(
        "run", str(EXPERIMENT_FILES["hdepf"]), "--quick", "--out", str(out), "--save-tracks"
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    assert done.stdout.startswith("Ranking over 20 runs by mean RMSE per run")
    return out


def test_run_writes_what_the_contract_names(hdepf: Path) -> None:
    for name in (
        "config.yaml",
        "manifest.json",
        "per_run.csv",
        "per_step.csv",
        "summary.csv",
        "run/timing.csv",
        "tracks.npz",
        "tables/table1.csv",
        "tables/table1.md",
        "figures/figure1.png",
        "figures/figure1.svg",
    ):
        assert (hdepf / name).stat().st_size > 0, name
    assert not list(hdepf.glob("**/.*"))


def test_the_files_agree_with_each_other(hdepf: Path) -> None:
    """RMSE from the tracks, the per-run values, the summary and the table are the same number."""
    tracks = np.load(hdepf / "tracks.npz")
    error = tracks["mean/PF"] - tracks["truth"]
    rmse = np.sqrt(np.square(error[0]).mean(axis=0))
    per_run = pd.read_csv(hdepf / "per_run.csv")
    mine = per_run[(per_run["filter"] == "PF") & (per_run["metric"] == "rmse")]["value"]
    np.testing.assert_allclose(mine, rmse, rtol=6e-7)  # the file has seven significant digits
    summary = pd.read_csv(hdepf / "summary.csv").set_index(["filter", "metric"])
    row = summary.loc[("PF", "mean(rmse)")]
    assert row["value"] == pytest.approx(rmse.mean())
    assert row["stderr"] == pytest.approx(rmse.std(ddof=1) / np.sqrt(20))
    table = pd.read_csv(hdepf / "tables" / "table1.csv").set_index("Filter")
    assert table.loc["PF", "Mean (RMSE)"] == pytest.approx(rmse.mean())
    per_step = pd.read_csv(hdepf / "per_step.csv")
    late = per_step.query("filter == 'PF' and metric == 'rmse' and step == 50")
    assert late["value"].item() == pytest.approx(np.sqrt(np.square(error[0, -1]).mean()))
    assert tracks["cov/PF"].shape == (1, 1, 50, 20)


def test_resolved_config_has_every_key(hdepf: Path) -> None:
    config = yaml.safe_load((hdepf / "config.yaml").read_text())
    assert config["runs"] == 20
    assert config["filters"]["HDEPF"]["reading"]["fitness"] == "log"
    assert config["scenario"]["target"]["motion"]["gamma_rate"] == 2.0


def test_overrides_and_only(tmp_path: Path) -> None:
    done = trackbench(
        *("run", str(EXPERIMENT_FILES["hdepf"]), "--runs", "5", "--out", str(tmp_path / "o")),
        *("--only", "PF", "--set", "filters.PF.N=33", "--set", "scenario.sensor.R=0.1"),
        *("--set", "block=fit", *BARE),
    )
    assert done.returncode == 0, done.stderr
    config = yaml.safe_load((tmp_path / "o" / "config.yaml").read_text())
    assert config["filters"]["PF"]["N"] == 33
    assert config["scenario"]["sensor"]["R"] == 0.1
    assert config["only"] == ["PF"]
    summary = pd.read_csv(tmp_path / "o" / "summary.csv")
    assert set(summary["filter"]) == {"PF", "Exact"}  # the reference stays


def test_dry_run_writes_nothing(tmp_path: Path) -> None:
    done = trackbench(
        "run", str(EXPERIMENT_FILES["hdepf"]), "--dry-run", "--out", str(tmp_path / "o")
    )
    assert done.returncode == 0
    assert "14 filters x 3200 runs x 49 steps" in done.stdout
    assert not (tmp_path / "o").exists()


def test_dry_run_expects_the_time_of_stored_runs(tmp_path: Path) -> None:
    """It grows with the runs that are missing; other filters are not those that are stored."""
    (tmp_path / "s.yaml").write_text(
        f"name: s\nruns: 9\n{PLANE}filters: {{PF: {{kind: pf, N: 4000}}}}\n"
    )
    words = ("--engine", "serial", "--set", "block=3", "--out", "o", "--format", "svg")

    def expected(*more: str) -> str:
        done = trackbench("run", "s.yaml", *words, *more, "--dry-run", cwd=tmp_path)
        return done.stdout.rstrip().partition("; ")[2]

    by_trial = r"about \S+ s of filtering, by a trial of the first steps"
    assert re.fullmatch(by_trial, expected())
    assert trackbench("run", "s.yaml", *words, cwd=tmp_path).returncode == 0
    assert expected() == "every block is in the cache"
    lines = [trackbench("run", "s.yaml", *words, *more, "--dry-run", cwd=tmp_path).stdout
             for more in ((), ("--runs", "12"), ("--fresh",))]  # fmt: skip
    for line, blocks in zip(
        lines, ("3 blocks (3 kept)", "4 blocks (3 kept)", "3 blocks"), strict=True
    ):
        assert f"{blocks} on 1 worker" in line
    assert re.fullmatch(by_trial, expected("--set", "filters.PF.N=3000"))
    with (tmp_path / "o" / "run" / "timing.csv").open(encoding="utf-8") as file:
        (timing,) = csv.DictReader(file)
    seconds = float(timing["cpu_s"]) / int(timing["runs"]) * (90_000 - 9)
    bound, found = seconds_in(expected("--runs", "90000"))
    assert not bound
    assert found == pytest.approx(seconds, rel=0.06)


def test_dry_run_does_not_take_the_blocks_of_the_original_for_those_of_a_tuned_filter(
    tmp_path: Path,
) -> None:
    text = f"name: s\nruns: 4\n{PLANE}filters: {{KF: {{kind: kf}}}}\n"
    (tmp_path / "s.yaml").write_text(text)
    words = ("run", "s.yaml", "--engine", "serial", "--out", "o", "--format", "svg", *BARE)
    assert trackbench(*words, cwd=tmp_path).returncode == 0
    tune = "tune: {KF: {assume.motion.q: [0.1, 1]}}\ntuning: {evaluations: 3, runs: 4}\n"
    (tmp_path / "s.yaml").write_text(text + tune)

    def expected() -> str:
        done = trackbench(*words, "--dry-run", cwd=tmp_path)
        return done.stdout.rstrip().rpartition("; ")[2]

    assert expected().endswith("of filtering, by a trial of the first steps")
    # When all trials are stored, the tuned filter is known.
    assert trackbench(*words, cwd=tmp_path).returncode == 0
    assert expected() == "every block is in the cache"


def seconds_in(text: str) -> tuple[bool, float]:
    """Whether an expected time is a bound, and its seconds."""
    at_most, value, unit = re.fullmatch(
        r"(at most )?about (\S+) (h|min|s) of filtering", text
    ).groups()
    return bool(at_most), float(value) * {"h": 3600, "min": 60, "s": 1}[unit]


def test_dry_run_scales_the_time_of_a_stored_run_by_blocks(tmp_path: Path) -> None:
    """One run takes the time of its whole block; a narrow block's time per run is a bound."""
    (tmp_path / "s.yaml").write_text(
        f"name: s\nruns: 1\n{PLANE}filters: {{PF: {{kind: pf, N: 400}}, KF: {{kind: ekf}}}}\n"
    )
    words = ("--engine", "serial", "--out", "o", "--format", "svg")

    def expected(*more: str) -> tuple[bool, float, int]:
        done = trackbench("run", "s.yaml", *words, *more, "--dry-run", cwd=tmp_path)
        line, _, text = done.stdout.rstrip().partition("; ")
        return *seconds_in(text), int(re.search(r"(\d+) blocks", line)[1])

    def timing() -> dict[str, tuple[int, float]]:
        with (tmp_path / "o" / "run" / "timing.csv").open() as file:
            return {r["filter"]: (int(r["runs"]), float(r["cpu_s"])) for r in csv.DictReader(file)}

    assert trackbench("run", "s.yaml", *words, cwd=tmp_path).returncode == 0
    of_block = timing()
    runs = 2_000_000
    is_bound, seconds, blocks = expected("--runs", str(runs))
    counts = {label: -(-runs // width) for label, (width, _) in of_block.items()}
    assert blocks == sum(counts.values())
    assert counts["PF"] > counts["KF"]
    right = sum((counts[label] - 1) * cpu_s for label, (_, cpu_s) in of_block.items())
    assert not is_bound
    assert seconds == pytest.approx(right, rel=0.06)
    # Blocks of as many runs as there are, 2 here, are narrower than those of more runs.
    narrow = ("--runs", "2", "--set", "block=fit", "--fresh")
    assert trackbench("run", "s.yaml", *words, *narrow, cwd=tmp_path).returncode == 0
    of_run = {label: cpu_s / computed for label, (computed, cpu_s) in timing().items()}
    is_bound, seconds, _ = expected("--runs", str(runs), "--fresh")
    assert is_bound
    widths = {label: width for label, (width, _) in of_block.items()}
    right = sum(counts[label] * widths[label] * of_run[label] for label in counts)
    assert seconds == pytest.approx(right, rel=0.06)


def test_list_and_describe() -> None:
    listed = trackbench("list").stdout
    for group, kind in (("targets", "legs"), ("motions", "cwna"), ("sensors", "bearing")):
        number = len(documentation(cast(Group, group)))
        assert re.search(rf"^  {group} +{number}  ", listed, re.MULTILINE)
        assert f"  {kind} " in trackbench("list", group).stdout
    assert "  two-scan " in trackbench("list", "starts").stdout
    described = trackbench("describe", "hdepf").stdout
    for word in ("number of particles", "0.9", "preset literal", "crossover probability"):
        assert word in described
    assert "assume.motion" in described
    for kind, seen in (("square-then-line", "z"), ("range-azimuth", "range,azimuth")):
        described = trackbench("describe", kind).stdout
        assert f"components of the measurement: {seen}\n" in described
        assert "sigma_range" not in described or "standard deviation of the range, m" in described
    described = trackbench("describe", "tracking").stdout
    assert "{kind: two-scan} (see `trackbench list starts`)" in described
    assert "score.windows.name" in described
    assert trackbench("describe", "recorded").returncode == 0
    wrong = spawned("describe", "hdpf")
    assert wrong.returncode == 2
    assert "did you mean hdepf" in wrong.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["show", "zzz"], "known: adaptive-kf, .* and [0-9]+ more$"),
        (
            ["check", "--contract", "mine.yaml"],
            "--contract mine.yaml: is a config; name the Python",
        ),
    ],
)
def test_a_first_mistake_gets_a_short_answer(
    tmp_path: Path, words: list[str], message: str
) -> None:
    done = trackbench(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert re.search(message, done.stderr.strip())
    assert len(done.stderr) < 800


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("run air-traffic --runs 3 --runs 4", "--runs is there twice, and takes one value"),
        ("plot r --style a --only x --only y --style b", "--style is there twice"),
        ("new experiment --from a.csv --truth b.csv --truth c.csv", "--truth is there twice"),
        ("gate c.yaml --filter a.py --filter b.py", "--filter is there twice"),
        ("run air-traffic --set runs=3 --set runs=4", "runs: has another value in --set runs=3"),
        ("suite --set runs=3 --set runs=4", "runs: has another value in --set runs=3"),
    ],
)
def test_of_two_values_of_an_option_none_is_dropped(words: str, expected: str) -> None:
    done = trackbench(*words.split())
    assert done.returncode == 2
    assert expected in done.stderr


@pytest.mark.parametrize(
    "option", ["--truth gps.csv", "--input odom.csv", "--landmarks tags.csv", "--set columns.x=a"]
)
def test_options_on_tables_name_the_one_that_they_need(option: str) -> None:
    done = trackbench("new", "experiment", "q", *option.split())
    assert done.returncode == 2
    way = f"trackbench new experiment q --from FILE {option}"
    assert f"needs --from, the table of measurements: {way}" in " ".join(done.stderr.split())


def test_an_option_of_several_values_and_one_that_repeats_a_key_alike_are_taken() -> None:
    words = "run air-traffic --only KF --only KF --set runs=3 --set runs=3 --dry-run"
    done = trackbench(*words.split())
    assert done.returncode == 0, done.stderr


def test_files_named_as_packages_in_the_working_folder_are_left_alone(tmp_path: Path) -> None:
    for name in ("numpy", "yaml", "statistics", "typing", "random"):
        (tmp_path / f"{name}.py").write_text("raise ValueError\n")
    done = spawned("check", "merwe2000", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
