"""What `trackbench new` writes runs as it is, and so does its test."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import trackbench
from trackbench.errors import UserError
from trackbench.starting_files import words_of_name

NAMES = {
    "filter": "my-filter",
    "filter --per-run": "my-own",
    "filter --per-run --nonlinear": "my-ekf",
    "sensor": "my-sensor",
    "motion": "my-motion",
    "motion --nonlinear": "my-pendulum",
    "start": "my-start",
    "scenario": "My_Radar",
    "experiment": "first",
}


@pytest.mark.parametrize(("what", "name"), NAMES.items())
def test_it_runs_at_once(tmp_path: Path, what: str, name: str) -> None:
    what, *options = what.split()
    made = trackbench("new", what, name, *options, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    module = name.lower().replace("-", "_")
    config = tmp_path / f"{module}.yaml"
    words = [] if what == "experiment" else ["--allow-plugins"]
    line = f"trackbench run {config.name}" + "".join(f" {w}" for w in words)
    assert line in made.stdout
    if what not in ("scenario", "experiment"):  # whose figures are their own
        words += ["--set", "figures={}"]
    done = trackbench("run", config.name, "--quick", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    assert "error" not in done.stderr
    assert "±" in done.stdout
    if what == "filter":
        good = trackbench("check", "--contract", f"{module}.py", cwd=tmp_path)
        assert good.returncode == 0, good.stdout
        per_run = "--per-run" in options
        kalman = "left out  equals the Kalman" if per_run else "good  equals the Kalman filter"
        assert kalman in good.stdout
    assert ("filtered run by run" in done.stdout) == ("--per-run" in options)
    again = trackbench("new", what, name, *options, cwd=tmp_path)
    assert again.returncode == 2
    assert "there is a file" in again.stderr


@pytest.mark.parametrize(
    "command",
    [
        ("pytest", "-q", "-W", "error"),
        ("ruff", "check", "--isolated", "--line-length=100"),
        ("ruff", "format", "--check", "--isolated", "--line-length=100"),
    ],
)
def test_its_tests_pass_and_it_keeps_the_house_style(
    tmp_path: Path, command: tuple[str, ...]
) -> None:
    for what, name in NAMES.items():
        what, *options = what.split()
        trackbench("new", what, name, *options, cwd=tmp_path)
    files = sorted(
        path.name for path in tmp_path.glob("test_*.py" if "pytest" in command else "my_*.py")
    )
    assert len(files) == (len(NAMES) if "pytest" in command else len(NAMES) - 1)
    done = subprocess.run(
        [sys.executable, "-m", *command, *files], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout


REFUSED = ["../x", "/x", "3x", "", "a b/c", "x" * 100, "a.b", "ukf", "numpy", "é"]


# The last one would take a pattern that can split a word in many ways longer than anybody waits.
@pytest.mark.parametrize("name", [*REFUSED, "regularizedunscentedparticlefilter.py"])
def test_names_that_are_refused(tmp_path: Path, name: str) -> None:
    done = trackbench("new", "filter", name, cwd=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_the_rule_of_names_is_that_of_the_names_that_are_taken() -> None:
    assert words_of_name("filter", "my own_new-Filter") == ["my", "own", "new", "filter"]
    with pytest.raises(UserError, match="with one -, _ or space between two words"):
        words_of_name("filter", "my--filter")
    with pytest.raises(UserError, match="at most 60 characters; this one has 61"):
        words_of_name("filter", 61 * "a")


def test_an_unknown_thing(tmp_path: Path) -> None:
    done = trackbench("new", "table", "x", cwd=tmp_path)
    assert done.returncode == 2
    assert (
        "'table' is not one of filter, sensor, motion, start, scenario, experiment" in done.stderr
    )


def test_only_a_filter_is_written_for_one_run(tmp_path: Path) -> None:
    done = trackbench("new", "sensor", "mine", "--per-run", cwd=tmp_path)
    assert done.returncode == 2
    assert "--per-run is of a filter" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (
            "filter mine --language cobol",
            "--language: 'cobol' is not one of c, c++, rust, julia, octave, javascript, python",
        ),
        ("sensor mine --language c", "new sensor mine: --language is of a filter"),
        (
            "filter mine --language c --per-run",
            "new filter mine: --per-run and --language exclude each other",
        ),
        (
            "filter numpy --language python",
            "new filter numpy: numpy.py would hide the module of this name from Python",
        ),
    ],
)
def test_a_program_is_a_filter_in_a_known_language(
    tmp_path: Path, words: str, problem: str
) -> None:
    done = trackbench("new", *words.split(), cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"{problem}\n")
    assert not list(tmp_path.iterdir())


def test_a_written_filter_stays_symmetric_in_long_runs(tmp_path: Path) -> None:
    """Rounding errors of a covariance's symmetry grow from step to step, if they stay in it."""
    made = trackbench("new", "filter", "my-ekf", "--per-run", "--nonlinear", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    done = trackbench("check", "--contract", "my_ekf.py", "--on", "uav-radar", cwd=tmp_path)
    assert "good  covariance is symmetric and positive definite" in done.stdout, done.stdout
    assert "of 920 steps of the experiment" in done.stdout
