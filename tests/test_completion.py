"""What the shells offer; asked as bash, zsh and fish ask."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.conftest import ROOT

START = "import sys; sys.argv[0] = 'trackbench'; from trackbench.cli.app import main; main()"


def asked(line: str, shell: str) -> dict[str, str]:
    """What a shell sets."""
    words = line.split(" ")
    return {
        "_TRACKBENCH_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
        "_TYPER_COMPLETE_ARGS": line,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }


def completed(line: str, cwd: Path = ROOT) -> list[str]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in asked(line, "bash").items():
            patch.setenv(name, value)
        done = trackbench(cwd=cwd)
    assert done.stderr == ""
    return [word for word in done.stdout.splitlines() if word]


def completed_by(shell: str, line: str) -> list[str]:
    """In a process of its own, which the shell starts at each press of the key."""
    found = {**os.environ, "PYTHONPATH": str(ROOT), **asked(line, shell)}
    command = [sys.executable, "-c", START]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=found, timeout=60)
    assert done.stderr == ""
    return [word for word in done.stdout.splitlines() if word]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("trackbench describe range-azimuth-d", ["range-azimuth-doppler"]),
        ("trackbench list sen", ["sensors"]),
        ("trackbench list exp", ["experiments"]),
        ("trackbench list pro", ["problems"]),
        ("trackbench list sui", ["suites"]),
        ("trackbench list met", ["metrics"]),
        ("trackbench list stat", ["statistics"]),
        ("trackbench run merwe2", ["merwe2000"]),
        ("trackbench run experiments/hdepf/merwe2", ["experiments/hdepf/merwe2000.yaml"]),
        ("trackbench check experiments/hdepf/sc", ["experiments/hdepf/scenarios/"]),
        ("trackbench show banana-k", ["banana-kf"]),
        ("trackbench copy banana-k", ["banana-kf"]),
        ("trackbench run hdepf --only HD", ["HDEPF"]),
        ("trackbench run hdepf --only UKF --only HD", ["HDEPF"]),
        ("trackbench check hdepf --set see", ["seed="]),
        (
            "trackbench run hdepf --set filters.HDEPF.reading.fit",
            ["filters.HDEPF.reading.fitness="],
        ),
        ("trackbench run hdepf --set filters.UKF.assume.m", ["filters.UKF.assume.motion="]),
        ("trackbench sweep hdepf --set scenario.sensor.R", ["scenario.sensor.R="]),
        ("trackbench run hdepf --set tables.table1.dig", ["tables.table1.digits="]),
        ("trackbench run nothing --only H", []),
    ],
)
def test_words(line: str, offered: list[str]) -> None:
    assert completed(line) == offered


def test_every_shell_gets_a_label_as_a_word() -> None:
    line = "trackbench run hdepf --only PF"
    assert completed_by("bash", line) == ["PF", "PFDE", r"PF\ \(N=100\)", r"PF\ \(N=210\)"]
    assert completed_by("fish", line) == ["PF", "PFDE", "PF (N=100)", "PF (N=210)"]
    zsh = "\n".join(completed_by("zsh", line))
    assert zsh.startswith("_arguments")
    assert '"PF (N=100)"' in zsh


def test_a_config_that_cannot_be_read_offers_nothing(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("a: [1\n")
    assert completed("trackbench run bad.yaml --only P", cwd=tmp_path) == []
    assert completed("trackbench run bad.yaml --set P", cwd=tmp_path) == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_scripts_are_printed(shell: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # Without it typer takes the shell that it runs in, and there need not be one here.
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    done = trackbench("--show-completion", shell)
    assert done.returncode == 0, done.stderr
    assert "COMPLETE" in done.stdout
