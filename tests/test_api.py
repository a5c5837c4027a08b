"""From Python: the same code path as the command line."""

import inspect
import re
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trackbench
from tests.commands import trackbench as command
from tests.papers import merwe_text
from trackbench import api, entry_points, registry
from trackbench.atomic_files import atomic_write
from trackbench.errors import UserError

CONFIG = """
name: a
runs: 8
block: 2
scenario: MERWE
filters: {PF: {kind: pf, N: 5}, UKF: {kind: ukf}}
""".replace("MERWE", merwe_text(T=5))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "a.yaml").write_text(CONFIG)
    return tmp_path / "a.yaml"


def test_run_and_load(config: Path, tmp_path: Path) -> None:
    report = trackbench.run(config, runs=6, workers=2, out=tmp_path / "api", quiet=True)
    assert set(report.per_run["filter"]) == {"PF", "UKF"}
    assert report.per_run["run"].max() == 5
    loaded = trackbench.load(tmp_path / "api")
    assert loaded.summary.equals(report.summary)
    done = command("run", "a.yaml", "--runs", "6", "--out", "cli", cwd=tmp_path)
    assert done.returncode == 0
    for name in ("per_run.csv", "per_step.csv", "summary.csv"):
        assert (tmp_path / "cli" / name).read_bytes() == (tmp_path / "api" / name).read_bytes()


CALL = "trackbench.run({config!r}, engine='processes', workers=2, quiet=True, formats=(), {out})"
WITHOUT_GUARD = {
    "at its top": ("import trackbench\nprint('begins')\nCALL\n", "script.py:3:1: several worker"),
    "in a function": ("import trackbench\ndef run():\n    CALL\nrun()\n", "script.py:4:1: several"),
    "in a thread": (
        "import threading\nimport trackbench\n"
        "def run():\n    CALL\nif not threading.current_thread().daemon:\n"
        "    thread = threading.Thread(target=run)\n    thread.start()\n    thread.join()\n",
        "several worker processes import this script, and would run it again",
    ),
}


@pytest.mark.parametrize("case", WITHOUT_GUARD)
def test_a_script_without_its_guard_ends_with_a_line(
    case: str, config: Path, tmp_path: Path
) -> None:
    text, expected = WITHOUT_GUARD[case]
    call = CALL.format(config=str(config), out=f"out={str(tmp_path / 'out')!r}")
    script = tmp_path / "script.py"
    script.write_text(text.replace("CALL", call))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert expected in done.stderr
    assert 'put the call under `if __name__ == "__main__":`' in done.stderr
    assert done.stderr.count("Traceback") == 1
    assert done.stdout.count("begins") <= 1
    assert not (tmp_path / "out" / "summary.csv").exists()


def test_a_script_from_standard_input_has_no_file_for_workers(config: Path, tmp_path: Path) -> None:
    for workers in (1, 2):
        out = tmp_path / str(workers)
        call = CALL.format(config=str(config), out=f"out={str(out)!r}")
        done = subprocess.run(
            [sys.executable, "-"],
            input=f"import trackbench\n{call.replace('workers=2', f'workers={workers}')}\n",
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert (out / "summary.csv").exists() == (workers == 1)
        assert done.stderr.count("Traceback") == workers - 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("trackbench.errors.UserError: <stdin>: several worker processes import")
    assert last.endswith("save it as a file, or run it with workers=1")


def test_a_worker_of_a_pool_starts_no_workers(config: Path, tmp_path: Path) -> None:
    for workers in (1, 2):
        out = tmp_path / str(workers)
        call = CALL.format(config=str(config), out=f"out={str(out)!r}")
        script = tmp_path / "script.py"
        script.write_text(
            "import multiprocessing\nimport trackbench\n"
            f"def run(name):\n    {call.replace('workers=2', f'workers={workers}')}\n"
            'if __name__ == "__main__":\n'
            "    with multiprocessing.Pool(1) as pool:\n        pool.map(run, ['one'])\n"
        )
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
        assert (out / "summary.csv").exists() == (workers == 1), done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.endswith("which may start no processes of its own: run with workers=1")


def test_kinds_of_an_installed_package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "my_package.py").write_text(
        "from dataclasses import dataclass\n"
        "from trackbench.filters.ukf import UKF\n"
        "from trackbench.registry import register\n\n\n"
        '@register("filters", "from-a-package")\n'
        "@dataclass(frozen=True, kw_only=True)\n"
        "class Mine(UKF):\n"
        '    """The UKF again."""\n'
    )
    own = {
        group: registry.kinds(group) for group in registry.GROUPS
    }  # imported now, not into these
    monkeypatch.syspath_prepend(tmp_path)
    entry = EntryPoint("from-a-package", "my_package", "trackbench.filters")
    monkeypatch.setattr(entry_points, "entry_points", lambda: EntryPoints([entry]))
    monkeypatch.setattr(registry, "_scanned", set())
    monkeypatch.setattr(registry, "_kinds", own)
    assert "from-a-package" in registry.kinds("filters")


@pytest.mark.parametrize(
    ("function", "wrong", "near"),
    [
        *((name, "seeed", "seed") for name in ("run", "sweep", "tune", "run_all")),
        *((name, "foldr", "folder") for name in ("load", "compare", "plot", "report")),
        ("plot", "format", "formats"),
        ("report", "allow_plugin", "allow_plugins"),
        ("Options", "wokers", "workers"),
    ],
)
def test_a_wrong_keyword_is_one_line(function: str, wrong: str, near: str) -> None:
    with pytest.raises(UserError) as error:
        getattr(api, function)(**{wrong: 3})
    assert str(error.value) == f"{function}() has no option {wrong!r}; did you mean {near}?"


def test_wrong_keywords_are_reported_together() -> None:
    with pytest.raises(UserError, match=r"'rusn'.*runs\?\n.*'zzz'; known: "):
        trackbench.run("merwe2000", rusn=3, zzz=1)
    with pytest.raises(UserError, match=r"^Options\(\) has no option 'rusn'"):
        trackbench.Options().changed({"rusn": 3})


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"only": "KF"}, "only=: 'KF' is one word; write a list: only=['KF']"),
        ({"formats": "svg"}, "formats=: 'svg' is one word; write a list: formats=['svg']"),
        ({"formats": ["bmp"]}, "formats=: 'bmp' is not one of png, svg, pdf, tex"),
        ({"filters": Path("a.py")}, "filters=: 'a.py' is one word; write a list: filters=['a.py']"),
        ({"set": {"runs": 3}}, "of the type dict; write a list of words: set=['PATH=VALUE']"),
        ({"workers": 0}, "workers=: 0 is no number of processes; write a whole number from 1 on"),
        ({"engine": "threads"}, "engine=: 'threads' is not one of serial, processes, dask"),
    ],
)
def test_a_wrong_value_of_an_option_is_one_line(options: dict[str, Any], line: str) -> None:
    with pytest.raises(UserError, match=re.escape(line)):
        trackbench.run("merwe2000", **options)


def test_options_take_numbers_of_numpy_and_any_iterables() -> None:
    options = api.Options(runs=np.int64(5), only=(label for label in ["PF"]))
    assert type(options.runs) is int
    assert options.only == ("PF",)


@pytest.mark.parametrize("wrong", ["name: x\nruns: 3\n" * 200, None, 3, ["merwe2000"]])
def test_a_config_of_another_type_is_one_line(wrong: Any) -> None:
    with pytest.raises(UserError, match=r"^config: a config is a path, a name or a mapping"):
        trackbench.run(wrong)


def test_threads_write_one_file_side_by_side(tmp_path: Path) -> None:
    """Each has a temporary file of its own, so that the other one's is neither removed nor renamed."""
    path = tmp_path / "block"
    wait = threading.Barrier(2)

    def write(text: bytes) -> None:
        with atomic_write(path) as file:
            wait.wait()
            file.write(text)
            wait.wait()

    with ThreadPoolExecutor(2) as pool:
        [*pool.map(write, (b"a" * 9, b"b" * 9))]
    assert path.read_bytes() in (b"a" * 9, b"b" * 9)
    assert [*tmp_path.iterdir()] == [path]


def test_functions_keep_their_signatures() -> None:
    assert [*inspect.signature(trackbench.run).parameters] == ["config", "options", "changes"]
    assert [*inspect.signature(trackbench.load).parameters] == ["folder"]
    assert trackbench.load.__doc__ == "Read the results of an earlier run."


def test_quick_runs_never_replace_more_runs(tmp_path: Path) -> None:
    """They go beside; with --force, and where there are no more runs, into the folder itself."""
    text = "name: q\nruns: 30\nscenario: SCENE\nfilters: {F: {kind: ekf}}\n"
    (tmp_path / "q.yaml").write_text(text.replace("SCENE", merwe_text(T=5)))
    run = partial(command, "run", "q.yaml", "--workers", "1", "--format", "tex", cwd=tmp_path)
    stored = tmp_path / "results" / "q" / "per_run.csv"
    for words, runs, beside in (
        ([], 30, 0),
        (["--quick"], 30, 20),
        (["--quick", "--force"], 20, 20),
    ):
        assert run(*words).returncode == 0
        assert trackbench.load(stored.parent).config["runs"] == runs
        quick = tmp_path / "results" / "q-quick"
        assert (trackbench.load(quick).config["runs"] if quick.exists() else 0) == beside
