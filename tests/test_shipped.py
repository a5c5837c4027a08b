"""Shipped experiments are found by name, listed, shown and copied, from any folder."""

import os
import re
import shutil
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.commands import BARE, trackbench
from tests.conftest import EXPERIMENT_FILES, EXPERIMENTS, ROOT
from tests.conftest import shipped as experiment
from tests.times import seconds
from trackbench import readable_files
from trackbench.config import shipped_experiments
from trackbench.config.copy_experiment import copy_experiment
from trackbench.config.load import load
from trackbench.report.tables_and_figures import Results
from trackbench.yaml_source import read

NAMES = [*EXPERIMENT_FILES]


def test_a_name_is_run_anywhere(tmp_path: Path) -> None:
    """With nothing of the repository in the working folder."""
    done = trackbench("run", "merwe2000", "--runs", "2", "--set", "block=fit", *BARE, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "results" / "merwe2000" / "published" / "merwe2000.csv").is_file()
    by_path = trackbench(
        *("run", str(EXPERIMENT_FILES["merwe2000"]), "--runs", "2", "--set", "block=fit"),
        *("--out", "by-path", *BARE),
        cwd=tmp_path,
    )
    assert by_path.returncode == 0, by_path.stderr
    for name in ("per_run.csv", "config.yaml", "comparison.csv"):
        mine = (tmp_path / "results" / "merwe2000" / name).read_bytes()
        assert mine == (tmp_path / "by-path" / name).read_bytes()


def test_a_sweep_takes_a_name(tmp_path: Path) -> None:
    words = ("--runs", "4", "--set", "block=fit", "--only", "UKF", *BARE)
    words += ("--grid", "filters.UKF.Q=0.5,1", "--format", "svg")
    done = trackbench("sweep", "merwe2000", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "results" / "merwe2000-sweep" / "sweep.csv").is_file()


def test_a_file_wins_over_a_name_and_a_folder_does_not(tmp_path: Path) -> None:
    (tmp_path / "hdepf").mkdir()
    done = trackbench("check", "hdepf", cwd=tmp_path)
    assert "hdepf: good, 14 filters" in done.stdout
    assert "note: using the shipped experiment hdepf" in done.stderr
    copy_experiment("radar-turns", tmp_path)
    (tmp_path / "radar-turns.yaml").rename(tmp_path / "merwe2000")
    done = trackbench("check", "merwe2000", "--json", cwd=tmp_path)
    assert '"experiment": "radar-turns"' in done.stdout
    assert "note: using the file merwe2000" in done.stderr


def test_a_word_that_is_neither(tmp_path: Path) -> None:
    done = trackbench("run", "hdpef", cwd=tmp_path)
    assert done.returncode == 2
    said = "hdpef: is neither a file nor a shipped experiment; did you mean hdepf?\n"
    assert done.stderr == said
    assert trackbench("show", "nothing").returncode == 2
    assert not list(tmp_path.iterdir())
    (tmp_path / "turn.yaml").touch()
    done = trackbench("run", "turn", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "turn: is neither a file nor a shipped experiment; did you mean turn.yaml?\n"
    )


def test_a_word_of_another_kind_is_explained(tmp_path: Path) -> None:
    """A suite, its problem, a folder: with the name that is allowed, and the command."""
    problem_file = EXPERIMENTS / "suites" / "problems" / "banana.yaml"
    assert problem_file.is_file()
    shutil.copytree(ROOT / "results" / "radar-turns", tmp_path / "stored")
    (tmp_path / "banana").mkdir()
    expected = {
        "banana": f"trackbench suite standard --problem banana` runs it; {problem_file}",
        "drone": "is a problem of the suite standard; uav-radar is the name for other commands",
        "noise": "is a suite, which is a list; `trackbench suite noise` runs it; turning-aircraft",
        "tracking-problems": "is the folder of several shipped experiments; turning-aircraft",
        str(problem_file.parent): "is a folder; name one of its files: banana.yaml",
        "stored": "is a results folder; name its config, stored/config.yaml",
        "./stored": "is a results folder; name its config, stored/config.yaml",
        str(EXPERIMENTS / "suites" / "noise.yaml"): "is a suite of problems; `trackbench suite`",
    }
    for word, texts in expected.items():
        done = trackbench("check", word, cwd=tmp_path)
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        for text in texts.split("; "):
            assert text in line, (word, line)


def test_no_two_files_have_the_same_name() -> None:
    for pattern in ("*/*.yaml", "*/published/*", "*/scenarios/*", "*/filters/*"):
        names = [path.name for path in EXPERIMENTS.glob(pattern)]
        assert len(names) == len(set(names)) > 0


def test_a_path_without_the_topics_folder_is_answered_with_the_whole_path(tmp_path: Path) -> None:
    for word in ("experiments/hdepf.yaml", "hdepf.yaml"):
        done = trackbench("check", word, cwd=tmp_path)
        assert done.returncode == 2
        path = EXPERIMENT_FILES["hdepf"]
        what = f"no such file or directory; the shipped experiment is {path}"
        assert done.stderr == f"{word}: {what}\n"
    done = trackbench("check", "experiments/own.yaml", cwd=tmp_path)
    assert done.stderr == "experiments/own.yaml:1:1: no such file or directory\n"


def test_the_list_has_titles_papers_and_times() -> None:
    listed = {one.name: one for one in shipped_experiments.listed()}
    assert sorted(listed) == NAMES
    for name, one in listed.items():
        config = read(EXPERIMENT_FILES[name]).data
        title = config["title"].replace("{runs}", str(config.get("runs", 100)))
        assert (one.title, one.paper) == (title, config.get("paper", ""))
        assert one.cpu_s == seconds()[name] > 0.0
    done = trackbench("list", "experiments")
    assert "{" not in done.stdout
    for one in listed.values():
        assert f"  {one.name} " in done.stdout
        assert one.title in done.stdout
        assert one.paper in done.stdout
    assert done.stdout.count("The Unscented Particle Filter") == 1


def test_a_config_is_shown_as_it_is() -> None:
    done = trackbench("show", "hdepf")
    assert done.stdout == EXPERIMENT_FILES["hdepf"].read_text()


def _folders(name: str) -> str:
    """The folders of the files that an experiment names."""
    text = EXPERIMENT_FILES[name].read_text()
    return " ".join(sorted({a + b for a, b in re.findall(r"\b(\w+/)[\w-]+(\.\w+)\b", text)}))


@pytest.mark.parametrize("name", {_folders(name): name for name in NAMES}.values())
def test_a_copy_stands_alone(tmp_path: Path, name: str) -> None:
    """Of experiments whose files lie in the same folders, one."""
    copied = copy_experiment(name, tmp_path)
    mine, theirs = load(copied.config), experiment(name)
    assert mine.settings == theirs.settings
    # A point of recorded data holds their absolute paths.
    has_recordings = tmp_path / "data" in {path.parent for path in copied.written}
    assert mine.points == theirs.points or has_recordings
    assert mine.published == theirs.published
    depth = len(copied.config.relative_to(tmp_path).parts)
    root = EXPERIMENT_FILES[name].parents[depth - 1]
    for path in copied.written:
        assert path.read_bytes() == (root / path.relative_to(tmp_path)).read_bytes()


def test_a_copy_with_recordings_has_their_folder_beside_its_own(tmp_path: Path) -> None:
    done = trackbench("copy", "nile", cwd=tmp_path)
    assert done.stdout.splitlines() == [
        "wrote data/nile.csv",
        "wrote nile/nile.yaml",
        "wrote nile/published/nile.csv",
        "run it: trackbench run nile/nile.yaml",
    ]
    assert trackbench("check", "nile/nile.yaml", cwd=tmp_path).returncode == 0


def test_a_copy_writes_over_nothing(tmp_path: Path) -> None:
    assert "wrote hdepf.yaml" in trackbench("copy", "hdepf", cwd=tmp_path).stdout
    again = trackbench("copy", "hdepf", cwd=tmp_path)
    assert again.stdout == "run it: trackbench run hdepf.yaml\n"
    (tmp_path / "scenarios" / "merwe.yaml").write_text("mine\n")
    refused = trackbench("copy", "hdepf-noise", cwd=tmp_path)
    assert refused.returncode == 2
    path = Path("scenarios", "merwe.yaml")
    what = "exists with another content; copy to another folder, or remove this file"
    assert refused.stderr == f"copy hdepf-noise: {path}: {what}\n"
    assert not (tmp_path / "hdepf-noise.yaml").exists()


def test_a_config_comes_on_stdin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = EXPERIMENT_FILES["merwe2000"].read_text()
    copy_experiment("merwe2000", tmp_path)

    def piped(text: str, *words: str) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=BytesIO(text.encode())))
        readable_files.text_of_stdin.cache_clear()  # a program has it once
        return trackbench(*words, cwd=tmp_path)

    few = ("--runs", "2", "--set", "block=fit", "--only", "UKF", *BARE)
    command = [sys.executable, "-m", "trackbench", "run", "-", *few]
    found = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, input=config, capture_output=True, text=True, cwd=tmp_path, env=found, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "results" / "merwe2000" / "manifest.json").is_file()
    swept = piped(config, "sweep", "-", *few, "--grid", "filters.UKF.Q=0.5,1")
    assert swept.returncode == 0, swept.stderr
    wrong = piped(config + "bogus: 1\n", "run", "-")
    assert wrong.returncode == 2
    assert wrong.stderr.startswith(f"stdin:{config.count(chr(10)) + 1}:1: bogus: unknown key")
    assert piped("", "check", "-").stderr == "stdin:1:1: is empty\n"
    assert "has more than 1 MB" in piped("#" * 1_000_001, "check", "-").stderr


def test_estimates_show_the_component_that_their_title_names() -> None:
    """Components are counted from 1."""
    checked = 0
    for path in sorted((ROOT / "results").glob("*/config.yaml")):
        results = Results(path.parent)
        config = results.config
        for figure in results.figure_configs.values():
            if figure["kind"] != "estimates":
                continue
            facts = results.facts(results.points()[0])
            name = facts.components[figure["component"] - 1]
            title = figure["title"]
            if title.startswith("The component "):
                assert title == f"The component {name}", path
                checked += 1
            if title == "A component that is not measured":
                assert name not in config["scenario"]["sensor"]["h"].values(), path
                checked += 1
    assert checked > 5


def test_a_folder_is_no_config(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    done = trackbench("check", "mine", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "mine: is a folder; name a file in YAML, or an experiment of `trackbench list`\n"
    )


def test_a_folder_with_a_files_name_is_no_config_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "conf.yaml").mkdir()
    expected = {
        ("check", "."): "name a file in YAML, or an experiment of `trackbench list`",
        ("new", "experiment", "--from", "."): "name a file with a table",
        ("new", "experiment", "--from", "conf.yaml"): "name one of its files: a.csv",
    }
    (tmp_path / "conf.yaml" / "a.csv").touch()
    for words, text in expected.items():
        done = trackbench(*words, cwd=tmp_path)
        assert done.returncode == 2
        assert done.stderr == f"{words[-1]}:1:1: is a folder; {text}\n"


def test_an_empty_out_is_not_this_folder(tmp_path: Path) -> None:
    """As that of a variable of the shell that is not set."""
    done = trackbench("run", "nile", "--out", "", cwd=tmp_path)
    assert done.returncode == 2
    assert "Invalid value for '--out': is empty; for this folder write ." in done.stderr
    assert not [*tmp_path.iterdir()]
