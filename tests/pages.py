"""The commands, configs and programs of a page, run in a folder of their own, with few runs.

What would take long is only validated (`LONG`), and what cannot be run here, such as a cluster's address
or a word that stands for another, is only held to the commands and options that there are (`known`).
"""

import glob
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import CodeType
from typing import Any

import pytest
import typer
import yaml

from docs.site.blocks import Block, blocks
from tests.conftest import ROOT
from trackbench import api
from trackbench.__main__ import main
from trackbench.commands import expected_time, run_experiment
from trackbench.config.experiment_keys import Settings
from trackbench.config.load import load
from trackbench.config.suite import load_suite
from trackbench.contract import problems as contract_problems
from trackbench.errors import UserError
from trackbench.scenarios.tracking import Tracking
from trackbench.yaml_source import parse

RUNS = 6
BARE = ("figures={}", "key_figure=null")
"""Draws nothing, which takes longest."""
LONG = {
    "experiments/banana/*.yaml": "every experiment",
    "adaptive-kf-tuned": "tunes eight filters",
    "sweep hdepf": "13 filters at each of 12 points",
    "sweep experiments/hdepf/hdepf.yaml": "13 filters at each of 15 points",
    "solent_ais.yaml": "an hour of radio",
    "tune c.yaml": "three filters, 1700 steps",
    "experiments/beyond/ais.yaml": "an hour of radio",
    "experiments/beyond/uav-radar.yaml": "900 steps of seven filters",
    "trackbench suite": "filters on 42 problems",
    "run robot.yaml": "runs in test_robot_page.py",
    "run turn.yaml --all ": "tunes three filters; runs in test_short_pages.py",
}
"""What is validated and not run, and why."""
_DONE: set[str] = set()
"""Experiments that were run by their names: again, for another page, they are validated."""
ELSEWHERE = ("jax", "dynamax")
_NOWHERE = re.compile(
    r"\.\.\.|--watch|--against-ref|--\w+-completion|tcp://|\bCONFIG\b|\bDIR\b|\bNAME\b|\bKIND\b"
)
_DATA = {
    "m.csv": "run,time,x,y\n" + "".join(f"1,{k * 2},{k * 20},{k * 5}\n" for k in range(12)),
    "reference.csv": "run,time,px,py\n"
    + "".join(f"1,{k * 2},{k * 20},{k * 5}\n" for k in range(12)),
    "radar.csv": "run,step,range,azimuth\n"
    + "".join(f"1,{k},{1 + k / 50},{k}\n" for k in range(12)),
    "gps.csv": "run,step,x,y\n" + "".join(f"1,{k},{1000 + k * 20},{k * 5}\n" for k in range(12)),
    # Two clocks: UNIX times in ms and dates, of one drive.
    "radar_log.csv": "time_unix_ms;range_m;azimuth_deg\n"
    + "".join(f"{1715679062370 + 1000 * k};{700 + 10 * k};{45 + k % 3}\n" for k in range(12)),
    "gps_logger.csv": "Timestamp (UTC),Latitude,Longitude\n"
    + "".join(
        f"2024-05-14T09:31:{3 + k:02}.000Z,{48.2696 + 6e-5 * k:.7f},{11.6756 + 1e-4 * k:.7f}\n"
        for k in range(12)
    ),
}


@contextmanager
def quickly(*keys: str) -> Iterator[None]:
    """Let every run have few runs, in this process, with these keys, such as `BARE`.

    No CPU time is measured, as with ``--quick``, a dry run tries no filter to estimate its time, and
    `check --contract --on` takes half of its steps.
    """
    original = run_experiment.run_each

    def run_each(configs: Any, options: Any, *more: Any, **other: Any) -> Any:
        of_files = any("measured" in str(config) for config in configs)
        of_files = of_files or any(map(_is_of_recording, configs))
        recorded = of_files or options.measurements is not None
        few = replace(options, set=("block=fit", *keys, *options.set))
        few = replace(few, runs=None if recorded else RUNS)
        few = replace(few, engine="serial", workers=1, formats=(), times=False)
        yield from original(configs, few, *more, **other)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(expected_time, "_MOST_TRIED_FILTERS", 0)
        patch.setattr(contract_problems, "_MOST_STEPS", 15)
        for module in (run_experiment, api):
            patch.setattr(module, "run_each", run_each)
        yield


def _is_of_recording(config: Any) -> bool:
    """Whether a config's file says that its data are recorded."""
    path = Path(str(config)[:200])
    return path.is_file() and "kind: measured" in path.read_text()


class Sandbox:
    """A folder in which a page is followed from its top to its end."""

    def __init__(self, folder: Path, stored: Path, page: str) -> None:
        self.folder = folder
        self.base = TURN
        self.names: dict[str, Any] = {"__name__": "__main__"}
        (folder / "experiments").symlink_to(ROOT / "experiments")
        shutil.copytree(stored, folder / "results")
        for place, text in _DATA.items():
            (folder / place).write_text(text)
        (folder / "data").mkdir()
        (folder / "data" / "measurements.csv").write_text(_DATA["m.csv"])
        (folder / "data" / "truth.csv").write_text(_DATA["reference.csv"])
        self.blocks = blocks(page)
        for block in self.blocks:
            if _file(block.title) and "at the end" not in block.title:
                (folder / str(_file(block.title))).write_text(block.text)

    def follow(self, block: Block) -> None:
        """Do what a block says."""
        file = _file(block.title)
        if file is not None and "at the end" in block.title:
            with (self.folder / file).open("a") as out:
                out.write(block.text)
        if block.language == "sh":
            for command in block.commands:
                for one in command.split(" && "):
                    self.command(one)
        elif block.language == "yaml":
            self.config(block.text, file)
        elif block.language == "python":
            program = compile(block.text, block.title or "page", "exec")
            if not block.title:
                with quickly(*(BARE if "report" in self.names else [])):
                    _run(program, self.names)

    def command(self, line: str) -> None:
        """Run a command, or hold it to what there is."""
        words = shlex.split(line.partition(" > ")[0], comments=True)
        if words[0] == "cc":
            if shutil.which("cc") is None:
                pytest.skip("no C compiler is here")
            subprocess.run(words, check=True)
            return
        if words[0] != "trackbench" or _NOWHERE.search(line):
            known(words)
            return
        for path in [w for w in words if w.endswith(".yaml") and not glob.glob(w)]:
            Path(path).write_text(self.base)
        name = " ".join(words[1:3])
        if "--filter" in words:
            # It has results of its own.
            name = " ".join(words[1:])
        # A space ends the last word, so that `--all` is not the begin of another option.
        long = name in _DONE or any(what in f"{line} " for what in LONG)
        if words[1] == "run" and not words[2].endswith(".yaml"):
            _DONE.add(name)
        words = [path for word in words for path in (sorted(glob.glob(word))[:2] or [word])]
        if words[1] == "verify":
            assert name in _DONE or _exit_code(words) == 0, line
            _DONE.add(name)
            return
        with quickly(*BARE):
            words += ["--dry-run"] if long else []
            words += ["--only", "HDEPF"] if long and words[1] == "sweep" else []
            if words[1:4] == [
                "plot",
                "results/hdepf",
                "--style",
            ]:  # one figure has it as well as six
                words += ["--only", "figure2"]
            assert _exit_code(words) == 0, line

    def config(self, text: str, file: str | None) -> None:
        """Validate a config, or a part of one in a whole; a suite with its problems."""
        part = parse(text, "page").data
        if "groups" in part:
            assert file is not None
            load_suite(Path(file))
            return
        problems = []
        for base in (self.base, TURN, TUNED, MERWE):
            data = _whole(part, parse(base, "base").data)
            try:
                load(data, allow_plugins=True)
                break
            except UserError as error:
                problems.append(error)
        else:
            raise problems[0]
        if {"scenario", "tune"} & part.keys():
            self.base = yaml.safe_dump(data)


TURN = next(
    block.text
    for block in blocks((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))
    if block.title == "turn.yaml"
)


MERWE = """
name: c
scenario: experiments/hdepf/scenarios/merwe.yaml
filters: {PF: {kind: pf}, HDEPF: {kind: hdepf}, Exact: {kind: grid}}
"""
TUNED = """
name: c
runs: 4
scenario: experiments/adaptive-kf/scenarios/maneuver.yaml
filters:
  KF: {kind: kf, assume: {motion: {kind: cv, q: 0.1}}}
  Adaptive: experiments/adaptive-kf/filters/adaptive-eta20.yaml
  EKF: {kind: ekf}
"""


def _whole(part: dict[str, Any], base: dict[str, Any]) -> dict[str, Any]:
    """A whole config of which the part is one: keys of the top level, or of the scenario."""
    if {"scenario", "filters"} <= part.keys():
        if "name" in part:
            return part
        # Changes of the whole config: some keys of its scenario, and further filters.
        return base | part | {key: base[key] | part[key] for key in ("scenario", "filters")}
    unrelated = ["tables", "figures", "published"]
    if "(tuned)" not in str(part) and "published" not in part:
        unrelated.append("tune")
    whole = {k: v for k, v in base.items() if k not in unrelated}
    if "scenario" in part and "filters" not in part and len(part) == 1:
        return whole | part | {"filters": {"UKF": {"kind": "ukf"}}, "runs": 1}
    fields = set(Tracking.__dataclass_fields__)
    inner = {key: value for key, value in part.items() if key in fields}
    top = {key: value for key, value in part.items() if key not in fields}
    assert top.keys() <= Settings.__dataclass_fields__.keys(), top
    if inner.get("target", {}).get("kind") == "measured":
        sensor = inner.get("sensor", {"kind": "position", "sigma": 5})
        start = {"kind": "one-scan", "sigma_velocity": 10}
        assume = {"motion": {"kind": "cwna", "q": 1}}
        whole["scenario"] = {"kind": "tracking", "sensor": sensor, "start": start, "assume": assume}
        whole |= {"filters": {"UKF": {"kind": "ukf"}}, "runs": 1}
        whole["scenario"] |= {"T": 2} if isinstance(sensor, list) else {}
    scenario = {"scenario": whole["scenario"] | inner} if inner else {}
    return whole | top | scenario


def known(words: list[str]) -> None:
    """Hold a command that is not run to what there is: commands, options, targets, extras, files."""
    if words[0] == "make":
        assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE), words
    elif words[0] == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        for extra in re.findall(r"\.\[(\w+)\]", " ".join(words)):
            assert extra in extras["optional-dependencies"], words
        for after, file in pairwise(words):
            assert after != "-r" or (ROOT / file).is_file(), words
    elif words[0] == "trackbench" and not words[1].startswith("--"):
        from trackbench.cli.app import app

        command = typer.main.get_command(app).commands[words[1]]
        there = {option for param in command.params for option in param.opts}
        assert {word for word in words if word.startswith("--")} <= there, words


def _run(program: CodeType, names: dict[str, Any]) -> None:
    """Run what a page shows; what takes a library that is not among the tests' is compiled alone."""
    try:
        exec(program, names)
    except ModuleNotFoundError as error:
        if error.name not in ELSEWHERE:
            raise


def _exit_code(words: list[str]) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", words)
        try:
            main()
        except SystemExit as done:
            return int(done.code or 0)
    return 0


def _file(title: str) -> str | None:
    """The file that a block's title names."""
    found = re.match(r"[\w-]+\.(yaml|csv|py|c)\b", title)
    return found[0] if found else None
