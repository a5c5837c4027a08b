"""Every command on a damaged or forged results folder ends with 0, 1 or 2 and plain lines."""

import json
import random
import re
import shutil
import warnings
from collections.abc import Callable
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from tests.conftest import PLANE
from tests.report.forging import reseal
from trackbench import api
from trackbench.errors import RunError, UserError

CONFIG = f"""name: small
runs: 4
{PLANE}
filters: {{PF: {{kind: pf, N: 20}}, UKF: {{kind: ukf}}}}
tune: {{UKF: {{kappa: -1..2}}}}
tuning: {{evaluations: 2, runs: 20}}
published: [p.csv, q.csv]
tables: {{t: {{kind: metrics, columns: {{a: rms(rmse_position)}}}}}}
figures: {{f: {{kind: estimates, run: 2}}}}
"""
NUMBERS = "paper,table,filter,metric,value,label,expression\np,t,f,m,1,PF,rms(rmse_position)\n"
CLAIMS = "paper,claim,left,expression,right\np,c,PF,rms(rmse_position),UKF\n"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("damaged")
    for name, text in {"c.yaml": CONFIG, "p.csv": NUMBERS, "q.csv": CLAIMS}.items():
        (home / name).write_text(text)
    options = api.Options(engine="serial", quiet=True, formats=("svg",))
    return api.run(home / "c.yaml", options, out=home / "out").folder


def load(folder: Path) -> None:
    """Read all that Python code may ask of a results folder."""
    with suppress(UserError, RunError):
        results = api.load(folder).results
        for point in results.points():
            for ask in (results.runs, results.tracks, results.facts, results.steps):
                ask(point)
        for name in ("per_run", "per_step", "summary", "timing", "shown", "tuning", "published"):
            getattr(results, name)


def said(*words: object) -> None:
    """Run a command and look at how it ends."""
    done = trackbench(*words)
    assert done.returncode in (0, 1, 2), done
    for text in ("Traceback", "Aborted", "Warning"):
        assert text not in done.stdout + done.stderr
    assert not done.returncode or done.stderr.strip() or "changed" in done.stdout


COMMANDS: dict[str, Callable[[Path], None]] = {
    "report": lambda folder: said("report", folder),
    "plot": lambda folder: said("plot", folder, "--format", "svg"),
    "compare": lambda folder: said("compare", folder, "--json"),
    "overview": lambda folder: said("report", folder.parent),
    "load": load,
    "verify": lambda folder: said("verify", folder, "--runs", 1),
    "run": lambda folder: said(
        *("run", folder / "config.yaml", "--out", folder, "--engine", "serial", "--format", "svg")
    ),
}


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def scrambled(path: Path) -> None:
    path.write_bytes(random.Random(1).randbytes(300))


def nested(path: Path) -> None:
    path.write_text("[" * 100_000)


def folder_instead(path: Path) -> None:
    path.unlink()
    path.mkdir()


def link_to_itself(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


FILES = (
    *("config.yaml", "manifest.json", "points.json", "per_run.csv", "per_step.csv", "summary.csv"),
    *(
        "run/machine.json",
        "run/timing.csv",
        "shown.npz",
        "tuning.csv",
        "published/p.csv",
        "figures/f.svg",
        "tables/t.csv",
    ),
)
WHOLE = [
    (name, damage, command)
    for (name, damage), command in zip(
        [
            (n, d)
            for n in FILES
            for d in (emptied, cut, scrambled, nested, folder_instead, link_to_itself)
        ],
        cycle(["report", "load", "plot", "overview", "compare", "load"]),
        strict=False,
    )
]


@pytest.mark.parametrize(("name", "damage", "command"), WHOLE)
def test_a_damaged_file(
    small: Path, tmp_path: Path, name: str, damage: Callable[[Path], None], command: str
) -> None:
    folder = shutil.copytree(small, tmp_path / "out")
    damage(folder / name)
    if not name.endswith(("manifest.json", "machine.json")):
        reseal(folder)
    COMMANDS[command](folder)


def leaf(*keys: Any, value: Any) -> Callable[[Path], None]:
    """Another value at a place of a JSON or YAML file."""

    def put(path: Path) -> None:
        data = yaml.safe_load(path.read_text())
        *outer, last = keys
        at = data
        for key in outer:
            at = at[key]
        at[last] = value
        path.write_text(json.dumps(data) if path.suffix == ".json" else yaml.safe_dump(data))

    return put


def text(old: str, new: str) -> Callable[[Path], None]:
    """Other words in a file, at the first place that matches."""

    def put(path: Path) -> None:
        found, number = re.subn(old, new, path.read_text(), count=1)
        assert number
        path.write_text(found)

    return put


def array(name: str, value: Any) -> Callable[[Path], None]:
    """Another array in shown.npz."""

    def put(path: Path) -> None:
        with np.load(path) as arrays:
            np.savez(path, **{**arrays, name: value})

    return put


FORGED: list[tuple[str, Callable[[Path], None], str]] = [
    ("manifest.json", leaf("files", value=3), "report"),
    ("manifest.json", leaf("failed", value=[{}]), "report"),
    ("manifest.json", leaf("steps", value=float("nan")), "report"),
    ("manifest.json", leaf("cpu_s", value=10**400), "report"),
    ("run/machine.json", leaf("packages", value=[]), "report"),
    ("run/machine.json", leaf("files", value=[]), "plot"),
    ("run/machine.json", leaf("runs", value="x"), "report"),
    ("run/machine.json", leaf("date", value=20261128), "report"),
    ("run/machine.json", leaf("commit", value=["x"]), "report"),
    ("run/machine.json", leaf("python", value={}), "report"),
    ("manifest.json", leaf("files", "../../own", value=[]), "run"),
    ("points.json", leaf(0, "spans", value=[["x"]]), "report"),
    ("points.json", leaf(0, value=[1]), "load"),
    ("config.yaml", leaf("scenario", value=None), "report"),
    ("config.yaml", leaf("runs", value=10**15), "verify"),
    ("config.yaml", leaf("tune", "UKF", "kappa", value="0..1"), "report"),
    ("config.yaml", leaf("figures", "f", "run", value=3), "plot"),
    ("config.yaml", leaf("published", value=["../../x"]), "compare"),
    ("per_run.csv", text(",metric", ",metrik"), "report"),
    ("per_run.csv", text(r"(,rmse_position),[0-9.]+", r"\1,x"), "load"),
    ("per_run.csv", text(r"(.*,rmse_position,.*\n)", ""), "report"),
    ("per_run.csv", text(r"(,rmse_position),[0-9.]+", r"\1,1e308"), "report"),
    ("per_step.csv", text(r"(UKF,[0-9]+),", r"\1.5,"), "load"),
    ("per_step.csv", text(r"(UKF,[0-9]+),", r"\g<1>,,"), "verify"),
    ("summary.csv", text(",stderr", ""), "report"),
    ("summary.csv", text(r"(mean\(rmse_position\)),[^,]+", r"\1,nan"), "report"),
    ("run/timing.csv", text("\n.*", ""), "report"),
    ("run/timing.csv", text(",cpu_s,", ",cpu,"), "verify"),
    ("tuning.csv", text("kappa", "alpha"), "report"),
    ("tuning.csv", text("kappa,[^,]+,", "kappa,=1,"), "load"),
    ("published/p.csv", text("rms", "rns"), "compare"),
    ("published/p.csv", text(",1,", ",=1,"), "report"),
    ("shown.npz", array("truth", np.array(1.0)), "plot"),
    ("shown.npz", array("mean/PF", np.array([["x"]])), "plot"),
    ("shown.npz", array("mean/PF", np.array([None])), "load"),
    ("figures/f.svg", text("<svg", "<html"), "report"),
    ("figures/f.svg", text(r' d="[^"]*"( clip-path=)', r' d="M1"\1'), "overview"),
    ("figures/f.svg", text("(?s)<g .*</g>", "<g>" * 2000 + "</g>" * 2000), "report"),
    ("figures/f.svg", text("(?s)<g .*</g>", "<g>" * 2000 + "</g>" * 2000), "overview"),
]


@pytest.mark.parametrize(("name", "forge", "command"), FORGED)
def test_a_forged_file(
    small: Path, tmp_path: Path, name: str, forge: Callable[[Path], None], command: str
) -> None:
    folder = shutil.copytree(small, tmp_path / "out")
    forge(folder / name)
    if not name.endswith(("manifest.json", "machine.json")):
        reseal(folder)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        COMMANDS[command](folder)


def test_a_line_names_the_file(small: Path, tmp_path: Path) -> None:
    """And what is wrong in it; where more than one file is to blame, the place in the program."""
    folder = shutil.copytree(small, tmp_path / "out")
    text(",stderr", ",error")(folder / "per_step.csv")
    reseal(folder)
    with pytest.raises(
        UserError, match=r"per_step\.csv: cannot be read, .*no column 'stderr': run"
    ):
        _ = api.load(folder).per_step
    array("truth", np.array(1.0))(folder / "shown.npz")
    reseal(folder)
    with pytest.raises(
        RunError, match=r"figure f failed: estimates_of_one_run\.py:\d+: IndexError"
    ):
        api.plot(folder, ["svg"])
