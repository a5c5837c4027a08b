"""Filters as programs in other languages: `new filter NAME --language` writes Kalman filters."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from tests.conftest import ROOT
from trackbench.config.added_filters import runs_as_program
from trackbench.core.arrays import Array
from trackbench.starting_files import LANGUAGES

RUNS, STEPS = 3, 20


@pytest.fixture(scope="module", params=LANGUAGES)
def command(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The command that the config names, of a program that is built as the file says."""
    language, folder = LANGUAGES[request.param], tmp_path_factory.mktemp("language")
    tool = (language.build or language.command).split()[0].strip("[,")
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")
    done = trackbench("new", "filter", "my-own", "--language", request.param, cwd=folder)
    assert done.returncode == 0, done.stderr
    if language.build:
        build = done.stdout.partition("build it: ")[2].splitlines()[0]
        assert build in (folder / f"my_own.{language.ending}").read_text()
        warn = ["-Wall", "-Wextra"] if tool.endswith(("cc", "c++")) else []
        made = subprocess.run([*build.split(), *warn], cwd=folder, capture_output=True, text=True)
        assert (made.returncode, made.stderr) == (0, "")
    words = yaml.safe_load((folder / "my_own.yaml").read_text())["filters"]["my-own"]["command"]
    files = [str(folder / word) if (folder / word).exists() else word for word in words]
    return [sys.executable if word == "python3" else word for word in files]


def problem(
    n: int, n_z: int, scale: float, q: float | None = None
) -> tuple[list[str], list[Array]]:
    """Lines to a program, and means and covariances by the information form of the Kalman filter.

    The parameter q multiplies Q. None: the program does not get it.
    """
    rng = np.random.default_rng(n)
    F, H = np.eye(n) + 0.3 * rng.normal(size=(n, n)) / n, rng.normal(size=(n_z, n))
    roots = [scale * rng.normal(size=(size, size)) for size in (n, n_z, n)]
    Q, R, P_0 = (root @ root.T + scale**2 * np.eye(len(root)) for root in roots)
    model = {name: A.tolist() for name, A in {"F": F, "Q": Q, "H": H, "R": R}.items()}
    facts = {"components": ["x"] * n, "measurement": ["z"] * n_z, "T": 2.0, "model": model}
    parameters: dict[str, object] = {"F": [1.0, 2.0], "model": "none", "R": 3}
    if q is not None:
        parameters["q"] = q
        Q = q * Q
    lines, estimates = [f"trackbench 1 {json.dumps({'parameters': parameters, **facts})}"], []
    for run in range(RUNS):
        x, P = scale * rng.normal(size=n), P_0 * (run + 1)
        lines.append(" ".join([f"init {2**64 - 1 - run} 0", *fields(x), *fields(P)]))
        estimates.append(np.append(x, P))
        for k in range(1, STEPS):
            z = scale * rng.normal(size=n_z)
            z[rng.random(n_z) < 0.2] = np.nan
            z[:] = z if k % 5 else np.nan
            lines.append(" ".join([f"step {2 * k}", *fields(z)]))
            x, P = F @ x, F @ P @ F.T + Q
            h, r = H[~np.isnan(z)], R[~np.isnan(z)][:, ~np.isnan(z)]
            information = np.linalg.inv(P) + h.T @ np.linalg.inv(r) @ h
            gradient = np.linalg.solve(P, x) + h.T @ np.linalg.solve(r, z[~np.isnan(z)])
            x, P = np.linalg.solve(information, gradient), np.linalg.inv(information)
            estimates.append(np.append(x, P))
    return lines, estimates


def fields(values: Array) -> list[str]:
    return [f"{value:.17g}" for value in values.ravel()]


@pytest.mark.parametrize(
    ("n", "n_z", "scale", "q"),
    [(4, 2, 1.0, None), (1, 1, 1e-9, None), (3, 3, 1e6, 25), (16, 16, 1, None), (4, 2, 1.0, 1e-05)],
)
def test_it_is_the_kalman_filter(
    command: list[str], n: int, n_z: int, scale: float, q: float | None
) -> None:
    lines, estimates = problem(n, n_z, scale, q)
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, bufsize=1) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        (timer := Timer(60, program.kill)).start()  # of a program that keeps its answers back
        answers = []
        for line in lines:
            program.stdin.write(f"{line}\n")
            answers.append(program.stdout.readline())
        program.stdin.write("end\n")
        assert program.wait(10) == 0
        timer.cancel()
        assert program.stdout.read() == ""
    assert answers[0] == "ready\n"
    for answer, expected in zip(answers[1:], estimates, strict=True):
        numbers = np.array(answer[:-1].split(" "), dtype=float)
        sd = np.sqrt(np.diag(expected[n:].reshape(n, n)))
        size = np.append(np.abs(expected[:n]) + sd, np.outer(sd, sd))
        assert (np.abs(numbers - expected) <= 1e-9 * size).all()
    # Lines that wait in the pipe, and the end of the input in place of `end`.
    done = subprocess.run(command, input="\n".join(lines) + "\n", capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "".join(answers))


@pytest.mark.parametrize("name", ["fixed_gain.c", "radar_ekf.c"])
def test_the_page_has_the_program(name: str) -> None:
    page = (ROOT / "docs" / "any-language.md").read_text(encoding="utf-8")
    program = (ROOT / "tests" / "programs" / name).read_text(encoding="utf-8")
    assert f'```c title="{name}"\n{program}```' in page


def test_a_program_gives_the_answers_of_the_page(command: list[str]) -> None:
    page = (ROOT / "docs" / "any-language.md").read_text(encoding="utf-8")
    exchange = page.partition("```text\n< trackbench 1")[2].partition("```")[0]
    lines = [line[2:] for line in exchange.splitlines() if line.startswith("< ")]
    expected = [line[2:] for line in exchange.splitlines() if line.startswith("> ")]
    two = np.eye(2).tolist()
    model = {"F": two, "Q": two, "H": two, "R": (2 * np.eye(2)).tolist()}
    facts = {"components": ["px", "py"], "measurement": ["x", "y"], "T": 1.0, "model": model}
    hello = f"trackbench 1 {json.dumps({'parameters': {}, **facts})}"
    text = "\n".join([hello, *lines]) + "\n"
    done = subprocess.run(command, input=text, capture_output=True, text=True)
    ready, *answers = done.stdout.splitlines()
    assert ready == expected[0]
    for answer, line in zip(answers, expected[1:], strict=True):
        assert np.array(answer.split(), float) == pytest.approx(np.array(line.split(), float))


def test_it_refuses_a_problem_without_matrices(command: list[str]) -> None:
    facts = {"components": ["x"], "measurement": ["z"], "T": None, "parameters": {"F": 1}}
    hello = f"trackbench 1 {json.dumps(facts | {'model': None})}\nend\n"
    done = subprocess.run(command, input=hello, capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stdout == "error this filter needs a linear, constant model\n"


WALK = """#!{python}
import sys
sys.stdin.readline()
print("ready", flush=True)
for line in sys.stdin:
    word, *rest = line.split()
    if word == "end":
        break
    numbers = [float(cell) for cell in rest]
    if word == "init":
        x, P = numbers[2], numbers[3]
    else:
        P += {q}
        if numbers[1] == numbers[1]:
            K = P / (P + {r})
            x, P = x + K * (numbers[1] - x), (1.0 - K) * P
    print(repr(x), repr(P), flush=True)
"""
WALKING = {"kind": "map", "components": ["x"], "next": {"x": "x"}, "Q": 0.5}
CONFIG = {
    "name": "walk",
    "runs": 20,
    "scenario": {
        "kind": "tracking",
        "last": 20,
        "target": {"kind": "driven", "motion": WALKING},
        "sensor": {"kind": "function", "h": {"z": "x"}, "R": 2.0},
        "start": {"kind": "gaussian", "sigma": [3.0]},
    },
    "filters": {"KF": {"kind": "kf"}},
}


def test_an_executable_python_file_without_filters_is_a_program(tmp_path: Path) -> None:
    """It was loaded as a plugin, and then read the terminal's lines."""
    program = tmp_path / "walk.py"
    program.write_text(WALK.format(python=sys.executable, q=0.5, r=2.0))
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(CONFIG))
    # Without the permission to execute it is a Python file, which registers no filter.
    assert not runs_as_program(program)
    program.chmod(0o755)
    assert runs_as_program(program)
    done = trackbench("check", "--contract", "./walk.py", "--on", "walk.yaml", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "good  errors and covariance fit reference filters" in done.stdout
    program.write_text("#!/usr/bin/env python3\nfrom trackbench import Filter\n")
    assert not runs_as_program(program)


CONSTANT_T = """#!{python}
import json
import sys
T = json.loads(sys.stdin.readline().split(" ", 2)[2])["T"]
print("ready", flush=True)
for line in sys.stdin:
    word, *rest = line.split()
    if word == "end":
        break
    if word == "init":
        estimate = rest[2:]
    else:
        estimate[0] = repr(float(estimate[0]) + T * float(estimate[1]))
    print(*estimate, flush=True)
"""


def test_a_program_that_fails_at_unequal_intervals_is_bad(tmp_path: Path) -> None:
    """It was said to refuse them."""
    program = tmp_path / "constant"
    program.write_text(CONSTANT_T.format(python=sys.executable))
    program.chmod(0o755)
    scenario = {
        "kind": "tracking",
        "last": 20,
        "target": {"kind": "driven", "motion": {"kind": "cwna", "q": 1.0}},
        "sensor": {"kind": "position", "sigma": 1.0},
        "start": {"kind": "gaussian", "sigma": [1.0, 1.0, 1.0, 1.0]},
    }
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(CONFIG | {"scenario": scenario}))
    for options in ((), ("--on", "walk.yaml")):
        done = trackbench("check", "--contract", "./constant", *options, cwd=tmp_path)
        line = next(x for x in done.stdout.splitlines() if "uses the interval between" in x)
        assert "bad  uses the interval between steps: fails at unequal intervals" in line
        assert "TypeError" in line
