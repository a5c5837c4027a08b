"""The manifest is written last and vouches for every file; what an earlier run left goes first."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.papers import merwe_text
from tests.report.forging import edit
from trackbench import api
from trackbench.errors import RunError, UserError
from trackbench.report.folder_check import _damage_lines, changed_files, open_results
from trackbench.results import write_folder
from trackbench.results.manifest import read_manifest
from trackbench.results.missing_and_changed_files import Damage
from trackbench.verify.verify_folder import verify

CONFIG = """
name: kept
runs: 12
verdict_seeds: 1
scenario: MERWE
filters: {PF: {kind: pf, N: 9}, UKF: {kind: ukf}}
published: [claims.csv]
tables: {TABLE: {kind: metrics, columns: {Mean: mean(rmse)}}}
figures: {FIGURE: {kind: rmse-vs-time}}
""".replace("MERWE", merwe_text(T=6))
CLAIMS = "paper,claim,experiment,left,expression,relation,factor\np,PF errs,,PF,mean(rmse),>,0\n"
OWN = (
    "notes.txt",
    "tables/own.csv",
    "figures/own.svg",
    "published/own.csv",
    "figures/sweep-own.svg",
)


def write(home: Path, table: str = "t", figure: str = "f", text: str = CONFIG) -> Path:
    (home / "claims.csv").write_text(CLAIMS)
    (home / "c.yaml").write_text(text.replace("TABLE", table).replace("FIGURE", figure))
    return home / "c.yaml"


def run(config: Path, formats: tuple[str, ...] = ("svg",), **changes: object) -> Path:
    options = api.Options(engine="serial", quiet=True, out=config.parent / "out", formats=formats)
    return api.run(config, options, **changes).folder


def files(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


def manifest(folder: Path) -> dict[str, object]:
    return read_manifest(folder)


MANIFESTS = {"manifest.json", "run/machine.json"}


def whole(folder: Path) -> bool:
    """Every file is in the manifest with its digest."""
    digests = {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest()
        for name in files(folder) - MANIFESTS
    }
    return manifest(folder)["files"] == digests


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return run(write(tmp_path))


def test_the_manifest_is_the_last_file_and_has_all_others(folder: Path) -> None:
    assert whole(folder)
    times = {name: (folder / name).stat().st_mtime_ns for name in files(folder)}
    assert max(times, key=lambda name: times[name]) == "manifest.json"
    assert {"report.html", "claims.csv", "paired.csv", "tables/t.md", "figures/f.svg"} < set(times)


def test_that_of_a_sweep_has_its_files_too(tmp_path: Path) -> None:
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out", formats=("svg",))
    swept = api.sweep(write(tmp_path), options, grid=("filters.PF.N=5,7",)).folder
    assert whole(swept)
    assert {"sweep.csv", "figures/sweep-PF-N.svg"} < set(manifest(swept)["files"])
    run(tmp_path / "c.yaml")
    assert not files(swept) & {"sweep.csv", "figures/sweep-PF-N.svg"}
    assert whole(swept)


@pytest.mark.parametrize("where", ["write_figures", "write_manifest"])
def test_a_killed_run_leaves_nothing_of_the_one_before(folder: Path, where: str) -> None:
    run(folder.parent / "c.yaml", formats=("png", "svg", "tex"), save_tracks=True)
    for name in OWN:
        (folder / name).write_text("mine")
    before = files(folder)
    config = write(folder.parent, "another", "new")
    module = "report.render" if where == "write_figures" else "commands.run_experiment"
    kill = (
        f"import os, signal, trackbench.{module} as m\n"
        f"m.{where} = lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL)\n"
        "from trackbench.cli.app import main; main()"
    )
    command = [sys.executable, "-c", kill, "run", config, "--workers", "1", "--out", folder]
    done = subprocess.run([*command, "--seed", "5"])
    assert done.returncode == -9
    left = files(folder)
    assert not left & {"tables/t.csv", "tables/t.tex", "tracks.npz"}
    assert not left & {"figures/f.svg", "figures/f.png"}
    assert set(OWN) < before & left
    # The manifest of the data is written before anything follows from them.
    assert ("manifest.json" in left) == (where != "write_manifest")
    if "manifest.json" in left:
        assert manifest(folder)["files"].keys() >= {"per_run.csv", "summary.csv", "config.yaml"}
        assert not [name for name in manifest(folder)["files"] if name.startswith(("t", "f"))]
        assert trackbench("report", folder).returncode == 0
        assert (folder / "report.html").is_file()
        return
    for command in ("compare", "plot", "report", "verify"):
        done = trackbench(command, folder)
        assert done.returncode == (1 if command == "verify" else 2)
        lines = (done.stdout + done.stderr).splitlines()
        assert lines[-1].strip() == (
            f"{folder}: is half-written, it has no manifest.json: run the experiment again"
        )
    run(config)
    assert files(folder) - set(OWN) == set(manifest(folder)["files"]) | MANIFESTS
    assert all((folder / name).read_text() == "mine" for name in OWN)
    assert verify(folder, 2) == []


def test_a_run_without_tracks_takes_older_ones_away(tmp_path: Path) -> None:
    folder = run(write(tmp_path), save_tracks=True)
    assert (folder / "tracks.npz").is_file()
    shutil.copy(folder / "per_run.csv", folder / "per_run.csv.xz")
    run(tmp_path / "c.yaml")
    assert not (folder / "tracks.npz").exists()
    assert not (folder / "per_run.csv.xz").exists()


def test_the_config_of_the_folder_is_there_at_any_time(folder: Path, monkeypatch) -> None:
    """It may be the only copy of what is being run, and so may the published numbers."""

    def killed(*_: object) -> None:
        raise SystemExit

    monkeypatch.setattr(write_folder, "write_text", killed)
    with pytest.raises(SystemExit):
        run(folder / "config.yaml", out=folder)
    assert files(folder) == {"config.yaml", "published/claims.csv"}


def test_a_folder_of_an_older_version_is_read_and_replaced(folder: Path) -> None:
    raw = {
        n: d for n, d in manifest(folder)["files"].items() if n in ("per_run.csv", "summary.csv")
    }
    content = manifest(folder) | {"format": 1, "files": raw}
    (folder / "run" / "timing.csv").rename(folder / "timing.csv")
    shutil.rmtree(folder / "run")
    (folder / "manifest.json").write_text(json.dumps(content))
    assert verify(folder, 2) == []
    api.plot(folder, ["svg"])
    assert set(manifest(folder)["files"]) == {*raw, "figures/f.svg"}
    (folder / "manifest.json").write_text(json.dumps(content))
    run(write(folder.parent, "other", "new"))
    assert not files(folder) & {"tables/t.csv", "tables/t.md", "figures/f.svg", "timing.csv"}


def test_the_manifest_follows_what_is_written_again(folder: Path) -> None:
    api.plot(folder, ["png", "svg"])
    assert "figures/f.png" in manifest(folder)["files"]
    before = (folder / "manifest.json").read_bytes()
    for command in (api.compare, api.report, api.plot):
        command(folder)
        assert whole(folder)
        assert (folder / "manifest.json").read_bytes() == before
    edit(folder, "config.yaml", "title: ''", "title: T")
    for command in (api.plot, api.compare, api.report):
        command(folder)
        assert whole(folder)
    assert verify(folder, 2) == []


def test_published_numbers_are_taken_over_by_compare(folder: Path, capsys) -> None:
    path = folder / "published" / "claims.csv"
    path.write_text(path.read_text().replace(",>,", ",<,"))
    line = f"{folder}: published/claims.csv was changed after the run: run the experiment again"
    assert line in verify(folder, 1)
    assert api.compare(folder).claims[0].verdict.z < -3.0
    assert capsys.readouterr().err == f"note: {line}\n"
    assert whole(folder)
    assert verify(folder, 1) == []


@pytest.mark.parametrize(
    ("names", "what"),
    [
        (["config.yaml"], "config.yaml was changed"),
        (["tables/t.md", "paired.csv"], "paired.csv, tables/t.md were changed"),
        (["claims.csv", "comparison.md", "paired.csv", "report.html"], " and 1 more were changed"),
    ],
)
def test_a_changed_file_is_said_and_stays_said(folder, capsys, names, what) -> None:
    for name in names:
        with (folder / name).open("a") as file:
            file.write("\n")
    for command in (lambda: api.plot(folder, ["svg"]), lambda: verify(folder, 1)):
        found = command()
        lines = capsys.readouterr().err.splitlines() or found
        assert f"{what} after the run: run the experiment again" in lines[0]
    assert changed_files(open_results(folder))
    (folder / "tables" / "t.csv").unlink()
    api.report(folder.parent)
    assert f"note: {folder}: tables/t.csv is missing: run" in capsys.readouterr().err


def test_a_missing_file_is_said_unless_git_leaves_it_out(tmp_path: Path, capsys) -> None:
    folder = run(write(tmp_path), formats=("png", "svg"), save_tracks=True)
    (folder / "figures" / "f.png").unlink()
    (folder / "tracks.npz").unlink()
    assert verify(folder, 1) == []
    (folder / "figures" / "f.svg").unlink()
    assert verify(folder, 1) == [f"{folder}: figures/f.svg is missing: run the experiment again"]
    api.plot(folder, ["svg"])
    assert "figures/f.svg is missing" in capsys.readouterr().err
    assert verify(folder, 1) == []


def test_a_figure_that_fails_leaves_the_manifest_true(folder: Path, monkeypatch) -> None:
    from trackbench.report import table_and_figure_files

    def broken(*_: object, **__: object) -> None:
        raise OSError("no space left on device")

    edit(folder, "config.yaml", "figures:", "figures:\n  a: {kind: bars}")
    real, drawn = table_and_figure_files.write_bytes, []

    def second(path: Path, content: bytes) -> None:
        drawn.append(path)
        (real if len(drawn) == 1 else broken)(path, content)

    monkeypatch.setattr(table_and_figure_files, "write_bytes", second)
    with pytest.raises(RunError, match="no space"):
        api.plot(folder, ["svg"])
    assert changed_files(open_results(folder)) == []


@pytest.mark.skipif(
    sys.platform == "win32" or getattr(os, "geteuid", int)() == 0, reason="every file can be read"
)
def test_a_file_that_may_not_be_read_is_not_called_changed(tmp_path: Path) -> None:
    folder = run(write(tmp_path))
    (folder / "summary.csv").chmod(0)
    with pytest.raises(UserError) as caught:
        open_results(folder)
    assert str(caught.value) == f"{folder}: summary.csv cannot be read: permission denied"


def test_damage_has_the_reason_why_a_file_cannot_be_read(tmp_path: Path) -> None:
    folder = run(write(tmp_path))
    damage = Damage(missing=[], changed=["a.csv"], unreadable={"b.csv": "permission denied"})
    assert _damage_lines(folder, damage) == [
        f"{folder}: b.csv cannot be read: permission denied",
        f"{folder}: a.csv was changed after the run: run the experiment again",
    ]
