"""A plugin's filter that fails in a run: one line with its file and line, and other filters' results."""

from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.conftest import PLANE

pytestmark = pytest.mark.usefixtures("no_report")

HEAD = """
from dataclasses import dataclass, field
from typing import Any, ClassVar
import numpy as np
from trackbench.adapters import FilterPy, PerRun
from trackbench.core.distributions import Gaussian
from trackbench.filters.kf import KF
from trackbench.registry import register


class Base(KF):
    def made(self, state):
        found = super().estimate(state)
        M = found.mean.shape[1]
        return found.mean, np.broadcast_to(found.cov.reshape(4, 4, -1), (4, 4, M))
"""
KIND = '@register("filters", "bad")\n@dataclass(frozen=True, kw_only=True)\n'
CLASS = HEAD + KIND + "class Bad(Base):\n    'Bad.'\n"
CONFIG = (
    """name: bad
runs: 6
block: 6
plugins: [bad.py]
"""
    + PLANE
    + """filters:
  KF: {kind: kf}
  Bad: {kind: bad}
"""
)


def gives(mean: str, cov: str = "P") -> str:
    """A filter whose estimate is made of mean m (4, M) and covariance P (4, 4, M)."""
    body = f"        m, P = self.made(state)\n        return Gaussian({mean}, {cov})\n"
    return CLASS + "    def estimate(self, state):\n" + body


def method(head: str, body: str) -> str:
    return f"{CLASS}    def {head}:\n        {body}\n"


def one(body: str, base: str = "PerRun", start: str = "self.x, self.P = mean, cov") -> str:
    """A filter of one run."""
    begin = f"    def start(self, mean, cov):\n        {start}\n" if base == "PerRun" else ""
    return f'{HEAD}class Bad({base}, kind="bad"):\n    "Bad."\n{begin}{body}'


REFUSED = "not an array (4, 6) of real numbers"
BAD: dict[str, tuple[str, str, str]] = {
    # what is wrong: plugin, a word of the line that is named, what is printed
    "a component less": (gives("m[:3]"), "def estimate", f"array (3, 6) of float64, {REFUSED}"),
    "one run's for all": (gives("m[:, :1]"), "def estimate", "array (4, 1)"),
    "one run's covariance": (gives("m", "P[..., :1]"), "def estimate", "array (4, 4, 1)"),
    "a pair": (method("estimate(self, state)", "return self.made(state)"), "def estimate",
               "an estimate is a Gaussian, and this is a tuple"),
    "nothing": (method("estimate(self, state)", "pass"), "def estimate", "this is a NoneType"),
    "a reserved diagnostic": (
        method("diagnostics(self, state)", "return {'rmse': state.nis}"), "def diagnostics",
        "a diagnostic cannot be named 'rmse'"),
    "diagnostics that are none": (
        method("diagnostics(self, state)", "return [state.nis]"), "def diagnostics",
        "diagnostics are a list, not a mapping"),
    "init raises": (method("init(self, model, prior, rng)", "1 / 0"), "1 / 0",
                    "ZeroDivisionError: division by zero"),
    "step leaves": (method("step(self, model, state, z, k, rng)", "raise SystemExit"),
                    "raise SystemExit", "raised SystemExit()"),
    "step ends the process": (
        method("step(self, model, state, z, k, rng)", "__import__('os')._exit(0)"),
        "_exit(0)", "code of a plugin raised SystemExit(0)"),
    "step ends the process by an import": (
        "from os import _exit\n" + method("step(self, model, state, z, k, rng)", "_exit(0)"),
        " _exit(0)", "code of a plugin raised SystemExit(0)"),
    "an error of its own": (
        HEAD + "class OwnError(Exception):\n    def __init__(self, a, b):\n        "
        "super().__init__(f'{a} and {b}')\n" + KIND +
        "class Bad(Base):\n    def estimate(self, state):\n        raise OwnError(1, 2)\n",
        "raise OwnError", "OwnError: 1 and 2"),
    "writes to what it is given": (
        method("step(self, model, state, z, k, rng)", "z -= 1"), "z -= 1", "read-only"),
    "makes it writable": (
        method("step(self, model, state, z, k, rng)", "z.setflags(write=True)"),
        "z.setflags", "read-only: copy it before you write to it (cannot set WRITEABLE"),
    "writes to its memory": (
        method("step(self, model, state, z, k, rng)",
               "import ctypes; ctypes.memset(z.ctypes.data, 0, z.nbytes); return state"),
        "def step", "writes to measurements, a prior or matrices that all filters"),
    "replaces a matrix of the model": (
        method("step(self, model, state, z, k, rng)",
               "object.__setattr__(model.motion, 'Q', 9 * model.motion.Q); return state"),
        "def step", "writes to measurements, a prior or matrices that all filters"),
    "one run: a component less": (
        one("    def step(self, z, dt):\n        return self.x[:3], self.P\n"), "def step",
        "the mean of a run is an array (3,) of float64, not (4,) real numbers"),
    "one run: no pair": (
        one("    def step(self, z, dt):\n        return 'x'\n"), "def step",
        "Bad returns a str, not a mean and a covariance; a filter without covariance returns the mean"),
    "one run: raises": (one("    def step(self, z, dt):\n        return z[7], self.P\n"),
                        "z[7]", "IndexError: index 7 is out of bounds"),
    "filterpy: another size": (
        one("    def make(self, dt):\n        from filterpy.kalman import KalmanFilter\n"
            "        return KalmanFilter(6, 2)\n", "FilterPy"), "def make",
        "make(dt) gives a filter of 6 components, not 4"),
    "filterpy: no filter": (one("    def make(self, dt):\n        return 1\n", "FilterPy"),
                            "def make", "make(dt) gives a int, which has no x"),
}  # fmt: skip


def line_of(plugin: str, word: str) -> int:
    """The last line with this word."""
    return max(i for i, line in enumerate(plugin.splitlines(), 1) if word in line)


@pytest.mark.parametrize("what", BAD)
def test_a_failure_has_its_line(what: str, tmp_path: Path) -> None:
    plugin, word, printed = BAD[what]
    if "filterpy" in what:
        pytest.importorskip("filterpy")
    (tmp_path / "bad.py").write_text(plugin)
    (tmp_path / "c.yaml").write_text(CONFIG)
    done = trackbench("run", "c.yaml", "--allow-plugins", "--engine", "serial", cwd=tmp_path)
    assert done.returncode == 1, done
    assert "Traceback" not in done.stdout + done.stderr
    place = f"error: Bad failed: bad.py:{line_of(plugin, word)}: "
    lines = [line for line in done.stderr.splitlines() if line.startswith(place)]
    assert [printed in line for line in lines] == [True], done.stderr
    summary = (tmp_path / "results" / "bad" / "summary.csv").read_text()
    assert "KF,mean(rmse_position)," in summary


def test_a_worker_hands_on_an_error_that_cannot_be_pickled(tmp_path: Path) -> None:
    plugin, word, printed = BAD["an error of its own"]
    (tmp_path / "bad.py").write_text(plugin)
    (tmp_path / "c.yaml").write_text(CONFIG)
    done = trackbench("run", "c.yaml", "--allow-plugins", "--workers", "2", cwd=tmp_path)
    assert done.returncode == 1
    assert f"error: Bad failed: bad.py:{line_of(plugin, word)}: " in done.stderr
    assert printed in done.stderr
