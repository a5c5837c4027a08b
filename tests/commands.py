"""The command line as a test calls it: in this process, or as a program where that is what is asked."""

import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess
from typing import Protocol

import pytest

from tests.conftest import ROOT, plugins_forgotten
from trackbench.__main__ import main


class Command(Protocol):
    """Either of these."""

    def __call__(self, *words: object, cwd: Path = ROOT) -> "CompletedProcess[str]": ...


def trackbench(*words: object, cwd: Path = ROOT) -> "CompletedProcess[str]":
    """What a command says and leaves behind, without the second that a start of the program takes."""
    out, err = StringIO(), StringIO()
    code: str | int | None = 0
    with plugins_forgotten(), pytest.MonkeyPatch.context() as patch:
        patch.chdir(cwd)
        patch.setattr(sys, "argv", ["trackbench", *map(str, words)])
        patch.setattr(sys.modules["__main__"], "__package__", None)  # or its name is that of pytest
        with redirect_stdout(out), redirect_stderr(err):
            try:
                main()
            except SystemExit as end:
                code = end.code
    if isinstance(code, str):  # which Python writes, and leaves with 1
        err.write(f"{code}\n")
        code = 1
    return CompletedProcess(words, code or 0, out.getvalue(), err.getvalue())


def spawned(*words: object, cwd: Path = ROOT) -> "CompletedProcess[str]":
    """The same by a program of its own, in which a warning is an error, as it is in the tests."""
    command = [sys.executable, "-W", "error", "-m", "trackbench", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120)
