"""A filter of one's own that is wrong is said to be wrong, in one line with its file and line."""

import re
import sys
from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.conftest import PLANE
from trackbench import cli

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
RUN, INPUT = 1, 2


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
BAD: dict[str, tuple[str, int, str, str]] = {
    # what is wrong: plugin, exit code, a word of the line that is named, what is said
    "a component less": (gives("m[:3]"), RUN, "def estimate", f"array (3, 6) of float64, {REFUSED}"),
    "a component too many": (gives("np.vstack([m, m[:1]])"), RUN, "def estimate", "array (5, 6)"),
    "transposed": (gives("m.T"), RUN, "def estimate", "array (6, 4)"),
    "one run's for all": (gives("m[:, :1]"), RUN, "def estimate", "array (4, 1)"),
    "no runs": (gives("m[:, 0]"), RUN, "def estimate", "array (4,)"),
    "one run's covariance": (gives("m", "P[..., :1]"), RUN, "def estimate", "array (4, 4, 1)"),
    "variances": (gives("m", "P[0]"), RUN, "def estimate", "the covariance of the estimate is"),
    "complex": (gives("m + 0j"), RUN, "def estimate", "of complex128"),
    "a list": (gives("m.tolist()"), RUN, "def estimate", "is a list"),
    "a pair": (method("estimate(self, state)", "return self.made(state)"), RUN, "def estimate",
               "an estimate is a Gaussian, and this is a tuple"),
    "nothing": (method("estimate(self, state)", "pass"), RUN, "def estimate", "this is a NoneType"),
    "a reserved diagnostic": (
        method("diagnostics(self, state)", "return {'rmse': state.nis}"), RUN, "def diagnostics",
        "a diagnostic cannot be named 'rmse'"),
    "a diagnostic that is no number": (
        method("diagnostics(self, state)", "return {'mine': 'high'}"), RUN, "def diagnostics",
        "diagnostic 'mine' is a str"),
    "diagnostics that are none": (
        method("diagnostics(self, state)", "return [state.nis]"), RUN, "def diagnostics",
        "diagnostics are a list, not a mapping"),
    "init raises": (method("init(self, model, prior, rng)", "1 / 0"), RUN, "1 / 0",
                    "ZeroDivisionError: division by zero"),
    "step leaves": (method("step(self, model, state, z, k, rng)", "raise SystemExit"), RUN,
                    "raise SystemExit", "raised SystemExit()"),
    "step ends the process": (
        method("step(self, model, state, z, k, rng)", "__import__('os')._exit(0)"), RUN,
        "_exit(0)", "code of a plugin raised SystemExit(0)"),
    "step ends the process by an import": (
        "from os import _exit\n" + method("step(self, model, state, z, k, rng)", "_exit(0)"), RUN,
        " _exit(0)", "code of a plugin raised SystemExit(0)"),
    "the process ends as it is read": (HEAD + "import os\nos._exit(0)\n", INPUT, "os._exit",
                                       "SystemExit"),
    "an error of its own": (
        HEAD + "class OwnError(Exception):\n    def __init__(self, a, b):\n        "
        "super().__init__(f'{a} and {b}')\n" + KIND +
        "class Bad(Base):\n    def estimate(self, state):\n        raise OwnError(1, 2)\n",
        RUN, "raise OwnError", "OwnError: 1 and 2"),
    "writes to what it is given": (
        method("step(self, model, state, z, k, rng)", "z -= 1"), RUN, "z -= 1", "read-only"),
    "makes it writable": (
        method("step(self, model, state, z, k, rng)", "z.setflags(write=True)"), RUN,
        "z.setflags", "read-only: copy it before you write to it (cannot set WRITEABLE"),
    "writes to its memory": (
        method("step(self, model, state, z, k, rng)",
               "import ctypes; ctypes.memset(z.ctypes.data, 0, z.nbytes); return state"), RUN,
        "def step", "writes to measurements, a prior or matrices that all filters"),
    "replaces a matrix of the model": (
        method("step(self, model, state, z, k, rng)",
               "object.__setattr__(model.motion, 'Q', 9 * model.motion.Q); return state"), RUN,
        "def step", "writes to measurements, a prior or matrices that all filters"),
    "a kind twice": (CLASS + KIND + "class Again(Base):\n    'Again.'\n", INPUT, "@register",
                     "the kind 'bad' is registered twice in this file"),
    "a kind that is taken": (CLASS.replace('"bad"', '"kf"'), INPUT, "@register", "already taken"),
    "conflicts raises": (method("conflicts(self, scenario)", "1 / 0"), INPUT, "1 / 0",
                         "ZeroDivisionError"),
    "conflicts gives words": (method("conflicts(self, scenario)", "return 'no'"), INPUT,
                              "def conflicts", "conflicts gives a str, not a dict"),
    "cautions raises": (method("cautions(self, scenario)", "raise SystemExit"), INPUT,
                        "raise SystemExit", "raised SystemExit()"),
    "is not made": (method("__post_init__(self)", "{}['a']"), INPUT, "{}['a']", "KeyError: 'a'"),
    "ends as it is made": (method("__post_init__(self)", "raise KeyboardInterrupt"), INPUT,
                           "raise KeyboardInterrupt", "raised KeyboardInterrupt()"),
    "ends as it is read": (HEAD + "raise SystemExit(0)\n", INPUT, "raise SystemExit", "SystemExit"),
    "an array for a key": (CLASS + "    gains: np.ndarray = None\n", INPUT, "@register",
                           "Bad: has a key of a type that no YAML can hold"),
    "a function for a key": (CLASS + "    f: Any = lambda x: x\n", INPUT, "@register",
                             "Bad: the key f is a function, which no YAML can hold"),
    "a list for a key": (CLASS + "    gains: list[int] = field(default_factory=list)\n", INPUT,
                         "@register", "TypeError: unhashable type: 'list'"),
    "a word for N": (CLASS + "    N: str = 'many'\n", INPUT, "@register",
                     "its N is 'many', no whole number"),
    "not frozen": (CLASS.replace("@dataclass(frozen=True", "@dataclass(eq=True"),
                   INPUT, "@dataclass(eq", "TypeError: cannot inherit non-frozen dataclass"),
    "a word for needs": (CLASS + "    requires: ClassVar[Any] = 'motion.F'\n", INPUT, "@register",
                         "requires is 'motion.F', not a tuple"),
    "no package": (HEAD + "import nosuchmodule\n", INPUT, "import nosuchmodule",
                   "needs the module nosuchmodule, which is not installed"),
    "one run: a component less": (
        one("    def step(self, z, dt):\n        return self.x[:3], self.P\n"), RUN, "def step",
        "the mean of a run is an array (3,) of float64, not (4,) real numbers"),
    "one run: no pair": (one("    def step(self, z, dt):\n        return self.x\n"), RUN, "def step",
                         "Bad gives a ndarray, not a mean and a covariance"),
    "one run: no step": (one("    pass\n"), INPUT, "class Bad(PerRun", "Bad has no step(z, dt)"),
    "one run: a key in the way": (
        one("    model: str = 'cv'\n    def step(self, z, dt):\n        return self.x, self.P\n"),
        INPUT, "class Bad(PerRun", "a key cannot be called 'model'"),
    "one run: raises": (one("    def step(self, z, dt):\n        return z[7], self.P\n"), RUN,
                        "z[7]", "IndexError: index 7 is out of bounds"),
    "one run: another sensor": (
        one("    measured = ('range', 'azimuth')\n    def step(self, z, dt):\n        pass\n"),
        INPUT, "", "it takes range, azimuth; this scenario measures x, y"),
    "one run: another state": (
        one("    state = ('px', 'py')\n    def step(self, z, dt):\n        pass\n"), INPUT, "",
        "its state (px, py) has no vx"),
    "filterpy: another size": (
        one("    def make(self, dt):\n        from filterpy.kalman import KalmanFilter\n"
            "        return KalmanFilter(6, 2)\n", "FilterPy"), RUN, "def make",
        "make(dt) gives a filter of 6 components, not 4"),
    "filterpy: no filter": (one("    def make(self, dt):\n        return 1\n", "FilterPy"), RUN,
                            "def make", "make(dt) gives a int, which has no x"),
}  # fmt: skip


def line_of(plugin: str, word: str) -> int:
    """The last line with this word."""
    return max(i for i, line in enumerate(plugin.splitlines(), 1) if word in line)


@pytest.mark.parametrize("what", BAD)
def test_it_is_said(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    plugin, code, word, said = BAD[what]
    if "filterpy" in what:
        pytest.importorskip("filterpy")
    (tmp_path / "bad.py").write_text(plugin)
    (tmp_path / "c.yaml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    command = ["run", "c.yaml", "--allow-plugins", "--engine", "serial", "--format", "svg"]
    monkeypatch.setattr(sys, "argv", ["trackbench", *command])
    with pytest.raises(SystemExit) as left:
        cli.main()
    out, err = capfd.readouterr()
    assert left.value.code == code, err
    assert "Traceback" not in out + err
    (line,) = [
        one for one in err.splitlines() if said in one and one.startswith(("error", "c.yaml"))
    ]
    if word:
        place = re.search(r"bad\.py:(\d+): ", line)
        assert place, line
        assert int(place.group(1)) == line_of(plugin, word), line
    if code == RUN:
        assert (
            "KF,mean(rmse_position)," in (tmp_path / "results" / "bad" / "summary.csv").read_text()
        )
    else:
        assert len(err.splitlines()) == 1, err
        assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("what", ["an error of its own", "one run's for all", "one run: raises"])
def test_it_is_said_by_a_worker(what: str, tmp_path: Path) -> None:
    plugin, code, word, said = BAD[what]
    (tmp_path / "bad.py").write_text(plugin)
    (tmp_path / "c.yaml").write_text(CONFIG)
    done = trackbench("run", "c.yaml", "--allow-plugins", "--workers", "2", cwd=tmp_path)
    assert done.returncode == code
    assert f"error: Bad failed: bad.py:{line_of(plugin, word)}: " in done.stderr
    assert said in done.stderr
