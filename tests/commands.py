"""The command line as a test calls it: in this process, or as a program where that is what is asked."""

import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any, Protocol, TextIO

import pytest

from tests.conftest import ROOT, plugins_forgotten
from trackbench import api
from trackbench.__main__ import main

BARE = ("--set", "figures={}", "--set", "key_figure=null")
"""Draws nothing, which takes longest."""


class Command(Protocol):
    """Either of these."""

    def __call__(self, *words: object, cwd: Path = ROOT) -> "CompletedProcess[str]": ...


def trackbench(
    *words: object, cwd: Path = ROOT, terminal: TextIO | None = None
) -> "CompletedProcess[str]":
    """What a command says and leaves behind, without the second that a start of the program takes."""
    out, err = StringIO(), StringIO()
    code: str | int | None = 0
    with plugins_forgotten(), pytest.MonkeyPatch.context() as patch:
        patch.chdir(cwd)
        patch.setattr(sys, "argv", ["trackbench", *map(str, words)])
        patch.setattr(sys.modules["__main__"], "__package__", None)  # or its name is that of pytest
        with redirect_stdout(terminal or out), redirect_stderr(terminal or err):
            try:
                main()
            except SystemExit as end:
                code = end.code
    if isinstance(code, str):  # which Python writes, and leaves with 1
        err.write(f"{code}\n")
        code = 1
    return CompletedProcess(words, code or 0, out.getvalue(), err.getvalue())


def ran(folder: Path, text: str, **options: Any) -> api.Report:
    """The report of a config that is run in this process, into ``out`` beside it, without figures."""
    (folder / "c.yaml").write_text(text)
    keys = {"engine": "serial", "quiet": True, "out": folder / "out", "formats": ()} | options
    return api.run(folder / "c.yaml", **keys)


def spawned(*words: object, cwd: Path = ROOT) -> "CompletedProcess[str]":
    """The same by a program of its own, in which a warning is an error, as it is in the tests."""
    command = [sys.executable, "-W", "error", "-m", "trackbench", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120)
